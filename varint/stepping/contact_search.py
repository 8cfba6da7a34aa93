"""The first event in a step: where a gap closes or a contact that holds would begin to pull."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from varint.arrays import call
from varint.manifold import multipliers_along
from varint.polynomials import lagrange_values
from varint.rules import Rule
from varint.stepping.contact import TOUCH
from varint.stepping.contact_view import Instant, View, first_contact, passage_function, split
from varint.stepping.events import LOCATED, lowest, root
from varint.stepping.run import Task
from varint.system import System

MOST_ITERATIONS = 100
NEWTON = 60  # of the cubic's root: bisection alone would be done by then


@dataclass(frozen=True, eq=False)
class Reached:
    """An instant some time ahead in the same phase, its view, residual and iterations of the way, the controls."""

    ahead: float
    now: Instant
    seen: View
    residual: float
    iterations: int
    u: np.ndarray

    @property
    def is_finite(self) -> bool:
        """Whether the state is, and every gap and rate there."""
        return bool(np.isfinite(self.now.x).all() and np.isfinite(self.seen.gap + self.seen.rate).all())


@dataclass(frozen=True, eq=False)
class Passage:
    """Sub-steps of any size from one instant within step k, all in the same phase."""

    system: System
    rule: Rule
    task: Task
    now: Instant
    here: View
    scale: np.ndarray
    k: int
    made: dict[float, Reached] = field(default_factory=dict)

    @property
    def reach(self) -> np.ndarray:
        """How far each coordinate moves in a step."""
        return abs(self.task.h) * self.scale[: len(self.now.q)]

    def to(self, ahead: float) -> Reached:
        """The instant so much later, computed once."""
        if ahead not in self.made:
            self.made[ahead] = self._to(ahead)
        return self.made[ahead]

    def _to(self, ahead: float) -> Reached:
        now, task, n = self.now, self.task, len(self.now.q)
        nodes = self.controls(ahead, self.rule.nodes)
        if ahead == 0:
            return Reached(0.0, now, self.here, 0.0, 0, self.controls(0.0, (0.0,)).ravel())
        function = passage_function(self.system, self.rule, now.phase.rows, now.phase.contacts)
        flat = call(function, now.x, self.scale, nodes.ravel(), task.c, np.array([now.t, ahead]))[0]
        there = Instant(now.t + ahead, flat[: 4 * n].copy(), now.phase)
        seen = split(flat[4 * n + 2 :], n, self.system.contact.numel())
        residual, count = float(flat[4 * n]), flat[4 * n + 1]
        return Reached(ahead, there, seen, residual, int(np.nan_to_num(count)), self.controls(ahead, (1.0,)).ravel())

    def controls(self, ahead: float, fractions: tuple[float, ...]) -> np.ndarray:
        """Controls at fractions of the way ahead, (len(fractions), k)."""
        u = self.task.u[min(self.k, len(self.task.u) - 1)]
        if not u.shape[1]:
            return np.empty((len(fractions), 0))
        if len(u) == 1:
            return np.broadcast_to(u, (len(fractions), u.shape[1])).copy()
        begin = (self.now.t - self.task.t0) / self.task.h - self.k
        at = begin + ahead / self.task.h * np.array(fractions)
        return lagrange_values(np.array(self.rule.nodes), np.clip(at, 0.0, 1.0)) @ u

    def push(self, reached: Reached, contact: int) -> float:
        """Multiplier of a contact that holds."""
        at, slot = reached.now, first_contact(self.system) + contact
        rows = at.q[None], reached.seen.v[None], reached.u[None], np.array([at.t]), self.task.c
        return float(multipliers_along(self.system, at.phase, *rows)[0, slot])


def earliest(passage: Passage, left: float) -> tuple[Reached, bool, int | None]:
    """(the first event in the rest of the step or its end, whether it is an event, the contact that lets go if any)."""
    end = passage.to(left)
    if not np.isfinite(end.residual) or not end.is_finite:
        return end, False, None
    best, happens, lets_go = left, False, None
    for i in range(len(end.seen.gap)):
        if i not in passage.now.phase.holding:
            ahead = closes(passage, i, end)
            if ahead is not None and (not happens or abs(ahead) < abs(best)):
                best, happens, lets_go = ahead, True, None
    for i in passage.now.phase.holding:
        ahead = releases(passage, i, end)
        if ahead is not None and (not happens or abs(ahead) < abs(best)):
            best, happens, lets_go = ahead, True, i
    return passage.to(best), happens, lets_go


def releases(passage: Passage, i: int, end: Reached) -> float | None:
    """Time ahead at which contact i would begin to pull, None if it pushes to the end."""
    last = passage.push(end, i)
    if not last < 0:
        return None
    first = passage.push(passage.to(0.0), i)
    if not first > 0:
        return 0.0
    return root(lambda ahead: passage.push(passage.to(ahead), i), 0.0, end.ahead, first, last)


def closes(passage: Passage, i: int, end: Reached) -> float | None:
    """Time ahead at which gap i closes, None if it does not."""

    def gap(ahead: float) -> tuple[float, float]:
        seen = passage.to(ahead).seen
        return float(seen.gap[i]), float(seen.rate[i])

    here, then, left = passage.here, end.seen, end.ahead
    a, (fa, ra) = 0.0, (float(here.gap[i]), float(here.rate[i]))
    b, (fb, rb) = left, (float(then.gap[i]), float(then.rate[i]))
    close = TOUCH * here.sizes(passage.now.q, passage.reach)[i]
    if fb > -close and not (fb < 0 and rb * left < 0):
        where, depth = lowest(*(np.array([x]) for x in (fa, fb, ra * left, rb * left)))
        if not depth[0] < 0:
            return None
        b = float(where[0]) * left
        fb, rb = gap(b)
        if not fb < (-close if fa <= close else 0.0):  # what has just let go rises from zero: round-off is no dip
            return None
    if fa <= close:  # it has just bounced: the other zero is wanted
        if not ra * left > 0:
            return 0.0
        fa = 0.0
    tolerance = LOCATED * max(abs(a), abs(b))
    for _ in range(MOST_ITERATIONS):
        at = a + (b - a) * cubic_root(fa, fb, ra * (b - a), rb * (b - a))
        f, r = gap(at)
        if abs(f) <= abs(r) * tolerance or abs(b - a) <= tolerance:
            return at
        if f < 0:
            b, fb, rb = at, f, r
        else:
            a, fa, ra = at, f, r
    return at


def cubic_root(a: float, b: float, ra: float, rb: float) -> float:
    """Root in (0, 1) of the cubic with values a ≥ 0 > b and slopes ra, rb at 0 and 1; the other one where a = 0."""
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
