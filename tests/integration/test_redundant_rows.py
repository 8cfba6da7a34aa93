"""Rows that are redundant at the start are not left behind where they no longer are."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

RULES = [vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)]
BACKENDS = ["interpreted", "compiled"]
REDUNDANT = "ignore:the constraint rows"


def wall(power: int) -> vi.System:
    """Beyond x = 1 the second row says more than the first."""
    q, v = vi.coordinates("x", "y", "z")
    rows = ca.vertcat(q[2], q[2] + 10 * ca.fmax(q[0] - 1, 0) ** power)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=rows)


@pytest.mark.filterwarnings(REDUNDANT)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("power", [2, 3])
@pytest.mark.parametrize("every", [1, 10])
def test_a_row_that_is_violated_later_ends_the_run(backend, rule, power, every):
    start = dict(q0=[0, 0, 0], v0=[1, 0, 0], h=0.01, steps=400)
    with pytest.raises(vi.ConvergenceError, match="row 1 was redundant at the start") as caught:
        vi.simulate(wall(power), rule, **start, save_every=every, backend=backend)
    assert caught.value.trajectory.q[-1, 0] == pytest.approx(1, abs=0.02 * every)


@pytest.mark.parametrize("v0", [[0.0, 0.3, 0.0], [0.5, 0.3, 0.0]])
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_rows_that_part_with_time_are_refused_at_the_start(rule, v0):
    """Two spheres that are one at t = 0: what follows is not determined there."""
    q, v = vi.coordinates("x", "y", "z")
    t = vi.time()
    rows = ca.vertcat(ca.sumsqr(q) - 1, ca.sumsqr(q - ca.vertcat(t, 0, 0)) - 1)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[2], constraint=rows, t=t)
    with pytest.raises(vi.InputError, match="dependent at the start"):
        vi.simulate(system, rule, q0=[0, 0, -1], v0=v0, h=0.01, steps=300)


@pytest.mark.filterwarnings(REDUNDANT)
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_row_that_says_more_and_holds_comes_back(backend):
    """Beyond x = 1 the second row holds w = 0, where nothing has moved it."""
    q, v = vi.coordinates("x", "z", "w")
    rows = ca.vertcat(q[1], q[1] + ca.fmax(q[0] - 1, 0) ** 3 * q[2])
    late = ca.if_else(q[0] > 3.005, 5.0, 0.0)
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=rows, force=ca.vertcat(0, 0, late))
    motion = vi.simulate(
        system,
        vi.lobatto(3),
        q0=[0, 0, 0],
        v0=[1, 0, 0],
        h=0.01,
        steps=400,
        save_every=100,
        backend=backend,
    )
    held = [active_set.rows for active_set in motion.active_sets]
    assert held == [(0,), (0, 1)]
    assert np.abs(motion.q[:, 1:]).max() < 1e-12 and motion.q[-1, 0] == pytest.approx(4)


@pytest.mark.filterwarnings(REDUNDANT)
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_rows_that_stay_redundant_change_nothing(rule):
    q, v = vi.coordinates("x", "y")
    t = vi.time()
    lagrangian = ca.sumsqr(v) / 2 - 9.81 * q[1]
    circle = ca.sumsqr(q - ca.vertcat(ca.sin(t), 0)) - 1
    twice = vi.System(q, v, lagrangian, constraint=ca.vertcat(circle, 2 * circle), t=t)
    once = vi.System(q, v, lagrangian, constraint=circle, t=t)
    start = dict(q0=[0, -1], v0=[1, 0], h=0.01, steps=500)
    np.testing.assert_array_equal(
        vi.simulate(twice, rule, **start).q, vi.simulate(once, rule, **start).q
    )
