"""Equations of a step as a loop over the nodes of the rule, see c/nodes.c: a scene's own functions
are those of one node, however many there are.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.band import VECTOR, Band, band
from varint.discrete.equations import VANISHES, Equations
from varint.rules.rule import Rule
from varint.scene.system import System

# operations at all nodes of what the residual is made of, from which on what is left of it at the
# end of a step is found in a loop; below, written out it is as short
LOOPED_ENDS = 200
# operations of the derivatives at all nodes, times the number of control points that they are for,
# from which on they are a loop too: below, written out they take 5 to 10 % less time; above, more,
# and compile far slower (a top in gauss(4): 97 s against 2 s). With angles, whose sines at several
# nodes are found together if written out; and without constraints, where little is left to do but
# to wait for them
LOOPED, LOOPED_WITH_ANGLES, LOOPED_FREE = 1_800, 3_600, 5_000
# operations of a node's derivatives from which on they are taken direction by direction: a row of
# statements so long takes the compiler a time that grows with the square of its length
BY_DIRECTIONS = 12_000
SINES = ca.OP_SIN, ca.OP_COS
NOWHERE = np.zeros(0, dtype=int)
COUNTS = (
    "AT_NODES",
    "SLOPES_AT_NODES",
    "COUPLED",
    "GAP_NONZEROS",
    "MOMENTUM_BY_Q",
    "PUSH_BY_Q",
    "PUSH_BY_V",
    "STEADY_INERTIA",
    "BY_DIRECTIONS",
)
PLACES = "FROM", "COUPLED_ROW", "COUPLED_COLUMN", "GAP_ROW", "GAP_COLUMN"
TABLES = "BASIS", "SLOPES", "WEIGHTS", "POINT_TIMES"
Functions = dict[str, tuple[list[ca.SX], list[ca.SX]]]


@dataclass(frozen=True, eq=False)
class Nodes:
    """What c/nodes.c needs of a rule and of the derivatives at a node, by the names it has there;
    as it is, where nothing is a loop over the nodes.
    """

    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTS, 0))
    places: dict[str, np.ndarray] = field(default_factory=lambda: dict.fromkeys(PLACES, NOWHERE))
    tables: dict[str, np.ndarray] = field(
        default_factory=lambda: dict.fromkeys(TABLES, np.zeros(1))
    )


class NodeLoop(NamedTuple):
    """The functions of one node and what the loop over them needs; where the derivatives are part
    of the loop, the order of their matrix.
    """

    functions: Functions
    nodes: Nodes
    band: Band | None


class _Node(NamedTuple):
    """Mechanics at one node: q, v, t, controls and multipliers; momentum, force with reactions, and
    gaps; the slope of these.
    """

    state: list[ca.SX]
    values: list[ca.SX]
    gap_slope: ca.SX


def node_loop(system: System, rule: Rule, e: Equations, slopes: bool = True) -> NodeLoop | None:
    """The residual as a loop over the nodes, and its derivatives where these are long; `slopes`:
    they are asked for. None where written out it is as short.
    """
    s, nodes = system, len(rule.nodes)
    if rule.degree == 1 or s.nonholonomic.numel():
        return None
    lam, rows = ca.SX.sym("lam", s.structure.constraints), ca.jacobian(s.constraint, s.q)
    values = [s.momentum, s.generalised_force + ca.mtimes(rows.T, lam), s.constraint]
    node = _Node([s.q, s.v, s.t, s.control, lam], values, rows)
    held = bool(s.structure.constraints)
    if held and nodes * _function(system, node, values).n_instructions() < LOOPED_ENDS:
        return None
    n, m, inner = s.structure.n, s.structure.constraints, s.structure.n * rule.degree
    (of_p, of_gap), (by_p, by_gap) = ((x[:n], x[inner:][:m]) for x in (e.row_size, e.judged))
    functions: Functions = {
        "node_values": (node.state, values),
        "row_units": ([], [ca.vertcat(e.h, 1 / of_p, 1 / of_gap)]),
        "judged": ([e.y, e.q, e.p, e.t, e.gained], [ca.vertcat(by_p, by_gap)]),
        "units": ([], [e.y_size]),
    }
    basis, rates = (np.where(abs(x) > VANISHES, x, 0.0)[:, 1:] for x in (rule.basis, rule.slopes))
    only_values = Nodes(
        Nodes().counts | {"AT_NODES": 1},
        tables={
            "BASIS": basis.ravel(),
            "SLOPES": rates.ravel(),
            "WEIGHTS": np.array(rule.weights),
            "POINT_TIMES": np.array(rule.nodes),
        },
    )
    found = NodeLoop(functions, only_values, None)
    whole = _with_slopes(system, node, found, basis, rates) if slopes else None
    return whole or (found if held else None)


def _function(system: System, node: _Node, outputs: list[ca.SX]) -> ca.Function:
    return ca.Function("node", [*node.state, system.c], outputs, {"cse": True})


def _with_slopes(
    system: System, node: _Node, loop: NodeLoop, basis: np.ndarray, rates: np.ndarray
) -> NodeLoop | None:
    """The loop with the derivatives; None where these are short if written out."""
    s, (nodes, d) = system, basis.shape
    slopes = _slopes(system, node)
    pattern = slopes[0].sparsity()
    for slope in slopes[1:]:
        pattern = pattern + slope.sparsity()
    varies = ca.depends_on(slopes[1], ca.vertcat(s.q, s.v, s.t, s.control))
    steady = not (varies or slopes[0].nnz())
    nonzeros = [ca.project(x, pattern).nz[:] if x.nnz() else ca.SX(0, 1) for x in slopes]
    functions = dict(loop.functions)
    if steady:
        functions["node_inertia"], nonzeros[1] = ([], [nonzeros[1]]), ca.SX(0, 1)
    every = [*node.values, node.gap_slope.nz[:], *nonzeros]
    whole = _function(system, node, every)
    size = whole.n_instructions()
    angles = any(whole.instruction_id(k) in SINES for k in range(size))
    with_gaps = LOOPED_WITH_ANGLES if angles else LOOPED
    if size * nodes * d < (with_gaps if s.structure.constraints else LOOPED_FREE):
        return None
    if size > BY_DIRECTIONS:
        turn = [ca.SX.sym(name, s.structure.n) for name in ("dq", "dv")]
        turns = [
            sum(ca.jtimes(x, y, dy) for y, dy in zip((s.q, s.v), turn, strict=True))
            for x in node.values
        ]
        functions["node_turn"] = [*node.state, *turn], turns
    else:
        functions["node_slopes"] = node.state, every
    rows = node.gap_slope.sparsity()
    at, within = _places([x.sparsity() for x in slopes], pattern, rows, basis, rates)
    unknowns = d * (pattern.size1() + rows.size1())
    order = band(ca.Sparsity.triplet(unknowns, unknowns, *at[:, within].tolist()))
    place = np.empty_like(order.order)
    place[order.order] = np.arange(unknowns)
    row, column = place[at]
    places = row * (order.below + order.reach) + order.below + column
    number, count = np.arange(len(within)), pattern.nnz()
    number += np.minimum(number // count, d * d) * (-count % VECTOR)  # blocks are whole vectors
    taken = np.flatnonzero(within)
    taken = taken[np.argsort(places[taken])]  # the rows that are needed last are stored last
    moves, _, pushed, slowed = (int(x.nnz() > 0) for x in slopes)
    (row, column), (gap, of) = (
        np.array(x.get_triplet(), dtype=int).reshape(2, -1) for x in (pattern, rows)
    )
    counts = {
        "SLOPES_AT_NODES": 1,
        "COUPLED": count,
        "GAP_NONZEROS": rows.nnz(),
        "MOMENTUM_BY_Q": moves,
        "PUSH_BY_Q": pushed,
        "PUSH_BY_V": slowed,
        "STEADY_INERTIA": int(steady),
        "BY_DIRECTIONS": int("node_turn" in functions),
    }
    placed = dict(zip(PLACES, (number[taken], row, column, gap, of), strict=True))
    return NodeLoop(
        functions,
        Nodes(loop.nodes.counts | counts, placed, loop.nodes.tables),
        replace(order, places=places[taken]),
    )


def _slopes(system: System, node: _Node) -> list[ca.SX]:
    """Of momentum and force, by q and v each; what derivatives of L have in common is found in one
    of them alone.
    """
    s, lam = system, node.state[-1]
    pull = ca.gradient(s.lagrangian, s.q) + ca.mtimes(node.gap_slope.T, lam)
    by_q = ca.jacobian(s.momentum, s.q)
    return [
        by_q,
        _symmetric(ca.jacobian(s.momentum, s.v)),
        _symmetric(ca.jacobian(pull, s.q)) + ca.jacobian(s.force, s.q),
        by_q.T + ca.jacobian(s.force, s.v),
    ]


def _symmetric(matrix: ca.SX) -> ca.SX:
    """Itself, the elements above the diagonal from those below it."""
    return ca.tril(matrix) + ca.tril(matrix, False).T


def _places(
    slopes: list[ca.Sparsity],
    pattern: ca.Sparsity,
    rows: ca.Sparsity,
    basis: np.ndarray,
    rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the numbers that c/nodes.c gives of the matrix, in its order, and which
    of them do not vanish by their form.

    Parameters
    ----------
    slopes : list of Sparsity
        Of momentum and force, by q and v each.
    pattern, rows : Sparsity
        All of these together, and the slope of the constraints.
    basis, rates : array (nodes, d)
    """
    n, m, d = pattern.size1(), rows.size1(), basis.shape[1]
    row, column = (np.array(x, dtype=int) for x in pattern.get_triplet())
    gap, of = (np.array(x, dtype=int) for x in rows.get_triplet())
    by_push = basis - (np.arange(d) == d - 1)
    factors = [abs(x).T @ abs(y) > 0 for x in (rates, by_push) for y in (basis, rates)]
    there = [np.array([x.has_nz(*at) for at in zip(row, column, strict=True)]) for x in slopes]
    found, within = [], []
    for j in range(d):
        for k in range(d):
            found.append((j * n + row, k * n + column))
            within.append(
                np.any([x[j, k] & y for x, y in zip(factors, there, strict=True)], axis=0)
            )
    for i in range(d + 1 if m else 0):
        pulls = ([d - 1] if i < d else []) + ([i - 1] if 0 < i < d else [])
        found += [(j * n + of, n * d + i * m + gap) for j in pulls]
        if i:
            found.append((n * d + (i - 1) * m + gap, (i - 1) * n + of))
    at = np.hstack(found)
    rest = np.ones(at.shape[1] - sum(map(len, within)), dtype=bool)
    return at, np.concatenate([*within, rest])
