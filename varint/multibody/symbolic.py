"""Numbers of a machine made parameters of its system."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import Joint, Machine, Passive
from varint.scene.parameters import with_more

FIELDS = {
    "bodies": ("mass", "com", "inertia"),
    "joints": ("position", *Passive._fields),
    "loops": ("length",),
    "springs": ("stiffness", "rest", "damping"),
    "actuators": ("gear",),
}


# where the six numbers of an inertia xx, yy, zz, xy, xz, yz stand in its matrix
INERTIA = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def make_symbolic(machine: Machine, name: str) -> None:
    """Put a symbol in place of "part.field" or "gravity"; its number becomes the default.

    Raises
    ------
    InputError
        If there is no such number, or it is an expression already.
    """
    if name in ("gravity", "creep"):
        setattr(machine, name, _parameter(machine, name, getattr(machine, name)))
        return
    part, _, field = str(name).rpartition(".")
    for group, fields in FIELDS.items():
        parts = getattr(machine, group)
        if part in parts and field in fields:
            parts[part] = _with_symbol(machine, parts[part], field)
            return
    known = [
        f"{x}.{field}"
        for group, fields in FIELDS.items()
        for x in getattr(machine, group)
        for field in fields
    ]
    raise InputError(f"the model has no number {name!r}; known: {['gravity', 'creep', *known]}")


def _with_symbol(machine: Machine, part: Any, field: str) -> Any:
    name = f"{part.name}_{field}"
    if field == "position":
        position = _parameter(machine, name, part.placement.position)
        return replace(part, placement=part.placement._replace(position=position))
    if field in Passive._fields and isinstance(part, Joint):
        value = _parameter(machine, name, getattr(part.passive, field))
        return replace(part, passive=part.passive._replace(**{field: value}))
    value = getattr(part, field)
    if field == "inertia" and not isinstance(value, ca.SX):
        six = _parameter(machine, name, value[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        return replace(part, inertia=six[INERTIA.ravel().tolist()].reshape((3, 3)))
    return replace(part, **{field: _parameter(machine, name, value)})


def _parameter(machine: Machine, name: str, value: Any) -> ca.SX:
    if isinstance(value, ca.SX):
        raise InputError(f"{name!r} is an expression already: {value}")
    if name in machine.params:
        raise InputError(f"the model has a parameter {name!r} already; rename the part")
    machine.params = with_more(machine.params, **{name: value})
    return getattr(machine.params, name)
