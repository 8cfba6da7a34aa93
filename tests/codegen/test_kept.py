"""Tapes that are kept in the cache folder: what is read is what was arranged, and nothing else."""

import os
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import kept, routines, tableau, tape
from varint.codegen.graph import NotCompilable
from varint.codegen.native import native_gauss
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_routines
from varint.integration.plan import plan
from varint.numerics import operations

HERE = Path(kept.__file__).parent


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "varint" / kept.FOLDER


def functions(terms: int = 60, name: str = "f", factor: float = 0.3) -> dict:
    """Two functions, of reciprocal roots, sums that are fused, and sines with cosines."""
    q, c = ca.SX.sym("q", 3), ca.SX.sym("c", 2)
    total = sum(ca.sin(k * q[0]) * ca.cos(k * q[0]) / ca.sqrt(k + q[1] ** 2) for k in range(terms))
    return routines.routines(
        c, {name: ([q], [factor * total * c[0]]), "g": ([q], [q * ca.exp(c[1]), q[2] / total])}
    )


def tapes(found: dict, many: bool = False) -> list[tuple]:
    arrays = ("constants", "once", "often", "inputs", "outputs")
    made = [f.tape(many) for f in found.values()]
    return [
        (t.sizes, t.uniforms, t.numbers, t.registers, *(getattr(t, x).tobytes() for x in arrays))
        for t in made
    ]


def never(*_: object) -> None:
    raise AssertionError("arranged again")


@pytest.mark.parametrize("many", (False, True))
def test_what_was_kept_is_read_not_arranged_again(folder, monkeypatch, many):
    arranged = tapes(functions(), many)
    assert len(list(folder.iterdir())) == 1
    monkeypatch.setattr(routines, "arranged", never)
    read = functions()
    assert tapes(read, many) == arranged
    assert read["f"].sizes == read["f"].tape(many).sizes and read["f"].sizes.roots > 50
    with pytest.raises(AssertionError, match="arranged again"):
        _ = read["f"].graph  # for C


@pytest.mark.parametrize(
    ("other", "same"),
    (
        ({"terms": 61}, False),
        ({"factor": float(np.nextafter(0.3, 1))}, False),
        ({"name": "h"}, False),
        ({}, True),
    ),
)
def test_other_operations_are_not_taken_for_those_that_were_kept(folder, monkeypatch, other, same):
    tapes(functions())
    tapes(functions(**other))
    assert len(list(folder.iterdir())) == 2 - same
    kept._code.cache_clear()
    monkeypatch.setattr(kept.ca, "__version__", "another")
    tapes(functions())
    assert len(list(folder.iterdir())) == 3 - same
    kept._code.cache_clear()


def test_all_code_that_arranges_is_part_of_the_name(folder):
    """Every module that runs while operations become a tape."""
    ran: set[str] = set()
    scenes = vi.models.four_bar().system, vi.models.heavy_top_quaternion().system
    made = [functions(), *(newton_routines(x, plan(x, None).rule) for x in scenes)]

    def note(frame, event, _):
        if event == "call":
            ran.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        for one in made:
            tapes(one)
    finally:
        sys.setprofile(None)
    whole = {Path(x) for x in ran if str(HERE.parent) in x}
    known = {HERE / x for x in kept.ARRANGING} | {Path(operations.__file__)}
    # what keeps them, and reads files, decides nothing
    assert whole - known <= {HERE / "cache.py", HERE / "arguments.py", HERE / "built.py"}
    assert {HERE / "algebra.py", HERE / "tape.py"} <= whole
    assert all(path.exists() for path in known)


@pytest.mark.parametrize("stages", (1, 2, 5, 8, 16))
def test_tables_of_a_rule_are_read_as_they_were_computed(folder, monkeypatch, stages):
    whole = tableau.gauss_tableau.__wrapped__
    computed = tableau._computed(stages)
    first = whole(stages)
    (path,) = folder.iterdir()
    monkeypatch.setattr(tableau, "_computed", never)
    for found in (first, whole(stages)):
        assert list(found) == list(computed)
        assert all(np.array_equal(found[name], x) for name, x in computed.items())
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(AssertionError, match="arranged again"):
        whole(stages)


def test_tables_are_computed_anew_by_other_code(folder, monkeypatch):
    tableau.gauss_tableau.__wrapped__(3)
    monkeypatch.setattr(tableau, "code_of", lambda *_: b"another")
    tableau.gauss_tableau.__wrapped__(3)
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("damage", ("cut", "changed", "longer", "empty"))
def test_a_damaged_file_is_not_read(folder, monkeypatch, damage):
    arranged = tapes(functions())
    (path,) = folder.iterdir()
    content = bytearray(path.read_bytes())
    if damage == "changed":
        content[len(content) // 2] ^= 1
    whole = {"cut": content[:-7], "longer": content + b"\0", "empty": b""}.get(damage, content)
    path.write_bytes(whole)
    assert tapes(functions()) == arranged  # arranged anew, and kept
    monkeypatch.setattr(routines, "arranged", never)
    assert tapes(functions()) == arranged


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no owners here")
@pytest.mark.parametrize("place", ("file", "folder", "link"))
def test_what_others_may_have_written_is_not_read(folder, place):
    tapes(functions())
    (path,) = folder.iterdir()
    if place == "link":
        path.rename(folder.parent / "elsewhere")
        path.symlink_to(folder.parent / "elsewhere")
    else:
        (path if place == "file" else folder).chmod(0o777)
    key = path.name
    assert kept.kept_tapes(key, ["f", "g"]) == {}


def test_without_room_everything_works(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert tapes(functions()) == tapes(functions())


def test_files_do_not_pile_up(folder, monkeypatch):
    monkeypatch.setattr(kept, "MOST_KEPT", 6)
    for k in range(6):
        tapes(functions(40 + k))
        for path in folder.iterdir():  # the older the earlier
            at = path.stat().st_mtime_ns - 10**9
            os.utime(path, ns=(at, at))
    first = min(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    tapes(functions(40))  # read: it was needed lately
    tapes(functions(50))
    assert len(list(folder.iterdir())) == 4 and first.exists()


def test_short_functions_are_not_kept(folder):
    tapes(functions(2))
    assert not folder.exists()


@pytest.mark.parametrize(
    ("model", "native"),
    (
        (vi.models.four_bar, lambda s: native_newton(s, vi.lobatto(3))),
        (vi.models.outer_solar_system, lambda s: native_gauss(s, vi.gauss(8))),
    ),
)
def test_runs_from_kept_tapes_have_the_bytes_of_others(folder, forget, monkeypatch, model, native):
    monkeypatch.setattr(routines, "KEPT_FROM", 0)

    def run():
        forget()
        made = model()
        native(made.system)
        rule = vi.lobatto(3) if made.system.structure.constraints else vi.gauss(8)
        given = {"q0": made.q0, "v0": made.v0, "h": made.h, "steps": 20}
        motion = vi.simulate(made.system, rule, **given, backend="native")
        return motion.q.tobytes() + motion.v.tobytes()

    first = run()
    assert list(folder.iterdir())
    monkeypatch.setattr(routines, "arranged", never)
    monkeypatch.setattr(routines, "graph_of", never)
    assert run() == first


def test_what_is_too_long_is_refused_each_time_and_examined_once(monkeypatch):
    examined = []
    whole = routines._short
    monkeypatch.setattr(routines, "MOST_OPERATIONS", 10)
    monkeypatch.setattr(routines, "_short", lambda *x: examined.append(x) or whole(*x))
    monkeypatch.setattr(routines, "KEPT_FROM", 10**9)
    found = functions()
    for _ in range(2):
        with pytest.raises(NotCompilable, match="more than 10"):
            found["f"].tape(False)
    assert len(examined) == 1


def test_few_and_many_roots_differ_in_their_operation_alone():
    x = ca.SX.sym("x", 2)
    (f,) = routines.routines(ca.SX.sym("c"), {"f": ([x], [1 / ca.sqrt(x)])}).values()
    few, many = f.tape(False).often, f.tape(True).often
    codes = tape.operation_codes()
    assert (few[:, 1:] == many[:, 1:]).all()
    changed = few[:, 0] != many[:, 0]
    assert changed.sum() == 2
    assert set(few[changed, 0]) == {codes[tape.EXACT]}
    assert set(many[changed, 0]) == {codes[tape.ITERATED]}
