"""The time loop: blocks of steps inside CasADi, checked one by one."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from varint.discrete.row_independence import folds
from varint.discrete.scales import (
    SMALLEST,
    UNKNOWN,
    inertia_function,
    rounding_sizes,
    scale_function,
)
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.integration.careful_step import careful_step
from varint.integration.cost import steps_at_once
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, Passed, RunState
from varint.integration.steppers.stepper import ITERATIONS, RESIDUAL, state_layout
from varint.numerics.arrays import call, over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

LARGEST_BLOCK = 1000  # nodes between two looks at the run
STEP_BY_STEP = 0  # instead of the nodes of the next block: single steps up to the next saved node
# loops of loops of so many turns: CasADi builds them four times faster than those of its own ten
NESTED = {"base": 6}
LARGE_STATE = 300  # numbers; CasADi takes long to build a long loop over a large state


@per_scene
def rollout(system: System, rule: Rule, nodes: int, every: int) -> ca.Function:
    """(x, u, t, h, c, scale) → states at `nodes` nodes, `every` steps apart."""
    stepper = plan(system, rule).build(system, rule)
    step = stepper.step
    if nodes * every == 1:
        return step
    sizes = [step.numel_in(i) for i in range(step.n_in())]
    x, u, t, h, c, scale = (
        ca.MX.sym(f"a{i}", size, nodes * every if i in (1, 2) else 1)
        for i, size in enumerate(sizes)
    )
    inner = _last_of(step, every) if every > 1 else step
    rolled = inner.mapaccum(f"roll_{nodes}_{every}", nodes, NESTED) if nodes > 1 else inner
    states = rolled(x, u, t, *(ca.repmat(a, 1, nodes * every) for a in (h, c, scale)))
    return ca.Function("rollout", [x, u, t, h, c, scale], [states])


def _last_of(step: ca.Function, every: int) -> ca.Function:
    """So many steps, and the state after the last of them."""
    inputs = [ca.MX.sym(f"a{i}", step.numel_in(i), every if i else 1) for i in range(step.n_in())]
    states = step.mapaccum("steps", every, NESTED)(*inputs)
    return ca.Function("last", inputs, [states[:, -1]])


def start_state(system: System, rule: Rule, problem: InitialValueProblem) -> RunState:
    """The position before the first step."""
    u, typical = problem.controls(problem.first, 1), np.empty(0)
    if u.size:
        typical = np.abs(problem.u).max(axis=(0, 1))
    t, h = np.array((problem.t0 + problem.h * problem.first,)), np.array((problem.h,))
    begin = beginning_function(system, rule)
    x, scale, inertia = call(begin, problem.q0, problem.p0, u, typical, t, h, problem.c)
    return RunState(x, scale, inertia, problem.first, largest_block(x))


def start_states(
    system: System,
    rule: Rule,
    q0: np.ndarray,
    p0: np.ndarray,
    u: np.ndarray,
    typical: np.ndarray,
    t0: float,
    h: np.ndarray,
    c: np.ndarray,
) -> RunState:
    """The positions of several motions before the first step; arrays have the motions first.

    `u` are the controls of the first step, `typical` the largest sizes of each control during the
    run.
    """
    t = np.full((len(q0), 1), t0)
    x, scale, inertia = over_columns(beginning_function(system, rule), q0, p0, u, typical, t, h, c)
    return RunState(x, scale, inertia, 0, largest_block(x[0]))


@per_scene
def beginning_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, typical, t, h, c) → x, typical sizes, and the inertia between them."""
    start, n = plan(system, rule).build(system, rule).start, system.structure.n
    sizes = (n, n, start.numel_in(2), system.structure.controls, 1, 1, system.c.numel())
    q, p, u, typical, t, h, c = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    scale = scale_function(system)(q, p, typical, t, h, c)
    outputs = [start(q, p, u, t, h, c), scale, inertia_function(system)(q, p, t, c)]
    return ca.Function("beginning", inputs, outputs)


def interpreted_blocks(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState | None = None
) -> Iterator[NodeBlock]:
    """The run from a position on, block after block; it ends with the first step that cannot be
    solved.

    A step that fails is tried once more from the velocity at its start, as the compiled loops do,
    with sizes looked up anew there: the last step's polynomial may lead too far, and the sizes of
    former steps may have little to do with this one; then with corrections that are halved where
    they lead too far (`careful_step`). What fails between two saved nodes is looked
    at step by step, and a block without one good node is one in which some step has no numbers.
    """
    layout = state_layout(system.structure.n)
    h, most = np.array([problem.h]), steps_at_once(system, rule)
    fresh = at is None
    at = start_state(system, rule, problem) if at is None else at
    while at.k < problem.steps:
        count, every = next_block(at.k, problem.steps, problem.save_every, at.largest, most)
        if at.largest == STEP_BY_STEP:
            count = every = 1
        total, whole = count * every, folds(system)
        times = problem.t0 + problem.h * np.arange(at.k, at.k + total)
        function = rollout(system, rule, *((total, 1) if whole else (count, every)))
        given = at.x, problem.controls(at.k, total), times, h, problem.c, at.scale
        states = call(function, *given)[0].reshape(total if whole else count, -1)
        all_states, states = states, states[every - 1 :: every] if whole else states
        good = int(count_good_nodes(states))
        if not good and total == 1 and fresh and (careful := careful_step(system, rule)):
            all_states = states = call(careful, *given)[0].reshape(1, -1)
            good = int(count_good_nodes(states))
        worst = float(states[good - 1, RESIDUAL]) if good else 0.0
        after = advance(at, states[:good], problem.h, every)
        counts = iterations_at(at.x, states[:good])
        failed = 0.0 if good == count else residual_of(states[good])
        k = at.k + every * np.arange(1, count + 1)
        steps = all_states[: good * every]
        passed = Passed(at.k + np.arange(1, len(steps) + 1), steps[:, layout.q], steps[:, layout.p])
        again = good < count and (good > 0 or count * every > 1 or not fresh)
        if again:
            k, count, fresh, failed = k[:good], good, every == 1, 0.0
            after = _before_failure(system, rule, problem, after, every)
        else:
            fresh = False
            if after.largest == STEP_BY_STEP and after.k % problem.save_every == 0:
                after = after._replace(largest=1)
        # within a long interval
        if (
            not again
            and good == count
            and not is_saved(int(k[-1]), problem.steps, problem.save_every)
        ):
            k, states = k[:0], states[:0]
        q, p = states[:good, layout.q], states[:good, layout.p]
        total = int(counts[-1]) if good else 0
        yield NodeBlock(
            k,
            q,
            p,
            worst,
            len(q),
            failed,
            iterations=total,
            after=after,
            counts=counts,
            passed=passed if whole else None,
        )
        if good < count:
            return
        at = after


def with_sizes_anew(system: System, problem: InitialValueProblem, at: RunState) -> RunState:
    """The position with typical sizes found there and then, and none below round-off; the next
    block is short.
    """
    layout = state_layout(system.structure.n)
    q, p = at.x[layout.q].copy(), at.x[layout.p].copy()
    t = np.array([problem.t0 + problem.h * at.k if at.t is None else at.t])
    u = problem.controls(min(at.k, problem.steps - 1), 1)
    typical, h, c = np.abs(u).max(axis=(0, 1), initial=0.0), np.array([problem.h]), problem.c
    scale = call(scale_function(system), q, p, typical, t, h, c)[0]
    least = rounding_sizes(system, q, p, u[0, 0].copy(), t, h, c)
    return at._replace(
        scale=np.maximum(scale, least),
        inertia=call(inertia_function(system), q, p, t, c)[0],
        largest=min(at.largest, 1),
    )


def _before_failure(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState, every: int
) -> RunState:
    """Where a run goes on that failed: at the step, its start values from the velocity alone; or
    step by step where the failure lies somewhere in an interval.
    """
    if every > 1:
        return at._replace(largest=STEP_BY_STEP)
    layout = state_layout(system.structure.n)
    q, p = at.x[layout.q], at.x[layout.p]
    x = start_state(system, rule, problem._replace(q0=q, p0=p, first=at.k)).x
    return with_sizes_anew(system, problem, at._replace(x=x))


def next_block(k: int, steps: int, every: int, largest: int, most: int) -> tuple[int, int]:
    """(nodes, steps between them) of the block after k steps: a power of ten of nodes, or of steps
    within an interval.

    It has at most so many nodes and steps (`steps_at_once`). It depends on the position alone, so a
    run that is taken up again has the blocks of the one that was not stopped.
    """
    whole = (steps - k) // every
    if k % every or not whole or every > most:
        return 1, _power_of_ten(min(every - k % every, steps - k, most))
    return _power_of_ten(min(whole, largest, max(most // every, 1))), every


def is_saved(k: int, steps: int, every: int) -> bool:
    """Whether the node after k steps is kept."""
    return k % every == 0 or k == steps


def count_good_nodes(states: np.ndarray) -> np.ndarray:
    """How many of the states (…, nodes, size), from the first on, are finite and solved."""
    good = np.isfinite(states).all(axis=-1) & (states[..., RESIDUAL] <= RESIDUAL_LIMIT)
    first = good.argmin(axis=-1)
    if good.ndim == 1:
        return first if not good[first] else np.intp(len(good))
    return np.where(good.all(axis=-1), states.shape[-2], first)


def iterations_at(before: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Iterations since the state `before`, at each of the states (nodes, size) that follow it."""
    return states[:, ITERATIONS] - before[ITERATIONS]


def advance(at: RunState, states: np.ndarray, h: float, every: int) -> RunState:
    """The position after the solved states, (nodes, size)."""
    if not len(states):
        return at._replace(largest=min(at.largest, 1))
    x, k = states[-1].copy(), at.k + every * len(states)
    x[RESIDUAL] = 0.0
    return at._replace(
        x=x,
        scale=renew_scales(at, states, abs(h) * every),
        k=k,
        largest=min(10 * at.largest, largest_block(x)),
    )


def largest_block(x: np.ndarray) -> int:
    """Nodes of a block: fewer where a state is large."""
    return LARGEST_BLOCK if x.size < LARGE_STATE else LARGEST_BLOCK // 10


def _power_of_ten(most: int) -> int:
    size = 1
    while 10 * size <= most:
        size *= 10
    return size


def residual_of(state: np.ndarray) -> float:
    """Residual of a state that failed: NaN where the state itself is not finite."""
    return float(state[RESIDUAL]) if np.isfinite(state).all() else float("nan")


def renew_scales(at: RunState, states: np.ndarray, apart: float) -> np.ndarray:
    """Typical sizes of velocities and momenta as the states (…, nodes, size) after `at` show;
    see `scale_function`.
    """
    n = at.inertia.shape[-1]
    layout = state_layout(n)
    q, p = states[..., layout.q], states[..., layout.p]
    before = np.concatenate([at.x[..., None, layout.q], q[..., :-1, :]], axis=-2)
    v_size = np.maximum(np.abs(q - before).max(axis=-2) / apart, 0.1 * at.scale[..., :n])
    p_size = np.maximum(np.abs(p).max(axis=-2), 0.1 * at.scale[..., n:])
    root = np.sqrt(at.inertia)
    least = np.maximum(SMALLEST * (v_size * root).max(axis=-1, keepdims=True), UNKNOWN)
    v_size = np.maximum(v_size, least / root)
    return np.concatenate([v_size, np.maximum(p_size, v_size * at.inertia)], axis=-1)
