"""Motions that come from afar to a centre, or through magnetic fields that vary, take steps by the
rate in flight, and keep the promise of their error.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

import varint as vi
from varint.integration.time_transformation.flight_rate import flight_rate

q1, v1 = vi.coordinates("x")
q2, v2 = vi.coordinates("x", "y")
q3, v3 = vi.coordinates("x", "y", "z")
R2 = ca.norm_2(q2)
RING = (q3[0] * v3[1] - q3[1] * v3[0]) / (ca.sumsqr(q3) + 0.1) ** 1.5


def of_potential(q, v, potential):
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential)


FLYING = {
    "charge on a line": of_potential(q1, v1, 1 / q1),
    "two powers": of_potential(q2, v2, 4 * (R2**-12 - R2**-6)),
    "screened charge": of_potential(q2, v2, ca.exp(-R2) / R2),
    "soft attraction": of_potential(q2, v2, -1 / ca.sqrt(ca.sumsqr(q2) + 0.01)),
    "ring current": vi.System(q3, v3, ca.sumsqr(v3) / 2 + 3 * RING),
}
NOT = {
    "quartic well": of_potential(q2, v2, ca.sumsqr(q2) ** 2),
    "pendulum": of_potential(q1, v1, -ca.cos(q1)),
    "Morse": of_potential(q1, v1, (1 - ca.exp(-q1)) ** 2),
    "bond": of_potential(q2, v2, (1 - ca.exp(-2 * (R2 - 1.12))) ** 2),
    "steep bond": of_potential(q2, v2, (1 - ca.exp(-60 * (R2 - 1.12))) ** 2),
    "square of powers": of_potential(q2, v2, (R2**-6 - 1) ** 2),
    "spring with a length": of_potential(q2, v2, (R2 - 1) ** 2),
    "uniform field": vi.System(q2, v2, ca.sumsqr(v2) / 2 + q2[0] * v2[1]),
}


@pytest.mark.parametrize("name", FLYING)
def test_ways_to_a_centre_or_in_a_field_have_a_rate(name):
    assert not flight_rate(FLYING[name]).reason


@pytest.mark.parametrize("name", NOT)
def test_where_no_force_becomes_larger_on_the_way_there_is_none(name):
    assert flight_rate(NOT[name]).reason


def thrown_back(q0: float, speed: float, duration: float) -> float:
    """Where a charge thrown at another one that repels it by 1/q² is when it has come back."""
    energy = speed**2 / 2 + 1 / q0
    nearest = 1 / energy

    def passed(q: float) -> float:  # from the nearest place to q
        root = np.sqrt(max(q * (q - nearest), 0.0))
        return (root + nearest * np.arccosh(max(np.sqrt(q / nearest), 1.0))) / np.sqrt(2 * energy)

    left = duration - passed(q0)
    return brentq(lambda q: passed(q) - left, nearest, q0 + speed * 2 * duration, xtol=1e-13)


@pytest.mark.parametrize("duration", [20.0, 1e3])
@pytest.mark.parametrize("more", [{}, {"events": {"nearest": v1}}, {"save_every": 3}])
def test_a_charge_thrown_at_another_one_takes_few_steps(duration, more):
    motion = vi.simulate(FLYING["charge on a line"], q0=10.0, v0=-3.0, duration=duration, **more)
    error = abs(motion.q[-1, 0] / thrown_back(10.0, 3.0, duration) - 1)
    assert error < motion.stats["error_estimate"] < 1e-9
    assert motion.stats["steps"] < 100
    assert motion.fictitious is not None
    for event in motion.events:
        assert event.q[0] == pytest.approx(1 / (4.5 + 0.1), rel=1e-9)


@pytest.mark.parametrize("name", ["ring current", "two powers", "screened charge"])
def test_runs_in_flight_keep_their_promise(name):
    system = FLYING[name]
    start = {
        "ring current": ([2, 0, 0.1], [0.1, 0.3, 0.2]),
        "two powers": ([-20.0, 0.4], [3.0, 0.0]),
        "screened charge": ([-30.0, 0.1], [4.0, 0.0]),
    }[name]
    asked = {"q0": start[0], "v0": start[1], "duration": 30.0}
    motion = vi.simulate(system, **asked)
    fine = vi.simulate(system, **asked, steps=8192, rule=vi.gauss(8))
    scale = np.abs(fine.q).max()
    error = np.abs(motion.q[-1] - fine.q[-1]).max() / scale
    assert motion.fictitious is not None
    assert error < motion.stats["error_estimate"] <= 1e-9
    assert motion.stats["steps"] < 500


@pytest.mark.parametrize("steepness", (2.0, 12.0))
@pytest.mark.parametrize("v0", ([-0.209, -0.0112], [0.05, 0.1], [0.0, -0.3]))
def test_a_bond_vibrates_through_where_its_force_vanishes(steepness, v0):
    """V''/V' has a pole there, at which steps that followed it came to an end."""
    bond = of_potential(q2, v2, (1 - ca.exp(-steepness * (R2 - 1.12))) ** 2)
    start = {"q0": [0.0, 1.1], "v0": v0, "duration": 2.0}
    motion = vi.simulate(bond, **start)
    closer = vi.simulate(bond, vi.gauss(8), **start, steps=400)
    assert np.abs(motion.q[-1] - closer.q[-1]).max() < 1e-9
    assert motion.stats["steps"] < 100
