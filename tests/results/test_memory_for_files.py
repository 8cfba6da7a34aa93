"""Files that ask for more memory than they fill are refused before any is taken."""

from __future__ import annotations

import json
import shutil
import tracemalloc
import zipfile

import numpy as np
import pytest
from saved_files import npy, plain_run, saved, whole_members, zipped
from scenes import henon_heiles

import varint as vi
from varint.numerics import archive, limits

HUGE = ["(100000000000, 2)", "(10**40,)", f"({10**40},)", "(-1,)", "(-3, -2)", "(1.5,)", "(True,)"]


@pytest.mark.parametrize("shape", HUGE)
def test_huge_and_impossible_shapes_are_refused_before_memory_is_asked_for(tmp_path, shape):
    members = whole_members(tmp_path)
    path = zipped(tmp_path / "huge.npz", members | {"q.npy": npy(shape, data=bytes(96))})
    vi.load(zipped(tmp_path / "small.npz", members))  # modules that are loaded then are none of it
    tracemalloc.start()
    with pytest.raises(vi.InputError):
        vi.load(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4e6


@pytest.mark.parametrize("field", ["file_size", "compress_size"])
@pytest.mark.parametrize("name", ["q.npy", "header.npy"])
def test_an_archive_that_declares_more_than_it_can_hold_is_refused(tmp_path, name, field):
    """The central directory says that a member of some bytes unpacks to 3 GB."""
    path = zipped(tmp_path / "a.npz", whole_members(tmp_path), compression=zipfile.ZIP_DEFLATED)
    whole = bytearray(path.read_bytes())
    at = whole.rindex(name.encode()) - 46
    assert whole[at : at + 4] == b"PK\x01\x02"
    place = at + (24 if field == "file_size" else 20)
    whole[place : place + 4] = (3 * 10**9).to_bytes(4, "little")
    path.write_bytes(bytes(whole))
    tracemalloc.start()
    with pytest.raises(vi.InputError):
        vi.load(path)
    assert tracemalloc.get_traced_memory()[1] < 4e6
    tracemalloc.stop()


def test_what_this_machine_has_no_memory_for_is_refused(tmp_path, monkeypatch):
    path = saved(tmp_path, plain_run(steps=20_000, backend="interpreted"))
    monkeypatch.setattr(limits, "_memory", lambda: 500_000)
    with pytest.raises(vi.InputError, match="more than this machine's memory"):
        vi.load(path)


def test_a_header_that_would_not_be_read_again_is_not_written(tmp_path, monkeypatch):
    path = saved(tmp_path, plain_run())
    before = path.read_bytes()
    monkeypatch.setattr(archive, "MOST_HEADER", 500)
    with pytest.raises(vi.InputError, match="its header is no text of at most 500 letters"):
        plain_run().save(path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_a_zarr_group_of_huge_arrays_without_content_is_refused(tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr", reason="needs the extra: zarr")
    where = tmp_path / "kept.zarr"
    q0 = np.ones((3, 2)) / 9
    vi.ensemble(henon_heiles(), q0=q0, v0=[0, 0], h=0.1, steps=4, store=where)
    for place, shape in (("good", [10**13]), ("q", [3, 10**12, 2]), ("given/q0", [10**13, 2])):
        shutil.copytree(where, tmp_path / "evil.zarr", dirs_exist_ok=True)
        about = tmp_path / "evil.zarr" / place / "zarr.json"
        whole = about.read_text()
        about.write_text(json.dumps(json.loads(whole) | dict(shape=shape)))
        with pytest.raises(vi.InputError):
            vi.load(tmp_path / "evil.zarr")
        about.write_text(whole)
    for text in ("", "[]", "{", 7, None, {"a": 1}):
        zarr.open_group(str(where), mode="a").attrs["varint"] = text
        with pytest.raises(vi.InputError):
            vi.load(where)
