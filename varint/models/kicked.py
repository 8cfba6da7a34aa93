"""A rotor that is kicked once a unit of time."""

from __future__ import annotations

import casadi as ca

from varint.models.model import Model
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def kicked_rotor(K: float = 0.971635, theta0: float = 1.0, p0: float = 0.5) -> Model:
    """Chirikov's kicked rotor: L = ½ θ'² and the force −K sin θ, by Störmer–Verlet with h = 1.

    `trapezoidal` makes kicks of the force, half of one at both ends of a step and a free turn by p
    between them. With P = p − ½ K sin θ, the momentum between two kicks, θ_{k+1} = θ_k + P_k and
    P_{k+1} = P_k − K sin θ_{k+1}: with h = 1 the standard map itself, and not an approximation of
    a motion. Other rules and steps know of no kicks and make a pendulum of it.

    Parameters
    ----------
    K : float
        Strength of the kicks. The last torus that winds around breaks at K = 0.971635…
    theta0, p0 : float
        Start.
    """
    c = Parameters(K=K)
    q, v = coordinates("theta")
    return Model(
        name="kicked_rotor",
        system=System(q, v, v**2 / 2, force=-c.K * ca.sin(q), params=c),
        q0=[theta0],
        v0=[p0],
        duration=1000.0,
        h=1.0,
        claim="By trapezoidal() with h = 1 it is the standard map: below K = 0.9716 tori bound "
        "every momentum, and for strong kicks the exponent is ln(K/2).",
        source="Chirikov, Physics Reports 52 (1979) 263, §§2.4 and 5.3; Greene, Journal of "
        "Mathematical Physics 20 (1979) 1183",
    )
