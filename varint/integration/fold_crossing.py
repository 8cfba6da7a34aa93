"""Steps over a fold one of whose own nodes lies on it: the saved nodes do not show it.

There the motion beyond depends on round-off. It is told by going the same way in other steps: over
a fold that no node meets both agree as well as elsewhere.
"""

from __future__ import annotations

import numpy as np

from varint.integration.problem import InitialValueProblem
from varint.integration.step_function import step_function
from varint.numerics.arrays import over_columns
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.system import System

# of a step: its first part when it is taken in two, whose nodes are none of the rules' own; both
# ways have to lead elsewhere, for the one may meet the fold itself
PARTS = 0.55, 0.37
LEAP = 100.0  # times the difference of the two ways in intervals nearby
# of the way and of the momenta: less is round-off that a fold makes larger
LEAST = 1e-7
APART = 2  # intervals between one over a fold and those that it is compared with
MOST_STEPS = 100  # in an interval that is gone through again
KEPT = 4  # nodes before a block that tell of folds at its beginning

# coordinates, momenta, step counts, and distances of a constraint row from the others, at nodes
Nodes = tuple[np.ndarray, ...]


def joined(before: Nodes | None, nodes: Nodes) -> Nodes:
    """Nodes after those kept from before, where these are as far apart."""
    if before is None:
        return nodes
    both = tuple(np.concatenate(x) for x in zip(before, nodes, strict=True))
    return both if len(np.unique(np.diff(both[2]))) <= 1 else nodes


def crossed_folds(far: np.ndarray) -> np.ndarray:
    """Numbers j of the intervals between nodes j and j + 1 in which the distance of a constraint
    row from the others comes to zero, continued in a straight line from either side: beyond a fold
    that a node has met the line may be another one.
    """
    change = np.diff(far)
    over = np.zeros(len(change), dtype=bool)
    over[1:] = far[1:-1] + change[:-1] <= 0
    over[:-1] |= far[1:-1] - change[1:] <= 0
    return np.flatnonzero(over)


@np.errstate(all="ignore")  # what is not finite is told elsewhere
def leaps_over_folds(
    system: System, rule: Rule, problem: InitialValueProblem, nodes: Nodes
) -> np.ndarray:
    """Of the intervals in which a fold is crossed those whose end is another one when it is reached
    by other steps.
    """
    over, steps = crossed_folds(nodes[3]), np.unique(np.diff(nodes[2]))
    if len(steps) != 1 or steps[0] > MOST_STEPS:
        return over[:0]
    for part in PARTS:
        over = over[_differ(system, rule, problem, nodes, over, part)]
    return over


def _differ(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    nodes: Nodes,
    over: np.ndarray,
    part: float,
) -> np.ndarray:
    """Which of these intervals end elsewhere when each step is taken in two parts, far more so than
    those nearby.
    """
    beside = np.stack([over - APART, over + APART])
    known = (beside >= 0) & (beside < len(nodes[0]) - 1)
    looked, place = np.unique(
        np.concatenate([over, *np.where(known, beside, over)]), return_inverse=True
    )
    found = _differences(system, rule, problem, nodes, looked, part)
    apart, *others = found[place].reshape(3, -1)
    usual = np.where(known, others, 0).max(axis=0)
    return known.any(axis=0) & (apart > np.maximum(LEAP * usual, LEAST))


def _differences(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    nodes: Nodes,
    begin: np.ndarray,
    part: float,
) -> np.ndarray:
    """How far from the next node each of these leads in steps of two parts each, of the way between
    them and of the momenta.
    """
    q, p, k, _ = nodes
    if not len(begin):
        return np.zeros(0)
    step, at = step_function(system, rule), [q[begin], p[begin]]
    for i in range(int(k[1] - k[0])):
        for first, size in ((0.0, part), (part, 1 - part)):
            t = problem.t0 + problem.h * (k[begin] + i + first)
            u = _controls(rule, problem, k[begin] + i, first, size)
            h = np.array([problem.h * size])
            at = over_columns(step, *at, u, problem.c, t[:, None], h)[:2]
    apart = [np.abs(new - x[begin + 1]).max(axis=1) for new, x in zip(at, (q, p), strict=True)]
    way = np.abs(q[begin + 1] - q[begin]).max(axis=1)
    momenta = np.abs(p).max()
    return np.maximum(apart[0] / np.maximum(way, way.mean()), apart[1] / momenta)


def _controls(
    rule: Rule, problem: InitialValueProblem, k: np.ndarray, first: float, size: float
) -> np.ndarray:
    """Controls at the nodes of a part of each of these steps, a row each."""
    u = problem.u[k] if problem.u.size else np.empty((len(k), 1, 0))
    nodes = np.array(rule.nodes)
    if u.shape[1] == 1:
        return np.repeat(u, len(nodes), axis=1).reshape(len(k), -1)
    return (lagrange_values(nodes, first + size * nodes) @ u).reshape(len(k), -1)
