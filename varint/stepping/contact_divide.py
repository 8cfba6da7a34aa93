"""A step with contacts that fails, or what an event has left of one: equal parts of it, with events of their own."""

from __future__ import annotations

import numpy as np

from varint.rules import Rule
from varint.stepping.contact_run import every_node, position
from varint.stepping.contact_view import Instant, view
from varint.stepping.run import Block, Position, Task, is_saved
from varint.stepping.subdivide import agreeing, division, in_parts
from varint.system import System


def divided(system: System, rule: Rule, task: Task, at: Position) -> list[Block]:
    """The rest of the step from a position on in 2, 4, 8, … parts, whose ends become nodes."""
    assert at.t is not None and at.phase is not None
    n, k, end = system.structure.n, at.k, task.t0 + task.h * (at.k + 1)
    began, now = at.t, Instant(at.t, at.x[: 4 * n], at.phase)

    def attempt(parts: int) -> tuple[np.ndarray | None, list[Block]]:
        small = in_parts(rule, task, k, began, end - began, parts)
        blocks = list(every_node(system, rule, small, position(system, rule, small, now, 0, at)))
        last = blocks[-1].after
        solved = last is not None and last.k == parts
        return last.x[:n] if solved and last is not None else None, blocks

    found, parts = agreeing(attempt, now.q)
    last = found[-1].after
    assert last is not None and last.phase is not None
    if not parts:
        nothing = np.empty((0, n))
        failed = found[-1].failed
        return [Block(np.array([k + 1]), nothing, nothing, 0.0, 0, failed, np.empty(0), at.phase, after=at)]
    there = Instant(end, last.x[: 4 * n], last.phase)
    energies = (view(system, instant, task.c).energy for instant in (now, there))
    blocks = [_relabelled(block, k, parts, end) for block in found]
    if began == task.t0 + task.h * k and not is_saved(k, task.steps, task.save_every):
        blocks.insert(0, Block(np.array([k]), now.q[None], now.p[None], 0.0, 1, t=np.array([began]), phase=at.phase))
    blocks[0] = blocks[0]._replace(events=(division(began, parts, *energies), *blocks[0].events))
    blocks[-1] = blocks[-1]._replace(after=position(system, rule, task, there, k + 1, at))
    return blocks


def _relabelled(block: Block, k: int, parts: int, end: float) -> Block:
    """A block of parts as one of step k: whole steps and times of the run; no run goes on from within."""
    assert block.t is not None
    last = block.k == parts
    return block._replace(k=np.where(last, k + 1, k), t=np.where(last, end, block.t), after=None)
