"""How the unknowns of a step are found: by a map, in closed form, in a band, or with equations that
are a loop over the nodes of the rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from varint.codegen.band import Band, band
from varint.codegen.frozen import frozen_slope, no_whole_derivatives
from varint.codegen.nodes import NOWHERE, Functions, NodeLoop, Nodes, node_loop
from varint.discrete.equations import Equations, start_row
from varint.discrete.tolerances import (
    LAST_CORRECTION,
    LAST_FROZEN_CORRECTION,
    LAST_LINEAR_CORRECTION,
)
from varint.numerics.limits import CLOSED
from varint.rules.rule import Rule
from varint.scene.system import System

MAPPED = 12  # so many unknowns of a linear scene: a full matrix times (q, p) is the cheapest step


@dataclass(frozen=True, eq=False)
class Solution:
    """How the unknowns are found: the functions for it, the order of the band, what makes it
    simpler (`steady`: of a map, that it is the same at all times); what a loop over the nodes of
    the rule needs; whether the matrix is not their derivative but near it, and
    the same all through a step; so many of the unknowns, the first ones, tell when to stop, where
    the equations are linear in the others (0: all of them).
    """

    functions: Functions
    band: Band
    closed: bool
    linear: bool
    map: bool
    steady: bool = False
    nodes: Nodes = field(default_factory=Nodes)
    frozen: bool = False
    judged: int = 0

    @property
    def last_correction(self) -> float:
        """Relative correction after which nothing is left to correct."""
        if self.linear:
            return LAST_LINEAR_CORRECTION
        return LAST_FROZEN_CORRECTION if self.frozen else LAST_CORRECTION


def solution_of(system: System, rule: Rule, e: Equations, held: bool) -> Solution:
    """The cheapest way to the unknowns of the equations; `held`: there are constraints."""
    linear = system.structure.linear and not held
    if no_whole_derivatives(system) and not system.structure.linear:
        found = _frozen(e, frozen_slope(system, rule, e))
        return _in_loop(found, node_loop(system, rule, e, slopes=False))
    if not held and (shorter := _without_end(system, rule, e)):
        return shorter
    loop = None if linear or e.y.numel() <= CLOSED else node_loop(system, rule, e)
    if loop and loop.band:
        return Solution(loop.functions, loop.band, False, False, False, nodes=loop.nodes)
    return _in_loop(_written_out(e, linear), loop)


def _in_loop(written: Solution, loop: NodeLoop | None) -> Solution:
    """What is left of the equations at the end of a step as a loop over the nodes, and where the
    matrix is frozen the equations too.
    """
    if not loop:
        return written
    apart = {"finish", "equations"} if written.frozen else {"finish"}
    kept = {name: f for name, f in written.functions.items() if name not in apart}
    return replace(written, functions=kept | loop.functions, nodes=loop.nodes)


def _without_end(system: System, rule: Rule, e: Equations) -> Solution | None:
    """Newton's correction in closed form where forces at the end push the momentum alone, and few
    unknowns are left inside.

    The row of the start is then linear in all unknowns: its constant block eliminates the end, and
    the adjugate of its Schur complement is straight-line code.
    """
    n, size = system.structure.n, e.y.numel()
    inside = size - n
    if system.structure.linear or size <= CLOSED or not 0 < inside <= CLOSED:
        return None
    varying = ca.vertcat(e.y, e.q, e.p, e.t, e.u)
    row = start_row(system, rule, e) / e.row_size[inside:]
    by_inner, by_end = ca.horzsplit(ca.densify(ca.jacobian(row, e.y)), [0, inside, size])
    if ca.depends_on(ca.horzcat(by_inner, by_end), varying):
        return None
    left = ca.densify(e.left[:inside] / e.row_size[:inside])
    inner, coupled = ca.horzsplit(ca.densify(ca.jacobian(left, e.y)), [0, inside, size])
    judged = 0 if ca.depends_on(coupled, varying) else inside
    inverse = ca.inv_minor(by_end)
    apart, by_inside = inverse @ row, inverse @ by_inner
    schur = inner - coupled @ by_inside
    correction = ca.inv_minor(schur) @ (left - coupled @ apart)
    every = ca.vertcat(correction, apart - by_inside @ correction)
    inputs, unordered = [e.y, e.q, e.p, e.t, e.u], Band(np.arange(size), 0, 0, NOWHERE, 0)
    functions: Functions = {"equations": (inputs, [every]), **_after(e)}
    return Solution(functions, unordered, True, False, False, judged=judged)


def _written_out(e: Equations, linear: bool) -> Solution:
    left = ca.densify(e.left / e.row_size)
    matrix = ca.jacobian(left, e.y)
    linear = linear and not ca.depends_on(matrix, ca.vertcat(e.y, e.q, e.p, e.t, e.u))
    unordered = Band(np.arange(e.y.numel()), 0, 0, NOWHERE, 0)
    if linear and e.y.numel() <= MAPPED:
        return _map(e, left, matrix)
    inputs, after = [e.y, e.q, e.p, e.t, e.u], _after(e)
    if not linear and e.y.numel() <= CLOSED:
        correction = ca.mtimes(ca.inv_minor(ca.densify(matrix)), left)
        return Solution(
            {"equations": (inputs, [correction]), **after}, unordered, True, False, False
        )
    order = band(matrix.sparsity())
    ordered = left[order.order.tolist()]
    if linear:
        functions = {"equations": (inputs, [ordered]), "slope": ([], [matrix.nz[:]])}
        return Solution(functions | after, order, False, True, False)
    return Solution(
        {"equations": (inputs, [ordered, matrix.nz[:]]), **after}, order, False, False, False
    )


def _after(e: Equations) -> Functions:
    """What follows the solution, and units of the unknowns."""
    return {
        "finish": ([e.y, e.q, e.p, e.t, e.u], [e.increment, e.gain, e.remains]),
        "units": ([], [e.y_size]),
    }


def _frozen(e: Equations, matrix: ca.SX) -> Solution:
    order = band(matrix.sparsity())
    left = ca.densify(e.left / e.row_size)[order.order.tolist()]
    functions: Functions = {
        "equations": ([e.y, e.q, e.p, e.t, e.u], [left]),
        "frozen": ([e.y, e.q, e.t], [matrix.nz[:]]),
    }
    return Solution(functions | _after(e), order, False, False, False, frozen=True)


def _map(e: Equations, left: ca.SX, matrix: ca.SX) -> Solution:
    """The parts of the affine map that a step of a linear scene is; see c/map.h."""
    start, still = ca.vertcat(e.q, e.p), [e.y, e.q, e.p]
    zeros = [ca.SX.zeros(x.shape) for x in still]
    after = ca.vertcat(e.increment, e.gain)
    slopes = [ca.jacobian(left, start), ca.jacobian(after, e.y), ca.jacobian(after, start)]
    # e.y, q and p are zero where these are constant; symbols that stay have no say
    parts = ca.substitute([ca.vec(ca.densify(x)) for x in slopes], still, zeros)
    offset = ca.vertcat(*ca.substitute([left, after], still, zeros))
    functions: Functions = {
        "slope": ([], [matrix.nz[:]]),
        "affine": ([], [ca.vertcat(*parts)]),
        "driven": ([e.t, e.u], [offset]),
        "finish": ([e.y, e.q, e.p, e.t, e.u], [e.increment, e.gain, e.remains]),
    }
    steady = not ca.depends_on(offset, ca.vertcat(e.t, e.u))
    return Solution(functions, band(matrix.sparsity()), False, True, True, steady)
