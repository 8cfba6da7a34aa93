"""Runs whose steps are chosen and whose controls are the same all the time: those of the scene that
has them as parameters, which go the short ways.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.integration.second_looks import has_switches
from varint.integration.switches.frozen import free_name
from varint.integration.time_transformation.rate_ahead import kinds_of
from varint.results.records import changed
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.parameters import Parameters, ParameterValues, values_by_name, with_more
from varint.scene.system import System, given_parameters

# of a run that is powers of one map, whose controls are kept for each, and between whose nodes a
# scene with controls takes all steps
MOST_STEPS = 2**22


def with_steady_controls(
    system: System,
    u: Any,
    params: ParameterValues | None,
    make: Callable[..., Trajectory],
) -> Trajectory | None:
    """The motion that is made of the scene with its controls as parameters, and of `params`; None
    where they are no numbers for all the time, or it is no such scene.
    """
    values = _steady_values(system, u)
    if values is None or (scene := _controls_as_parameters(system)) is None:
        return None
    given_parameters(system, params)  # refuses what the user's scene does not have
    given = {} if params is None else values_by_name(params)
    (name,) = scene.defaults.keys() - system.defaults.keys()
    try:
        motion = make(scene, params={**given, name: values})
        if len(motion) < len(motion.u) > MOST_STEPS:  # by steps one by one
            motion = make(scene, params={**given, name: values}, backend="native")
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


def _of_users_scene(system: System, motion: Trajectory, values: np.ndarray) -> Trajectory:
    u = values[None, None].repeat(len(motion.u), axis=0)
    found: Trajectory = changed(motion, system=system, c=motion.c[: -values.size].copy(), u=u)
    return found
