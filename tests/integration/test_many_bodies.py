"""Scenes of many bodies, two of which meet: steps follow a rate that nobody looks for before."""

from __future__ import annotations

from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from references import end_by_dop853

import varint as vi
from varint.integration.time_transformation import rate_ahead


def bodies(count: int, axes: str, seed: int, strengths, trap: float, drag: float):
    """Charges or masses of random places, of a potential Σ strengths(i, j)/r, and a start."""
    random = np.random.default_rng(seed)
    q, v = vi.coordinates(*(f"{a}{i}" for i in range(count) for a in axes))
    each = ca.vertsplit(q, len(axes))
    potential = trap * ca.sumsqr(q) / 2 + sum(
        strengths(i, j) / ca.norm_2(each[i] - each[j]) for i, j in combinations(range(count), 2)
    )
    force = -drag * v if drag else None
    system = vi.System(q, v, ca.sumsqr(v) / 2 - potential, force=force)
    n = len(axes) * count
    return system, random.normal(size=n), 0.3 * random.normal(size=n)


def sign(i: int, j: int) -> float:
    return 0.1 * (-1) ** (i + j + 1)


CHARGES = bodies(10, "xyz", 1, sign, 0.2, 0.0), 2.0, (1e-5, 1e-9), 1e-11
MASSES = bodies(14, "xy", 4, lambda i, j: -0.05, 0.0, 0.1), 3.0, (1e-4, 1e-6), 1e-7


@pytest.mark.parametrize("case", (CHARGES, MASSES), ids=("charges", "masses with drag"))
def test_an_encounter_of_two_of_many_is_followed(case):
    """32,768 equal steps of the charges, by thirteen runs, took two hundred times as long; with
    drag building Newton's method for a run of eight steps alone took seconds. The last number is
    what DOP853 errs by at most.
    """
    (system, q0, v0), duration, tolerances, unsure = case
    exact = end_by_dop853(system, q0, v0, duration)
    for tol in tolerances:
        motion = vi.simulate(system, q0=q0, v0=v0, duration=duration, tol=tol)
        assert motion.fictitious is not None and motion.stats["steps"] < 600
        error = np.abs(motion.q[-1] - exact).max() / np.abs(motion.q).max()
        assert error < motion.stats["error_estimate"] + unsure <= tol + unsure
        long = vi.simulate(system, q0=q0, v0=v0, duration=duration, tol=tol, progress=True)
        assert long.q.tobytes() == motion.q.tobytes()


def test_calm_scenes_of_many_bodies_are_not_asked_for_a_rate(monkeypatch):
    def never(*_):
        raise AssertionError("a rate is looked for")

    monkeypatch.setattr(rate_ahead, "local_rate", never)
    system, q0, v0 = bodies(10, "xyz", 1, lambda i, j: 0.01, 0.2, 0.0)
    motion = vi.simulate(system, q0=q0, v0=v0, duration=2.0)
    assert motion.fictitious is None and motion.stats["error_estimate"] < 1e-9


def test_terms_that_are_none_leave_many_coordinates_to_equal_steps():
    """A product of all coordinates is a function of no single form."""
    q, v = vi.coordinates(*(f"x{i}" for i in range(25)))
    lagrangian = ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2 - ca.exp(-ca.sumsqr(q[:5])) * ca.cos(q[6])
    assert rate_ahead.kinds_of(vi.System(q, v, lagrangian)) == ()
