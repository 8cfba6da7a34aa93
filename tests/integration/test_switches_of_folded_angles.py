"""Kinks and jumps that functions make of what undoes them: asin(sin x), acos(cos x), atan(tan x),
hypot(x, 0).
"""

from __future__ import annotations

import math
import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi

FOLDED = {
    "asin": lambda x: ca.asin(ca.sin(x)),
    "acos": lambda x: ca.acos(ca.cos(x)),
    "atan": lambda x: ca.atan(ca.tan(x)),
    "hypot": lambda x: ca.hypot(x, 0),
}


def pushed_by(force) -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2, force=-force(q))


def turned(x: float, v: float, centre: float, sign: float, t: float) -> tuple[float, float]:
    """The motion of x'' = −sign (x − centre)."""
    c, s = (math.cos(t), math.sin(t)) if sign > 0 else (math.cosh(t), math.sinh(t))
    return centre + (x - centre) * c + v * s, v * c - sign * (x - centre) * s


@pytest.mark.parametrize("name", ["asin", "atan"])
def test_folded_angles_are_followed_over_their_folds(name):
    """x'' = −x as far as π/2, and behind that −(π − x), or, where it jumps, −(x − π)."""
    v0, tol = 2.5, 1e-9
    at = math.asin(math.pi / 2 / v0)
    fold, rest = turned(0.0, v0, 0.0, 1.0, at), 1.0
    right = turned(*fold, math.pi, -1.0 if name == "asin" else 1.0, rest)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(pushed_by(FOLDED[name]), q0=0.0, v0=v0, duration=at + rest, tol=tol)
    assert abs(motion.q[-1, 0] - right[0]) < tol * abs(motion.q).max()
    assert motion.stats["steps"] < 100  # thousands where they go across


def test_distances_along_a_line_are_sizes():
    """x'' = −hypot(x, 0) is −x above zero and x below."""
    at = math.pi / 2  # from 1 at rest to zero
    right = turned(*turned(1.0, 0.0, 0.0, 1.0, at), 0.0, -1.0, 1.0)
    motion = vi.simulate(pushed_by(FOLDED["hypot"]), q0=1.0, v0=0.0, duration=at + 1.0)
    assert abs(motion.q[-1, 0] - right[0]) < 1e-9 * abs(motion.q).max()
    assert motion.stats["steps"] < 100


@pytest.mark.parametrize("name", FOLDED)
def test_branches_are_what_is_written(name):
    """Frozen, each is its own value wherever its switch stands as it should."""
    from varint.integration.switches.frozen import frozen_scene

    scene = frozen_scene(pushed_by(lambda x: FOLDED[name](2 * x + 0.3)))
    s = scene.system
    look = ca.Function("look", [s.q, s.c], [s.force, scene.sigma])
    for x in np.linspace(-6, 6, 41):
        sigma = float(look(x, [1.0])[1])
        branch = math.floor(sigma) if scene.counts[0] else math.copysign(1.0, sigma)
        written = float(FOLDED[name](ca.DM(2 * x + 0.3)))
        assert abs(float(look(x, [branch])[0]) + written) < 1e-13
