"""A matrix for Newton's method that costs what the mass matrix and the rows do.

The exact derivative of a step's equations holds all second derivatives of L and of the rows; for a
machine of many links in a loop these are more than all else together. With the inertia M and the
rows G as they are halfway through the step, the same for all of the iteration, this contracts by
about h/2 times the rate at which they change, and ends at the same step.
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
LARGE_TREE = 24  # and from which on, without loops, whole derivatives take half a minute or more


def freezes(system: System) -> bool:
    """Is the scene a large machine with loops?"""
    s = system.structure
    known = system.kinetics is not None and s.constraints and not s.nonholonomic
    return bool(known) and s.n >= LARGE


def no_whole_derivatives(system: System) -> bool:
    """Is the scene a machine so large that an iteration which fails ends the run: shorter steps
    take less time than Newton's method with all second derivatives of L to be set up?
    """
    s, known = system.structure, system.kinetics
    tree = known is not None and known.velocity.numel() and not (s.constraints or s.nonholonomic)
    return freezes(system) or (bool(tree) and s.n >= LARGE_TREE)


def frozen_slope(system: System, rule: Rule, e: Equations) -> ca.SX:
    """∂(left/row_size)/∂y of the equations `e` with M and G taken in the middle of the step's
    chord, (q0 + q1)/2 as `e.y` has it, and no other derivative of L or of the rows.
    """
    s, n = system, system.structure.n
    mass, rows = ca.SX(s.mass_matrix), ca.jacobian(s.constraint, s.q)
    params = with_more(
        s.params or Parameters(),
        frozen_inertia=np.ones(mass.nnz()),
        frozen_rows=np.ones(rows.nnz()),
    )
    inertia = ca.SX(mass.sparsity(), params.frozen_inertia)
    held = ca.mtimes(ca.SX(rows.sparsity(), params.frozen_rows), s.q)
    scene = System(s.q, s.v, ca.bilin(inertia, s.v, s.v) / 2, constraint=held, params=params, t=s.t)
    like = constrained_equations(scene, rule)
    own = [like.y, like.q, like.p, like.t, like.h, like.c, like.scale, like.sizes]
    slope = ca.Function("slope", own, [ca.jacobian(like.left / like.row_size, like.y)])
    last = slice((rule.degree - 1) * n, rule.degree * n)  # of the mean velocity of the step
    middle = ca.vertcat(e.q + e.h / 2 * e.y[last], e.t + e.h / 2, e.c)
    found = ca.vertcat(mass.nz[:], rows.nz[:])
    c = ca.vertcat(e.c, ca.substitute(found, ca.vertcat(s.q, s.t, s.c), middle))
    return slope(e.y, e.q, e.p, e.t, e.h, c, e.scale, e.sizes)
