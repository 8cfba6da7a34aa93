"""A matrix for Newton's method that costs what the mass matrix and the rows do.

The exact derivative of a step's equations holds all second derivatives of L and of the rows; for a
machine of many links in a loop these are more than all else together. With the inertia M and the
rows G as they are halfway through the step, and what springs and dampers resist there, the same for
some iterations, this contracts by about h/2 times the rate at which they change, and ends at the
same step.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.constrained_equations import constrained_equations
from varint.discrete.equations import Equations, implicit_equations
from varint.rules.rule import Rule
from varint.scene.parameters import Parameters, with_more
from varint.scene.system import System

LARGE = 12  # coordinates from which on a scene that knows its mass matrix is solved by it
LARGE_TREE = 24  # and from which on, without loops, whole derivatives take half a minute or more
PARTS = ("inertia", "rows", "stiffness", "damping")  # of the matrix


def freezes(system: System) -> bool:
    """Is the scene a large machine with loops?"""
    s = system.structure
    known = system.kinetics is not None and s.constraints and not s.nonholonomic
    return bool(known) and s.n >= LARGE


def no_whole_derivatives(system: System) -> bool:
    """Is the scene a machine so large that second derivatives of its L take minutes to set up?"""
    s, known = system.structure, system.kinetics
    tree = known is not None and known.velocity.numel() and not (s.constraints or s.nonholonomic)
    return freezes(system) or (bool(tree) and s.n >= LARGE_TREE)


def stiff_tree(system: System) -> bool:
    """Is it a large tree that resists by springs or dampers? Where the stages' iteration fails
    for them, Newton's method with this matrix does not; without them shorter steps are taken.
    """
    large = no_whole_derivatives(system) and not freezes(system)
    return large and system.kinetics is not None and system.kinetics.resists


def frozen_slope(system: System, rule: Rule, e: Equations) -> ca.SX:
    """∂(left/row_size)/∂y of the equations `e` with inertia, rows, stiffness and damping taken in
    the middle of the step's chord, (q0 + q1)/2 and (q1 − q0)/h as `e.y` has it, and no other
    derivative of L, of the forces or of the rows.
    """
    s, n, known = system, system.structure.n, system.kinetics
    assert known is not None
    zeros = [ca.SX(n, n) if not x.numel() else x for x in (known.stiffness, known.damping)]
    matrices = [ca.SX(s.mass_matrix), ca.jacobian(s.constraint, s.q), *zeros]
    names = {f"frozen_{part}": x for part, x in zip(PARTS, matrices, strict=True)}
    given = {name: np.ones(x.nnz()) for name, x in names.items() if x.nnz()}
    params = with_more(s.params or Parameters(), **given)
    inertia, rows, stiffness, damping = (
        ca.SX(x.sparsity(), getattr(params, name) if name in given else ca.SX(0, 1))
        for name, x in names.items()
    )
    scene = System(
        s.q,
        s.v,
        ca.bilin(inertia, s.v, s.v) / 2 - ca.bilin(stiffness, s.q, s.q) / 2,
        constraint=ca.mtimes(rows, s.q),
        force=-ca.mtimes(damping, s.v),
        params=params,
        t=s.t,
    )
    held = bool(s.structure.constraints)
    like = (constrained_equations if held else implicit_equations)(scene, rule)
    own = [like.y, like.q, like.p, like.t, like.h, like.c, like.scale, like.sizes]
    slope = ca.Function("slope", own, [ca.jacobian(like.left / like.row_size, like.y)])
    last = slice((rule.degree - 1) * n, rule.degree * n)  # of the mean velocity of the step
    middle = ca.vertcat(e.q + e.h / 2 * e.y[last], e.y[last], e.t + e.h / 2, e.c)
    found = ca.vertcat(*(x.nz[:] for x in matrices if x.nnz()))
    c = ca.vertcat(e.c, ca.substitute(found, ca.vertcat(s.q, s.v, s.t, s.c), middle))
    return slope(e.y, e.q, e.p, e.t, e.h, c, e.scale, e.sizes)
