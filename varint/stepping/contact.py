"""Contacts at one instant: who touches, who holds, and what an impact does.

Frictionless unilateral contacts gap(q, t) ≥ 0 with Newton's law of restitution: the gap's rate changes from r to −e r
by an impulse Λ ≥ 0 along ∂gap/∂q (Fetecau, Marsden, Ortiz & West 2003). A contact at rest holds as long as its
multiplier λ ≥ 0; then it is one more holonomic constraint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.arrays import call
from varint.consistency import independent
from varint.legendre import velocity_function
from varint.manifold import Phase, every_row_function, multiplier_function, multipliers_along
from varint.projection import row_sizes
from varint.system import System, per_system
from varint.trajectory import Event

TOUCH = 1e-10  # a gap this small against what the coordinates contribute to it is closed
RESTING = 1e-10  # a rate this small against the velocities in play is zero
PULL = 1e-10  # a contact that pulls by less than this part of the forces in play pushes
ZENO = 1e-5  # of a step: a body that would fly for a shorter time comes to rest
MOST_IMPACTS = 1000  # between two nodes of the grid; after as many, bodies come to rest


@dataclass(frozen=True, eq=False)
class Instant:
    """Where the motion is: time, coordinates, momenta, what holds."""

    t: float
    q: np.ndarray
    p: np.ndarray
    phase: Phase


@per_system
def instant_function(system: System) -> ca.Function:
    """(q, v, t, c) → (gaps, their rates, M, energy)."""
    s = system
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    outputs = [ca.densify(x) for x in (s.contact, rate, s.mass_matrix, s.energy)]
    return ca.Function("instant", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


@per_system
def gap_function(system: System) -> ca.Function:
    """(q, t, c) → gaps."""
    return ca.Function("gaps", [system.q, system.t, system.c], [ca.densify(system.contact)])


@per_system
def closing_function(system: System) -> ca.Function:
    """(q, v, a, t, c) → d²gap/dt² for accelerations a."""
    s, a = system, ca.SX.sym("a", system.q.numel())
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    second = ca.jtimes(rate, s.q, s.v) + ca.jtimes(rate, s.v, a) + ca.jacobian(rate, s.t)
    return ca.Function("closing", [s.q, s.v, a, s.t, s.c], [ca.densify(second)], {"cse": True})


@dataclass(frozen=True, eq=False)
class View:
    """The contacts as one instant shows them: velocities, gaps, rates, slopes of all rows, masses, energy, sizes."""

    v: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    slope: np.ndarray
    mass: np.ndarray
    energy: float
    size: np.ndarray


def view(system: System, now: Instant, c: np.ndarray) -> View:
    """Everything about the contacts at an instant."""
    n, t = len(now.q), np.array([now.t])
    v = call(velocity_function(now.phase.scene(system)), now.q, now.p, t, c)[0]
    gap, rate, mass, energy = call(instant_function(system), now.q, v, t, c)
    slope = call(every_row_function(system), now.q, v, t, c)[1].reshape(n, -1).T
    contacts = slope[len(slope) - len(gap) :]
    return View(v, gap, rate, slope, mass.reshape(n, n).T, float(energy[0]), row_sizes(contacts, now.q))


def settle(
    system: System, now: Instant, c: np.ndarray, u: np.ndarray, h: float, *, released: frozenset[int] = frozenset(),
    tired: bool = False,
) -> tuple[Instant, list[Event]]:  # fmt: skip
    """Impacts of all that touches and approaches, one after the other, then what stays closed.

    `released` contacts have just let go and do not hold; a `tired` body has bounced too often and comes to rest.
    """
    events: list[Event] = []
    quick = np.zeros(0)
    for _ in range(MOST_IMPACTS):
        seen = view(system, now, c)
        speed = _row_speed(system, seen)
        quick = speed if not len(quick) else np.maximum(quick, speed)
        closed = seen.gap <= TOUCH * seen.size
        coming = closed & (seen.rate < -RESTING * quick) & ~np.isin(np.arange(len(closed)), now.phase.holding)
        if not coming.any():
            break
        hit = int(np.argmin(np.where(coming, seen.rate / np.maximum(quick, 1e-300), 0.0)))
        now, event = _impact(system, now, seen, hit, c, u, h, 0.0 if tired else None)
        events.append(event)
    resting = closed & (np.abs(seen.rate) <= RESTING * quick)
    resting |= np.isin(np.arange(len(closed)), now.phase.holding)
    phase = _holding(system, now, seen, [int(i) for i in np.flatnonzero(resting) if i not in released], c, u)
    events = [replace(e, kind="stop" if e.kind == "stop" and e.contact in phase.holding else "impact") for e in events]
    return replace(now, phase=phase), events


def _row_speed(system: System, seen: View) -> np.ndarray:
    contacts = seen.slope[len(seen.slope) - len(seen.gap) :]
    return np.abs(contacts) @ np.abs(seen.v) + np.abs(seen.rate - contacts @ seen.v)


def _impact(
    system: System, now: Instant, seen: View, hit: int, c: np.ndarray, u: np.ndarray, h: float, rest_in: float | None
) -> tuple[Instant, Event]:
    """Reflect the rate of one contact; those that hold stay closed, or open where the impulse would pull them.

    Flights that become too short end at once: with `rest_in`, the time all that remain would take, the rate becomes 0.
    """
    bounce = float(system.restitution[hit]) if rest_in is None else 0.0
    first = len(seen.slope) - len(seen.gap)
    holding = list(now.phase.holding)
    while True:
        still = [*now.phase.rows, *range(system.constraint.numel(), first), *(first + i for i in holding)]
        rows = seen.slope[[*still, first + hit]]
        want = np.zeros(len(rows))
        want[-1] = -(1 + bounce) * seen.rate[hit]
        impulse = _impulses(seen.mass, rows, want)
        pulled = impulse[len(still) - len(holding) : -1]
        if not (pulled < -PULL * np.abs(impulse).max()).any():
            break
        holding.pop(int(np.argmin(pulled)))
    after = replace(now, p=now.p + rows.T @ impulse, phase=replace(now.phase, contacts=(), holding=tuple(holding)))
    after = replace(after, phase=_solvable(system, after, seen, holding))
    later = view(system, after, c)
    kind = "impact"
    if bounce > 0:
        flight = _flight(system, after, later, hit, c, u)
        if flight <= ZENO * abs(h):  # Σ flight e^k over all bounces to come
            return _impact(system, now, seen, hit, c, u, h, flight / (1 - bounce) if bounce < 1 else 0.0)
    else:
        kind = "stop"
    return after, Event(now.t + (rest_in or 0.0), kind, hit, float(impulse[-1]), seen.energy, later.energy)


def _impulses(mass: np.ndarray, rows: np.ndarray, want: np.ndarray) -> np.ndarray:
    """Impulses along the rows that change their rates as wanted: [M −Wᵀ; W 0] [Δv; Λ] = [0; want]."""
    n, m = mass.shape[0], len(want)
    size = np.sqrt(np.abs(np.diag(mass)))
    size = np.where(size > 0, size, size.max())
    scaled = rows / size
    length = np.linalg.norm(scaled, axis=1)
    matrix = np.block([[mass / np.outer(size, size), -(scaled / length[:, None]).T],
                       [scaled / length[:, None], np.zeros((m, m))]])  # fmt: skip
    right = np.concatenate([np.zeros(n), want / length])
    try:
        found = np.linalg.solve(matrix, right)  # exact where an elastic impact only turns a sign
    except np.linalg.LinAlgError:
        found = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
    return found[n:] / length


def _flight(system: System, now: Instant, seen: View, contact: int, c: np.ndarray, u: np.ndarray) -> float:
    """Time until a contact that just bounced closes again, if its acceleration stays."""
    scene, t = now.phase.scene(system), np.array([now.t])
    a = call(multiplier_function(scene), now.q, seen.v, u, t, c)[1]
    towards = -call(closing_function(system), now.q, seen.v, a, t, c)[0][contact]
    return 2 * seen.rate[contact] / towards if towards > 0 else np.inf


def _holding(system: System, now: Instant, seen: View, candidates: list[int], c: np.ndarray, u: np.ndarray) -> Phase:
    """Of the contacts at rest, those that must push to stay closed."""
    while candidates:
        phase = _solvable(system, now, seen, candidates)
        slots = len(seen.slope) - len(seen.gap) + np.array(candidates)
        rows = now.q[None], seen.v[None], u[None], np.array([now.t]), c
        lam = multipliers_along(system, phase, *rows)[0]
        weight = np.abs(lam * np.linalg.norm(seen.slope, axis=1)).max()
        pushes = lam[slots] * np.linalg.norm(seen.slope[slots], axis=1)
        if pushes.min() >= -PULL * weight:
            return phase
        candidates.pop(int(np.argmin(pushes)))
    return replace(now.phase, contacts=(), holding=())


def _solvable(system: System, now: Instant, seen: View, holding: list[int]) -> Phase:
    """The phase with these contacts held; of dependent rows, the first are solved for."""
    first = len(seen.slope) - len(seen.gap)
    fixed = [*now.phase.rows, *range(system.constraint.numel(), first)]
    kept = independent(seen.slope, seen.mass, [*fixed, *(first + i for i in holding)])
    return replace(now.phase, contacts=tuple(i - first for i in kept if i >= first), holding=tuple(holding))
