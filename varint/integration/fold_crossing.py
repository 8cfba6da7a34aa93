"""Steps over a fold one of whose own nodes lies on it: its ends do not show it.

There the motion beyond depends on round-off. It is told by going the same way in other steps: over
a fold that no node meets both agree as well as elsewhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.integration.many_steps import Steps
from varint.integration.problem import InitialValueProblem
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule

# of a step: its first part when it is taken in two, whose nodes are none of the rules' own; both
# ways have to lead elsewhere, for the one may meet the fold itself
PARTS = 0.55, 0.37
LEAP = 100.0  # times the difference of the two ways in steps nearby
# of the way and of the momenta: less is round-off that a fold makes larger
LEAST = 1e-7
OVER, BESIDE = 2, (0, 4)  # first nodes, in a window, of the step over a fold and of those beside it
WIDE = 2 * OVER + 2  # nodes of a window: LATELY of c/run.h


class Windows(NamedTuple):
    """Nodes around steps over folds (windows, WIDE, …): two steps before each of them to two behind
    it.

    Their steps' numbers k (−1: there is no such node), q, p, and the distance of a constraint row
    from the others (−1: not known).
    """

    k: np.ndarray
    q: np.ndarray
    p: np.ndarray
    far: np.ndarray

    def at(self, which: np.ndarray | slice) -> Windows:
        """Some of them."""
        return Windows(*(x[which] for x in self))


def crossed_folds(far: np.ndarray) -> np.ndarray:
    """Numbers j of the steps between nodes j and j + 1 in which the distance of a constraint row
    from the others comes to zero, continued in a straight line from either side: beyond a fold
    that a node has met the line may be another one.
    """
    change = np.diff(far)
    over = np.zeros(len(change), dtype=bool)
    over[1:] = far[1:-1] + change[:-1] <= 0
    over[:-1] |= far[1:-1] - change[1:] <= 0
    return np.flatnonzero(over)


def windows_around(steps: np.ndarray, nodes: Windows) -> Windows:
    """The windows around some steps between successive nodes (nodes, …)."""
    which = steps[:, None] + np.arange(-OVER, OVER + 2)
    there = (which >= 0) & (which < len(nodes.k))
    found = nodes.at(np.where(there, which, 0))
    return found._replace(
        k=np.where(there, found.k, -1),
        far=np.where(there, found.far, -1.0),
    )


@np.errstate(all="ignore")  # what is not finite is told elsewhere
def are_leaps(
    steps: Steps, rule: Rule, problem: InitialValueProblem, windows: Windows
) -> np.ndarray:
    """Which of the steps over folds end elsewhere when they are taken in two parts, far more so
    than those beside them.
    """
    leaps = np.ones(len(windows.k), dtype=bool)
    for part in PARTS:
        some = np.flatnonzero(leaps)
        leaps[some] = _differ(steps, rule, problem, windows.at(some), part)
    return leaps


def _differ(
    steps: Steps, rule: Rule, problem: InitialValueProblem, windows: Windows, part: float
) -> np.ndarray:
    begin = np.array([OVER, *BESIDE])
    k, q, p = windows.k, windows.q, windows.p
    known = (k[:, begin] >= 0) & (k[:, begin + 1] >= 0)
    rows, columns = np.nonzero(known)
    begins, ends = (rows, begin[columns]), (rows, begin[columns] + 1)
    if not len(rows):
        return np.zeros(len(k), dtype=bool)
    at = q[begins].copy(), p[begins].copy()
    for first, size in ((0.0, part), (part, 1 - part)):
        t = problem.t0 + problem.h * (k[begins] + first)
        u = _controls(rule, problem, k[begins].astype(int), first, size)
        at = steps(*at, u, t, np.full(len(t), problem.h * size))
    apart = [np.abs(new - x[ends]).max(axis=1) for new, x in zip(at, (q, p), strict=True)]
    way = np.zeros(known.shape)
    way[known] = np.abs(q[ends] - q[begins]).max(axis=1)
    usual_way = way.sum(axis=1) / known.sum(axis=1)
    momenta = np.where(k >= 0, np.abs(p).max(axis=2), 0.0).max(axis=1)
    found = np.zeros(known.shape)
    found[known] = np.maximum(
        apart[0] / np.maximum(way, usual_way[:, None])[known], apart[1] / momenta[rows]
    )
    return known[:, 1:].any(axis=1) & (
        found[:, 0] > np.maximum(LEAP * found[:, 1:].max(axis=1), LEAST)
    )


def _controls(
    rule: Rule, problem: InitialValueProblem, k: np.ndarray, first: float, size: float
) -> np.ndarray:
    """Controls at the nodes of a part of each of these steps, a row each."""
    u = problem.u[k] if problem.u.size else np.empty((len(k), 1, 0))
    nodes = np.array(rule.nodes)
    if u.shape[1] == 1:
        return np.repeat(u, len(nodes), axis=1).reshape(len(k), -1)
    return (lagrange_values(nodes, first + size * nodes) @ u).reshape(len(k), -1)
