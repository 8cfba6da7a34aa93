"""The first event in a step: where a gap closes or a contact that holds would begin to pull."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from varint.discrete.constraints import multipliers_along
from varint.errors import StepRefused
from varint.integration.events.clearance import Ends, least_gaps
from varint.integration.events.contacts import (
    Instant,
    View,
    first_contact,
    least_pull,
    passage_function,
    split,
)
from varint.integration.events.held import ROUND_OFF
from varint.integration.events.impacts import PULL, RESTING, TOUCH
from varint.integration.events.roots import LOCATED, find_root
from varint.integration.problem import InitialValueProblem
from varint.integration.steppers.stepper import state_layout
from varint.numerics.arrays import call
from varint.numerics.limits import GAP_ITERATIONS
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_LOOKS = 300  # within a step; a gap that is in doubt everywhere is zero up to round-off
HALVINGS = 20  # of what is left of a step: gaps that dip shallower than its square allows stay open
NEWTON = 60  # of the cubic's root: bisection alone would be done by then


@dataclass(frozen=True, eq=False)
class Reached:
    """The end of a sub-step of duration `ahead` in the same active set: instant, contact problem
    and controls there, residual and iterations of the sub-step.
    """

    ahead: float
    now: Instant
    seen: View
    residual: float
    iterations: int
    u: np.ndarray

    def as_ends(self) -> Ends:
        """The instant as one end of a piece of the way."""
        seen = self.seen
        states = (self.now.q, seen.v, seen.gap, seen.rate, np.array(self.now.t))
        return Ends(*(x[None] for x in states))

    @property
    def is_finite(self) -> bool:
        """Whether the state is, and every gap and rate there."""
        return bool(
            np.isfinite(self.now.x).all() and np.isfinite(self.seen.gap + self.seen.rate).all()
        )


@dataclass(frozen=True, eq=False)
class Passage:
    """The dense output of the rest of step k: sub-steps of the rule, of any duration, from one
    instant, all in the same active set.
    """

    system: System
    rule: Rule
    problem: InitialValueProblem
    now: Instant
    here: View
    scale: np.ndarray
    k: int
    made: dict[float, Reached] = field(default_factory=dict)
    bounds: dict[tuple[float, float], np.ndarray] = field(default_factory=dict)

    @property
    def reach(self) -> np.ndarray:
        """How far each coordinate moves in a step."""
        return abs(self.problem.h) * self.scale[: len(self.now.q)]

    def to(self, ahead: float) -> Reached:
        """The instant so much later, computed once."""
        if ahead not in self.made:
            self.made[ahead] = self._to(ahead)
        return self.made[ahead]

    def _to(self, ahead: float) -> Reached:
        now, problem, n = self.now, self.problem, len(self.now.q)
        nodes = self.controls(ahead, self.rule.nodes)
        if ahead == 0:
            return Reached(0.0, now, self.here, 0.0, 0, self.controls(0.0, (0.0,)).ravel())
        function = passage_function(
            self.system, self.rule, now.active_set.rows, now.active_set.contacts
        )
        flat = call(
            function, now.x, self.scale, nodes.ravel(), problem.c, np.array([now.t, ahead])
        )[0]
        there = Instant(now.t + ahead, flat[state_layout(n).moving].copy(), now.active_set)
        seen = split(flat[4 * n + 2 :], n, self.system.contact.numel())
        residual, count = float(flat[4 * n]), float(flat[4 * n + 1])
        return Reached(
            ahead,
            there,
            seen,
            residual,
            int(count) if count == count else 0,
            self.controls(ahead, (1.0,)).ravel(),
        )

    def least_gap(self, left: Reached, right: Reached, i: int) -> float:
        """A lower bound of gap i between two instants."""
        ends = left.ahead, right.ahead
        if ends not in self.bounds:
            self.bounds[ends] = least_gaps(
                self.system, left.as_ends(), right.as_ends(), self.problem.c
            )[0]
        return float(self.bounds[ends][i])

    def controls(self, ahead: float, fractions: tuple[float, ...]) -> np.ndarray:
        """Controls at fractions of the way ahead, (len(fractions), k)."""
        u = self.problem.u[min(self.k, len(self.problem.u) - 1)]
        if not u.shape[1]:
            return np.empty((len(fractions), 0))
        if len(u) == 1:
            return np.broadcast_to(u, (len(fractions), u.shape[1])).copy()
        begin = (self.now.t - self.problem.t0) / self.problem.h - self.k
        at = begin + ahead / self.problem.h * np.array(fractions)
        return lagrange_values(np.array(self.rule.nodes), np.clip(at, 0.0, 1.0)) @ u

    def push(self, reached: Reached, contact: int) -> float:
        """Multiplier of a contact that holds."""
        at, slot = reached.now, first_contact(self.system) + contact
        rows = at.q[None], reached.seen.v[None], reached.u[None], np.array([at.t]), self.problem.c
        return float(multipliers_along(self.system, at.active_set, *rows)[0, slot])

    def least_pull(self, reached: Reached) -> float:
        """A multiplier that is nothing beside the forces that move other bodies."""
        at = reached.now
        rows = at.q[None], reached.seen.v[None], reached.u[None], np.array([at.t]), self.problem.c
        return float(least_pull(self.system, at.active_set, *rows)[0])


class NextEvent(NamedTuple):
    """The first event in the rest of a step, or its end if there is none: whether it is one, the
    contact that lets go there, and those at rest that would sink and so must hold.
    """

    reached: Reached
    happens: bool
    lets_go: int | None = None
    sinking: frozenset[int] = frozenset()


def first_event(passage: Passage, left: float, restless: bool = False) -> NextEvent:
    """The first event in the rest of a step; in a `restless` one contacts that hold do not let
    go until its end.
    """
    end = passage.to(left)
    if not np.isfinite(end.residual) or not end.is_finite:
        return NextEvent(end, False)
    best, happens, lets_go = left, False, None
    free = [i for i in range(len(end.seen.gap)) if i not in passage.now.active_set.holding]
    sinking = frozenset(i for i in free if sinks(passage, i, end))
    for i in free:
        ahead = 0.0 if i in sinking else closing_time(passage, i, end)
        if ahead is not None and (not happens or abs(ahead) < abs(best)):
            best, happens, lets_go = ahead, True, None
    for i in () if restless else passage.now.active_set.holding:
        ahead = release_time(passage, i, end)
        if ahead is not None and (not happens or abs(ahead) < abs(best)):
            best, happens, lets_go = ahead, True, i
    return NextEvent(passage.to(best), happens, lets_go, sinking)


def release_time(passage: Passage, i: int, end: Reached) -> float | None:
    """Time ahead at which contact i would begin to pull, None if it pushes to the end."""
    last = passage.push(end, i)
    if not last < -PULL * passage.least_pull(end):
        return None
    first = passage.push(passage.to(0.0), i)
    if not first > 0:
        return 0.0
    return find_root(lambda ahead: passage.push(passage.to(ahead), i), 0.0, end.ahead, first, last)


def closing_time(passage: Passage, i: int, end: Reached) -> float | None:
    """Time ahead at which gap i closes first, None if it does not.

    Where bounds along a piece of the way leave it in doubt, its halves are looked at, the earlier
    one first.
    """
    close, shortest = _close(passage, i, end), abs(end.ahead) * 0.5**HALVINGS

    def first_between(left: Reached, right: Reached, known: float | None) -> float | None:
        if known is None and _is_closed(right, i, close):
            known = _closing(passage, i, left, right, close)
        if known is not None:
            right = passage.to(known)
        if passage.least_gap(left, right, i) >= -close:
            return known
        if abs(right.ahead - left.ahead) <= shortest or len(passage.made) > MOST_LOOKS:
            return known
        middle = passage.to((left.ahead + right.ahead) / 2)
        earlier = first_between(left, middle, None)
        return earlier if earlier is not None else first_between(middle, right, known)

    start, here = passage.to(0.0), passage.here
    if here.gap[i] <= close:
        if _rests(passage, i):
            start = _leaving(passage, i, end, close)
        elif not here.rate[i] * end.ahead > 0:
            return 0.0 if first_between(start, end, None) is not None else None
    return first_between(start, end, None)


def sinks(passage: Passage, i: int, end: Reached) -> bool:
    """Whether a gap that is closed and at rest would go below zero at once.

    A contact whose multiplier says that it would pull, but whose gap does not open, is where the
    multiplier changes its sign: it holds.
    """
    close = _close(passage, i, end)
    if not (passage.here.gap[i] <= close and _rests(passage, i)):
        return False
    return bool(_leaving(passage, i, end, close).seen.gap[i] < -close)


def _close(passage: Passage, i: int, end: Reached) -> float:
    """A gap this small is closed."""
    moved = np.maximum(passage.reach, np.abs(end.now.q - passage.now.q))
    return float(TOUCH * passage.here.sizes(passage.now.q, moved)[i])


def _rests(passage: Passage, i: int) -> bool:
    quick = passage.here.speeds(passage.scale[: len(passage.now.q)])
    return bool(abs(passage.here.rate[i]) <= RESTING * quick[i])


def _leaving(passage: Passage, i: int, end: Reached, close: float) -> Reached:
    """Of the instants 2⁻ᵏ of the way ahead, the first at which a gap at rest is not zero."""
    found = end
    for k in range(1, HALVINGS):
        earlier = passage.to(end.ahead * 0.5**k)
        if abs(earlier.seen.gap[i]) <= close:
            break
        found = earlier
    return found


def _is_closed(reached: Reached, i: int, close: float) -> bool:
    """Whether gap i is beyond zero, or about to be."""
    gap, rate = reached.seen.gap[i], reached.seen.rate[i]
    return bool(gap < -close or (gap < 0 and rate * reached.ahead < 0))


def _closing(passage: Passage, i: int, left: Reached, right: Reached, close: float) -> float:
    """Time ahead at which gap i closes, open at one instant and closed at a later one."""
    (a, fa, ra), (b, fb, rb) = (
        (x.ahead, float(x.seen.gap[i]), float(x.seen.rate[i])) for x in (left, right)
    )
    level = 0.0
    if fa <= close:  # it has just bounced: the other zero is wanted
        if not ra * right.ahead > 0:
            return a
        level, fa = level_of(fa, fb, ra * (b - a), rb * (b - a)), 0.0
    fb -= level
    tolerance = LOCATED * max(abs(a), abs(b))
    at = b
    for _ in range(GAP_ITERATIONS):
        at = a + (b - a) * cubic_root(fa, fb, ra * (b - a), rb * (b - a))
        reached = passage.to(at)
        f, r = float(reached.seen.gap[i]) - level, float(reached.seen.rate[i])
        rounding = ROUND_OFF * float(np.abs(passage.here.closing[i] * reached.now.q).sum())
        if abs(f) <= max(abs(r) * tolerance, rounding):
            return at
        if abs(b - a) <= tolerance:
            break
        if f < 0:
            b, fb, rb = at, f, r
        else:
            a, fa, ra = at, f, r
    if abs(f) > close:
        raise StepRefused(
            f"gap {i} jumps to {fb:.3g} at t = {passage.now.t + at:g}, so no impulse can keep it "
            "open: give a gap that is continuous, such as the distance from the obstacle"
        )
    return at


def level_of(a: float, b: float, ra: float, rb: float) -> float:
    """Where a gap closes again that rises from a at the rate ra, along the cubic with values a, b
    and slopes ra, rb at 0 and 1: at zero, or where it began below, as it hardly leaves that.
    """
    low, bend = min(a, 0.0), 3 * (b - a) - 2 * ra - rb
    return low if ra * ra <= 8 * low * bend else 0.0


def cubic_root(a: float, b: float, ra: float, rb: float) -> float:
    """Root in (0, 1) of the cubic with values a ≥ 0 > b and slopes ra, rb at 0 and 1; the other
    one where a = 0.
    """
    c3, c2 = 2 * (a - b) + ra + rb, 3 * (b - a) - 2 * ra - rb
    c = (a, ra, c2, c3) if a > 0 else (ra, c2, c3, 0.0)
    low, high, s = 0.0, 1.0, 0.5
    for _ in range(NEWTON):
        value = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
        slope = c[1] + s * (2 * c[2] + s * 3 * c[3])
        if value > 0:
            low = s
        else:
            high = s
        following = s - value / slope if slope < 0 else 0.5 * (low + high)
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - s) <= LOCATED * s:
            break
        s = following
    return s
