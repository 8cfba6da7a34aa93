"""A matrix for Newton's method that costs what the mass matrix and the rows do.

The exact derivative of a step's equations holds all second derivatives of L; for a machine of
many links in a loop these are more than all else together. With the inertia as it is where the
step begins, and the rows G as they are, the iteration contracts by about h times the rate at which
the inertia changes, and ends at the same step.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.constrained_equations import constrained_equations
from varint.discrete.equations import Equations
from varint.rules.rule import Rule
from varint.scene.parameters import Parameters, with_more
from varint.scene.system import System

LARGE = 12  # coordinates from which on a scene that knows its mass matrix is solved by it


def freezes(system: System) -> bool:
    """Is the scene a large machine with loops?"""
    s = system.structure
    known = system.kinetics is not None and s.constraints and not s.nonholonomic
    return bool(known) and s.n >= LARGE


def frozen_slope(system: System, rule: Rule, e: Equations) -> ca.SX:
    """∂(left/row_size)/∂y of the equations `e`, with M(q0) in all of the step and no other
    derivative of L.
    """
    s = system
    mass = ca.SX(s.mass_matrix)
    params = with_more(s.params or Parameters(), frozen_inertia=np.ones(mass.nnz()))
    inertia = ca.SX(mass.sparsity(), params.frozen_inertia)
    scene = System(
        s.q, s.v, ca.bilin(inertia, s.v, s.v) / 2, constraint=s.constraint, params=params, t=s.t
    )
    like = constrained_equations(scene, rule)
    own = [like.y, like.q, like.p, like.t, like.h, like.c, like.scale, like.sizes]
    slope = ca.Function("slope", own, [ca.jacobian(like.left / like.row_size, like.y)])
    here = ca.substitute(mass, ca.vertcat(s.q, s.t, s.c), ca.vertcat(e.q, e.t, e.c))
    c = ca.vertcat(e.c, here.nz[:])
    return slope(e.y, e.q, e.p, e.t, e.h, c, e.scale, e.sizes)
