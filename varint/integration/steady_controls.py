"""Runs whose steps are chosen and whose controls are the same all the time: those of the scene that
has them as parameters, which go the short ways.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.integration.second_looks import has_switches
from varint.integration.switches.frozen import free_name
from varint.integration.time_transformation.rate_ahead import kinds_of
from varint.results.records import changed
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.memory import per_scene
from varint.scene.parameters import Parameters, ParameterValues, values_by_name, with_more
from varint.scene.system import System, given_parameters

# of a run that is powers of one map, whose controls are kept for each, and between whose nodes a
# scene with controls takes all steps
MOST_STEPS = 2**22
REMEMBERED = 64  # expressions of a scene, as the one with its controls as parameters has them


def with_steady_controls(
    system: System,
    u: Any,
    params: ParameterValues | None,
    watched: tuple[Any, Any],
    make: Callable[..., Trajectory],
) -> Trajectory | None:
    """The motion that is made of the scene with its controls as parameters, of `params`, and of
    what is `watched` for (until, events); None where they are no numbers for all the time, or it is
    no such scene.
    """
    values = _steady_values(system, u)
    if values is None or (scene := _controls_as_parameters(system)) is None:
        return None
    given_parameters(system, params)  # refuses what the user's scene does not have
    given = {} if params is None else values_by_name(params)
    (name,) = scene.defaults.keys() - system.defaults.keys()
    until, events = watched
    if until is not None:
        until = _in_parameters(system, scene, until)
    if events and isinstance(events, Mapping):
        events = {key: _in_parameters(system, scene, x) for key, x in events.items()}
    make = partial(make, scene, params={**given, name: values}, until=until, events=events)
    try:
        motion = make()
        if _leaves_out_many(motion):  # by steps one by one
            motion = make(backend="native")
    except ConvergenceError as failure:
        if failure.trajectory is not None:
            failure.trajectory = _of_users_scene(system, failure.trajectory, values)
        raise
    return _of_users_scene(system, motion, values)


def _steady_values(system: System, u: Any) -> np.ndarray | None:
    """The controls (k,), where they are numbers for all the time."""
    count = system.structure.controls
    try:
        values = np.array(u, dtype=float)
    except (TypeError, ValueError, RuntimeError):  # it is told elsewhere what they should be
        return None
    if values.shape == (1, count) or (values.shape == () and count == 1):
        values = values.reshape(count)
    return values if values.shape == (count,) and np.isfinite(values).all() else None


@per_scene
def _controls_as_parameters(system: System) -> System | None:
    """The scene whose last parameters are the controls; None where something holds it, or its steps
    end at switches or follow a rate, by ways of their own.
    """
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.degenerate
    if not s.controls or held or system.rays or system.kinetics or has_switches(system):
        return None
    name = free_name(system, "control")
    params = with_more(system.params or Parameters(), **{name: np.zeros(s.controls)})
    force = ca.substitute(system.force, system.control, params._symbols[name])
    given = {"force": ca.sparsify(force), "params": params, "t": system.t}
    scene = System(system.q, system.v, system.lagrangian, **given)
    return None if kinds_of(scene) else scene


def _leaves_out_many(motion: Trajectory) -> bool:
    """Whether so many steps lie between nodes of a motion that is there already."""
    there = "_make" not in motion.__dict__
    return there and len(motion.u) > MOST_STEPS and len(motion) <= int(motion.k[-1])


def _in_parameters(system: System, scene: System, wanted: Any) -> Any:
    """What is watched for, `expression` or `(expression, direction)`, of that scene; what is none
    as it is, for it is refused elsewhere.
    """
    if isinstance(wanted, tuple) and len(wanted) == 2:
        return _in_parameters(system, scene, wanted[0]), wanted[1]
    if not isinstance(wanted, ca.SX) or wanted.numel() != 1:
        return wanted
    known, key = _known_expressions(system), wanted.element_hash()
    if key not in known:
        own, count = in_own_symbols(wanted, system), system.structure.controls
        if len(known) >= REMEMBERED:
            known.clear()
        of_scene = ca.substitute(own, system.control, scene.c[-count:])
        known[key] = ca.SX(wanted), of_scene if ca.depends_on(own, system.control) else own
    return known[key][1]


@per_scene
def _known_expressions(system: System) -> dict[int, tuple[ca.SX, ca.SX]]:
    """Expressions of the scene and those of the one with parameters, by what tells the first ones
    from others as long as they are kept.
    """
    return {}


def _of_users_scene(system: System, motion: Trajectory, values: np.ndarray) -> Trajectory:
    own, c = motion.__dict__, motion.c[: -values.size].copy()
    if "_make" not in own:
        u = _for_all_steps(values, len(motion.u))
        found: Trajectory = changed(motion, system=system, c=c, u=u)
        return found
    found = object.__new__(Trajectory)  # what nobody has looked at stays to be made
    found.__dict__.update(own, system=system, c=c, _make=partial(_made, own["_make"], values))
    if "u" in own:
        found.__dict__["u"] = _for_all_steps(values, len(own["u"]))
    return found


def _made(make: Callable[[str], Any], values: np.ndarray, name: str) -> Any:
    """The field of this name of a motion with such controls."""
    made = make(name)
    return _for_all_steps(values, len(made)) if name == "u" else made


def _for_all_steps(values: np.ndarray, steps: int) -> np.ndarray:
    return values[None, None].repeat(steps, axis=0)
