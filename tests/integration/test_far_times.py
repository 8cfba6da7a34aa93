"""Explicit time far from zero, where a number of it is known to fewer digits."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.error_scale import error_scales


def driven_at(kind, rate, phase):
    (q, v), t = vi.coordinates("x"), vi.time()
    drive = ca.cos(rate * t + phase)
    lagrangian, force = {
        "linear": (v**2 / 2 - q**2 / 2, drive - 0.05 * v),
        "quartic": (v**2 / 2 - q**2 / 2 - q**4 / 10, drive - 0.05 * v),
        "parametric": (v**2 / 2 + (9.81 + drive) * ca.cos(q), 0.0),
    }[kind]
    return vi.System(q, v, lagrangian, force=force, t=t)


@pytest.mark.parametrize("tol", [1e-6, 1e-9])
@pytest.mark.parametrize("kind", ["linear", "quartic", "parametric"])
def test_they_are_rounded_and_it_is_said(kind, tol):
    """Explicit time acts at rounded times, alike in all runs: no two of them differ by that. The
    same drive with a phase instead begins at zero.
    """
    rate, told, broken = 1.25, 0, []
    for far in 2.0 ** np.arange(18, 40, 3) + 1.0:
        phase = np.arctan2(np.sin(rate * far), np.cos(rate * far))  # rate * far is a number
        start = {"q0": 0.4, "v0": 0.9, "duration": 12.0}
        near = vi.simulate(driven_at(kind, rate, phase), **start, tol=1e-11)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            motion = vi.simulate(driven_at(kind, rate, 0.0), **start, t0=far, tol=tol)
        told += bool(said)
        off = (np.abs(motion.q[-1] - near.q[-1]) / error_scales(motion.system, motion)).max()
        if off > (motion.stats["error_estimate"] if said else tol):
            broken.append((far, off, motion.stats["error_estimate"]))
    assert not broken
    assert 1 <= told <= 7  # far enough away it is told of, near zero not
