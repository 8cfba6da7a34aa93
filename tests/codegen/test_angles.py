"""Sines and cosines that are asked for together, and numbers that functions share."""

import casadi as ca
import numpy as np
import pytest
import scenes

import varint as vi
from varint.codegen import instructions
from varint.codegen.angles import with_angles_together
from varint.codegen.cache import compiler
from varint.codegen.emit import arranged, emit_graph
from varint.codegen.kernel import run_loop
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_kernel, newton_source
from varint.codegen.parts import Statement
from varint.codegen.prepared import PreparedNumbers


def folded():
    """Angles of angles: sines that wait for others."""
    q, v = vi.coordinates("a", "b")
    return vi.System(q, v, ca.sumsqr(v) / 2 + ca.cos(q[0] + ca.sin(q[1])) - ca.cos(q[0] - q[1]))


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("turns", (0, 200_000))
@pytest.mark.parametrize("make", (scenes.double_pendulum, folded))
def test_sines_of_several_angles_have_the_bytes_of_each_by_itself_near_and_far(
    make, turns, monkeypatch, forget
):
    monkeypatch.setattr(instructions, "has_instructions", lambda: False)
    forget()
    system, rule = make(), vi.lobatto(4)
    assert "sines_and_cosines(w, a" in newton_source(system, rule).text
    q0, p0 = np.array([1.0 + 2 * np.pi * turns, 0.3]), np.array([0.1, 0.2])
    ways = (
        run_loop(kernel(system, rule), q0, p0, system.default_vector, t0=0.0, h=0.01, steps=20)
        for kernel in (newton_kernel, native_newton)
    )
    one, other = ways
    assert one.done and one.rows.tobytes() == other.rows.tobytes()


def test_angles_go_together_only_where_they_do_not_wait_for_one_another():
    angle = [Statement(f"x{i}", (i,), ()) for i in (0, 1)]
    pairs = [Statement("", (2, 3), (0,)), Statement("", (5, 6), (4,)), Statement("", (7, 8), (1,))]
    statements = [angle[0], pairs[0], Statement("x4", (4,), (2,)), pairs[1], angle[1], pairs[2]]
    placed = with_angles_together(statements, 2)
    known: set[int] = set()
    for x in placed:
        assert known.issuperset(x.taken)
        known.update(x.defined)
    assert [len(x.defined) for x in placed] == [1, 1, 4, 1, 2]


def test_functions_that_share_what_is_prepared_have_every_number_once():
    x, c = ca.SX.sym("x"), ca.SX.sym("c", 2)
    shared = PreparedNumbers(2)
    for name in ("f", "g"):
        whole = ca.Function(name, [x, c], [x * ca.exp(c[0] * c[1]) + c[1]])
        emit_graph(name, arranged(whole), 1, shared=shared)
    assert len(shared) == 3 and len(shared.statements) == 2
