"""Angles of atan2, which jump by 2π on the negative x axis: followed where motions meet it."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.cuts import cuts_of
from varint.integration.switches import switched_run


def along_a_line() -> vi.System:
    """x'' = atan2(y, −1), y'' = 0."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2, force=ca.vertcat(ca.atan2(q[1], -1), 0))


def wrapped() -> vi.System:
    """x'' = −x within ±π, wrapped beyond."""
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2, force=-ca.atan2(ca.sin(q), ca.cos(q)))


def pushed(end: float) -> float:
    """x at the end where y = ½ − t: ∫ (end − t) atan2(y, −1) dt, by quadrature on both sides."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    total = 0.0
    for a, b in ((0.0, 0.5), (0.5, end)):
        t = (a + b) / 2 + (b - a) / 2 * nodes
        total += (b - a) / 2 * weights @ ((end - t) * np.arctan2(0.5 - t, -1.0))
    return total


@pytest.mark.parametrize("how", [{}, {"at": [0.3, 1.5]}, {"save_every": 1}, {"tol": 1e-6}])
def test_a_jump_is_followed(how):
    tol = how.get("tol", 1e-9)
    duration = {} if "at" in how else {"duration": 1.5}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(along_a_line(), q0=[0, 0.5], v0=[0, -1], **duration, **how)
    assert abs(motion.q[-1, 0] - pushed(1.5)) < tol * abs(motion.q).max()
    assert motion.stats["steps"] < 100


def test_a_wrapped_angle_is_followed_over_its_jump():
    """x'' = −x as far as π, −(x − 2 π) behind it."""
    v0, rest = 4.0, 1.0
    at = np.arcsin(np.pi / v0)
    speed = v0 * np.cos(at)
    right = 2 * np.pi - np.pi * np.cos(rest) + speed * np.sin(rest)
    motion = vi.simulate(wrapped(), q0=0.0, v0=v0, duration=float(at + rest))
    assert abs(motion.q[-1, 0] - right) < 1e-9 * abs(motion.q).max()
    assert motion.stats["steps"] < 100


def test_motions_that_keep_away_are_those_of_a_smooth_scene(monkeypatch):
    def followed(*_):
        raise AssertionError("followed from switch to switch")

    monkeypatch.setattr(switched_run, "choose_switched_steps", followed)
    motion = vi.simulate(wrapped(), q0=0.5, v0=0.1, duration=3.0)
    right = 0.5 * np.cos(3.0) + 0.1 * np.sin(3.0)
    assert abs(motion.q[-1, 0] - right) < 1e-9 * abs(motion.q).max()
    vi.simulate(along_a_line(), q0=[0, 0.5], v0=[0, -1], duration=0.4)
    vi.simulate(along_a_line(), q0=[0, 0.5], v0=[0, -1], h=0.1, duration=1.5)


def test_angles_that_cannot_jump_are_none():
    q, v = vi.coordinates("x", "y", "z")
    height = ca.atan2(q[2], ca.sqrt(q[0] ** 2 + q[1] ** 2))
    scene = vi.System(q, v, ca.sumsqr(v) / 2, force=-q * height)
    assert cuts_of(scene) is None and cuts_of(wrapped()) is not None
