"""Orbits with close encounters: satellites of Earth and Moon, seven bodies, three from rest."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.models.particles import many_bodies, newtonian
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

ARENSTORF_PERIOD = 17.0652165601579625588917206249
HALO_PERIOD = 1.5111


def arenstorf(mu: float = 0.012277471) -> Model:
    """A satellite of Earth and Moon in the frame that turns with them, L = ½ (ẋ − y)² + ½ (ẏ + x)²
    + (1 − μ)/r₁ + μ/r₂.

    The Moon has the share μ of both masses and stands at (1 − μ, 0), the Earth at (−μ, 0). The
    start is 0.006 from the Moon, on an orbit of four loops.
    """
    c = Parameters(mu=mu)
    q, v = coordinates("x", "y")
    seen = v + ca.vertcat(-q[1], q[0])
    earth, moon = (ca.norm_2(q - ca.vertcat(x, 0)) for x in (-c.mu, 1 - c.mu))
    system = System(q, v, ca.sumsqr(seen) / 2 + (1 - c.mu) / earth + c.mu / moon, params=c)
    return Model(
        name="arenstorf",
        system=system,
        q0=[0.994, 0.0],
        v0=[0.0, -2.00158510637908252240537862224],
        duration=ARENSTORF_PERIOD,
        h=ARENSTORF_PERIOD / 10_000,
        invariants=energy(system),
        claim="After four loops and 17.0652 units of time the satellite is back at its start.",
        source="Arenstorf, American Journal of Mathematics 85 (1963) 27; data: Hairer, Nørsett & "
        "Wanner, Solving Ordinary Differential Equations I, II.0 (0.2)",
    )


def restricted_three_body(mu: float = 0.01215058560962404) -> Model:
    """A satellite of Earth and Moon in space, in the frame that turns with them, L = ½ (ẋ − y)² +
    ½ (ẏ + x)² + ½ ż² + (1 − μ)/r₁ + μ/r₂.

    Units are the distance of Earth and Moon, and the time in which they turn by a radian. The start
    lies on a halo orbit about L2 that passes close to the Moon, of 9 turns in 2 synodic months.
    """
    c = Parameters(mu=mu)
    q, v = coordinates("x", "y", "z")
    seen = v + ca.vertcat(-q[1], q[0], 0)
    earth, moon = (ca.norm_2(q - ca.vertcat(x, 0, 0)) for x in (-c.mu, 1 - c.mu))
    system = System(q, v, ca.sumsqr(seen) / 2 + (1 - c.mu) / earth + c.mu / moon, params=c)
    return Model(
        name="restricted_three_body",
        system=system,
        q0=[1.0220206689445093, 0.0, -0.1820962021322289],
        v0=[0.0, -0.10325451730376045, 0.0],
        duration=HALO_PERIOD,
        h=HALO_PERIOD / 2000,
        invariants=energy(system),
        claim="After 1.5111 units of time, a ninth of two synodic months, the satellite is back.",
        source="Szebehely, Theory of Orbits, 1967, chapter 1; halo orbits: Howell, Celestial "
        "Mechanics 32 (1984) 53",
    )


def pleiades() -> Model:
    """Seven stars in the plane, mᵢ = i, with several close encounters."""
    x0, y0 = [3, 3, -1, -3, 2, -2, 2], [3, -3, 2, 0, 0, -4, 4]
    xdot0, ydot0 = [0, 0, 0, 0, 0, 1.75, -1.5], [0, 0, 0, -1.25, 1, 0, 0]
    c = Parameters(m=np.arange(1.0, 8.0), G=1.0)
    return many_bodies(
        "pleiades",
        np.transpose([x0, y0]),
        np.transpose([xdot0, ydot0]),
        c,
        newtonian(c),
        3.0,
        3.0 / 3000,
        "At t = 3, past several close encounters, every star is where the published solution has "
        "it.",
        "Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, II.10; Mazzia & "
        "Magherini, Test Set for Initial Value Problem Solvers, PLEI",
    )


def pythagorean_three_body() -> Model:
    """Masses 3, 4 and 5, released at rest opposite to the sides 3, 4 and 5 of a right triangle.

    Ten units of time have the first close encounters; at t = 15.83 two of the bodies come within
    4e-4 of each other, and past t = 60 the lightest escapes.
    """
    c = Parameters(m=[3.0, 4.0, 5.0], G=1.0)
    return many_bodies(
        "pythagorean_three_body",
        [[1, 3], [-2, -1], [1, -1]],
        np.zeros((3, 2)),
        c,
        newtonian(c),
        10.0,
        1e-4,
        "From rest, momentum and angular momentum stay zero; the lightest body escapes in the end "
        "and leaves the others as a pair.",
        "Burrau, Astronomische Nachrichten 195 (1913) 113; Szebehely & Peters, Astronomical "
        "Journal 72 (1967) 876",
    )
