"""Lagrangians linear in the velocities, L = ϑ(q)·v − H(q): Lotka–Volterra, whose ϑ is linear in q,
and the guiding centre, for which there is `midpoint`.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def lotka_volterra(
    prey: float = 2.0,
    predators: float = 1.0,
    a: float = 1.0,
    b: float = 1.0,
    c: float = 1.0,
    d: float = 1.0,
) -> Model:
    """Prey x and predators y, ẋ = x (a − b y), ẏ = y (d x − c), in ξ = log x and η = log y.

    ``L = η ξ̇ − H``, ``H = a η − b e^η + c ξ − d e^ξ``.
    """
    k = Parameters(a=a, b=b, c=c, d=d)
    q, v = coordinates("log_prey", "log_predators")
    total = k.a * q[1] - k.b * ca.exp(q[1]) + k.c * q[0] - k.d * ca.exp(q[0])
    system = System(q, v, q[1] * v[0] - total, params=k)
    return Model(
        name="lotka_volterra",
        system=system,
        q0=np.log([prey, predators]),
        v0=[a - b * predators, d * prey - c],
        duration=50.0,
        h=0.05,
        invariants=energy(system),
        claim="The numbers run round closed curves H = const and never spiral.",
        source=(
            "Lotka 1920; Volterra 1926; Hairer, Lubich & Wanner, Geometric Numerical Integration, "
            "I.1.1"
        ),
    )


def guiding_centre(
    q0: Sequence[float] = (0.1, 0.0, 0.0),
    parallel: float = 0.5,
    moment: float = 0.018,
    m: float = 1.0,
    e: float = 1.0,
    B0: float = 10.0,
    L: float = 1.0,
) -> Model:
    """Guiding centre in the field of `magnetic_mirror`, L = (e A + m w b)·ṙ − ½ m w² − μ B, w
    along b = B/|B|.
    """
    c = Parameters(moment=moment, m=m, e=e, B0=B0, L=L)
    q, v = coordinates("x", "y", "z", "w")
    place, w = q[:3], q[3]
    A = c.B0 / 2 * (1 + (place[2] / c.L) ** 2) * ca.vertcat(-place[1], place[0], 0)
    slope = ca.jacobian(A, place)
    field = ca.vertcat(
        slope[2, 1] - slope[1, 2], slope[0, 2] - slope[2, 0], slope[1, 0] - slope[0, 1]
    )
    size = ca.norm_2(field)
    carrier = c.e * A + c.m * w * field / size
    total = c.m * w**2 / 2 + c.moment * size
    system = System(q, v, ca.dot(carrier, v[:3]) - total, params=c)
    start = np.array([*q0, parallel])
    return Model(
        name="guiding_centre",
        system=system,
        q0=start,
        v0=degenerate_velocity(system, start),
        duration=20.0,
        h=0.1,
        invariants=energy(system) | {"p_phi": place[0] * carrier[1] - place[1] * carrier[0]},
        claim=(
            "Without the gyration, steps much longer than its period follow the bounce and the "
            "slow drift."
        ),
        source=(
            "Littlejohn, Journal of Plasma Physics 29 (1983) 111; Qin & Guan, Physical Review "
            "Letters 100 (2008)"
        ),
    )


def degenerate_velocity(system: System, q0: np.ndarray) -> np.ndarray:
    """v at q of L = ϑ(q)·v − H(q), from (∂ϑ/∂qᵀ − ∂ϑ/∂q) v = ∂H/∂q, with the default parameters."""
    form = system.momentum
    twist = ca.jacobian(form, system.q).T - ca.jacobian(form, system.q)
    rows = ca.Function("rows", [system.q, system.c], [twist, ca.gradient(system.energy, system.q)])
    matrix, slope = (x.full() for x in rows(q0, system.default_vector))
    return np.linalg.solve(matrix, slope[:, 0])
