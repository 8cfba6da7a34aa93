"""What contacts do at one instant of a motion with switches: impacts, and who holds from then on.

An impact turns velocities, with them the signs of friction, and these forces decide which contacts
hold: one after the other until both agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.errors import StepRefused
from varint.integration.events.contacts import Instant, view
from varint.integration.events.impacts import TOUCH, Setting, event_between, settle
from varint.integration.switches.branch import Branch
from varint.integration.switches.course import Course
from varint.integration.switches.decision import ahead_at, all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.next_branch import next_branch
from varint.integration.switches.timetable import timed
from varint.integration.switches.touching import gap_function, ties, with_contacts
from varint.numerics.arrays import call
from varint.results.records import Event, State
from varint.scene.memory import per_system
from varint.scene.system import System

TURNS = 6  # of impacts, switches and contacts that hold, until they agree
# of the time in which the motion covers its own size: contacts that would fly for 1e-5 of this step
# rest, and heights of 5e-15 are above round-off
STEP = 0.02
SMALL = 1e-3  # of the largest: coordinates and velocities that do not tell how fast a motion is
UNMOVED = 1e-10  # of what velocities contribute to a switch: an impact does not change it
ROUNDED = 64 * np.finfo(float).eps  # of a time: what is shorter is none
NOTHING = 1e-300  # under a division


@dataclass(eq=False)
class Extent:
    """Where a motion has been, (n,) each, and its largest speeds."""

    low: np.ndarray
    high: np.ndarray
    fast: np.ndarray

    def add(self, q: np.ndarray, v: np.ndarray) -> None:
        """Nodes (N, n)."""
        self.low = np.minimum(self.low, q.min(axis=0))
        self.high = np.maximum(self.high, q.max(axis=0))
        self.fast = np.maximum(self.fast, np.abs(v).max(axis=0))

    @property
    def far(self) -> float:
        """The largest coordinate."""
        return float(np.maximum(np.abs(self.low), np.abs(self.high)).max())

    def step(self, most: float) -> float:
        """A step by the motion's own time, of that of the whole run at most."""
        size = np.maximum(self.high - self.low, SMALL * self.far)
        tells = self.fast > SMALL * self.fast.max()
        if not tells.any() or not size[tells].max() > 0:
            return STEP * most
        return STEP * min(float((size[tells] / self.fast[tells]).min()), most)


def extent_of(state: State) -> Extent:
    """That of one state."""
    return Extent(state.q.copy(), state.q.copy(), np.abs(state.v))


@dataclass(frozen=True, eq=False)
class Landed:
    """State and branch after everything that happens at one instant, and the records of it."""

    state: State
    branch: Branch
    events: tuple[Event, ...]


def land(
    course: Course,
    state: State,
    branch: Branch,
    extent: Extent,
    released: frozenset[int] = frozenset(),
) -> Landed | None:
    """Impacts of all that touches and approaches, the branch after them and the contacts that
    hold on it; None where these do not agree.

    `branch` is the one before, or that after a switch; `released` contacts have just let go.
    """
    problem, clocks = course.problem, list(timed(course.system).places)
    events: list[Event] = []
    for turn in range(TURNS):
        active_set = branch.active_set
        assert active_set is not None
        scene = with_contacts(course.system, branch.sliding, active_set)
        c, h = all_parameters(problem.c, branch), extent.step(abs(problem.h))
        rest = np.zeros(len(state.q))
        now = Instant(state.t, np.concatenate([state.q, rest, state.p, rest]), active_set)
        setting = Setting(scene, c, np.empty(0), np.copysign(h, problem.h), h * extent.fast)
        try:
            after, seen, more = settle(setting, now, view(scene, now, c), released=released)
        except StepRefused:
            return None
        events += more
        holds = after.active_set
        if not more:
            paces = seen.speeds(extent.fast) / (h / STEP)
            holds = _without_weak(course, state, branch, holds, paces)
        new = State(state.t, after.q, seen.v, after.p)
        if not more and holds == active_set and (turn or not released):
            return Landed(new, branch, tuple(events))
        one = _branch_after(course, state, new, branch._replace(active_set=holds), extent, clocks)
        if one is None:
            return None
        if one == branch and not more:
            return Landed(new, branch, tuple(events))
        state, branch = new, one
    return None


def _branch_after(
    course: Course, before: State, after: State, branch: Branch, extent: Extent, clocks: list[int]
) -> Branch | None:
    """The branch on which the motion goes on with the contacts that hold now."""
    system, c, held = course.system, course.problem.c, branch.active_set
    assert held is not None
    tied, free = ties(system, held), branch._replace(sliding=())
    sigma = [ahead_at(system, x, c, free) for x in (before, after)]
    if sigma[0] is None or sigma[1] is None:
        return None
    at = after.q, after.v, np.array([after.t]), all_parameters(c, branch)
    least = UNMOVED * call(_speed_function(system), *at, extent.fast)[0]
    stays = np.abs(sigma[1][0] - sigma[0][0]) <= least
    sliding = tuple(j for j in branch.sliding if stays[j] and j not in tied)
    now, counts = sigma[1][0], _counts(system)
    # what an impact leaves at rest is at zero, whatever round-off says
    still = (np.abs(now) <= least) & ~counts
    known = np.array(branch.values)
    own = np.where(counts, np.floor(now), np.where(still | (now == 0), known, np.sign(now)))
    own[clocks] = known[clocks]
    for j, side in tied.items():
        own[j] = side * np.sign(course.problem.h) if still[j] else own[j]
    at_zero = sorted({*sliding, *np.flatnonzero(still).tolist()} - {*tied, *clocks})
    one = branch._replace(values=tuple(own.tolist()), sliding=sliding)
    return next_branch(course, after, one, at_zero, [*clocks, *tied])


def _counts(system: System) -> np.ndarray:
    frozen = frozen_scene(system)
    assert frozen is not None
    return frozen.counts


@per_system
def _speed_function(system: System) -> ca.Function:
    """(q, v, t, c, w) → |∂σ/∂v| w, what velocities of sizes w contribute to each switch."""
    frozen = frozen_scene(system)
    assert frozen is not None
    s, w = frozen.system, ca.SX.sym("w", system.structure.n)
    size = ca.fabs(ca.jacobian(frozen.sigma, s.v)) @ w
    return ca.Function("speeds", [s.q, s.v, s.t, s.c, w], [ca.densify(size)])


def _without_weak(
    course: Course, state: State, branch: Branch, holds: ActiveSet, paces: np.ndarray
) -> ActiveSet:
    """The contacts that hold without those that came to it although nothing presses on them, by
    the usual accelerations of gaps: friction holds what rests there, or it is about to leave.
    """
    before = branch.active_set
    assert before is not None
    new = [i for i in holds.holding if i not in before.holding]
    if not new:
        return holds
    second = _gaps(course, state, branch)[2] * np.sign(course.problem.h)
    weak = [i for i in new if not second[i] < -TOUCH * paces[i]]
    kept = [tuple(i for i in some if i not in weak) for some in (holds.contacts, holds.holding)]
    return replace(holds, contacts=kept[0], holding=kept[1])


def _gaps(course: Course, state: State, branch: Branch) -> list[np.ndarray]:
    """Gaps, their rates and second derivatives."""
    assert branch.active_set is not None
    function = gap_function(course.system, branch.sliding, branch.active_set)
    return call(
        function, state.q, state.v, np.array([state.t]), all_parameters(course.problem.c, branch)
    )


def let_go(
    course: Course, state: State, branch: Branch, contact: int, extent: Extent
) -> Landed | None:
    """What follows where a contact that holds begins to pull."""
    active_set = branch.active_set
    assert active_set is not None
    kept = tuple(i for i in active_set.holding if i != contact)
    scene = with_contacts(course.system, branch.sliding, active_set)
    rest = np.zeros(len(state.q))
    now = Instant(state.t, np.concatenate([state.q, rest, state.p, rest]), active_set)
    seen = view(scene, now, all_parameters(course.problem.c, branch))
    event = event_between(state.t, "detachment", contact, 0.0, (now, seen), (now, seen))
    free = branch._replace(active_set=replace(active_set, contacts=kept, holding=kept))
    landed = land(course, state, free, extent, frozenset({contact}))
    return landed and replace(landed, events=(event, *landed.events))


def touches(course: Course, state: State, branch: Branch) -> bool:
    """Whether contacts hold, or some that do not lie at their gaps' zeros."""
    if branch.active_set is None:
        return False
    if branch.active_set.holding:
        return True
    gap = _gaps(course, state, branch)[0]
    size = np.abs(state.q).max(initial=0.0)
    return bool((gap <= 4 * np.finfo(float).eps * size).any())


def flight_ahead(course: Course, state: State, branch: Branch) -> float:
    """Time, without a sign, until a contact that is all but closed closes if accelerations stay, as
    after an impact; infinity where there is none.
    """
    assert branch.active_set is not None
    gap, rate, second = _gaps(course, state, branch)
    size = np.abs(state.q).max(initial=0.0)
    low = (gap <= TOUCH * size) & (second < 0)
    low[list(branch.active_set.holding)] = False
    gap, rate, pull = np.maximum(gap[low], 0), rate[low] * np.sign(course.problem.h), -second[low]
    ahead = (rate + np.sqrt(rate**2 + 2 * pull * gap)) / pull
    return float(ahead[ahead > ROUNDED * abs(state.t)].min(initial=np.inf))


def with_times_of_rest(
    t: float, events: Sequence[Event], new: Sequence[Event]
) -> tuple[Event, ...]:
    """Records of what comes to rest at t by ever shorter flights, at the sum of all to come: they
    shrink as the last ones did.
    """
    found = []
    for event in new:
        before = [x.time for x in events if x.contact == event.contact and x.kind == "impact"][-2:]
        if event.kind == "stop" and len(before) == 2 and event.time != t:
            last = t - before[1]
            ratio = last / (before[1] - before[0] or NOTHING)
            if 0 < ratio < 1:
                event = replace(event, time=t + last * ratio / (1 - ratio))
        found.append(event)
    return tuple(found)
