"""Constraint rows that were redundant at the start: what they say is watched along the run.

They are not solved for, since the others imply them where the run begins. That may end: a row that
acts only beyond some point, or from some time on. Then it comes back, or the run ends with an
error; it is never left behind in silence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from varint.discrete.consistency import independent
from varint.discrete.constraints import ActiveSet, position_rows, position_rows_function
from varint.discrete.inertia import mass_at
from varint.discrete.legendre import velocity_function
from varint.discrete.projection import row_sizes, velocity_gaps
from varint.errors import StepRefused
from varint.integration.interpreted_loop import interpreted_blocks
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.numerics.arrays import call, over_columns
from varint.rules.rule import Rule
from varint.scene.system import System

# of what the coordinates contribute to a row: more than the round-off of rows that others imply
VIOLATED = 1e-9
TINY = 1e-300  # a row that depends on nothing here
BlocksFrom = Callable[[RunState | None], Iterator[NodeBlock]]


def watch_rows(
    blocks_from: BlocksFrom, system: System, rule: Rule, problem: InitialValueProblem
) -> BlocksFrom:
    """The blocks of a run, each node of them checked against the rows that are not solved for.

    Raises
    ------
    StepRefused
        While the blocks come: a row is violated that cannot be solved for from where the run is.
    """
    m = system.structure.constraints

    def watched(at: RunState | None) -> Iterator[NodeBlock]:
        active_set = problem.active_set if at is None else at.active_set or problem.active_set
        assert active_set is not None
        if active_set == problem.active_set:
            blocks = blocks_from(at)
        else:
            blocks = interpreted_blocks(active_set.scene(system), rule, problem, at)
        q, p, k = problem.q0, problem.p0, problem.first
        while True:
            for block in blocks:
                block = _mark(block, active_set)
                dropped = [i for i in range(m) if i not in active_set.rows]
                good = _nodes_on_rows(system, problem, block, dropped)
                solved = block._replace(k=block.k[:good]) if good < block.good else block
                if good < block.good:
                    solved = solved._replace(q=block.q[:good], p=block.p[:good], good=good)
                    solved = solved._replace(after=None, counts=None)
                if good or solved is block:
                    yield solved
                more = active_set
                if dropped and good and good == len(solved.k):
                    q, p, k = solved.q[-1], solved.p[-1], int(solved.k[-1])
                    more = _rows_at(system, problem, active_set, q, p, k)
                if more != active_set:
                    active_set = more
                    break
                if good < block.good:
                    raise StepRefused(_why(system, problem, block, good, dropped))
            else:
                return
            again = problem._replace(q0=q.copy(), p0=p.copy(), first=k, active_set=active_set)
            blocks = interpreted_blocks(active_set.scene(system), rule, again)

    return watched


def _mark(block: NodeBlock, active_set: ActiveSet) -> NodeBlock:
    after = None if block.after is None else block.after._replace(active_set=active_set)
    return block._replace(active_set=active_set, after=after)


def _nodes_on_rows(
    system: System, problem: InitialValueProblem, block: NodeBlock, dropped: list[int]
) -> int:
    """How many of the good nodes, from the first on, keep to the rows that are not solved for."""
    if not block.good or not dropped:
        return block.good
    t = problem.t0 + problem.h * block.k[: block.good, None]
    q = np.ascontiguousarray(block.q[: block.good])
    g, flat = over_columns(position_rows_function(system), q, t, problem.c)
    slopes = flat.reshape(len(q), q.shape[1], -1).transpose(0, 2, 1)
    sizes = row_sizes(slopes, q)
    kept = (np.abs(g[:, dropped]) <= VIOLATED * np.maximum(sizes[:, dropped], TINY)).all(axis=1)
    return block.good if kept.all() else int(np.argmin(kept))


def _rows_at(
    system: System,
    problem: InitialValueProblem,
    active_set: ActiveSet,
    q: np.ndarray,
    p: np.ndarray,
    k: int,
) -> ActiveSet:
    """The rows that are independent at a node, where those that come back hold there, velocities
    included.
    """
    t, m, c = problem.t0 + problem.h * k, system.structure.constraints, problem.c
    slope = position_rows(system, q, t, c)[1][:m]
    at = np.array([t])
    v = call(velocity_function(active_set.scene(system)), q.copy(), p.copy(), at, c)[0]
    candidates = [*active_set.rows, *(i for i in range(m) if i not in active_set.rows)]
    found = sorted(independent(slope, mass_at(system, q, v, t, c), candidates))
    back = [i for i in found if i not in active_set.rows]
    rates, w = velocity_gaps(system, q, v, t, c)
    size = np.abs(w[back]) @ np.abs(v)
    if not back or not (np.abs(rates[back]) <= VIOLATED * size).all():
        return active_set
    return ActiveSet(tuple(found))


def _why(
    system: System, problem: InitialValueProblem, block: NodeBlock, node: int, dropped: list[int]
) -> str:
    t = problem.t0 + problem.h * int(block.k[node])
    g = position_rows(system, block.q[node].copy(), t, problem.c)[0][dropped]
    worst = int(np.argmax(np.abs(g)))
    return (
        f"the constraint row {dropped[worst]} was redundant at the start and no longer is: g = "
        f"{g[worst]:.3g} at t = {t:g}; start where its gradient is independent of the others', or "
        "write the rows so that it is all along the motion"
    )
