"""The contacts of a motion that is followed from switch to switch: what has happened to them, and
what lies ahead.
"""

from __future__ import annotations

import math

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.switches.branch import Branch
from varint.integration.switches.course import Course
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.landing import (
    Extent,
    Landed,
    flight_ahead,
    land,
    let_go,
    touches,
    with_times_of_rest,
)
from varint.integration.switches.touching import scene_in, ties
from varint.numerics.arrays import call
from varint.results.records import Event, State

SOON = 4.0  # times the flight that lies ahead, after which a contact has closed again

Next = tuple[Branch | None, State]  # with which a motion goes on


class Meetings:
    """Where a motion has been, and the records of its contacts; nothing in scenes without any."""

    def __init__(self, course: Course):
        problem = course.problem
        self.course = course
        self.extent = Extent(problem.q0, problem.q0, np.zeros(len(problem.q0)))
        self._events: list[Event] = []
        self._new = 0

    def begin(self, branch: Branch) -> Next:
        """What touches at the start bounces at once, and what rests holds."""
        problem = self.course.problem
        state = self._with_velocity(State(problem.t0, problem.q0, problem.q0, problem.p0), branch)
        self.extent.add(state.q[None], state.v[None])
        return self._after(state, land(self.course, state, branch, self.extent))

    def meet(self, state: State, branch: Branch, contact: int) -> Next:
        """A gap closes, or what holds lets go."""
        assert branch.active_set is not None
        if contact in branch.active_set.holding:
            found = let_go(self.course, state, branch, contact, self.extent)
        else:
            found = land(self.course, state, branch, self.extent)
        return self._after(state, found)

    def after_switch(self, state: State, branch: Branch) -> Next:
        """On a new branch other contacts may hold."""
        if not touches(self.course, state, branch):
            return branch, state
        return self._after(state, land(self.course, state, branch, self.extent))

    def flight(self, start: State, branch: Branch, until: float) -> tuple[float, float]:
        """Until when to go on, and the unit of time: a contact that has just opened may close again
        long before that of all other motions.
        """
        if branch.active_set is None:
            return until, math.inf
        state = self._with_velocity(start, branch)
        ahead = flight_ahead(self.course, state, branch)
        end = start.t + math.copysign(SOON * ahead, self.course.problem.h)
        return (end, ahead) if abs(end - start.t) < abs(until - start.t) else (until, ahead)

    def ties(self, branch: Branch) -> list[int]:
        """Switches to which the contacts that hold leave no choice."""
        held = branch.active_set
        return [] if held is None else list(ties(self.course.system, held))

    def noted(self) -> tuple[Event, ...]:
        """What has happened since it was asked last."""
        new, self._new = tuple(self._events[self._new :]), len(self._events)
        return new

    def _with_velocity(self, state: State, branch: Branch) -> State:
        scene = scene_in(self.course.system, branch)
        assert scene is not None
        c = all_parameters(self.course.problem.c, branch)
        v = call(velocity_function(scene.system), state.q, state.p, np.array([state.t]), c)[0]
        return state._replace(v=v)

    def _after(self, state: State, found: Landed | None) -> Next:
        if found is None:
            return None, state
        self._events += with_times_of_rest(state.t, self._events, found.events)
        return found.branch, found.state
