"""The branch on which a motion goes on from a state: at its start, and at every switch."""

from __future__ import annotations

import math

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.discrete.legendre import velocity_function
from varint.integration.switches.branch import Branch, branch_scene, passed_straight, slidable
from varint.integration.switches.course import Course
from varint.integration.switches.decision import (
    ahead_at,
    all_parameters,
    decide,
    decided_alone,
)
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.timetable import timed
from varint.integration.switches.touching import held_scene
from varint.numerics.arrays import call
from varint.results.records import State

AT_ZERO = 64 * np.finfo(float).eps  # of what switches could change by during the run


def first_branch(course: Course) -> Branch | None:
    """The branch at the start."""
    system, problem = course.system, course.problem
    begin, clocks = begins_with(course), timed(system).places
    scene = branch_scene(held_scene(system, begin))
    if scene is None:
        return None
    values = np.ones(frozen_scene(system).s.numel())  # type: ignore[union-attr]
    values[list(clocks)] = course.timetable.values[0]
    acting = tuple(course.timetable.controls[0].tolist())
    branch = Branch(tuple(values.tolist()), controls=acting, active_set=begin)
    q, p, t = problem.q0, problem.p0, problem.t0
    c = all_parameters(problem.c, branch)
    v = call(velocity_function(scene.system), q, p, np.array([t]), c)[0]
    return next_branch(course, State(t, q, v, p), branch, [], list(clocks))


def begins_with(course: Course) -> ActiveSet | None:
    """All constraints and no contact, of scenes with contacts."""
    s = course.system.structure
    return ActiveSet(tuple(range(s.constraints))) if s.contacts else None


def next_branch(
    course: Course, state: State, branch: Branch, at_zero: list[int], known: list[int]
) -> Branch | None:
    """The branch on which the motion goes on from a state, with all switches that are at zero."""
    system = held_scene(course.system, branch.active_set)
    c, total = course.problem.c, course.problem.h
    frozen = frozen_scene(system)
    assert frozen is not None
    direction = math.copysign(1.0, total)
    alone = at_zero[0] if len(at_zero) == 1 and not branch.sliding else None
    if alone in slidable(system) and len(branch.values) == 1:
        return _through(course, state, direction, branch, alone)
    found = ahead_at(system, state, c, branch)
    if found is None:
        return None
    off = np.where(frozen.counts, found[0] - np.round(found[0]), found[0])
    reach = AT_ZERO * np.abs(found[1]) * max(abs(state.t), abs(total))
    near = np.flatnonzero(np.abs(off) <= reach).tolist()
    every = sorted({*at_zero, *near} - set(known))
    if alone is not None and every == at_zero:
        if alone in passed_straight(system):
            values = np.array(branch.values)
            values[alone] = math.copysign(1.0, found[1][alone] * direction)
            if found[1][alone] and values[alone] != branch.values[alone]:
                return branch._replace(values=tuple(values.tolist()))
        elif alone in slidable(system):
            return _through(course, state, direction, branch, alone)
    return decide(system, state, c, direction, branch, every, known)


def _through(
    course: Course, state: State, direction: float, branch: Branch, switch: int
) -> Branch | None:
    """The branch after the one switch at zero, which may hold the motion."""
    system, c = held_scene(course.system, branch.active_set), course.problem.c
    found = decided_alone(system, state, c, direction, branch, switch)
    return found or decide(system, state, c, direction, branch, [switch], [])
