"""Coefficients of restitution: numbers, or expressions of the parameters."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.inputs import finite_array
from varint.scene.memory import per_system
from varint.scene.validation import expression

WITHOUT_CONTACT = (
    "restitution={!r} was given, but the system has no contact; give contact=gap as well"
)


def bounce_of(value: Any, contacts: int, c: ca.SX) -> ca.SX:
    """The coefficient of restitution of every contact, (contacts,), as expressions of c."""
    parts = list(value) if isinstance(value, (list, tuple)) else [value]
    if not any(isinstance(x, (ca.SX, ca.MX)) for x in parts):
        return ca.SX(ca.DM(_restitution_of(value, contacts)))
    given = ca.vertcat(*(expression("restitution", x, (None, 1)) for x in parts))
    known = {x.element_hash() for x in ca.symvar(c)}
    if wrong := sorted({x.name() for x in ca.symvar(given) if x.element_hash() not in known}):
        raise InputError(
            f"restitution may not depend on {wrong}; it is a number, or an expression of the "
            "parameters"
        )
    if given.numel() not in (1, contacts):
        raise InputError(
            f"restitution has shape {given.shape}; give one number or one per contact ({contacts})"
        )
    if not contacts:
        raise InputError(WITHOUT_CONTACT.format(value))
    if given.is_constant():
        require_restitution(np.array(ca.DM(given)).ravel())
    return ca.densify(ca.repmat(given, contacts, 1) if given.numel() == 1 else given)


def _restitution_of(value: Any, contacts: int) -> np.ndarray:
    """One coefficient between 0 and 1 for every contact."""
    e = finite_array("restitution", value)
    if e.shape not in ((), (contacts,)):
        raise InputError(
            f"restitution has shape {e.shape}; give one number or one per contact ({contacts})"
        )
    if not contacts and np.any(e != 0):
        raise InputError(WITHOUT_CONTACT.format(value))
    return np.broadcast_to(require_restitution(e), (contacts,)).copy()


def require_restitution(e: np.ndarray) -> np.ndarray:
    """Refuse coefficients that do not lie between 0 and 1."""
    if not ((e >= 0) & (e <= 1)).all():
        raise InputError(f"restitution must lie between 0 and 1, got {e.tolist()}")
    return e


def restitution_at(system: Any, c: np.ndarray) -> np.ndarray:
    """The coefficient of every contact at parameter values, (contacts,).

    Raises
    ------
    InputError
        If one does not lie between 0 and 1.
    """
    if system.bounce.is_constant():
        return _constant_restitution(system).copy()
    return require_restitution(np.array(_restitution_function(system)(c)).ravel())


@per_system
def _constant_restitution(system: Any) -> np.ndarray:
    return np.array(ca.DM(system.bounce)).ravel()


@per_system
def _restitution_function(system: Any) -> ca.Function:
    return ca.Function("restitution", [system.c], [system.bounce])


def loses_energy(system: Any) -> bool:
    """Whether impacts may take energy away."""
    return not (system.bounce.is_constant() and (system.restitution == 1).all())
