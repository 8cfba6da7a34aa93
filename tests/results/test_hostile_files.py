"""Files that somebody else wrote: nothing in them is executed, and whatever is wrong with them ends
in an `InputError`.
"""

from __future__ import annotations

import io
import json
import random
import shutil
import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, driven_damped, henon_heiles, rocking

import varint as vi
from varint.codegen.cache import compiler
from varint.numerics import limits
from varint.numerics.archive import read_archive

ROOT = Path(__file__).resolve().parents[2]
HARMLESS = (vi.VarintError,)  # what a bad file may raise


def parts_of(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files if name != "header"}
        return json.loads(str(data["header"])), arrays


def put(path: Path, header, arrays) -> Path:
    text = header if isinstance(header, str) else json.dumps(header)
    np.savez(path, header=np.array(text), **arrays)
    return path


def saved(folder: Path, motion: vi.Trajectory) -> Path:
    motion.save(folder / "whole.npz")
    return folder / "whole.npz"


def plain_run(**more) -> vi.Trajectory:
    start = dict(q0=[0.1, 0.2], v0=[0, 0.1], h=0.1, steps=5)
    return vi.simulate(henon_heiles(), **start | more)


# ------------------------------------------------------------------------- what runs programs


def inputs_of(system: vi.System) -> tuple[list[ca.SX], list[ca.SX]]:
    s = system
    outputs = [s.lagrangian, s.force, s.constraint, s.nonholonomic, s.contact]
    return [s.q, s.v, s.t, s.control, s.c], outputs


def shell_function(system: vi.System, marker: Path) -> ca.Function:
    """A function whose compiler is a shell command that leaves a mark wherever it is rebuilt."""
    options = {
        "jit": True,
        "compiler": "shell",
        "jit_options": {"flags": [f"-O0 $(touch {marker})"]},
    }
    return ca.Function("system", *inputs_of(system), options)


def external_function(system: vi.System, marker: Path) -> ca.Function:
    """A function in a library that leaves a mark as it is loaded."""
    folder = marker.parent
    generator = ca.CodeGenerator("hidden.c")
    generator.add(ca.Function("system", *inputs_of(system)))
    source = folder / "hidden.c"
    source.write_text(
        generator.dump()
        + "\n#include <stdio.h>\n__attribute__((constructor)) static void mark(void) "
        + f'{{ FILE *f = fopen("{marker}", "w"); if (f) fclose(f); }}\n'
    )
    line = [*compiler(), "-shared", "-fPIC", "-o", str(folder / "hidden.so"), str(source), "-lm"]
    subprocess.run(line, check=True, capture_output=True)
    return ca.external("system", str(folder / "hidden.so"))


def old_system(system: vi.System, functions: str) -> dict:
    """A system as format 1 had it."""
    inputs, _ = inputs_of(system)
    return {
        "names": [[x[i].name() for i in range(x.numel())] for x in inputs],
        "parameters": {name: value.tolist() for name, value in system.defaults.items()},
        "restitution": system.restitution.tolist(),
        "functions": functions,
    }


OPEN = """
import sys
import varint as vi
from varint.ensembles.executor import work
where, trust = sys.argv[1], sys.argv[2] == "trust"
try:
    motion = vi.load(where, trust=True) if trust else vi.load(where)
    print("opened", len(motion))
except vi.VarintError as error:
    print("refused", error)
"""


def opened(where: Path, trust: bool = False) -> str:
    call = [sys.executable, "-c", OPEN, str(where), "trust" if trust else ""]
    done = subprocess.run(call, capture_output=True, text=True, timeout=120, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(sys.platform == "win32" or compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("make", [shell_function, external_function])
@pytest.mark.parametrize("kind", ["old", "new", "inner", "ensemble", "zarr"])
def test_no_program_in_a_file_is_run(tmp_path, monkeypatch, make, kind):
    if kind == "zarr":
        zarr = pytest.importorskip("zarr", reason="needs the extra: zarr")
    monkeypatch.chdir(tmp_path)  # CasADi compiles where it is
    marker, system = tmp_path / "marker", henon_heiles()
    evil = old_system(system, make(system, marker).serialize())
    assert make is external_function or marker.exists(), "the trap does not work"
    if kind in ("ensemble", "zarr"):
        where = tmp_path / ("kept.zarr" if kind == "zarr" else "kept")
        vi.ensemble(system, q0=np.ones((3, 2)) / 9, v0=[0, 0], h=0.1, steps=4, store=where)
        if kind == "ensemble":
            header, arrays = parts_of(where / "ensemble.npz")
            put(where / "ensemble.npz", header | {"system": evil}, arrays)
        else:
            group = zarr.open_group(str(where), mode="a")
            header = json.loads(group.attrs["varint"])
            group.attrs["varint"] = json.dumps(header | {"system": evil})
    else:
        header, arrays = parts_of(saved(tmp_path, plain_run()))
        if kind == "inner":
            header["fictitious"] = {**header, "system": evil}
            arrays |= {f"fictitious_{name}": x for name, x in arrays.items()}
        else:
            header |= {"system": evil}
        header |= {"format": "varint trajectory 1"} if kind == "old" else {}
        where = put(tmp_path / "evil.npz", header, arrays)
    marker.unlink(missing_ok=True)
    assert "trust=True" in opened(where) and not marker.exists()
    if kind in ("old", "ensemble"):  # the trap is armed: who says so, runs it
        opened(where, trust=True)
        assert marker.exists()


@pytest.mark.parametrize("kind", ["plain", "constraint", "parameters"])
def test_old_files_are_refused_with_what_to_do_and_read_by_those_who_trust_them(tmp_path, kind):
    if kind == "plain":
        motion = plain_run()
    elif kind == "parameters":
        q, v = vi.coordinates("x")
        c = vi.Parameters(a=2.0, b=[1.0, 3.0])
        system = vi.System(q, v, v**2 / 2 - c.a * q**2 - c.b[1] * q**4, params=c)
        motion = vi.simulate(system, q0=1, v0=0, h=0.1, steps=5, params=dict(a=1.5))
    else:
        q, v = vi.coordinates("x", "y")
        system = vi.System(q, v, ca.sumsqr(v) / 2 - q[1], constraint=ca.sumsqr(q) - 1)
        motion = vi.simulate(system, q0=[1, 0], v0=[0, 0], h=0.1, steps=5)
    header, arrays = parts_of(saved(tmp_path, motion))
    function = ca.Function("system", *inputs_of(motion.system))
    header |= {"format": "varint trajectory 1", "sizes": None}
    header["system"] = old_system(motion.system, function.serialize())
    path = put(tmp_path / "old.npz", header, arrays)
    with pytest.raises(vi.InputError, match=r"'varint trajectory 1'.*load\(path, trust=True\)"):
        vi.load(path)
    again = vi.load(path, trust=True)
    assert again.energy.tobytes() == motion.energy.tobytes()
    again.save(tmp_path / "new.npz")
    assert vi.load(tmp_path / "new.npz").v.tobytes() == motion.v.tobytes()


@pytest.mark.parametrize("functions", ["", "nonsense", "jhpnnagiieahaaaadaaaaaaaaa", None, 7, []])
def test_trusted_old_files_with_damaged_functions_end_in_an_error_too(tmp_path, functions):
    header, arrays = parts_of(saved(tmp_path, plain_run()))
    header |= {"format": "varint trajectory 1", "sizes": None}
    header["system"] = old_system(henon_heiles(), functions)
    with pytest.raises(vi.InputError):
        vi.load(put(tmp_path / "old.npz", header, arrays), trust=True)


def test_a_pickle_in_the_place_of_an_array_is_not_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "marker",))

    header, arrays = parts_of(saved(tmp_path, plain_run()))
    trap = np.empty(6, dtype=object)
    trap[:] = [Trap()] * 6
    for name in ("t", "more"):
        put(tmp_path / "evil.npz", header, arrays | {name: trap})
        with pytest.raises(vi.InputError):
            vi.load(tmp_path / "evil.npz")
    assert not (tmp_path / "marker").exists()


# --------------------------------------------------------------------- what asks for memory


def npy(shape: str, dtype: str = "<f8", data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + length + text + data


def zipped(path: Path, members: dict[str, bytes], **kind) -> Path:
    with zipfile.ZipFile(path, "w", **kind) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def whole_members(tmp_path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(saved(tmp_path, plain_run())) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


HUGE = ["(100000000000, 2)", "(10**40,)", f"({10**40},)", "(-1,)", "(-3, -2)", "(1.5,)", "(True,)"]


@pytest.mark.parametrize("shape", HUGE)
def test_huge_and_impossible_shapes_are_refused_before_memory_is_asked_for(tmp_path, shape):
    members = whole_members(tmp_path)
    path = zipped(tmp_path / "huge.npz", members | {"q.npy": npy(shape, data=bytes(96))})
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


# --------------------------------------------------------------------------- whatever else


def with_contacts() -> vi.Trajectory:
    return vi.simulate(rocking(), q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=120)


def with_controls() -> vi.Trajectory:
    return vi.models.rest_to_rest(steps=4).solve()[0]


def with_a_time_scale() -> vi.Trajectory:
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    return vi.simulate(
        kepler, q0=[1, 0], v0=[0, 0.8], h=0.05, steps=8, time_scale=ca.norm_2(q) ** 1.5
    )


def with_events() -> vi.Trajectory:
    system = double_pendulum()
    return vi.simulate(
        system, q0=[1, 0], v0=[0, 0], h=0.05, steps=40, events=dict(down=system.q[0])
    )


def driven() -> vi.Trajectory:
    n = driven_damped().structure.n
    return vi.simulate(driven_damped(), q0=np.ones(n) / 2, v0=np.zeros(n), h=0.05, steps=5)


MOTIONS = [plain_run, with_contacts, with_controls, with_a_time_scale, with_events, driven]
STRANGE = [
    None,
    -1,
    0,
    2**70,
    10**400,
    1.5,
    float("nan"),
    float("inf"),
    "",
    "x",
    "\ud800",
    "0x1p9999",
    [],
    [[]],
    {},
    {"a": 1},
    True,
    [1] * 3,
    "t",
]


def places_of(data, path=()) -> list[tuple]:
    """Where something stands in nested lists and dictionaries."""
    found = [path] if path else []
    children = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    for key, value in children:
        found += places_of(value, (*path, key))
    return found


def mutated(header: dict, moments: random.Random) -> dict:
    """The header with something replaced, removed or doubled somewhere."""
    header = json.loads(json.dumps(header))
    for _ in range(moments.randint(1, 2)):
        *way, last = moments.choice(places_of(header))
        at = header
        for key in way:
            at = at[key]
        kind = moments.random()
        if kind < 0.2:
            del at[last]
        elif kind < 0.3 and isinstance(at, list):
            at.insert(last, at[last])
        elif kind < 0.5 and isinstance(at[last], (int, float)):
            at[last] = at[last] + moments.choice([-1, 1, 7])
        else:
            at[last] = moments.choice(STRANGE)
    return header


def used(motion: vi.Trajectory) -> None:
    """What one does with a trajectory; the numbers may be anything."""
    with np.errstate(all="ignore"):
        _ = repr(motion), motion.parameters, motion.v, motion.energy


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_headers_with_anything_in_them_open_or_are_refused(tmp_path, make):
    header, arrays = parts_of(saved(tmp_path, make()))
    moments, refused = random.Random(14), 0
    for _ in range(100):
        path = put(tmp_path / "a.npz", mutated(header, moments), arrays)
        try:
            used(vi.load(path))
        except HARMLESS:
            refused += 1
    assert 30 < refused < 100


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_arrays_with_anything_in_them_open_or_are_refused(tmp_path, make):
    header, arrays = parts_of(saved(tmp_path, make()))
    moments, refused = random.Random(15), 0
    for _ in range(80):
        changed = dict(arrays)
        name = moments.choice(list(arrays))
        x = arrays[name]
        other = [
            None,
            x[..., None],
            x.ravel()[:1],
            x[:0],
            x.astype(np.int64 if x.dtype.kind == "f" else float),
            np.full_like(x, moments.choice([-1, 0, 10**6])),
            np.full(x.shape, np.nan),
            np.full(x.shape, 2**62),
            x.T,
            x.astype(np.float32),
            x.astype("S3"),
            np.zeros((0, 5)),
            np.array(3.0),
        ]
        change = moments.choice(other)
        if change is None:
            del changed[name]
        else:
            changed[name] = change
        try:
            used(vi.load(put(tmp_path / "a.npz", header, changed)))
        except HARMLESS:
            refused += 1
    assert refused > 30


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("make", MOTIONS)
def test_files_with_turned_bits_and_torn_ends_open_or_are_refused(tmp_path, make):
    path = saved(tmp_path, make())
    whole, moments, refused = path.read_bytes(), random.Random(16), 0
    for i in range(200):
        broken = bytearray(whole)
        if i % 4:
            for _ in range(moments.randint(1, 3)):
                broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
        else:
            broken = broken[: moments.randrange(len(broken))]
        path.write_bytes(bytes(broken))
        try:
            used(vi.load(path))
        except HARMLESS:
            refused += 1
    assert refused > 100


@pytest.mark.filterwarnings("ignore")
def test_checkpoints_with_anything_in_them_are_refused_or_go_on(tmp_path):
    start = dict(q0=[1.0, 0.5, 1.2], v0=[1.5, 0, 0], h=0.01, steps=60)
    path = tmp_path / "run"
    vi.simulate(rocking(), checkpoint=path, **start)
    header, arrays = parts_of(path)
    whole, moments, refused = path.read_bytes(), random.Random(17), 0
    for i in range(80):
        if i % 2:
            put(tmp_path / "other.npz", mutated(header, moments), arrays)
            shutil.move(tmp_path / "other.npz", path)
        else:
            broken = bytearray(whole)
            broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
            path.write_bytes(bytes(broken))
        try:
            vi.simulate(rocking(), checkpoint=path, **start)
        except HARMLESS:
            refused += 1
    assert refused > 40


@pytest.mark.filterwarnings("ignore")
def test_ensembles_with_anything_in_their_files_are_refused_or_open(tmp_path):
    where = tmp_path / "kept"
    q0 = np.linspace(0, 0.2, 8).reshape(4, 2)
    vi.ensemble(henon_heiles(), q0=q0, v0=[0, 0], h=0.1, steps=6, store=where)
    files = sorted(where.iterdir())
    whole, moments, refused = {x: x.read_bytes() for x in files}, random.Random(18), 0
    header, arrays = parts_of(where / "ensemble.npz")
    for i in range(200):
        for x, content in whole.items():
            x.write_bytes(content)
        if i % 2:
            put(where / "ensemble.npz", mutated(header, moments), arrays)
        else:
            path = moments.choice(files)
            broken = bytearray(whole[path])
            broken[moments.randrange(len(broken))] ^= 1 << moments.randrange(8)
            path.write_bytes(bytes(broken))
        try:
            found = vi.load(where)
            _ = found.q, found.p, found[0], repr(found)
            with np.errstate(all="ignore"):
                _ = found.v
        except HARMLESS:
            refused += 1
    assert 60 < refused < 200


def test_a_zarr_group_that_unpacks_by_pickle_is_not_unpacked(tmp_path):
    zarr = pytest.importorskip("zarr", reason="needs the extra: zarr")
    from numcodecs import Pickle

    where, marker = tmp_path / "kept.zarr", tmp_path / "marker"
    group = zarr.open_group(str(where), mode="w", zarr_format=2)
    q0 = np.ones((3, 2)) / 9
    vi.ensemble(henon_heiles(), q0=q0, v0=[0, 0], h=0.1, steps=4, store=group)
    assert vi.load(where).q.shape == (3, 5, 2)

    class Trap:
        def __reduce__(self):
            return (Path.touch, (marker,))

    for place in ("given/q0", "good", "q"):
        shutil.copytree(where, tmp_path / "evil.zarr", dirs_exist_ok=True)
        about = tmp_path / "evil.zarr" / place / ".zarray"
        found = json.loads(about.read_text())
        for change in (
            dict(filters=[{"id": "pickle", "protocol": 5}]),
            dict(filters=None, compressor={"id": "pickle", "protocol": 5}),
        ):
            about.write_text(json.dumps(found | change))
            for chunk in about.parent.glob("[0-9]*"):
                chunk.write_bytes(Pickle().encode(np.array([Trap()], dtype=object)))
            with pytest.raises(vi.InputError, match="pickle"):
                _ = vi.load(tmp_path / "evil.zarr").q
    assert not marker.exists()


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


def test_equal_contents_are_equal_files(tmp_path):
    motion = plain_run()
    motion.save(tmp_path / "a.npz")
    vi.load(tmp_path / "a.npz").save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_what_varint_writes_numpy_reads_without_pickle(tmp_path):
    header, arrays = parts_of(saved(tmp_path, plain_run()))
    assert header["format"] == "varint trajectory 2" and arrays["q"].shape == (6, 2)
    found = read_archive(tmp_path / "whole.npz", "trajectory")[1]
    for name, x in arrays.items():
        assert found[name].dtype == x.dtype and found[name].tobytes() == x.tobytes()


def test_arrays_in_any_order_of_memory_and_of_no_size_come_back(tmp_path):
    from varint.numerics.archive import write_archive

    arrays = {
        "a": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "b": np.zeros((3, 0)),
        "c": np.float64(2.5),
        "d": np.arange(4).reshape(2, 2).T,
        "e": np.array([1.0, -0.0, np.nan, np.inf]).astype(">f8"),
        "f": np.array([True, False]),
    }
    for compress in (True, False):
        file = io.BytesIO()
        write_archive(file, {"é": "∂L/∂v"}, arrays, compress=compress)
        (tmp_path / "a.npz").write_bytes(file.getvalue())
        header, found = read_archive(tmp_path / "a.npz", "archive")
        assert header == {"é": "∂L/∂v"}
        for name, x in arrays.items():
            np.testing.assert_array_equal(found[name], x)
            assert found[name].dtype.isnative and found[name].shape == np.shape(x)
