"""Pendulums that are swung up at the least cost."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.phase import Phase
from varint.models.control import ControlModel
from varint.models.pendulums import pendulum
from varint.models.robots import acrobot, cart_pole
from varint.rules.rule import gauss, lobatto
from varint.scene.system import System, coordinates


def swing_up_cart_pole(steps: int = 40, stages: int = 4) -> ControlModel:
    """Cart-pole swung up in 2 s with least ∫ u² dt, |u| ≤ 20, |x| ≤ 2."""
    system = cart_pole().system
    push, q = system.control, system.q
    phase = Phase(
        system,
        gauss(stages),
        2.0,
        steps,
        push**2,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[1, np.pi], v=[0, 0]),
        bounds=[(-20, push, 20), (-2, q[0], 2)],
    )
    return ControlModel(
        name="swing_up_cart_pole",
        phases=(phase,),
        cost=58.80766745816687,
        claim=(
            "J = 58.80766745816687 from a straight line, with order 2s; another minimum costs "
            "57.94478030672802."
        ),
        source="Kelly, SIAM Review 59 (2017) 849, §6",
    )


def swing_up_pendulum(duration: float = 3.0, steps: int = 40) -> ControlModel:
    """Pendulum (m = ℓ = 1) swung up by a torque with least ∫ u² dt."""
    torque = ca.SX.sym("torque")
    plain = pendulum().system
    system = System(
        plain.q, plain.v, plain.lagrangian, force=torque, control=torque, params=plain.params
    )
    phase = Phase(
        system,
        gauss(4),
        duration,
        steps,
        torque**2,
        start=dict(q=[0], v=[0]),
        end=dict(q=[np.pi], v=[0]),
    )
    return ControlModel(
        name="swing_up_pendulum",
        phases=(phase,),
        cost=36.6402890624 if duration == 3.0 else None,
        claim=(
            "T = 3: J = 36.6402890624 with one back-swing; straight up J = 66.84; further minima "
            "turn more often."
        ),
        source="Ober-Blöbaum, Junge, Marsden, ESAIM: COCV 17 (2011) 322",
    )


def swing_up_acrobot(duration: float = 3.0, steps: int = 80) -> ControlModel:
    """Acrobot swung up by its elbow alone with least ∫ torque² dt, from a guess of a few sine
    waves.
    """
    system = acrobot().system
    torque = system.control
    waves = np.array([[-1.4, -0.4, 0.7, 0.1, -0.1, 0.2], [-0.1, -3.2, -0.7, 0.5, 0.0, -0.1]])

    def guess(t: float) -> np.ndarray:
        angle = np.pi * t / duration
        return np.array([angle, 0.0]) + waves @ np.sin(angle * np.arange(1, 7))

    phase = Phase(
        system,
        gauss(4),
        duration,
        steps,
        torque**2,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[np.pi, 0], v=[0, 0]),
        bounds=[(-40, torque, 40)],
        guess=dict(q=guess),
    )
    return ControlModel(
        name="swing_up_acrobot",
        phases=(phase,),
        cost=74.999464709684 if duration == 3.0 else None,
        claim="One torque moves two links from hanging to standing; the energy gained is its work.",
        source="Spong, IEEE Control Systems 15 (1995) 49",
    )


def swing_up_rod(steps: int = 40, stages: int = 4) -> ControlModel:
    """`swing_up_pendulum` as a particle on a rod, x² + y² = 1; the torque acts through F = u
    ∂θ/∂(x, y).
    """
    q, v = coordinates("x", "y")
    torque = ca.SX.sym("torque")
    system = System(
        q,
        v,
        ca.sumsqr(v) / 2 - 9.81 * q[1],
        constraint=ca.sumsqr(q) - 1,
        force=torque * ca.vertcat(-q[1], q[0]),
        control=torque,
    )
    phase = Phase(
        system,
        lobatto(stages),
        3.0,
        steps,
        torque**2,
        start=dict(q=[0, -1], v=[0, 0]),
        end=dict(q=[0, 1], v=[0, 0]),
        guess=dict(q=lambda t: [np.sin(np.pi * t / 3), -np.cos(np.pi * t / 3)]),
    )
    return ControlModel(
        name="swing_up_rod",
        phases=(phase,),
        cost=36.6402890624,
        claim="The cost of the angle form, to the order 2(s − 1) of the rule.",
        source=(
            "Leyendecker, Ober-Blöbaum, Marsden, Ortiz, Optimal Control Applications and Methods "
            "31 (2010) 505"
        ),
    )
