"""What parts of a machine are called, and how users refer to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from varint.errors import InputError
from varint.multibody.data import WORLD, Anchor, Body, Machine
from varint.multibody.quantities import placement


def body_name(machine: Machine, given: Any) -> str:
    """The name of a body or of the ground, given itself or by name."""
    name = given.name if isinstance(given, Body) else given
    if not isinstance(name, str) or name not in (WORLD, *machine.bodies):
        raise InputError(f"unknown body {name!r}; known: {[WORLD, *machine.bodies]}")
    return name


def ground(model: Any, given: Any) -> Any:
    """What is given, with the ground's name for the model itself, in (body, place), too."""
    if type(given) is tuple:  # an anchor stays one
        return tuple(ground(model, part) for part in given)
    return WORLD if given is model else given


def anchor_of(machine: Machine, given: Any) -> Anchor:
    """A frame: an anchor itself, the name of a marker or body, a body, or (body, place)."""
    if isinstance(given, Anchor):
        return given
    if isinstance(given, str) and given in machine.markers:
        return machine.markers[given]
    body, at = given if isinstance(given, tuple) and len(given) == 2 else (given, (0.0, 0.0, 0.0))
    name = body.name if isinstance(body, Body) else body
    if not isinstance(name, str) or name not in (WORLD, *machine.bodies):
        known = [WORLD, *machine.bodies, *machine.markers]
        raise InputError(f"unknown frame {name!r}; known: {known}")
    return Anchor(name, placement(f"the place of a frame of {name!r}", at))


def joint_name(machine: Machine, child: Any, name: str | None) -> str:
    """The name of a new joint to a body that none leads to: by default the body's."""
    below = body_name(machine, child)
    if below == WORLD:
        raise InputError("the ground cannot be the child of a joint")
    if led := [joint.name for joint in machine.joints.values() if joint.child == below]:
        raise InputError(
            f"joint {led[0]!r} leads to body {below!r} already; close a loop by model.loop(...) "
            "instead of a second joint"
        )
    return new_name("joint", below if name is None else name, machine.joints)


def refuse_taken(machine: Machine, coordinates: Iterable[str]) -> None:
    """Two joints' coordinates must not have one name."""
    taken = {x for joint in machine.joints.values() for x in joint.coordinates}
    if twice := sorted(taken & set(coordinates)):
        raise InputError(f"coordinates {twice} exist already; rename the joint")


def new_name(what: str, name: str | None, taken: Iterable[str]) -> str:
    """A name that is not taken; a number where none is given."""
    others = [WORLD, *taken]
    if name is None:
        name = f"{what}{len(others)}"
    if not isinstance(name, str) or not name or name in others:
        raise InputError(
            f"names of {what}s are strings that are not taken, got {name!r}; taken: {others}"
        )
    return name
