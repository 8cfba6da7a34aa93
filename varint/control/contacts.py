"""Contacts in a known order: in each phase some are closed, the others stay open.

A closed contact is a constraint, gap = 0, that can only push: its reaction is bounded, λ ≥ 0, at
the quadrature nodes. An open one is a bound, gap ≥ 0, at the control points; where a contact
closes or opens between two phases its gap is 0 by the link, and is not bounded there a second time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import with_active_rows
from varint.discrete.reactions import reactions
from varint.errors import InputError, parsed_or_refused
from varint.nlp.bounds import PathBounds
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class Contacts:
    """The contacts of a phase.

    Attributes
    ----------
    closed : tuple of int
        Numbers of the contacts that are closed.
    open : SX (o,)
        Gaps of the others.
    touching : ndarray of bool (2, o)
        Is such a gap 0 by a link at the start, at the end?
    """

    closed: tuple[int, ...]
    open: ca.SX
    touching: np.ndarray


def check_contacts(system: System, closed: Any) -> tuple[System, Contacts]:
    """The scene in which these contacts of a system are closed, as constraints."""
    count = system.structure.contacts
    given = parsed_or_refused(
        lambda: tuple(int(i) for i in closed if float(i) == int(i)),
        lambda: f"closed must be numbers of contacts such as [0], got {closed!r}",
    )
    wrong = len(given) != len(tuple(closed)) or len(set(given)) != len(given)
    if wrong or not all(0 <= i < count for i in given):
        known = f"those of this scene are {list(range(count))}" if count else "this scene has none"
        raise InputError(
            f"closed={closed!r} must be numbers of contacts, each once; {known} "
            "(contact= of the System)"
        )
    if not count:
        return system, Contacts((), ca.SX(0, 1), np.zeros((2, 0), dtype=bool))
    if not system.structure.quadratic_kinetic:
        raise InputError(
            "contacts need a Lagrangian that is quadratic in the velocities: the law of impact is "
            "M Δv = Λ ∂gap/∂q"
        )
    rows = tuple(range(system.structure.constraints))
    given = tuple(sorted(given))
    free = [system.contact[i] for i in range(count) if i not in given]
    return (
        with_active_rows(system, rows, given),
        Contacts(given, ca.vertcat(ca.SX(0, 1), *free), np.zeros((2, len(free)), dtype=bool)),
    )


def with_contacts(bounds: PathBounds, system: System, contacts: Contacts) -> PathBounds:
    """The bounds along the path, then gap ≥ 0 of open contacts and λ ≥ 0 of closed ones."""
    if not contacts.closed and not contacts.open.numel():
        return bounds
    first = system.structure.constraints - len(contacts.closed)
    pushes = reactions(system)[first : system.structure.constraints] if contacts.closed else []
    pushes = ca.vertcat(ca.SX(0, 1), pushes)
    gaps, least = contacts.open.numel(), np.zeros(contacts.open.numel() + pushes.numel())
    most = np.full(len(least), np.inf)
    return bounds._replace(
        at_points=ca.vertcat(bounds.at_points, contacts.open),
        points_low=np.append(bounds.points_low, least[:gaps]),
        points_high=np.append(bounds.points_high, most[:gaps]),
        points_names=(*bounds.points_names, *map(str, ca.vertsplit(contacts.open))),
        at_nodes=ca.vertcat(bounds.at_nodes, pushes),
        nodes_low=np.append(bounds.nodes_low, least[gaps:]),
        nodes_high=np.append(bounds.nodes_high, most[gaps:]),
        nodes_names=(*bounds.nodes_names, *(f"reaction of contact {i}" for i in contacts.closed)),
    )


def touched(contacts: Contacts, known: list[ca.SX], last: bool) -> Contacts:
    """Open contacts whose gaps are known to be 0 at an end."""
    touching = contacts.touching.copy()
    closing = [is_among(gap, known) for gap in ca.vertsplit(contacts.open)]
    touching[int(last)] |= np.array(closing, dtype=bool)
    return replace(contacts, touching=touching)


DEPTH = 100  # of the comparison of two expressions


def is_among(row: ca.SX, rows: list[ca.SX]) -> bool:
    """Is this one of the expressions?"""
    return any(ca.is_equal(row, other, DEPTH) for other in rows)
