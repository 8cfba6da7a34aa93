"""The ends of an optimal path: free, bounded, periodic, given by momenta or by expressions."""

from __future__ import annotations

import numpy as np
import pytest
from control_scenes import (
    U,
    move,
    particle,
    pendulum,
    swing,
    swing_up,
)

import varint as vi


def test_free_end_has_zero_costate():
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[1, np.pi], v=[0, None]))
    # Mᵀμ of the free velocity
    assert abs(motion.costates.p[-1] @ np.array([0.3 * 0.5 * -1, 0.3 * 0.25])) < 1e-8
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[None, np.pi], v=[0, 0]))
    assert abs(motion.costates.q[-1, 0]) < 1e-8
    assert abs(motion.q[-1, 0] - 1) > 0.05


def test_end_given_by_momenta_and_by_expressions_equals_the_end_given_by_velocities():
    q, v = particle().q, particle().v
    base = move(vi.gauss(2), 8, end=dict(q=[1], v=[0.5]))
    by_momentum = move(vi.gauss(2), 8, end=dict(q=[1], p=[0.5]))
    by_expressions = move(vi.gauss(2), 8, end=dict(bounds=[(1.5, q + v, 1.5), (0.5, q - v, 0.5)]))
    assert [by_momentum.cost, by_expressions.cost] == pytest.approx([base.cost] * 2, rel=1e-9)


def test_bounded_end_takes_the_cheapest_value_in_its_window():
    motion = move(vi.gauss(2), 8, end=dict(q=[vi.free(2, 1, 3)], v=[0]))
    assert motion.q[-1, 0] == pytest.approx(1, abs=1e-8)
    assert motion.cost == pytest.approx(12, rel=1e-7)


def test_periodic_end_repeats_the_start():
    motion = swing(
        pendulum(),
        5.0,
        40,
        cost=U**2 + (pendulum().v - 1.5) ** 2,
        start=None,
        end=dict(periodic=[2 * np.pi]),
        guess=dict(q=lambda t: 2 * np.pi * t / 5),
    )
    assert motion.q[-1] - motion.q[0] == pytest.approx(2 * np.pi, abs=1e-10)
    assert motion.p[-1] == pytest.approx(motion.p[0], abs=1e-10)
    assert np.ptp(motion.p) > 0.1
