"""Ready optimal control problems: phases, links, and the cost that must come out.

Every factory can be called without arguments and returns a `ControlModel`; ``models.control_catalogue`` holds them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.control.links import Link
from varint.control.optimal import optimal_phases
from varint.control.phase import Phase
from varint.horizon import free
from varint.models.pendulums import pendulum
from varint.models.robots import acrobot, cart_pole
from varint.rules import gauss, lobatto
from varint.system import System, coordinates
from varint.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class ControlModel:
    """An optimal control problem with its source and, where one is known, its cost.

    Attributes
    ----------
    name : str
        Name of the factory.
    phases : tuple of Phase
        The problem.
    links : tuple of Link
        What ties the phases.
    cost : float or None
        Optimal cost of all phases (a local minimum where there are several).
    claim, source : str
        What must come out, and where it comes from.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.rest_to_rest()
    >>> abs(model.solve()[0].cost - model.cost) < 1e-9
    True
    """

    name: str
    phases: tuple[Phase, ...]
    cost: float | None
    claim: str
    source: str
    links: tuple[Link, ...] = ()

    def solve(self) -> list[Trajectory]:
        """One trajectory a phase, by `optimal_phases`."""
        ties = self.links or tuple(Link(i, i + 1) for i in range(len(self.phases) - 1))
        return optimal_phases(self.phases, ties)


def _particle() -> tuple[System, ca.SX]:
    q, v = coordinates("x")
    force = ca.SX.sym("force")
    return System(q, v, v**2 / 2, force=force, control=force), force


def rest_to_rest(distance: float = 1.0, duration: float = 1.0, steps: int = 10) -> ControlModel:
    """Unit mass moved from rest to rest with least ∫ u² dt."""
    system, force = _particle()
    phase = Phase(system, gauss(2), duration, steps, force**2, start=dict(q=[0], v=[0]), end=dict(q=[distance], v=[0]))
    return ControlModel(
        name="rest_to_rest", phases=(phase,), cost=12 * distance**2 / duration**3,
        claim="u falls linearly from 6 d/T² to −6 d/T²; J = 12 d²/T³, with N constant pieces J N²/(N² − 1).",
        source="Bryson & Ho, Applied Optimal Control, 1975",
    )  # fmt: skip


def fastest_transfer(x0: float = 2.0, v0: float = 1.0, limit: float = 1.0) -> ControlModel:
    """Unit mass brought to rest at 0 in least time with |u| ≤ limit: full thrust, one switch, full thrust."""
    system, force = _particle()
    side = np.sign(x0 + v0 * abs(v0) / (2 * limit)) or np.sign(v0) or 1.0
    root = np.sqrt((side * x0 + v0**2 / (2 * limit)) / limit)
    lengths = side * v0 / limit + root, root
    thrust = -side * limit
    phases = (
        Phase(system, gauss(2), free(1, 1e-3, 100), 4, 1, start=dict(q=[x0], v=[v0]), bounds=[(thrust, force, thrust)]),
        Phase(system, gauss(2), free(1, 1e-3, 100), 4, 1, end=dict(q=[0], v=[0]), bounds=[(-thrust, force, -thrust)]),
    )
    return ControlModel(
        name="fastest_transfer", phases=phases, cost=sum(lengths),
        claim="Two phases of constant thrust with free durations give the switching time to round-off.",
        source="Pontryagin et al., The Mathematical Theory of Optimal Processes, §5",
    )  # fmt: skip


def swing_up_cart_pole(steps: int = 40, stages: int = 4) -> ControlModel:
    """Cart-pole swung up in 2 s with least ∫ u² dt, |u| ≤ 20, |x| ≤ 2."""
    system = cart_pole().system
    push, q = system.control, system.q
    phase = Phase(
        system, gauss(stages), 2.0, steps, push**2, start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, np.pi], v=[0, 0]),
        bounds=[(-20, push, 20), (-2, q[0], 2)],
    )  # fmt: skip
    return ControlModel(
        name="swing_up_cart_pole", phases=(phase,), cost=58.80766745816687,
        claim="J = 58.80766745816687 from a straight line, with order 2s; another minimum costs 57.94478030672802.",
        source="Kelly, SIAM Review 59 (2017) 849, §6",
    )  # fmt: skip


def swing_up_pendulum(duration: float = 3.0, steps: int = 40) -> ControlModel:
    """Pendulum (m = ℓ = 1) swung up by a torque with least ∫ u² dt."""
    torque = ca.SX.sym("torque")
    plain = pendulum().system
    system = System(plain.q, plain.v, plain.lagrangian, force=torque, control=torque, params=plain.params)
    phase = Phase(system, gauss(4), duration, steps, torque**2, start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0]))
    return ControlModel(
        name="swing_up_pendulum", phases=(phase,), cost=36.6402890624 if duration == 3.0 else None,
        claim="T = 3: J = 36.6402890624 with one back-swing; straight up J = 66.84; further minima turn more often.",
        source="Ober-Blöbaum, Junge, Marsden, ESAIM: COCV 17 (2011) 322",
    )  # fmt: skip


def swing_up_acrobot(duration: float = 3.0, steps: int = 80) -> ControlModel:
    """Acrobot swung up by its elbow alone with least ∫ torque² dt, from a guess of a few sine waves."""
    system = acrobot().system
    torque = system.control
    waves = np.array([[-1.4, -0.4, 0.7, 0.1, -0.1, 0.2], [-0.1, -3.2, -0.7, 0.5, 0.0, -0.1]])

    def guess(t: float) -> np.ndarray:
        angle = np.pi * t / duration
        return np.array([angle, 0.0]) + waves @ np.sin(angle * np.arange(1, 7))

    phase = Phase(
        system, gauss(4), duration, steps, torque**2, start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[np.pi, 0], v=[0, 0]),
        bounds=[(-40, torque, 40)], guess=dict(q=guess),
    )  # fmt: skip
    return ControlModel(
        name="swing_up_acrobot", phases=(phase,), cost=74.999464709684 if duration == 3.0 else None,
        claim="One torque moves two links from hanging to standing; the energy gained is its work.",
        source="Spong, IEEE Control Systems 15 (1995) 49",
    )  # fmt: skip


def overhead_crane(distance: float = 4.0, limit: float = 6.0) -> ControlModel:
    """Trolley with a hanging load carried to a stop without swing in least time, |push| ≤ limit."""
    system = cart_pole(M=2.0, m=1.0, length=2.0).system
    push, q = system.control, system.q
    phase = Phase(
        system, gauss(3), free(4, 1, 10), 40, 1 + 1e-3 * push**2, start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[distance, 0], v=[0, 0]), bounds=[(-limit, push, limit), (-0.4, q[1], 0.4)],
    )  # fmt: skip
    return ControlModel(
        name="overhead_crane", phases=(phase,), cost=3.252005112719 if (distance, limit) == (4.0, 6.0) else None,
        claim="The load stays within 0.4 rad and hangs at rest on arrival.",
        source="Sakawa & Shindo, Automatica 18 (1982) 257",
    )  # fmt: skip


def fastest_wire(x: float = 10.0, drop: float = 5.0, g: float = 9.80665, steps: int = 20) -> ControlModel:
    """Fastest wire from rest at 0 to (x, −drop): the wire pushes across the velocity, F = u (v_y, −v_x)."""
    q, v = coordinates("x", "y")
    u = ca.SX.sym("u")
    system = System(q, v, ca.sumsqr(v) / 2 - g * q[1], force=u * ca.vertcat(v[1], -v[0]), control=u)
    phase = Phase(
        system, gauss(3), free(1, 0.1, 20), steps, 1, start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[x, -drop]),
        bounds=[(-50, u, 50)], guess=dict(q=[[0, 0], [x, -drop]], u=[[-1.0]]),
    )  # fmt: skip
    known = (x, drop, g) == (10.0, 5.0, 9.80665)
    return ControlModel(
        name="fastest_wire", phases=(phase,), cost=1.8016031224530813 if known else None,
        claim="The cycloid; u is constant, minus twice the rate of the path's direction, as for a charge in E × B.",
        source="Johann Bernoulli 1696; numbers of the Dymos example, recomputed",
    )  # fmt: skip


def orbit_transfer(revolutions: int = 1, r1: float = 1.2) -> ControlModel:
    """Low-thrust transfer between circles of radius 1 and r1 with tangential force, least ∫ u² dt (μ = m = 1)."""
    q, v = coordinates("r", "phi")
    u = ca.SX.sym("u")
    kinetic = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    system = System(q, v, kinetic + 1 / q[0], force=ca.vertcat(0, q[0] * u), control=u)
    duration = revolutions * np.sqrt(4 * np.pi**2 * (1 + r1) ** 3 / 8)
    angle = 2 * np.pi * revolutions
    phase = Phase(
        system, gauss(4), duration, 40 * revolutions, u**2, start=dict(q=[1, 0], v=[0, 1]),
        end=dict(q=[r1, angle], v=[0, r1**-1.5]),
    )  # fmt: skip
    return ControlModel(
        name="orbit_transfer", phases=(phase,),
        cost=0.0010650580279977073 if (revolutions, r1) == (1, 1.2) else None,
        claim="Angular momentum changes by the torque's integral only, to round-off.",
        source="Junge, Marsden, Ober-Blöbaum, Discrete mechanics and optimal control, IFAC 2005; scaled",
    )  # fmt: skip


def free_floating_robot(target: Sequence[float] = (4.0, 4.0, 0.0), duration: float = 5.0) -> ControlModel:
    """Robot in the plane (M = 10, I = 12) with two pairs of thrusters at arm 5, least ½ ∫ Σ u² dt."""
    q, v = coordinates("x", "y", "theta")
    u = ca.SX.sym("u", 4)
    along, across = u[0] + u[2], u[1] + u[3]
    c, s = ca.cos(q[2]), ca.sin(q[2])
    force = ca.vertcat(along * c - across * s, along * s + across * c, 5 * (u[0] - u[2] - u[1] + u[3]))
    system = System(q, v, 5 * ca.sumsqr(v[:2]) + 6 * v[2] ** 2, force=force, control=u)
    phase = Phase(
        system, gauss(3), duration, 20, ca.sumsqr(u) / 2, start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=list(target), v=[0, 0, 0]),
    )  # fmt: skip
    straight = target[2] == 0
    cost = 3 * 100 * (target[0] ** 2 + target[1] ** 2) / duration**3 if straight else None
    return ControlModel(
        name="free_floating_robot", phases=(phase,), cost=cost,
        claim="Without turning it moves as a point: J = 3 M² d²/T³ = 76.8.",
        source="PROPT user's guide, Free floating robot, after dyn.Opt example 6b",
    )  # fmt: skip


def swing_up_rod(steps: int = 40, stages: int = 4) -> ControlModel:
    """`swing_up_pendulum` as a particle on a rod, x² + y² = 1; the torque acts through F = u ∂θ/∂(x, y)."""
    q, v = coordinates("x", "y")
    torque = ca.SX.sym("torque")
    system = System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, force=torque * ca.vertcat(-q[1], q[0]),
        control=torque,
    )  # fmt: skip
    phase = Phase(
        system, lobatto(stages), 3.0, steps, torque**2, start=dict(q=[0, -1], v=[0, 0]), end=dict(q=[0, 1], v=[0, 0]),
        guess=dict(q=lambda t: [np.sin(np.pi * t / 3), -np.cos(np.pi * t / 3)]),
    )  # fmt: skip
    return ControlModel(
        name="swing_up_rod", phases=(phase,), cost=36.6402890624,
        claim="The cost of the angle form, to the order 2(s − 1) of the rule.",
        source="Leyendecker, Ober-Blöbaum, Marsden, Ortiz, Optimal Control Applications and Methods 31 (2010) 505",
    )  # fmt: skip


def walker(stride: float = 0.5, steps: int = 20) -> ControlModel:
    """Two stiff legs on a hip walk periodically with least ∫ |torques|² dt: stance, impact, change of legs."""
    torque = ca.SX.sym("torque", 2)
    q, v = coordinates("x", "y", "stance", "swing")

    def along(angle: ca.SX, part: float) -> ca.SX:
        return q[:2] + part * ca.vertcat(ca.sin(angle), -ca.cos(angle))

    lagrangian = ca.SX(0)
    for mass, place in ((10, q[:2]), (5, along(q[2], 0.5)), (5, along(q[3], 0.5))):
        lagrangian += mass / 2 * ca.sumsqr(ca.jtimes(place, q, v)) - mass * 9.81 * place[1]
    force = ca.vertcat(0, 0, torque[1] - torque[0], torque[0])
    system = System(q, v, lagrangian, constraint=along(q[2], 1), force=force, control=torque)
    foot, lean = along(q[3], 1), np.arcsin(stride / 2)

    def guess(t: float) -> list[float]:
        angle = lean * (1 - t / 0.4)
        return [-np.sin(angle), np.cos(angle), angle, -angle]

    phase = Phase(
        system, lobatto(3), free(0.8, 0.3, 1.5), steps, ca.sumsqr(torque), guess=dict(q=guess),
        end=dict(bounds=[(stride, foot[0], stride)]),
    )  # fmt: skip
    swap = ca.vertcat(q[0] - foot[0], q[1] - foot[1], q[3], q[2])
    step = Link(0, 0, contact=foot[1], sticks=foot[0], relabel=swap, time=False)
    return ControlModel(
        name="walker", phases=(phase,), links=(step,), cost=None,
        claim="The gait repeats itself after the impact, whose loss of energy the torques give back.",
        source="Goswami, Thuilot, Espiau, International Journal of Robotics Research 17 (1998) 1282",
    )  # fmt: skip


def falling_cat(turn: float = 0.6, duration: float = 4.0) -> ControlModel:
    """Satellite with two arms turned by moving the arms around and back, with least ∫ |torques|² dt."""
    q, v = coordinates("body", "left", "right")
    torque = ca.SX.sym("torque", 2)
    kinetic = 1.5 * v[0] ** 2 / 2
    for side, angle in ((-1, q[0] + q[1]), (1, q[0] + q[2])):
        place = side * 0.6 * ca.vertcat(ca.cos(q[0]), ca.sin(q[0])) + side * ca.vertcat(ca.cos(angle), ca.sin(angle))
        kinetic += ca.sumsqr(ca.jtimes(place, q, v)) / 2
    system = System(q, v, kinetic, force=ca.vertcat(0, torque), control=torque)

    def guess(t: float) -> list[float]:
        s = 2 * np.pi * t / duration
        return [turn * t / duration, 1.2 * (1 - np.cos(s)), 1.2 * np.sin(s)]

    phase = Phase(
        system, gauss(3), duration, 40, ca.sumsqr(torque), start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=[turn, 0, 0], v=[0, 0, 0]), guess=dict(q=guess), bounds=[(-2.5, q[1], 2.5), (-2.5, q[2], 2.5)],
    )  # fmt: skip
    return ControlModel(
        name="falling_cat", phases=(phase,), cost=30.671493472396 if (turn, duration) == (0.6, 4.0) else None,
        claim="The body turns although the angular momentum stays zero to round-off.",
        source="Montgomery, Gauge theory of the falling cat, Fields Institute Communications 1 (1993) 193",
    )  # fmt: skip
