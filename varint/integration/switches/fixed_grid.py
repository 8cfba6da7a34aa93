"""Steps of a given size beside contacts and switches: both end steps, and after them the grid goes
on where it would have been.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from varint.integration.events.crossings import Watch
from varint.integration.problem import InitialValueProblem, RunOptions
from varint.integration.switches.course import Course, kernel_in
from varint.integration.switches.follow import first_unit
from varint.integration.switches.joined import joined
from varint.integration.switches.passage import EDGE
from varint.integration.switches.runs import possible, run_pieces
from varint.integration.switches.timetable import timetable
from varint.integration.switches.watching import with_events
from varint.integration.switches.within_rows import of_users_scene, rows_written_out, written_out
from varint.integration.trajectories import with_stats
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

PARTS = 4  # steps of flights that are shorter than a step


def switched_steps(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    options: RunOptions,
    stop: Watch | None,
    watches: list[Watch],
    began: float,
) -> Trajectory | None:
    """The run in steps of the problem's size; None where it cannot be followed so.

    Its nodes are those of the grid, of events and of switches.
    """
    simple = problem.level == 0 and options.checkpoint is None and options.on_failure == "raise"
    if not (simple and possible(system, rule, problem, options)):
        return None
    user, nodes, save_every = system, rule.nodes, problem.save_every
    if problem.u.shape[1] > 1:
        system, problem = written_out(system, nodes), rows_written_out(problem)
    h, total = problem.h, problem.h * problem.steps
    table = timetable(system, problem.c, problem.t0, total, problem.u[:, 0])
    whole = problem._replace(h=total, steps=1)
    course = Course(system, rule, whole, table, options.backend, grid=h)
    with np.errstate(all="ignore"):
        if first_unit(course) is None:
            return None
        pieces = run_pieces(course, PARTS, stop)
        if not pieces:
            return None
        motion = joined(course, pieces, kernel_in(course, pieces[0].branch))
        motion = replace(with_events(course, pieces, motion, watches), h=h)
        if system is not user:
            motion = of_users_scene(user, nodes, motion)
    motion = with_stats(motion, seconds=perf_counter() - began)
    step = (motion.t - problem.t0) / h
    near = np.round(step)
    off = np.abs(step - near) > EDGE * max(abs(problem.t0), abs(total)) / abs(h)
    kept = off | (near % save_every == 0)
    kept[-1] = True
    return motion if kept.all() else motion[np.flatnonzero(kept)]
