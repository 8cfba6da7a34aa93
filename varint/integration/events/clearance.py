"""Steps along which every gap certainly stays open: bounds along whole steps, cheap ones first.

Boxes around many steps at once, then enclosures of single steps, then of parts of the few steps
that are still in doubt, whose ends are sub-steps of the rule.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from varint.integration.events.contacts import passage_function
from varint.integration.events.enclosures import (
    Pieces,
    boxes,
    enclosure,
    gap_enclosure_function,
    gap_floor_function,
    lower_bound,
)
from varint.integration.problem import InitialValueProblem
from varint.integration.state import RunState
from varint.numerics.arrays import over_columns
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.system import System

TREE = 10  # boxes that make a larger one
HALVINGS = 3  # of a step in doubt; then it is looked at by itself
AT_ONCE = 10  # steps in doubt: most often the first of them is the one in which something happens


class Nodes(NamedTuple):
    """States of the stepper at nodes one step apart, (M + 1, …), velocities, gaps and their rates,
    times; and the index of the first.
    """

    x: np.ndarray
    v: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    t: np.ndarray
    k: int


class Ends(NamedTuple):
    """States at one end of pieces, (M, …)."""

    q: np.ndarray
    v: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    t: np.ndarray


def least_gaps(system: System, left: Ends, right: Ends, c: np.ndarray) -> np.ndarray:
    """Lower bounds of every gap along pieces of the motion, (M, contacts)."""
    w = right.t - left.t
    pieces = Pieces(left.q, left.v, right.q, right.v, left.t, w)
    none = np.zeros(4 * system.control.numel())  # gaps know no controls
    e = enclosure(gap_enclosure_function(system), pieces, none, c)
    return lower_bound((left.gap, right.gap, left.rate, right.rate), w[:, None], e)


def may_close(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    at: RunState,
    nodes: Nodes,
    close: np.ndarray,
) -> np.ndarray:
    """For each step whether a gap that is open may close in it, true only up to the first that
    does; gaps within `close` of zero touch.
    """
    assert at.active_set is not None
    n, doubtful = system.structure.n, np.zeros(len(nodes.x) - 1, dtype=bool)
    free = np.array([i not in at.active_set.holding for i in range(nodes.gap.shape[1])])
    q = np.ascontiguousarray(nodes.x[:, :n])
    every = Ends(q, nodes.v, nodes.gap, nodes.rate, nodes.t)
    left, right = Ends(*(a[:-1] for a in every)), Ends(*(a[1:] for a in every))
    pieces = Pieces(left.q, left.v, right.q, right.v, left.t, right.t - left.t)
    near = np.flatnonzero(~_far(system, pieces, free, problem.c))
    if not len(near):
        return doubtful

    def in_doubt(left: Ends, right: Ends) -> np.ndarray:
        least = least_gaps(system, left, right, problem.c)
        return ~((least >= -close) | ~free).all(axis=1)

    near = near[in_doubt(_rows(left, near), _rows(right, near))]
    for first in range(0, len(near), AT_ONCE):
        some = near[first : first + AT_ONCE]
        doubtful[some] = _halve(
            system,
            rule,
            problem,
            at,
            nodes,
            some,
            (_rows(left, some), _rows(right, some)),
            in_doubt,
        )
        if doubtful[some].any():
            break
    return doubtful


def _rows(ends: Ends, which: np.ndarray) -> Ends:
    return Ends(*(a[which] for a in ends))


def _join(first: Ends, second: Ends) -> Ends:
    return Ends(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def _far(system: System, pieces: Pieces, free: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Steps whose boxes, or those around ten, a hundred … of them, lie wholly where all gaps are
    open.
    """
    count = len(pieces.t)
    low, high, begin, end = boxes(pieces)
    far, function = np.zeros(count, dtype=bool), gap_floor_function(system)
    size = TREE ** int(np.log10(count) + 0.5)
    while size:
        edges = np.arange(0, count, size)
        asked = ~np.logical_and.reduceat(far, edges)
        around = (
            np.minimum.reduceat(low, edges)[asked],
            np.maximum.reduceat(high, edges)[asked],
            np.minimum.reduceat(begin, edges)[asked, None],
            np.maximum.reduceat(end, edges)[asked, None],
        )
        if asked.any():
            floors = over_columns(function, *around, c)[0]
            is_far = np.zeros(len(edges), dtype=bool)
            is_far[asked] = ((floors > 0) | ~free).all(axis=1)
            far |= np.repeat(is_far, np.diff(np.append(edges, count)))
        size //= TREE
    return far


def _halve(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    at: RunState,
    nodes: Nodes,
    steps: np.ndarray,
    ends: tuple[Ends, Ends],
    in_doubt: Callable[[Ends, Ends], np.ndarray],
) -> np.ndarray:
    """Which of the steps are still in doubt when their parts are looked at."""
    assert at.active_set is not None
    n, m, active_set = system.structure.n, system.contact.numel(), at.active_set
    function = passage_function(system, rule, active_set.rows, active_set.contacts)
    left, right = ends
    step = np.arange(len(steps))
    begin, end = np.zeros(len(steps)), np.ones(len(steps))
    for _ in range(HALVINGS):
        middle = (begin + end) / 2
        k = steps[step]
        u = _controls(rule, problem, nodes.k + k, middle)
        ahead = middle * problem.h
        clock = np.column_stack([nodes.t[k], ahead])
        flat = over_columns(function, nodes.x[k, : 4 * n], at.scale, u, problem.c, clock)[0]
        seen = flat[:, 4 * n + 2 :]
        parts = np.split(seen[:, : n + 2 * m], [n, n + m], axis=1)
        v, gap, rate = (x.copy() for x in parts)
        between = Ends(flat[:, :n].copy(), v, gap, rate, nodes.t[k] + ahead)
        doubts = in_doubt(left, between), in_doubt(between, right)
        if not (doubts[0].any() or doubts[1].any()):
            return np.zeros(len(steps), dtype=bool)
        step = np.concatenate([step[doubt] for doubt in doubts])
        begin = np.concatenate([begin[doubts[0]], middle[doubts[1]]])
        end = np.concatenate([middle[doubts[0]], end[doubts[1]]])
        left, right = (
            _join(_rows(left, doubts[0]), _rows(between, doubts[1])),
            _join(_rows(between, doubts[0]), _rows(right, doubts[1])),
        )
    return np.isin(np.arange(len(steps)), step)


def _controls(
    rule: Rule, problem: InitialValueProblem, steps: np.ndarray, fraction: np.ndarray
) -> np.ndarray:
    """Controls at the rule's nodes of sub-steps from the beginning of steps, (M, r·k)."""
    nodes, u = np.array(rule.nodes), problem.u[steps]
    if not u.size:
        return np.empty((len(steps), 0))
    if u.shape[1] == 1:
        return np.repeat(u, len(nodes), axis=1).reshape(len(steps), -1)
    tables = lagrange_values(nodes, (nodes * fraction[:, None]).ravel())
    return (tables.reshape(-1, len(nodes), len(nodes)) @ u).reshape(len(steps), -1)
