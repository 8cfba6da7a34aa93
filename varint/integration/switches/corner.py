"""Where the potential itself jumps: the momentum across the jump changes so that the action is
stationary there, by refraction or, where the motion is too slow for the higher side, by reflection.

δ∫ L dt = 0 with L different on both sides of σ(q, t) = 0 demands [p] = λ ∂σ/∂q and [H] = −λ ∂σ/∂t
(Weierstrass & Erdmann; Gelfand & Fomin, Calculus of Variations, §15).
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from varint.integration.switches.branch import Branch, branch_scene
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import call
from varint.results.records import State
from varint.scene.memory import per_system
from varint.scene.system import System

BESIDE, TINY = 16 * np.finfo(float).eps, 1e-300
NO_JUMP = 1e-12  # of the Lagrangian's terms: round-off of the place of the switch


@per_system
def _corner_function(system: System) -> ca.Function:
    """(q, v, t, c) → L, what switches (its slope and rate at rest of q), M."""
    scene = branch_scene(system)
    frozen = frozen_scene(system)
    assert scene is not None and frozen is not None
    s = scene.system
    outputs = [s.lagrangian, ca.jacobian(frozen.sigma, s.q), ca.jacobian(frozen.sigma, s.t)]
    outputs.append(s.mass_matrix)
    return ca.Function(
        "corner", [s.q, s.v, s.t, s.c], [ca.densify(x) for x in outputs], {"cse": True}
    )


@per_system
def may_jump(system: System) -> bool:
    """Whether the potential may jump: not where the Lagrangian knows of switches by kinks alone."""
    frozen = frozen_scene(system)
    assert frozen is not None
    return ca.depends_on(frozen.system.lagrangian, frozen.s)


def past_corner(
    system: System,
    state: State,
    c: np.ndarray,
    direction: float,
    before: Branch,
    after: Branch,
) -> tuple[np.ndarray, np.ndarray, Branch] | None:
    """Coordinates, momenta and the branch after a switch; None where they are not determined."""
    stays = state.q, state.p, after
    if not may_jump(system):
        return stays
    corner = _corner_function(system)
    at = state.q, state.v, np.array([state.t])
    old, slopes, rates, mass = call(corner, *at, all_parameters(c, before))
    new = call(corner, *at, all_parameters(c, after))[0]
    jump = float(new[0] - old[0])
    size = abs(float(state.p @ state.v)) + abs(float(old[0])) + abs(float(new[0]))
    if abs(jump) <= NO_JUMP * size:
        return stays
    n, m = len(state.q), len(before.values)
    normals = slopes.reshape(n, m).T
    crossed = [j for j in range(m) if before.values[j] != after.values[j] and normals[j].any()]
    if not crossed:  # by time alone
        return stays
    s = system.structure
    if len(crossed) > 1 or not s.quadratic_kinetic or s.constraints:
        return None
    normal = normals[crossed[0]]
    pace = float(normal @ state.v + rates[crossed[0]])
    softness = float(normal @ np.linalg.solve(mass.reshape(n, n).T, normal))
    square = pace**2 + 2 * softness * jump
    passes = square > 0
    leaves = math.copysign(math.sqrt(square), pace) if passes else -pace
    p = state.p + (leaves - pace) / softness * normal
    # on the side to which it goes, by no more than round-off
    off = BESIDE * float(np.abs(normal) @ np.abs(state.q) + abs(leaves * state.t)) + TINY
    q = state.q + math.copysign(off, leaves * direction) / float(normal @ normal) * normal
    return q, p, after if passes else before
