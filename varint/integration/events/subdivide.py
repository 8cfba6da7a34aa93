"""The automatic remedy for a step that fails: equal parts of it instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from varint.discrete.lagrangian import energy_function
from varint.discrete.legendre import velocity_function
from varint.integration.events.contact_loop import every_node, position
from varint.integration.events.contacts import Instant, view
from varint.integration.interpreted_loop import (
    count_good_nodes,
    is_saved,
    iterations_at,
    residual_of,
    start_state,
)
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import RESIDUAL, state_layout
from varint.numerics.arrays import call
from varint.results.records import Event
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.system import System

T = TypeVar("T")

AGREED = 1e-8  # of the way of the step
# of it: as many parts as there may be agree with half of them at least so far, or nothing is known
COARSE = 1e-2
MOST_PARTS = 1024  # of a step: what still fails then is a singularity, not a step that is too large


def around_failures(
    blocks: Callable[[RunState | None], Iterator[NodeBlock]],
    divided: Callable[[RunState], list[NodeBlock]],
    steps: int,
    at: RunState | None,
) -> Iterator[NodeBlock]:
    """The run that `blocks` makes from a position on, each failure followed by the blocks that
    go around it.
    """
    while True:
        block = None
        for block in blocks(at):
            yield block._replace(k=block.k[: block.good])
        if block is None or block.after is None or block.after.k == steps:
            return
        around = divided(block.after)
        yield from around
        if around[-1].good < len(around[-1].k):
            return
        at = around[-1].after


def problem_of_parts(
    rule: Rule, problem: InitialValueProblem, k: int, began: float, left: float, parts: int
) -> InitialValueProblem:
    """What is `left` of step k from a time on, as a run of its own; controls as `Trajectory.at`
    has them.
    """
    u = problem.u[k]
    if len(u) == 1:
        u = np.broadcast_to(u, (parts, *u.shape))
    else:
        nodes, passed = np.array(rule.nodes), (began - problem.t0) / problem.h - k
        at = passed + left / problem.h / parts * (np.arange(parts)[:, None] + nodes)
        u = (lagrange_values(nodes, at.ravel()) @ u).reshape(parts, *u.shape)
    return problem._replace(t0=began, h=left / parts, steps=parts, save_every=1, first=0, u=u)


def refine_until_agreed(
    attempt: Callable[[int], tuple[np.ndarray | None, T]], start: np.ndarray
) -> tuple[T, int]:
    """What an attempt with 2, 4, … parts found, and how many: enough to be solved and to agree with
    half of them.

    An attempt returns the coordinates where it ended, None where it failed, and what it found on
    the way. No parts are returned where even the most of them do not agree.
    """
    parts, before = 1, None
    while True:
        parts *= 2
        end, found = attempt(parts)
        apart, way = np.inf, 0.0
        if end is not None and before is not None:
            apart, way = np.abs(end - before).max(), np.abs(end - start).max()
        if apart <= AGREED * way or parts == MOST_PARTS:
            return found, parts if apart <= COARSE * way else 0
        before = end


def subdivide(system: System, rule: Rule, problem: InitialValueProblem, at: RunState) -> NodeBlock:
    """The steps from a position to the next node, those that fail replaced by 2, 4, 8, … parts.

    A part is a step of the same rule, but changing h costs the long-time guarantees of a symplectic
    method around it. Start, parts and end of such a step become nodes of the trajectory, so its
    dense output stays right.
    """
    n, layout = system.structure.n, state_layout(system.structure.n)
    end = min((at.k // problem.save_every + 1) * problem.save_every, problem.steps)
    if not at.scale.size:  # of a compiled run: q and p alone
        q, p = at.x.reshape(2, n)
        at = start_state(system, rule, problem._replace(q0=q, p0=p, first=at.k))
    nodes: list[tuple[int, float, np.ndarray]] = []  # whole steps, time, state
    divided: list[Event] = []
    x, k, worst, failed, iterations = at.x, at.k, 0.0, 0.0, 0
    while k < end:
        states, parts = _divide(system, rule, problem, k, x, at.scale)
        if not parts:
            failed = residual_of(states[-1])
            break
        t = problem.t0 + problem.h * (k + np.arange(1, parts + 1) / parts)
        if parts > 1:
            began = float(problem.t0 + problem.h * k)
            after = _seen(system, float(t[-1]), states[-1], problem.c)[0][0]
            here = _seen(system, began, x, problem.c)
            divided.append(division_event(began, parts, here, float(after)))
            if not is_saved(k, problem.steps, problem.save_every) and (
                not nodes or nodes[-1][0] < k
            ):
                nodes.append((k, began, x))
            nodes += [(k, float(t[j]), states[j]) for j in range(parts - 1)]
        k += 1
        iterations += _iterations(x, states, parts)
        worst = max(worst, float(states[:, RESIDUAL].max()))
        x = _restart(system, rule, problem, k, states[-1]) if parts > 1 else states[-1].copy()
        x[RESIDUAL] = 0.0
        if parts > 1 or is_saved(k, problem.steps, problem.save_every):
            nodes.append((k, problem.t0 + problem.h * k, x))
    saved = np.array([x for _, _, x in nodes]).reshape(len(nodes), len(x))
    counts = [i for i, _, _ in nodes] + ([k + 1] if k < end else [])
    return NodeBlock(
        np.array(counts, dtype=int),
        saved[:, layout.q],
        saved[:, layout.p],
        worst,
        len(nodes),
        failed,
        np.array([t for _, t, _ in nodes]),
        None,
        tuple(divided),
        iterations,
        at._replace(x=x, k=k, largest=1),
    )


def division_event(began: float, parts: int, state: list[np.ndarray], after: float) -> Event:
    """The event of a step that was divided: energy and q, v, p where it began, the energy after."""
    (before,), *states = (x.tolist() for x in state)
    q, v, p = (tuple(x) for x in states)
    return Event(began, f"divided in {parts}", None, 0.0, before, after, q, v, p, v, p)


def _iterations(x: np.ndarray, states: np.ndarray, parts: int) -> int:
    """Iterations of a whole step from x, or of its parts, which are counted from zero."""
    return int(iterations_at(x if parts == 1 else np.zeros(len(x)), states)[-1])


def _divide(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    k: int,
    x: np.ndarray,
    scale: np.ndarray,
) -> tuple[np.ndarray, int]:
    """States at the ends of the parts of step k, and how many: one, or enough, or none where no
    number is enough.
    """
    states, n = _one_step(system, rule, problem, k, x, scale), system.structure.n
    if count_good_nodes(states) == 1:
        return states, 1

    def attempt(parts: int) -> tuple[np.ndarray | None, np.ndarray]:
        states = _parts(system, rule, problem, k, x, scale, parts)
        return states[-1, :n] if count_good_nodes(states) == len(states) else None, states

    return refine_until_agreed(attempt, x[:n])


def _seen(system: System, t: float, x: np.ndarray, c: np.ndarray) -> list[np.ndarray]:
    """Energy, q, v and p of a state."""
    layout = state_layout(system.structure.n)
    q, p, time = x[layout.q].copy(), x[layout.p].copy(), np.array([t])
    v = call(velocity_function(system), q, p, time, c)[0]
    return [call(energy_function(system), q, v, time, c)[0], q, v, p]


def _one_step(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    k: int,
    x: np.ndarray,
    scale: np.ndarray,
) -> np.ndarray:
    step = plan(system, rule).build(system, rule).step
    t, h = np.array([problem.t0 + problem.h * k]), np.array([problem.h])
    return call(step, x, problem.controls(k, 1), t, h, problem.c, scale)[0][None]


def _parts(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    k: int,
    x: np.ndarray,
    scale: np.ndarray,
    parts: int,
) -> np.ndarray:
    """States at the ends of the parts of step k, up to the first that is not solved."""
    small = problem_of_parts(rule, problem, k, problem.t0 + problem.h * k, problem.h, parts)
    states = []
    x = _restart(system, rule, small, 0, x)
    for j in range(parts):
        state = _one_step(system, rule, small, j, x, scale)
        states.append(state[0])
        if not count_good_nodes(state):
            break
        x = state[0]
    return np.array(states)


def _restart(
    system: System, rule: Rule, problem: InitialValueProblem, k: int, x: np.ndarray
) -> np.ndarray:
    """The state at the same node for steps of another size: compensations kept, the stepper's
    memory made anew.
    """
    layout, stepper = state_layout(system.structure.n), plan(system, rule).build(system, rule)
    t, h = np.array([problem.t0 + problem.h * k]), np.array([problem.h])
    u = problem.controls(min(k, problem.steps - 1), 1)
    q, p = x[layout.q].copy(), x[layout.p].copy()
    fresh = call(stepper.start, q, p, u, t, h, problem.c)[0]
    fresh[layout.moving] = x[layout.moving]
    return fresh


def subdivide_contact_step(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState
) -> list[NodeBlock]:
    """The rest of the step from a position on in 2, 4, 8, … parts, whose ends become nodes."""
    assert at.t is not None and at.active_set is not None
    n, k, end = system.structure.n, at.k, problem.t0 + problem.h * (at.k + 1)
    began, now = at.t, Instant(at.t, at.x[state_layout(n).moving], at.active_set)

    def attempt(parts: int) -> tuple[np.ndarray | None, list[NodeBlock]]:
        small = problem_of_parts(rule, problem, k, began, end - began, parts)
        blocks = list(every_node(system, rule, small, position(system, rule, small, now, 0, at)))
        last = blocks[-1].after
        solved = last is not None and last.k == parts
        return last.x[:n] if solved and last is not None else None, blocks

    found, parts = refine_until_agreed(attempt, now.q)
    last = found[-1].after
    assert last is not None and last.active_set is not None
    if not parts:
        nothing = np.empty((0, n))
        failed = found[-1].failed
        return [
            NodeBlock(
                np.array([k + 1]),
                nothing,
                nothing,
                0.0,
                0,
                failed,
                np.empty(0),
                at.active_set,
                after=at,
            )
        ]
    there = Instant(end, last.x[state_layout(n).moving], last.active_set)
    here, after = (view(system, instant, problem.c) for instant in (now, there))
    state = [np.array([here.energy]), now.q, here.v, now.p]
    blocks = [_relabel(block, k, parts, end) for block in found]
    if began == problem.t0 + problem.h * k and not is_saved(k, problem.steps, problem.save_every):
        blocks.insert(
            0,
            NodeBlock(
                np.array([k]),
                now.q[None],
                now.p[None],
                0.0,
                1,
                t=np.array([began]),
                active_set=at.active_set,
            ),
        )
    blocks[0] = blocks[0]._replace(
        events=(division_event(began, parts, state, after.energy), *blocks[0].events)
    )
    blocks[-1] = blocks[-1]._replace(after=position(system, rule, problem, there, k + 1, at))
    return blocks


def _relabel(block: NodeBlock, k: int, parts: int, end: float) -> NodeBlock:
    """A block of parts as one of step k: whole steps and times of the run; no run goes on from
    within.
    """
    assert block.t is not None
    last = block.k == parts
    return block._replace(k=np.where(last, k + 1, k), t=np.where(last, end, block.t), after=None)
