"""Motions from what files hold of them, which is checked."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.many_steps import in_gear, interpreted, steps_again
from varint.integration.switches.within_rows import dense_output_of
from varint.integration.time_transformation.physical_time import at_times
from varint.numerics.limits import MOST_STEPS
from varint.numerics.plain import field_of, finite
from varint.results.records import OWN_ACTION, Event, with_own_action
from varint.results.save import ARRAYS, BY_HAND, INNER, OPTIONAL, SWITCHES, WHOLE
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.serialisation import rule_of
from varint.scene.system import System

WHOLE_NUMBERS = ("k", "phase")
FINITE = ("t", "c", "sizes")
FILLED = ("t", "sizes")  # arrays with at least one row


def whole_motion(
    header: dict[str, Any],
    arrays: dict[str, np.ndarray],
    scene_in: Callable[[dict[str, Any]], System],
) -> Trajectory:
    """The motion of which `save.parts_of` made a header and arrays, with that in fictitious time;
    its scene and the one there are found by their headers.

    Raises
    ------
    InputError
        If a part is missing, or they do not fit together.
    """
    inner, whole, switches = (taken(arrays, first) for first in (INNER, WHOLE, SWITCHES))
    system, more = scene_in(header), dict[str, Any]()
    if switches:
        more = {"dense_output": dense_output_of(system, rule_of(header.get("rule")), switches)}
    elif inner:
        about = field_of(header, "fictitious", dict)
        fictitious = _assembled(about, inner, scene_in(about), {})
        more = {"dense_output": at_times, "fictitious": fictitious}
    if whole:
        about = field_of(header, "whole", dict)
        more["whole"] = _assembled(about, whole, system, dict(more))
    return _assembled(header, arrays, system, more)


def taken(arrays: dict[str, np.ndarray], first: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, out of all of them, by the rest of their names."""
    names = [name for name in arrays if name.startswith(first)]
    return {name.removeprefix(first): arrays.pop(name) for name in names}


def _assembled(
    header: dict[str, Any], arrays: dict[str, np.ndarray], system: System, more: dict[str, Any]
) -> Trajectory:
    """A trajectory of checked parts, and more of it."""
    rule = rule_of(header.get("rule"))
    if sizes := field_of(header, "sizes", list[float] | None):  # of format 1
        arrays["sizes"] = np.array(sizes)
    active_sets = field_of(header, "phases", tuple[ActiveSet, ...])
    _check_active_sets(system, active_sets)
    stats = field_of(header, "stats", dict[str, str | bool | int | float])
    field_of(stats, "error_estimate", float | int | None)
    h = finite("h", field_of(header, "h", float))
    if h == 0:
        raise InputError("h must not be zero")
    nodes = _checked(system, rule, arrays, len(active_sets))
    v = nodes.pop("v", None)
    by_hand = field_of(header, BY_HAND, bool | None)
    motion = Trajectory(
        system=system,
        rule=rule,
        h=h,
        origin=field_of(header, "origin", float | None),
        functions=steps_again(rule, interpreted if by_hand else in_gear),
        active_sets=active_sets,
        events=field_of(header, "events", tuple[Event, ...]),
        stats=MappingProxyType(stats),
        **nodes,
        **more,
    )
    if v is not None:
        motion.__dict__["v"] = v
    return with_own_action(motion, field_of(header, OWN_ACTION, float | None))


def _check_active_sets(system: System, active_sets: tuple[ActiveSet, ...]) -> None:
    held = system.constraint.numel(), system.contact.numel(), system.contact.numel()
    for one in active_sets:
        for rows, count in zip((one.rows, one.contacts, one.holding), held, strict=True):
            if any(not 0 <= row < count for row in rows):
                raise InputError(f"the active set {one} holds rows that the system does not have")


def _checked(
    system: System, rule: Rule, arrays: dict[str, np.ndarray], active_sets: int
) -> dict[str, Any]:
    """The arrays of a trajectory by their names in it, if shapes and numbers are possible."""
    missing = [name for name in ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{missing} are missing")
    nodes, n, controls = arrays["t"].shape[:1], system.q.numel(), system.control.numel()
    wanted: dict[str, tuple[tuple[int, ...], ...]] = {
        "t": (nodes,),
        "q": ((*nodes, n),),
        "p": ((*nodes, n),),
        "v": ((*nodes, n),),
        "k": (nodes,),
        "u": tuple((*arrays["u"].shape[:1], r, controls) for r in (1, len(rule.nodes))),
        "c": ((system.c.numel(),),),
        "phase": (nodes,),
        "closure": ((n, n + 1),),
        "sizes": (arrays["sizes"].shape[:1] if "sizes" in arrays else (),),
    }
    found: dict[str, Any] = {}
    for name, shapes in wanted.items():
        if name not in arrays:
            continue
        array, whole = arrays[name], name in WHOLE_NUMBERS
        if array.shape not in shapes or 0 in array.shape[: name in FILLED]:
            raise InputError(f"{name} has shape {array.shape}; it must be {shapes[0]}")
        if (array.dtype.kind in "iu") != whole:
            raise InputError(f"{name} holds numbers of type {array.dtype}")
        if name in FINITE and not np.isfinite(array).all():
            raise InputError(f"{name} is not finite")
        found[OPTIONAL.get(name, name)] = array.astype(int if whole else float, copy=False)
    limits = {"k": MOST_STEPS, "phase": active_sets - 1}
    for name, most in limits.items():
        if name in arrays and not ((arrays[name] >= 0) & (arrays[name] <= most)).all():
            raise InputError(f"{name} holds numbers that are not between 0 and {most}")
    if controls and not len(arrays["u"]):
        raise InputError("there are no controls")
    return found
