"""Contacts at one instant: who touches, who holds, and what an impact does.

Frictionless unilateral contacts gap(q, t) ≥ 0 with Newton's law of restitution: the gap's rate
changes from r to −e r by an impulse Λ ≥ 0 along ∂gap/∂q (Fetecau, Marsden, Ortiz & West 2003).
Blows that come together are dealt one after the other, the fastest first. A contact at rest holds
as long as its multiplier λ ≥ 0; then it is one more holonomic constraint, which stays closed under
a blow elsewhere unless it is elastic itself: then it hands the blow on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, multiplier_function, multipliers_along
from varint.discrete.inertia import inertia_roots
from varint.errors import StepRefused
from varint.integration.events.contacts import Instant, View, first_contact, least_pull, view
from varint.integration.events.held import answer, landed, solvable
from varint.numerics.arrays import call, lengths
from varint.results.records import Event
from varint.scene.memory import per_system
from varint.scene.restitution import restitution_at
from varint.scene.system import System

TOUCH = 1e-10  # a gap this small against what the coordinates contribute to it is closed
RESTING = 1e-10  # a rate this small against the velocities in play is zero
PULL = 1e-10  # a contact that pulls by less than this part of the forces in play pushes
ZENO = 1e-5  # of a step: a body that would fly for a shorter time comes to rest
MOST_IMPACTS = 1000  # between two nodes of the grid; after as many, bodies come to rest
RESTLESS = 10  # events in a step after which contacts that hold do so until its end
SPEED_OF_NOTHING = 1e-300  # under a division
DEPENDENT = 1e-7  # of a gradient: what is left of it beside those of constraints that hold
FLAT = 1e-150  # of a gradient: its square must be a number, too


@per_system
def flight_function(
    system: System, rows: tuple[int, ...], contacts: tuple[int, ...]
) -> ca.Function:
    """(q, v, u, t, c) → d²gap/dt² of every contact with the accelerations of an active set."""
    s, a = system, ca.SX.sym("a", system.q.numel())
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    second = ca.jtimes(rate, s.q, s.v) + ca.jtimes(rate, s.v, a) + ca.jacobian(rate, s.t)
    closing = ca.Function("closing", [s.q, s.v, a, s.t, s.c], [ca.densify(second)], {"cse": True})
    sizes = (s.q.numel(), s.q.numel(), s.control.numel(), 1, s.c.numel())
    q, v, u, t, c = (ca.MX.sym(name, k) for name, k in zip("qvutc", sizes, strict=True))
    accelerations = multiplier_function(ActiveSet(rows, contacts, contacts).scene(s))(
        q, v, u, t, c
    )[1]
    return ca.Function("flight", [q, v, u, t, c], [ca.densify(closing(q, v, accelerations, t, c))])


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change while an event is dealt with: the scene, its parameters, controls, step,
    and how far each coordinate moves in it."""

    system: System
    c: np.ndarray
    u: np.ndarray
    h: float
    reach: np.ndarray

    @cached_property
    def restitution(self) -> np.ndarray:
        """Of every contact."""
        return restitution_at(self.system, self.c)

    @property
    def direction(self) -> float:
        """+1, and −1 in a run backwards in time, where gaps close that are growing."""
        return 1.0 if self.h > 0 else -1.0


def settle(
    setting: Setting,
    now: Instant,
    seen: View,
    *,
    released: frozenset[int] = frozenset(),
    sinking: frozenset[int] = frozenset(),
    tired: bool = False,
) -> tuple[Instant, View, list[Event]]:
    """Impacts of all that touches and approaches, one after the other, then what stays closed.

    `released` contacts have just let go and do not hold, `sinking` ones do; a `tired` body has
    bounced too often and comes to rest.
    """
    events: list[Event] = []
    closed = seen.gap <= TOUCH * seen.sizes(now.q, setting.reach)
    if not (closed.any() or now.active_set.holding):
        return now, seen, events
    quick = seen.speeds(setting.reach / abs(setting.h))
    for _ in range(MOST_IMPACTS):
        quick = np.maximum(quick, seen.speeds(setting.reach / abs(setting.h)))
        rate = setting.direction * seen.rate
        coming = closed & (rate < -RESTING * quick)
        for i in now.active_set.holding:
            coming[i] = False
        if not coming.any():
            break
        hit = int(np.argmin(np.where(coming, rate / np.maximum(quick, SPEED_OF_NOTHING), 0.0)))
        still = np.flatnonzero(closed & (np.abs(rate) <= RESTING * quick)).tolist()
        now, seen, event = _impact(setting, now, seen, hit, still, tired)
        events.append(event)
    resting = np.flatnonzero(closed & (np.abs(seen.rate) <= RESTING * quick)).tolist()
    candidates = sorted({*now.active_set.holding, *resting} - released)
    now = replace(now, active_set=_holding(setting, now, seen, candidates, sinking))
    there = landed(setting.system, now, seen, np.flatnonzero(closed).tolist())
    if there is not now:
        now, seen = there, view(setting.system, there, setting.c)
    q, holding = tuple(now.q.tolist()), now.active_set.holding
    events = [
        replace(e, q=q)
        if e.kind == "impact" or e.contact in holding
        else replace(e, q=q, kind="impact", time=float(now.t))
        for e in events
    ]
    return now, seen, events


def _impact(
    setting: Setting, now: Instant, seen: View, hit: int, still: list[int], tired: bool
) -> tuple[Instant, View, Event]:
    """Reflect the rate of one contact; plastic ones that hold stay closed, or open where the
    impulse would pull them.

    Flights that become too short end at once: all that remain take Σ flight eᵏ, and the rate
    becomes 0. Those that are `still` and would open for such a flight stay closed: rocking that
    dies out.
    """
    bounce = 0.0 if tired else float(setting.restitution[hit])
    if lengths(seen.slope[first_contact(setting.system) + hit]) <= FLAT:
        raise StepRefused(
            f"contact {hit} closes at t = {now.t:g} where its gap has no gradient ∂gap/∂q, so no "
            "impulse can open it: give a gap that grows with the distance, not with a power of it"
        )
    if setting.h < 0 and bounce < 1:
        raise StepRefused(
            f"contact {hit} is hit at t = {now.t:g} in a run backwards in time, and its "
            f"restitution is {bounce:g}: what an impact takes away cannot be found again; only "
            "restitution 1 can be undone"
        )
    shortest, wait, kept = ZENO * abs(setting.h), 0.0, list[int]()
    while True:
        after, later, impulse = _reflect(setting, now, seen, hit, bounce, kept, tired)
        opened = [
            i
            for i in still
            if i not in after.active_set.holding
            and later.rate[i] > 0
            and _flight(setting, after, later, i) <= shortest
        ]
        kept += opened
        flight = np.inf
        if not opened and bounce > 0 and setting.h > 0:
            flight = _flight(setting, after, later, hit)
        if flight <= shortest:
            wait, bounce = flight / (1 - bounce) if bounce < 1 else 0.0, 0.0
        elif not opened:
            break
    kind = "impact" if bounce > 0 else "stop"
    return (
        after,
        later,
        event_between(float(now.t + wait), kind, hit, impulse, (now, seen), (after, later)),
    )


def event_between(
    time: float,
    kind: str,
    contact: int | None,
    impulse: float,
    before: tuple[Instant, View],
    after: tuple[Instant, View],
) -> Event:
    """The record of what leads from one instant to another."""
    (now, seen), (then, later) = before, after
    states = (x.tolist() for x in (now.q, seen.v, now.p, later.v, then.p))
    return Event(time, kind, contact, impulse, seen.energy, later.energy, *map(tuple, states))


def _reflect(
    setting: Setting,
    now: Instant,
    seen: View,
    hit: int,
    bounce: float,
    kept: list[int],
    sticks: bool,
) -> tuple[Instant, View, float]:
    """The instant after the blow, as seen then, and its impulse; those that are `kept` stay
    closed, and if it `sticks`, plastic contacts all do.
    """
    system, first = setting.system, first_contact(setting.system)
    fixed = [*now.active_set.rows, *range(system.constraint.numel(), first)]
    holding = sorted({*now.active_set.holding, *kept})
    row = seen.slope[first + hit]
    while True:
        rows = seen.slope[[*fixed, *(first + i for i in holding)]]
        y, shares = answer(seen.mass, rows, row)
        felt = np.empty(0)
        if holding:
            blows = np.append(shares[len(fixed) :], 1.0) * lengths(
                seen.slope[[*(first + i for i in holding), first + hit]]
            )
            felt = math.copysign(1.0, -float(seen.rate[hit])) * blows[:-1] / np.abs(blows).max()
        free = [x for x in zip(holding, felt.tolist(), strict=True) if x[0] not in kept]
        elastic = [i for i, x in free if setting.restitution[i] > 0 and abs(x) > PULL]
        pulled = min(free, key=lambda x: x[1], default=(0, 0.0))
        if elastic:  # these hand the blow on; one that does not feel it stays closed
            holding = [i for i in holding if i not in elastic]
        elif not sticks and pulled[1] < -PULL:
            holding.remove(pulled[0])
        else:
            break
    active_set = solvable(system, now, seen, holding)
    blow, size = row + rows.T @ shares, inertia_roots(seen.mass)
    if lengths(blow / size) <= DEPENDENT * lengths(row / size):
        raise StepRefused(
            f"contact {hit} closes at t = {now.t:g} where the constraints alone say how its gap "
            "changes, so no impulse can open it: start elsewhere, or give constraints that leave "
            "the gap free"
        )
    unit = float(row @ y)
    impulse = -(1 + bounce) * float(seen.rate[hit]) / unit
    rest = -(1 + bounce) * float(y @ now.carry) / unit
    after = replace(now.pushed(impulse * blow, rest * blow), active_set=active_set)
    return after, view(system, after, setting.c), impulse


def _flight(setting: Setting, now: Instant, seen: View, contact: int) -> float:
    """Time until a contact that just bounced closes again, if its acceleration stays."""
    function = flight_function(setting.system, now.active_set.rows, now.active_set.contacts)
    towards = -call(function, now.q, seen.v, setting.u, np.array([now.t]), setting.c)[0][contact]
    return 2 * abs(seen.rate[contact]) / towards if towards > 0 else np.inf


def _holding(
    setting: Setting, now: Instant, seen: View, candidates: list[int], sinking: frozenset[int]
) -> ActiveSet:
    """Of the contacts at rest, those that must push to stay closed, and those known to sink."""
    system = setting.system
    while candidates:
        active_set = solvable(system, now, seen, candidates)
        slots = first_contact(system) + np.array(candidates)
        rows = now.q[None], seen.v[None], setting.u[None], np.array([now.t]), setting.c
        lam = multipliers_along(system, active_set, *rows)[0]
        weight = np.abs(lam * lengths(seen.slope)).max()
        weight = max(weight, float(least_pull(system, active_set, *rows)[0]))
        pressures = lam[slots] * lengths(seen.slope[slots])
        pressures[np.isin(candidates, list(sinking))] = 0.0
        if pressures.min() >= -PULL * weight:
            return active_set
        candidates.pop(int(np.argmin(pressures)))
    return replace(now.active_set, contacts=(), holding=())
