"""Scenes and problems of the optimal control tests; every reference value is read from
`reference/d.json`.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from references import entries

import varint as vi
from varint.control.replay import defect

REFERENCE = entries("d")
U = ca.SX.sym("u")
# of tests that take too few steps on purpose
coarse = pytest.mark.filterwarnings("ignore:the solution is too coarse")


def replay_defect(motion: vi.Trajectory) -> float:
    return defect(motion, motion.replay())


@cache
def particle() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2, force=U, control=U)


@cache
def pendulum(gravity: float = 1.0) -> vi.System:
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + gravity * ca.cos(q), force=U, control=U)


@cache
def cartpole() -> vi.System:
    """Kelly's cart-pole; theta = 0 hangs."""
    q, v = vi.coordinates("x", "theta")
    m1, m2, length, g = (
        REFERENCE["D02_cartpole_kelly"]["params"][k] for k in ("m1", "m2", "l", "g")
    )
    kinetic = (
        (m1 + m2) * v[0] ** 2 / 2
        + m2 * length * ca.cos(q[1]) * v[0] * v[1]
        + m2 * length**2 * v[1] ** 2 / 2
    )
    lagrangian = kinetic + m2 * g * length * ca.cos(q[1])
    return vi.System(q, v, lagrangian, force=ca.vertcat(U, 0), control=U)


def swing_up(rule=None, steps=40, weight=1.0, **given) -> vi.Trajectory:
    """Kelly's swing-up in 2 s."""
    system = cartpole()
    ends = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, np.pi], v=[0, 0]))
    bounds = [(-20, U, 20), (-2, system.q[0], 2)]
    return vi.optimal_control(
        system,
        rule or vi.gauss(4),
        duration=2.0,
        steps=steps,
        cost=weight * U**2,
        bounds=bounds,
        **(ends | given),
    )


def swing(system: vi.System, duration, steps: int = 40, **given) -> vi.Trajectory:
    """A pendulum from rest below to rest above."""
    given = dict(cost=U**2, start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0])) | given
    return vi.optimal_control(
        system, given.pop("rule", vi.gauss(4)), duration=duration, steps=steps, **given
    )


def move(rule, steps: int, duration=1.0, **given) -> vi.Trajectory:
    """The particle from rest at 0 to rest at 1."""
    given = dict(cost=U**2, start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0])) | given
    return vi.optimal_control(particle(), rule, duration=duration, steps=steps, **given)


def rod():
    """The pendulum as a particle on a rod; the torque u acts through F = u ∂θ/∂q."""
    q, v = vi.coordinates("x", "y")
    force = U * ca.vertcat(-q[1], q[0])
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, force=force, control=U
    )


def rod_swing(rule, steps, end=None, **given):
    def circle(t):
        return [np.sin(np.pi * t / 3), -np.cos(np.pi * t / 3)]

    return vi.optimal_control(
        rod(),
        rule,
        duration=3.0,
        steps=steps,
        cost=U**2,
        start=dict(q=[0, -1], v=[0, 0]),
        end=end or dict(q=[0, 1], v=[0, 0]),
        guess=dict(q=circle),
        **given,
    )
