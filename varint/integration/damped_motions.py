"""How fast a motion turns where dampers are stiff: what they stop at once needs no steps.

Beside a damper that is stiffer than its spring a small motion has two rates, one far above its
frequency without the damper and one far below. By the frequencies alone a beam of twenty elements
with dampers in its joints begins with thousands of steps, none of which anything is seen in. Here
the equations of motion are linear about the start: its velocities and accelerations are a sum of
motions that go like exp(λ t), each with a size |c/λ|. Those whose size nobody sees are left out.
What is seen is what first steps are for, and steps may grow to what lasts.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.small_motions import MOST_COORDINATES, angle_turned
from varint.numerics.arrays import call
from varint.scene.memory import per_scene
from varint.scene.system import System

FEWEST = 7  # coordinates: small scenes take less time than this look
STIFF = 2.0  # times as fast as the fastest frequency must dampers be
SEEN = 0.1  # of the wanted error: sizes of motions that are looked at
LASTS = 20.0  # what falls by less than e to this in the whole duration


def may_be_damped(system: System) -> bool:
    """Whether forces on velocities may be stiff, in a scene that is looked at for this: steps grow
    where nothing depends on time, and linear scenes have maps.
    """
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts
    free = s.autonomous and not (held or s.degenerate or s.linear or system.rays)
    return free and s.force_on_velocity and FEWEST <= s.n <= MOST_COORDINATES


def damped_turns(
    system: System,
    q: np.ndarray,
    p: np.ndarray,
    t: float,
    c: np.ndarray,
    duration: float,
    tol: float,
    fastest: float,
) -> tuple[float, float] | None:
    """By how much the motions that last turn in the duration, and the fastest one that is seen.

    None where no damper is stiff, or this cannot be told. `fastest` is the frequency without
    dampers.
    """
    mass, places, speeds, v, push = (
        x.reshape(-1, len(q)).T for x in call(_linear(system), q, p, np.array((t,)), c)
    )
    try:
        damped = np.linalg.solve(mass, speeds)
        if not STIFF * fastest < np.abs(damped).sum(axis=1).max(initial=0.0) < math.inf:
            return None
        n, sprung = len(q), np.linalg.solve(mass, places)
        matrix = np.block([[np.zeros((n, n)), np.eye(n)], [sprung, damped]])
        rates, ways = np.linalg.eig(matrix)
        begins = np.concatenate((v.ravel(), np.linalg.solve(mass, push).ravel()))
        parts = np.linalg.solve(ways, begins)
    except np.linalg.LinAlgError:
        return None
    fast = np.abs(rates)
    if not STIFF * fastest < fast.max():
        return None
    with np.errstate(all="ignore"):
        sizes = np.abs(ways[:n] * parts) / fast
    moving = fast * abs(duration) > 1
    scale = np.abs(q).max() + sizes[:, moving].max(initial=0.0)
    if not (np.isfinite(sizes[:, moving]).all() and scale > 0):
        return None
    seen = moving & (sizes.max(axis=0) > SEEN * tol * scale)
    lasts = fast[-rates.real * duration < LASTS].max(initial=0.0)  # backwards all grows
    turned = angle_turned(duration, float(lasts))
    return turned, max(turned, angle_turned(duration, float(fast[seen].max(initial=0.0))))


@per_scene
def _linear(system: System) -> ca.Function:
    """(q, p, t, c) → M, ∂(M a)/∂q, ∂(M a)/∂v, v and M a, as columns: Lagrange's equations."""
    s, n = system, system.structure.n
    force = ca.substitute(s.force, s.control, 0 * s.control)
    inertial = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    push = ca.gradient(s.lagrangian, s.q) + force - inertial
    slopes = [s.mass_matrix, ca.jacobian(push, s.q), ca.jacobian(push, s.v)]
    outputs = [*map(ca.densify, slopes), s.v, ca.densify(push)]
    by_speed = ca.Function("linear", [s.q, s.v, s.t, s.c], outputs)
    velocity = velocity_function(system)
    symbol = ca.SX.sym if velocity.is_a("SXFunction") else ca.MX.sym
    q, p, t, c = (symbol(x, k) for x, k in zip("qptc", (n, n, 1, s.c.numel()), strict=True))
    found = by_speed(q, velocity(q, p, t, c), t, c)
    return ca.Function("linear", [q, p, t, c], found)
