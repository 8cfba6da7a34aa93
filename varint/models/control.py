"""Ready optimal control problems: phases, links, and the cost that must come out.

Every factory can be called without arguments and returns a `ControlModel`;
``models.control_catalogue`` holds them all.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.control.links import Link
from varint.control.optimal import optimal_phases
from varint.control.phase import Phase
from varint.models.robots import cart_pole
from varint.results.trajectory import Trajectory
from varint.rules.rule import gauss
from varint.scene.free import free
from varint.scene.system import System, coordinates


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
    phase = Phase(
        system,
        gauss(2),
        duration,
        steps,
        force**2,
        start=dict(q=[0], v=[0]),
        end=dict(q=[distance], v=[0]),
    )
    return ControlModel(
        name="rest_to_rest",
        phases=(phase,),
        cost=12 * distance**2 / duration**3,
        claim=(
            "u falls linearly from 6 d/T² to −6 d/T²; J = 12 d²/T³, with N constant pieces J "
            "N²/(N² − 1)."
        ),
        source="Bryson & Ho, Applied Optimal Control, 1975",
    )


def fastest_transfer(x0: float = 2.0, v0: float = 1.0, limit: float = 1.0) -> ControlModel:
    """Unit mass brought to rest at 0 in least time with |u| ≤ limit: full thrust, one switch,
    full thrust.
    """
    system, force = _particle()
    side = np.sign(x0 + v0 * abs(v0) / (2 * limit)) or np.sign(v0) or 1.0
    root = np.sqrt((side * x0 + v0**2 / (2 * limit)) / limit)
    lengths = side * v0 / limit + root, root
    thrust = -side * limit
    phases = (
        Phase(
            system,
            gauss(2),
            free(1, 1e-3, 100),
            4,
            1,
            start=dict(q=[x0], v=[v0]),
            bounds=[(thrust, force, thrust)],
        ),
        Phase(
            system,
            gauss(2),
            free(1, 1e-3, 100),
            4,
            1,
            end=dict(q=[0], v=[0]),
            bounds=[(-thrust, force, -thrust)],
        ),
    )
    return ControlModel(
        name="fastest_transfer",
        phases=phases,
        cost=sum(lengths),
        claim=(
            "Two phases of constant thrust with free durations give the switching time to "
            "round-off."
        ),
        source="Pontryagin et al., The Mathematical Theory of Optimal Processes, §5",
    )


def overhead_crane(distance: float = 4.0, limit: float = 6.0) -> ControlModel:
    """Trolley with a hanging load carried to a stop without swing in least time, |push| ≤ limit."""
    system = cart_pole(M=2.0, m=1.0, length=2.0).system
    push, q = system.control, system.q
    phase = Phase(
        system,
        gauss(3),
        free(4, 1, 10),
        40,
        1 + 1e-3 * push**2,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[distance, 0], v=[0, 0]),
        bounds=[(-limit, push, limit), (-0.4, q[1], 0.4)],
    )
    return ControlModel(
        name="overhead_crane",
        phases=(phase,),
        cost=3.252005112719 if (distance, limit) == (4.0, 6.0) else None,
        claim="The load stays within 0.4 rad and hangs at rest on arrival.",
        source="Sakawa & Shindo, Automatica 18 (1982) 257",
    )


def fastest_wire(
    x: float = 10.0, drop: float = 5.0, g: float = 9.80665, steps: int = 20
) -> ControlModel:
    """Fastest wire from rest at 0 to (x, −drop): the wire pushes across the velocity, F = u
    (v_y, −v_x).
    """
    q, v = coordinates("x", "y")
    u = ca.SX.sym("u")
    system = System(q, v, ca.sumsqr(v) / 2 - g * q[1], force=u * ca.vertcat(v[1], -v[0]), control=u)
    phase = Phase(
        system,
        gauss(3),
        free(1, 0.1, 20),
        steps,
        1,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[x, -drop]),
        bounds=[(-50, u, 50)],
        guess=dict(q=[[0, 0], [x, -drop]], u=[[-1.0]]),
    )
    known = (x, drop, g) == (10.0, 5.0, 9.80665)
    return ControlModel(
        name="fastest_wire",
        phases=(phase,),
        cost=1.8016031224530813 if known else None,
        claim=(
            "The cycloid; u is constant, minus twice the rate of the path's direction, as for a "
            "charge in E × B."
        ),
        source="Johann Bernoulli 1696; numbers of the Dymos example, recomputed",
    )


def orbit_transfer(revolutions: int = 1, r1: float = 1.2) -> ControlModel:
    """Low-thrust transfer between circles of radius 1 and r1 with tangential force, least ∫ u²
    dt (μ = m = 1).
    """
    q, v = coordinates("r", "phi")
    u = ca.SX.sym("u")
    kinetic = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    system = System(q, v, kinetic + 1 / q[0], force=ca.vertcat(0, q[0] * u), control=u)
    duration = revolutions * np.sqrt(4 * np.pi**2 * (1 + r1) ** 3 / 8)
    angle = 2 * np.pi * revolutions
    phase = Phase(
        system,
        gauss(4),
        duration,
        40 * revolutions,
        u**2,
        start=dict(q=[1, 0], v=[0, 1]),
        end=dict(q=[r1, angle], v=[0, r1**-1.5]),
    )
    return ControlModel(
        name="orbit_transfer",
        phases=(phase,),
        cost=0.0010650580279977073 if (revolutions, r1) == (1, 1.2) else None,
        claim="Angular momentum changes by the torque's integral only, to round-off.",
        source=(
            "Junge, Marsden, Ober-Blöbaum, Discrete mechanics and optimal control, IFAC 2005; "
            "scaled"
        ),
    )
