"""How the unknowns of a step are found: by a map, in closed form, in a band, or with equations that
are a loop over the nodes of the rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from varint.codegen.band import Band, band
from varint.codegen.frozen import frozen_slope, no_whole_derivatives
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
# operations of the equations from which on they are a loop over the nodes: below, written out they
# are as fast; above, they run slower and compile far slower (a top in gauss(4): 97 s against 2 s)
LOOPED = 2_500
# operations of a node's derivatives from which on they are taken direction by direction: a row of
# statements so long takes the compiler a time that grows with the square of its length
BY_DIRECTIONS = 12_000
NOWHERE = np.zeros(0, dtype=int)
Functions = dict[str, tuple[list[ca.SX], list[ca.SX]]]


@dataclass(frozen=True, eq=False)
class Solution:
    """How the unknowns are found: the functions for it, the order of the band, what makes it
    simpler (`steady`: of a map, that it is the same at all times); tables of the rule where the
    equations are a loop over its nodes; whether the matrix is not their derivative but near it, and
    the same all through a step; so many of the unknowns, the first ones, tell when to stop, where
    the equations are linear in the others (0: all of them).
    """

    functions: Functions
    band: Band
    closed: bool
    linear: bool
    map: bool
    steady: bool = False
    tables: dict[str, np.ndarray] = field(default_factory=dict)
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
    if no_whole_derivatives(system) and not system.structure.linear:
        return _frozen(e, frozen_slope(system, rule, e))
    if held:
        return _written_out(e, False)
    shorter = _without_end(system, rule, e) or _at_nodes(system, rule, e)
    return shorter or _written_out(e, system.structure.linear)


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


def _at_nodes(system: System, rule: Rule, e: Equations) -> Solution | None:
    """The equations as a loop over the nodes of the rule, where they are long if written out."""
    s, n, d, nodes = system, system.structure.n, rule.degree, len(rule.nodes)
    if s.structure.linear or d == 1 or e.y.numel() <= CLOSED:
        return None
    state, push = [s.q, s.v, s.t, s.control], s.generalised_force
    slopes = [ca.jacobian(x, y) for x in (s.momentum, push) for y in (s.q, s.v)]
    pattern = slopes[0].sparsity()
    for slope in slopes[1:]:
        pattern = pattern + slope.sparsity()
    values = [s.momentum, push]
    every = [*values, *(ca.project(slope, pattern).nz[:] for slope in slopes)]
    size = ca.Function("node", [*state, s.c], every, {"cse": True}).n_instructions()
    if size * nodes < LOOPED:
        return None
    if size > BY_DIRECTIONS:
        q_turn, v_turn = ca.SX.sym("dq", n), ca.SX.sym("dv", n)
        turns = [ca.jtimes(x, s.q, q_turn) + ca.jtimes(x, s.v, v_turn) for x in values]
        slopes_of: Functions = {"node_turn": ([*state, q_turn, v_turn], turns)}
    else:
        slopes_of = {"node_slopes": (state, every)}
    functions: Functions = slopes_of | {
        "node_values": (state, values),
        "row_units": ([], [ca.vertcat(e.h, e.row_size[:n])]),
        "judged": ([e.y, e.q, e.p, e.t], [e.judged[:n]]),
        "units": ([], [e.y_size]),
    }
    order = band(ca.repmat(pattern, d, d))
    rows, columns = np.array(pattern.row()), np.array(pattern.get_triplet()[1])
    place = np.empty_like(order.order)
    place[order.order] = np.arange(n * d)
    blocks = [
        place[j * n + rows] * (order.below + order.reach) + order.below + place[k * n + columns]
        for j in range(d)
        for k in range(d)
    ]
    tables = {
        "BASIS": rule.basis[:, 1:].ravel(),
        "SLOPES": rule.slopes[:, 1:].ravel(),
        "WEIGHTS": np.array(rule.weights),
        "POINT_TIMES": np.array(rule.nodes),
        "COUPLED_ROW": rows,
        "COUPLED_COLUMN": columns,
    }
    band_of_blocks = replace(order, places=np.concatenate(blocks))
    return Solution(functions, band_of_blocks, False, False, False, tables=tables)


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
