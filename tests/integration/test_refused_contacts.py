"""Contacts that cannot be stepped are refused."""

from __future__ import annotations

import pickle

import casadi as ca
import pytest
from contact_scenes import ball

import varint as vi


def test_a_start_inside_a_contact_is_refused():
    with pytest.raises(vi.InputError, match=r"q0 violates the contacts \[0\]: gap = \[-0\.1\]"):
        vi.simulate(ball(), q0=-0.1, v0=0.0, h=0.01, steps=1)


def test_rules_that_cannot_carry_a_contact_are_refused():
    with pytest.raises(vi.InputError, match=r"gauss\(2\) cannot carry contacts.*lobatto\(3\)"):
        vi.simulate(ball(), vi.gauss(2), q0=1.0, v0=0.0, h=0.01, steps=1)
    q, v = vi.coordinates("y")
    fast = vi.System(q, v, -ca.sqrt(1 - v**2), contact=q)
    with pytest.raises(vi.InputError, match="quadratic in the velocities"):
        vi.simulate(fast, q0=1.0, v0=0.0, h=0.01, steps=1)
    with pytest.raises(vi.InputError, match="no step of its own"):
        vi.step_function(ball())


@pytest.mark.parametrize("backend", ["native", "compiled"])
def test_what_flights_in_c_cannot_do_is_refused_where_they_are_asked_for(backend):
    with pytest.raises(vi.InputError, match="time runs backwards"):
        vi.simulate(ball(), q0=1.0, v0=0.0, h=-0.1, steps=1, backend=backend)
    with pytest.raises(vi.InputError, match="unknown backend 'fast'"):
        vi.simulate(ball(), q0=1.0, v0=0.0, h=-0.1, steps=1, backend="fast")


@pytest.mark.parametrize("place", [1e-200, 1e-226, 1e-310])
def test_a_blow_on_a_contact_whose_gradient_vanishes_is_refused(place):
    q, v = vi.coordinates("x")
    squared = vi.System(q, v, 1e-20 * (v**2 / 2 - q), contact=q**2, restitution=0.0)
    with pytest.raises(
        vi.InputError, match="contact 0 closes at t = 0 where its gap has no gradient"
    ):
        vi.simulate(squared, q0=place, v0=-1.0, h=0.001, steps=1)


def rolling_up():
    """Rolls along (x, x, z), nearly upwards where x is small, and pushed along x."""
    q, v = vi.coordinates("x", "y", "z")
    rolling = ca.horzcat(q[0], q[0], q[2])
    moving = ca.sumsqr(v) / 2 - q[0]
    return vi.System(q, v, moving, nonholonomic=rolling, contact=q[2] - 1, restitution=0.0)


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
@pytest.mark.parametrize("x", [0.0, 7e-13, 1e-9])
def test_a_blow_that_constraints_leave_nothing_of_is_refused(x, backend):
    """Divided by that nothing it was a bare ZeroDivisionError."""
    start = {"q0": [x, 0.0, 1.0], "v0": [0.0, 1.0, -x], "h": 1e-3, "backend": backend}
    if x == 0.0:
        motion = vi.simulate(rolling_up(), steps=1, **start)
        assert motion.q[-1, 2] == pytest.approx(1.0, abs=1e-8)
        return
    with pytest.raises(vi.InputError, match="contact 0 closes at t = 0 where the constraints"):
        vi.simulate(rolling_up(), steps=5, **start)


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
def test_a_blow_that_constraints_leave_little_of_is_given(backend):
    x = 1e-5
    start = {"q0": [x, 0.0, 1.0], "v0": [0.0, 1.0, -x], "h": 1e-3, "backend": backend}
    motion = vi.simulate(rolling_up(), steps=1, **start)
    slid = motion.events[0].v_after
    assert abs(slid[2]) < 1e-12
    assert slid[0] == pytest.approx(-0.5, abs=1e-4) and slid[1] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(
    "asked", [{"duration": -0.5}, {"duration": -50.0}, {"at": [-0.1, -0.5]}, {"h": -0.01}]
)
@pytest.mark.parametrize("drag", [0.0, 0.1])
def test_what_an_impact_took_away_is_not_looked_for_however_steps_are_chosen(asked, drag):
    """2¹⁸ steps were tried, and an impact that is described was asked for."""
    q, v = vi.coordinates("y")
    thrown = vi.System(
        q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.5, force=-drag * v if drag else None
    )
    grid = asked | ({"steps": 60} if "h" in asked else {})
    words = r"contact 0 is hit at t = -0\.4.* only restitution 1 can be undone"
    with pytest.raises(vi.ConvergenceError, match=words) as caught:
        vi.simulate(thrown, q0=1.0, v0=0.0, **grid)
    assert caught.value.refused and len(caught.value.trajectory) < 10_000
    copy = pickle.loads(pickle.dumps(caught.value))
    assert copy.refused and str(copy) == str(caught.value)
