"""What ties the end of one phase to the start of another: continuity, periodicity, relabelling,
impacts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.control.contacts import touched
from varint.control.ends import offsets
from varint.control.impacts import WORDS, impact_at, named_contact
from varint.control.phase import CheckedPhase
from varint.control.transcription import PhaseTranscription, pick
from varint.errors import InputError
from varint.nlp.assembly import Element
from varint.nlp.expressions import column


@dataclass(frozen=True, eq=False)
class Link:
    """How the end of phase `before` becomes the start of phase `after` (numbers in the list of
    phases).

    Attributes
    ----------
    before, after : int
        Numbers of the phases.
    contact : SX (c,) or None
        φ(q) of the first phase's coordinates: zero at the link, and the momentum jumps along its
        normal. Constraints and contacts that hold in the second phase only need not be named,
        unless coordinates are relabelled: they stop the motion across them.
    sticks : SX (f,) or None
        Further expressions of q that stop moving at a contact (a foot that does not slip): the
        momentum jumps along them too.
    restitution : float
        e of the contact, 0 (no bounce) to 1.
    relabel : SX (n,) or None
        New coordinates as expressions of the old ones (legs change names, a frame moves on);
        default: the same.
    offset : sequence or None
        Added to the new coordinates (None for a component: this coordinate is not linked).
    time : bool
        The second phase begins when the first one ends.

    States beside the mechanics that both phases have, by their names, go on where they were.
    """

    before: int
    after: int
    contact: Any = None
    sticks: Any = None
    restitution: float = 0.0
    relabel: Any = None
    offset: Any = None
    time: bool = True


def default_links(count: int) -> list[Link]:
    """Each of so many phases continues where the one before ended."""
    return [Link(i, i + 1) for i in range(count - 1)]


class LinkTranscription(NamedTuple):
    """A link in the program: its own unknowns (impulses Λ) and rows."""

    impulses: np.ndarray  # where Λ sits among the unknowns
    x_low: np.ndarray  # of its own unknowns: contacts push
    rows: int
    elements: list[Element]

    @property
    def unknowns(self) -> int:
        """Number of its own unknowns."""
        return len(self.x_low)


def transcribe_link(
    link: Link, phases: list[PhaseTranscription], x: int, g: int
) -> LinkTranscription:
    """Place a link behind x unknowns and g rows."""
    before, after = phases[link.before], phases[link.after]
    s, n = before.phase.system, before.phase.system.structure.n
    if after.phase.system.structure.n != n:
        raise InputError(
            f"phases {link.before} and {link.after} have {n} and {after.phase.system.structure.n} "
            "coordinates; a link needs equally many"
        )
    impact = impact_at(
        link.contact,
        link.sticks,
        link.restitution,
        link.relabel is None,
        before.phase,
        after.phase,
    )
    new = (
        s.q
        if link.relabel is None
        else column("relabel", link.relabel, ca.vertcat(s.q, s.c), WORDS)
    )
    if new.numel() != n:
        raise InputError(f"relabel has {new.numel()} components; one for each of {list(s.names)}")
    if not isinstance(link.time, bool):
        raise InputError(f"time of a link must be True or False, got {link.time!r}")
    offset = (
        np.zeros(n) if link.offset is None else offsets("offset of a link", link.offset, n, s.names)
    )
    tied, offset_or_zero = np.flatnonzero(~np.isnan(offset)), np.nan_to_num(offset)
    q0, v0, c0, q1, v1 = (
        ca.SX.sym(name, k) for name, k in zip("abcde", (n, n, s.c.numel(), n, n), strict=True)
    )
    impulses = len(impact.bounce)
    impulse = ca.SX.sym("impulse", impulses)
    p_before = ca.Function("p", [s.q, s.v, s.c], [s.momentum])
    old = ca.Function("old", [s.q, s.c], [impact.contact, impact.rows, new, ca.jacobian(new, s.q)])
    gap, normal, q_new, slope = old(q0, c0)
    rows = [pick(q1 - q_new - offset_or_zero, tied)]
    extra, extra_x = [], np.zeros(0, dtype=int)
    if impulses:
        bounce = ca.DM(impact.bounce)
        w = ca.SX.sym("w", n)  # velocity after the impact in the old coordinates
        rows += [
            pick(v1 - ca.mtimes(slope, w), tied),
            gap,
            ca.mtimes(normal, w) + bounce * ca.mtimes(normal, v0),
        ]
        rows.append(p_before(q0, w, c0) - p_before(q0, v0, c0) - ca.mtimes(normal.T, impulse))
        extra, extra_x = [w, impulse], x + np.arange(n + impulses)
    else:
        rows.append(pick(v1 - ca.mtimes(slope, v0), tied))
    column_of_rows = ca.densify(ca.vertcat(*rows))
    place_c, constant_c = before.slots.shared[2:], before.first_shared + 2
    free = np.flatnonzero(place_c >= 0)
    fixed = np.flatnonzero(place_c < 0)
    element = Element(
        variables=ca.vertcat(q0, v0, q1, v1, *extra, pick(c0, free)),
        constants=pick(c0, fixed),
        cost=ca.SX(0),
        rows=column_of_rows,
        x=np.concatenate(
            [
                before.slots.q[-1],
                before.slots.v[1],
                after.slots.q[0],
                after.slots.v[0],
                extra_x,
                place_c[free],
            ]
        ).astype(int)[None],
        p=(constant_c + fixed)[None],
        g=g + np.arange(column_of_rows.numel())[None],
    )
    elements, count = [element], column_of_rows.numel()
    if link.time and link.after != link.before and after.slots.shared[0] >= 0:
        elements.append(_clock(before, after, g + count))
        count += 1
    if link.after != link.before and len(after.phase.states.index):
        element = _states(before, after, g + count)
        elements.append(element)
        count += element.rows.numel()
    x_low = np.full(len(extra_x), -np.inf)
    x_low[n:][impact.pushes] = 0.0
    return LinkTranscription(extra_x[n:], x_low, count, elements)


def with_touching(checks: list[CheckedPhase], links: list[Link]) -> list[CheckedPhase]:
    """The phases, with those of their open contacts marked that are 0 by a link at their ends."""
    contacts = [x.contacts for x in checks]
    for link in links:
        first, second = checks[link.before], checks[link.after]
        hits = ca.vertsplit(named_contact(link.contact, first))
        plain = link.relabel is None and link.offset is None
        ahead = ca.vertsplit(second.system.constraint) if plain else []
        contacts[link.before] = touched(contacts[link.before], [*hits, *ahead], True)
        if plain:
            known = [*hits, *ca.vertsplit(first.system.constraint)]
            contacts[link.after] = touched(contacts[link.after], known, False)
    return [replace(x, contacts=own) for x, own in zip(checks, contacts, strict=True)]


def _states(before: PhaseTranscription, after: PhaseTranscription, row: int) -> Element:
    """States that both phases have, by their names, go on where they were."""
    names = [part.phase.states.names(part.phase.system) for part in (before, after)]
    common = [name for name in names[1] if name in names[0]]
    ends = before.slots.states[-1], after.slots.states[0]
    places = [at[[own.index(name) for name in common]] for own, at in zip(names, ends, strict=True)]
    z0, z1 = ca.SX.sym("z0", len(common)), ca.SX.sym("z1", len(common))
    return Element(
        variables=ca.vertcat(z0, z1),
        constants=ca.SX(0, 1),
        cost=ca.SX(0),
        rows=z1 - z0,
        x=np.concatenate(places).astype(int)[None],
        p=np.zeros((1, 0), dtype=int),
        g=row + np.arange(len(common))[None],
    )


def _clock(before: PhaseTranscription, after: PhaseTranscription, row: int) -> Element:
    """t0 of the second phase = t0 + T of the first."""
    t0, T, t1 = ca.SX.sym("t0"), ca.SX.sym("T"), ca.SX.sym("t1")
    base = before.first_shared
    places, names = before.slots.shared[:2], [t0, T]
    free = [i for i in (0, 1) if places[i] >= 0]
    fixed = [i for i in (0, 1) if places[i] < 0]
    return Element(
        variables=ca.vertcat(*(names[i] for i in free), t1),
        constants=ca.vertcat(ca.SX(0, 1), *(names[i] for i in fixed)),
        cost=ca.SX(0),
        rows=t1 - t0 - T,
        x=np.array([[*(places[i] for i in free), after.slots.shared[0]]], dtype=int),
        p=np.array([[base + i for i in fixed]], dtype=int).reshape(1, len(fixed)),
        g=np.array([[row]]),
    )
