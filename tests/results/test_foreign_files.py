"""Archives that `save` cannot have written are refused, each with an `InputError`."""

from __future__ import annotations

import zipfile

import pytest
from saved_files import npy, parts_of, plain_run, put, saved, whole_members, zipped

import varint as vi


def test_archives_of_other_kinds_are_refused(tmp_path):
    members = whole_members(tmp_path)
    for more in (
        {"q.npy": npy("(6, 2)", "<c16", bytes(192))},
        {"q.npy": npy("(6, 2)", "|O", bytes(96))},
        {"q.npy": npy("(6, 2)", "|V8", bytes(96))},
        {"q.npy": npy("(6, 2)", "<U2", bytes(96))},
        {"q.npy": npy("(6, 2)", data=bytes(96), version=b"\x02\x00")},
        {"q.npy": npy("(6, 2)", data=bytes(97))},
        {"q.npy": npy("(6, 2)", data=bytes(95))},
        {"q.npy": b""},
        {"q.npy": b"\x93NUMPY"},
        {"header.npy": npy("()", "<U3", "{}".encode("utf-32-le") + bytes(4))},
        {"header.npy": npy("()", "<U1", b"\xff\xff\xff\xff")},  # no letter has this number
        {"header.npy": npy("()", "<U0")},
        {"header.npy": npy("(1,)", "<U2", "{}".encode("utf-32-le"))},
        {"header.npy": npy("()", "<f8", bytes(8))},
    ):
        with pytest.raises(vi.InputError):
            vi.load(zipped(tmp_path / "a.npz", members | more))
    with pytest.raises(vi.InputError):
        vi.load(zipped(tmp_path / "a.npz", members, compression=zipfile.ZIP_BZIP2))
    with (
        pytest.warns(UserWarning, match="Duplicate"),
        zipfile.ZipFile(tmp_path / "b.npz", "w") as x,
    ):
        x.writestr("q.npy", members["q.npy"])
        x.writestr("q.npy", members["q.npy"])
    with pytest.raises(vi.InputError):
        vi.load(tmp_path / "b.npz")
    many = {f"a{i}.npy": npy("()", data=bytes(8)) for i in range(10_001)}
    with pytest.raises(vi.InputError, match="arrays"):
        vi.load(zipped(tmp_path / "c.npz", members | many))


@pytest.mark.parametrize(
    "text",
    ["", "7", "[]", "null", "{", "[" * 100_000, '{"format": ' + "9" * 10_000 + "}", '"\\ud800"'],
    ids=range(8),
)
def test_headers_that_are_none_are_refused(tmp_path, text):
    _, arrays = parts_of(saved(tmp_path, plain_run()))
    with pytest.raises(vi.InputError):
        vi.load(put(tmp_path / "a.npz", text, arrays))
