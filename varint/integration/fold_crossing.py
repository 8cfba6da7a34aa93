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
NEAR = 0.1  # of a step: how well the distances at earlier nodes tell where a fold lies
BEHIND = 1.5  # steps from the node before a fold to the fold: told later on
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
    leaps = _may_meet(rule, windows.far)
    for part in PARTS:
        some = np.flatnonzero(leaps)
        if not len(some):
            break
        leaps[some] = _differ(steps, rule, problem, windows.at(some), part)
    return leaps


@np.errstate(all="ignore")
def _may_meet(rule: Rule, far: np.ndarray) -> np.ndarray:
    """Which of the folds between the middle nodes of windows may lie on a node within the step, as
    far as the distances before it tell, by a line and a parabola through the last of them.

    A step whose ends alone are nodes of the rule goes over a fold between them; and a fold in the
    step before or behind has a window of its own.
    """
    within = np.array([x for x in {*rule.nodes, *rule.points} if 0 < x < 1])
    first, before, begin = far[:, : OVER + 1].T
    fall, bend = before - begin, first - 2 * before + begin
    line = begin / fall
    # begin − fall x + bend x (x + 1) / 2 = 0, by its smaller root
    slope = fall - bend / 2
    curve = 2 * begin / (slope + np.sqrt(slope**2 - 2 * bend * begin))
    at = np.where(first >= 0, curve, line)
    about = NEAR + np.where(first >= 0, np.abs(curve - line), 0.0)
    told = (before >= 0) & (begin >= 0) & (at >= 0) & (at <= BEHIND)
    away = np.abs(at[:, None] - within).min(axis=1, initial=np.inf) > about
    ahead, usual = first - 2 * before, first - before  # beyond the fold, as the line has it
    passed = (first >= 0) & (ahead > 2 * NEAR * usual) & (np.abs(begin - ahead) < NEAR * usual)
    return ~(told & away) & ~passed


def _differ(
    steps: Steps, rule: Rule, problem: InitialValueProblem, windows: Windows, part: float
) -> np.ndarray:
    own = _apart(steps, rule, problem, windows, part, (OVER,))[:, 0]
    differ = own > LEAST
    some = np.flatnonzero(differ)  # steps beside the others need not be taken
    if not len(some):
        return differ
    beside = _apart(steps, rule, problem, windows.at(some), part, BESIDE)
    known = ~np.isneginf(beside).all(axis=1)
    differ[some] = known & (own[some] > LEAP * beside.max(axis=1, initial=0.0))
    return differ


def _apart(
    steps: Steps,
    rule: Rule,
    problem: InitialValueProblem,
    windows: Windows,
    part: float,
    begin: tuple[int, ...],
) -> np.ndarray:
    """How far the ends of the steps from these nodes of each window are from those of the same
    steps in two parts, of the way or of the momenta; −∞ where a node is not known.
    """
    first = np.array(begin)
    k, q, p = windows.k, windows.q, windows.p
    apart = np.full((len(k), len(first)), -np.inf)
    rows, columns = np.nonzero((k[:, first] >= 0) & (k[:, first + 1] >= 0))
    if not len(rows):
        return apart
    begins, ends = (rows, first[columns]), (rows, first[columns] + 1)
    at = q[begins].copy(), p[begins].copy()
    for share, size in ((0.0, part), (part, 1 - part)):
        t = problem.t0 + problem.h * (k[begins] + share)
        u = _controls(rule, problem, k[begins].astype(int), share, size)
        at = steps(*at, u, t, np.full(len(t), problem.h * size))
    off = [np.abs(new - x[ends]).max(axis=1) for new, x in zip(at, (q, p), strict=True)]
    known = (k[:, :-1] >= 0) & (k[:, 1:] >= 0)
    ways = np.where(known, np.abs(np.diff(q, axis=1)).max(axis=2), 0.0)
    usual = ways.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    momenta = np.where(k >= 0, np.abs(p).max(axis=2), 0.0).max(axis=1)
    way = np.maximum(ways[begins], usual[rows])
    apart[rows, columns] = np.maximum(off[0] / way, off[1] / momenta[rows])
    return apart


def _controls(
    rule: Rule, problem: InitialValueProblem, k: np.ndarray, first: float, size: float
) -> np.ndarray:
    """Controls at the nodes of a part of each of these steps, a row each."""
    u = problem.u[k] if problem.u.size else np.empty((len(k), 1, 0))
    nodes = np.array(rule.nodes)
    if u.shape[1] == 1:
        return np.repeat(u, len(nodes), axis=1).reshape(len(k), -1)
    return (lagrange_values(nodes, first + size * nodes) @ u).reshape(len(k), -1)
