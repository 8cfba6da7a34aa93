"""The course of a run: its blocks, watched as they come, become one trajectory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from varint.codegen.frozen import no_whole_derivatives
from varint.discrete.constraints import ActiveSet
from varint.discrete.legendre import velocity_function
from varint.discrete.row_independence import folds
from varint.errors import InputError, StepRefused
from varint.integration.backend import (
    blocks_of,
    kernel_for,
    run_at_once,
    subdivide_failed_step,
)
from varint.integration.hard_steps import loop_that_took_over
from varint.integration.plan import Plan
from varint.integration.problem import InitialValueProblem, check_on_failure
from varint.integration.state import NodeBlock
from varint.integration.trajectories import (
    Run,
    active_scene,
    cut_at,
    energy_note,
    first_node,
    in_order,
    last_node,
    motion_of,
    trajectory_of,
    with_velocities,
)
from varint.numerics.arrays import call
from varint.numerics.progress import progress_bar
from varint.results.records import changed
from varint.results.trajectory import Trajectory
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel, LoopResult
    from varint.integration.checkpoint import Checkpoint
    from varint.integration.events.crossings import Crossings, Watch
    from varint.integration.row_watch import BlocksFrom


# nodes that are searched together for zeros, and coordinates of nodes where there are few: many
# cost little more than a few
AT_ONCE, NUMBERS_AT_ONCE = 10_000, 50_000
FIRST = 1000  # steps of a run that is searched as a whole: a longer one may end soon


def start_run(
    system: System,
    chosen: Plan,
    problem: InitialValueProblem,
    began: float,
    *,
    backend: str,
    on_failure: str = "raise",
    file: Checkpoint | None = None,
    by: Kernel | None = None,
) -> Run:
    """The run that `problem` describes, from its checkpoint on where there is one; anew `by` a loop
    that takes it over from its start.

    Raises
    ------
    InputError
        If the backend or `on_failure` is unknown or not possible here.
    """
    check_on_failure(on_failure)
    kernel: Kernel | None = None
    loop_in: Callable[[ActiveSet], Kernel | None] | None = None
    blocks_from: BlocksFrom
    scene = active_scene(system, problem)
    if system.structure.contacts:
        from varint.integration.events.contact_loop import contact_run
        from varint.integration.events.subdivide import subdivide_contact_step
        from varint.integration.flight_choice import flights_for

        flights = flights_for(system, chosen.rule, problem, backend)
        begin = problem.active_set or ActiveSet(tuple(range(system.structure.constraints)))
        loop_in = flights and flights.loop_in
        kernel = loop_in and loop_in(begin)
        blocks_from = partial(contact_run, system, chosen.rule, problem, flights=flights)
        remedy = partial(subdivide_contact_step, system, chosen.rule, problem)
    else:
        kernel = by or kernel_for(scene, chosen.rule, problem, backend)
    if file:  # "auto" may choose otherwise next time, where no compiler is found
        file.identity["loop"] = "interpreted" if kernel is None or by else kernel.about
    nodes = file.read() if file and by is None else []
    if not nodes and not system.structure.contacts:
        nodes = [first_node(problem)]
    if not system.structure.contacts:
        if kernel is None:
            kernel = loop_that_took_over(nodes[-1].after, scene, chosen.rule)
        if problem.active_set is not None:
            loop_in = {problem.active_set: kernel}.get
        blocks_from = partial(blocks_of, scene, chosen.rule, problem, kernel)
        if folds(scene):
            from varint.integration.fold_watch import with_folds_watched

            blocks_from = with_folds_watched(blocks_from, scene, chosen.rule, problem, kernel)
        if scene is not system:
            from varint.integration.row_watch import watch_rows

            blocks_from = watch_rows(blocks_from, system, chosen.rule, problem)
        remedy = partial(subdivide_failed_step, scene, chosen.rule, problem, kernel)
    at = nodes[-1].after if nodes else None
    blocks = blocks_from(at)
    if on_failure == "subdivide":
        if kernel is not None and no_whole_derivatives(system):
            raise InputError(
                "on_failure='subdivide' solves parts of a step with all second derivatives of L, "
                f"which takes minutes to set up for the {system.structure.n} coordinates of this "
                "machine; take a smaller h, or give tol in place of h"
            )
        from varint.integration.events.subdivide import around_failures

        blocks = around_failures(blocks_from, remedy, problem.steps, at)
    nodes = nodes or [next(blocks)]
    return Run(system, chosen, problem, nodes, blocks, kernel, began, loop_in)


def short_run(
    system: System,
    chosen: Plan,
    problem: InitialValueProblem,
    began: float,
    backend: str,
    stop: Watch | None = None,
    watches: Sequence[Watch] = (),
) -> Trajectory | None:
    """A run that is over before anyone could watch it, of a scene whose nodes need no look: in one
    call, without the blocks of the long ones. None where it is no such run, or comes to no good
    end.

    Raises
    ------
    InputError
        If the backend is unknown.
    """
    s, looks = system.structure, bool(stop or watches)
    if s.contacts:
        return None if looks else _short_contact_run(system, chosen, problem, began, backend)
    if s.constraints or s.nonholonomic:
        return None
    if looks and (system.rays or problem.steps > FIRST):
        return None
    kernel = kernel_for(system, chosen.rule, problem, backend)
    found = None if kernel is None else run_at_once(system, chosen.rule, problem, kernel)
    if found is None or not found.done:
        return None
    run = Run(system, chosen, problem, [], iter(()), kernel, began)
    motion = motion_at_once(run, found)
    return looked_along(motion, found.rows[:, 2], kernel, stop, watches) if looks else motion


def _short_contact_run(
    system: System, chosen: Plan, problem: InitialValueProblem, began: float, backend: str
) -> Trajectory | None:
    from varint.integration.events.short_flights import motion_of_flight, short_flight
    from varint.integration.flight_choice import flights_for

    flights = flights_for(system, chosen.rule, problem, backend)
    found = flights and short_flight(system, chosen, problem, flights)
    return found and motion_of_flight(system, chosen, problem, found, began)


@np.errstate(all="ignore")  # what is not finite has no zero
def looked_along(
    motion: Trajectory,
    v: np.ndarray,
    kernel: Kernel | None,
    stop: Watch | None,
    watches: Sequence[Watch],
) -> Trajectory:
    """A whole motion, whose nodes after the first have these velocities, with what is watched for
    on the way, or until `stop` crosses zero.
    """
    from varint.integration.events.crossings import crossing_search
    from varint.integration.events.first_crossing import find_first
    from varint.integration.events.native_crossings import log_crossings

    moving = changed(motion)
    moving.__dict__["v"] = v = v.copy()
    velocity = velocity_function(motion.system)
    v[0] = call(velocity, motion.q[0], motion.p[0], motion.t[:1], motion.c)[0]
    end = None
    if stop:
        end = find_first(kernel, crossing_search(motion.system, stop), moving, {}, 0)
    if watches:
        searches = [crossing_search(motion.system, watch) for watch in watches]
        noted = log_crossings(searches, moving, {}, kernel)
        motion = changed(motion, events=in_order([*motion.events, *noted], motion.h))
    return cut_at(motion, 0, end) if end and len(end.jump) else motion


def motion_at_once(run: Run, found: LoopResult) -> Trajectory:
    """The motion that one call of the loop found, from the start of the run to its end."""
    problem = run.problem
    q, p = found.rows[:, 0].copy(), found.rows[:, 1].copy()
    if len(q):
        q[0], p[0] = problem.q0, problem.p0
    k = np.arange(0, problem.steps + 1, problem.save_every)
    t = problem.h * k
    t += problem.t0
    return motion_of(run, (k, t, q, p), (found.iterations, found.residual))


def collect(
    run: Run,
    *,
    stop: Watch | None = None,
    watches: Sequence[Watch] = (),
    file: Checkpoint | None = None,
    progress: bool | None = None,
    on_failure: str | None = "raise",
) -> Trajectory:
    """The whole run, or its nodes until `stop` crosses zero or Ctrl-C. None: failures are raised,
    and another way is not offered, for there is none.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    from varint.integration.events.crossings import crossing_search, impacts_in
    from varint.integration.events.first_crossing import find_first
    from varint.integration.events.native_crossings import log_crossings

    problem, nodes, interrupted = run.problem, run.nodes, False
    searches = [crossing_search(run.system, watch) for watch in watches]
    stopping = crossing_search(run.system, stop) if stop else None
    noted, pending = [], [last_node(nodes)]  # events so far, and the nodes not yet searched
    reached = int(nodes[-1].k[-1])
    at_once = max(AT_ONCE, NUMBERS_AT_ONCE // run.system.structure.n)

    def so_far() -> Trajectory:
        if searches and len(pending) > 1:
            motion = with_velocities(trajectory_of(run, pending), pending)
            impacts = impacts_in(pending)
            noted.extend(log_crossings(searches, motion, impacts, run.kernel, run.loop_in))
            whole = len(pending) == len(nodes) and not interrupted
            pending[:] = [last_node(pending)]
            if whole:
                return changed(motion, events=in_order([*motion.events, *noted], problem.h))
        return trajectory_of(run, nodes, noted, interrupted)

    try:
        # blocks are checked
        with (
            progress_bar(problem.steps, "step", progress, reached) as move,
            np.errstate(all="ignore"),
        ):
            for block in run.blocks:
                end: Crossings | None = None
                if stopping and block.good:
                    recent = [last_node(nodes), block]
                    motion = with_velocities(trajectory_of(run, recent), recent)
                    impacts = impacts_in(recent)
                    passed = reached - problem.first
                    end = find_first(run.kernel, stopping, motion, impacts, passed, run.loop_in)
                nodes.append(block)
                if searches and block.good:
                    pending.append(block)
                if end and len(end.jump):
                    motion = so_far()
                    motion = cut_at(motion, len(motion) - block.good - 1, end)
                    move(int(motion.k[-1]) + 1 - reached, partial(energy_note, run, block))
                    return motion
                if block.good < len(block.k):
                    from varint.integration.failures import failure

                    remedy = None if no_whole_derivatives(run.system) else on_failure
                    raise failure(so_far(), _next_step(block), block.failed, remedy)
                if block.good:
                    before, reached = reached, int(block.k[block.good - 1])
                    move(reached - before, partial(energy_note, run, block))
                if sum([part.good for part in pending]) > at_once:
                    so_far()
                if file and file.due():
                    so_far()
                    file.write(problem.t0, problem.h, nodes, noted)
    except StepRefused as error:
        from varint.integration.failures import refusal

        last = next(block for block in reversed(nodes) if block.after or len(block.k))
        motion, step = so_far(), error.step
        if step is None:  # that after the last node
            raise refusal(motion, _next_step(last), float(motion.t[-1]), str(error)) from None
        raise refusal(motion, step, problem.t0 + problem.h * step, str(error)) from None
    except KeyboardInterrupt:
        interrupted = True
    motion = so_far()
    if file and len(nodes) > 1:
        file.write(problem.t0, problem.h, nodes, noted)
    return motion


def _next_step(block: NodeBlock) -> int:
    """Index of the first step that is not known to be solved."""
    if block.after is not None:
        return block.after.k
    return int(block.k[block.good - 1]) if block.good else int(block.k[0]) - 1
