"""The same scene in other units: a default call knows none, and takes the same steps in all."""

import casadi as ca
import numpy as np
import pytest

import varint as vi

NANOMETRES = 2.0**-30  # near enough, and it rounds nothing


def cantilever(unit):
    """A needle of unit mass on a unit spring that taps a wall of Lennard-Jones' potential."""
    q, v = vi.coordinates("z")
    gap = 12 * unit + q
    wall = unit**3 / (6 * gap) - unit**3 * (0.3 * unit) ** 6 / (180 * gap**7)
    return vi.System(q, v, v**2 / 2 - q**2 / 2 + wall)


@pytest.mark.parametrize("unit", [2.0**-10, NANOMETRES])
@pytest.mark.parametrize("tol", [1e-9, 1e-4])
def test_a_needle_that_taps_a_wall_takes_the_same_steps_in_metres(unit, tol):
    """Twelve units away from a wall of three tenths: steps follow the rate beside it. Products of
    powers of lengths overflowed, and round-off of the time was seen beside so small energies.
    """
    known, small = (
        vi.simulate(cantilever(x), q0=12 * x, v0=0.0, duration=30.0, tol=tol) for x in (1.0, unit)
    )
    assert small.stats["error_estimate"] < tol
    assert len(small) == pytest.approx(len(known), abs=2)
    assert np.abs(small.q[-1] / unit - known.q[-1]).max() < 12 * tol


def test_the_action_of_an_orbit_of_small_energy_is_that_of_any_other():
    """The clock of a run in fictitious time has a weight there, which the action leaves out."""
    found = []
    for unit in (1.0, 2.0**-12):
        q, v = vi.coordinates("x", "y")
        orbit = vi.System(q, v, ca.sumsqr(v) / 2 + unit**3 / ca.norm_2(q))
        motion = vi.simulate(orbit, q0=[1.9 * unit, 0], v0=[0, 0.23 * unit], duration=10.0)
        assert motion.fictitious is not None
        found.append(motion.action / unit**2)
    assert found[1] == pytest.approx(found[0], rel=1e-8)


@pytest.mark.parametrize("unit", [1.0, 2.0**-8, 2.0**-12, NANOMETRES])
def test_the_action_of_a_needle_that_taps_a_wall_is_the_same_in_metres(unit):
    """Steps were solved once more to find it: with a weight of the time that was large beside small
    energies Newton's method went elsewhere, and second derivatives of the rate overflowed.
    """
    motion = vi.simulate(cantilever(unit), q0=12 * unit, v0=0.0, duration=30.0, tol=1e-9)
    assert motion.fictitious is not None
    by_quadrature = 101.733355357274  # DOP853 at 3e-14 with the action as a third unknown
    assert motion.action / unit**2 == pytest.approx(by_quadrature, rel=1e-11)


@pytest.mark.parametrize("rule", [vi.gauss(8), vi.lobatto(5), vi.midpoint()])
@pytest.mark.parametrize("drag", [0.0, 0.05])
def test_actions_in_fictitious_time_are_those_of_equal_steps(rule, drag):
    q, v = vi.coordinates("x", "y")
    force = {"force": -drag * v} if drag else {}
    orbit = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), **force)
    start = {"q0": [1.9, 0.0], "v0": [0.0, 0.5], "duration": 10.0}
    known = vi.simulate(orbit, vi.gauss(8), **start, h=0.01).action
    found = vi.simulate(orbit, rule, **start, h=0.02, time_scale="auto", save_every=3)
    assert found.action == pytest.approx(known, rel=1e-3 if rule.order < 8 else 1e-11)


def test_a_bond_in_kilogrammes_and_metres_is_no_angle_and_nobody_is_warned():
    """exp overflows where it is looked whether a turn of the coordinate changes anything."""
    q, v = vi.coordinates("r")
    bond = 1.8e-18 * (1 - ca.exp(-2.3e10 * (q - 1.128e-10))) ** 2
    motion = vi.simulate(
        vi.System(q, v, 1.14e-26 * v**2 / 2 - bond), q0=1.3e-10, v0=0.0, duration=1e-12
    )
    assert motion.stats["error_estimate"] < 1e-9
    assert motion.energy == pytest.approx(motion.energy[0], rel=1e-9)
