"""Files that hold programs: nothing in them is executed, unless who opens them says so."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from saved_files import parts_of, plain_run, put, saved
from scenes import henon_heiles

import varint as vi
from varint.codegen.cache import compiler

ROOT = Path(__file__).resolve().parents[2]


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
