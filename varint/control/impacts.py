"""Impacts between two phases: what stops, and along which rows the momentum jumps.

An impact on a contact φ(q) = 0 keeps q and makes the momentum jump along the contact's normal,
p⁺ − p⁻ = (∂φ/∂q)ᵀ Λ, with ∂φ/∂q v⁺ = −e ∂φ/∂q v⁻ (Fetecau, Marsden, Ortiz, West 2003, §3). What
holds before and after it, constraints, closed contacts and non-holonomic rows, keeps holding: the
momentum jumps along these rows too. A constraint that holds after the link and not before it begins
to hold there, by a plastic impact.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.control.contacts import is_among
from varint.control.phase import CheckedPhase
from varint.errors import InputError
from varint.nlp.expressions import column
from varint.scene.inputs import number

WORDS = "q and the parameters of the first phase"


class Impact(NamedTuple):
    """What stops at a link; nothing where it is continuous.

    Attributes
    ----------
    contact : SX (c,)
        Expressions of q that are zero at the link.
    rows : SX (r, n)
        Directions in which the velocity is given.
    bounce : ndarray (r,)
        Part of the velocity before that is thrown back.
    pushes : ndarray of bool (r,)
        Can the impulse only push?
    """

    contact: ca.SX
    rows: ca.SX
    bounce: np.ndarray
    pushes: np.ndarray


def impact_at(
    contact: Any,
    sticks: Any,
    restitution: float,
    plain: bool,
    before: CheckedPhase,
    after: CheckedPhase,
) -> Impact:
    """What the user names as contact and as sticking; then, where coordinates keep their names
    (`plain`), what begins to hold, and all that holds before and after.
    """
    s, none = before.system, ca.SX(0, 1)
    contact, allowed = named_contact(contact, before), ca.vertcat(s.q, s.c)
    stuck = column("sticks", none if sticks is None else sticks, allowed, WORDS)
    if stuck.numel() and not contact.numel():
        raise InputError("sticks= belongs to a contact: give contact= as well")
    if not 0 <= number("restitution", restitution) <= 1:
        raise InputError(f"restitution must lie between 0 and 1, got {restitution!r}")
    bounces = ca.vertsplit(contact)
    held, gaps, slides = _held_after(before, after) if plain else ([], [], ca.SX(0, s.q.numel()))
    if restitution > 0 and any(is_among(row, held) for row in bounces):
        raise InputError(
            "a contact that is closed in the phase after the link does not bounce: leave out "
            "restitution=, or leave the contact open"
        )
    others = [row for row in held if not is_among(row, [*bounces, *ca.vertsplit(stuck)])]
    known = ca.vertsplit(s.constraint)
    begins = [row for row in others if not is_among(row, known)]
    starts_to_roll = slides.shape[0] and not s.structure.nonholonomic
    if not contact.numel() and not begins and not starts_to_roll:
        return Impact(none, ca.SX(0, s.q.numel()), np.zeros(0), np.zeros(0, dtype=bool))
    zero = ca.vertcat(contact, *begins)
    stops = ca.vertcat(zero, stuck, *(row for row in others if is_among(row, known)))
    rows = ca.vertcat(ca.jacobian(stops, s.q), slides)
    if ca.depends_on(ca.vertcat(s.momentum, ca.vec(rows), stops), s.t):
        raise InputError(
            "impacts need momenta, constraints and gaps that do not depend on time explicitly"
        )
    bounce, pushes = np.zeros(rows.shape[0]), np.zeros(rows.shape[0], dtype=bool)
    bounce[: len(bounces)] = restitution
    pushes[: stops.numel()] = [is_among(row, gaps) for row in ca.vertsplit(stops)]
    return Impact(zero, rows, bounce, pushes)


def named_contact(contact: Any, phase: CheckedPhase) -> ca.SX:
    """The contact that a link names at the end of its first phase."""
    s = phase.system
    given = ca.SX(0, 1) if contact is None else contact
    return column("the contact of a link", given, ca.vertcat(s.q, s.c), WORDS)


def _held_after(
    before: CheckedPhase, after: CheckedPhase
) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
    """What holds in the phase after a link, in symbols of the phase before: rows g, those of them
    that are closed contacts, and A; nothing where the two have other parameters.
    """
    s, other = before.system, after.system
    contact = after.given.system.contact
    gaps = ca.vertcat(ca.SX(0, 1), *(contact[i] for i in after.contacts.closed))
    own, new = ca.vertcat(other.q, other.t), ca.vertcat(s.q, s.t)
    held, gaps, slides = (
        ca.substitute(x, own, new) for x in (other.constraint, gaps, other.nonholonomic)
    )
    symbols = ca.symvar(ca.vertcat(held, ca.vec(slides)))
    if not all(ca.depends_on(ca.vertcat(s.q, s.t, s.c), x) for x in symbols):
        return [], [], ca.SX(0, s.q.numel())
    return ca.vertsplit(held), ca.vertsplit(gaps), slides
