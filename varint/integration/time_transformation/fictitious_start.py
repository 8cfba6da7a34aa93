"""The start of a run in fictitious time: energy, time scale, the slowest rate that it may have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.integration.problem import InitialValueProblem, Start
from varint.integration.time_transformation.rate_pilot import RatePilot
from varint.integration.time_transformation.transformed_scene import TransformedScene
from varint.numerics.arrays import call
from varint.numerics.limits import MOST_STEPS, check_steps
from varint.scene.inputs import number, vector
from varint.scene.system import System, parameter_values

RADIANS = 10.0  # at least, that a run turns: no step leaps over it
# of the mean rate: where the forces' change vanishes, and far out where nothing pulls, no step is
# longer than 1/SHARE of those that a motion at its mean rate would take
SHARE = 0.15


def in_fictitious_time(
    system: System,
    scene: TransformedScene,
    problem: InitialValueProblem,
    v0: Any,
    slowest: float,
    total: float | None,
) -> InitialValueProblem:
    """The problem of the rescaled scene, with the clock at zero; as many steps as the duration
    `total` takes at the pace of the start.

    Raises
    ------
    InputError
        If the time scale is not positive at the start, or the steps are too many or too long.
    """
    t, v = np.array([problem.t0]), start_velocity(system, problem, v0)
    (energy,), (scale,) = call(scene.energy, problem.q0, v, t, problem.c, np.array([slowest]))
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"time_scale must be positive, but it is {scale:g} at the start")
    check_steps(problem.t0, problem.h * scale, problem.steps)
    pace = 0.0 if total is None else total / float(problem.h * scale)
    if pace > MOST_STEPS:
        raise InputError(
            f"duration={total:g} takes {pace:.3g} steps of h={problem.h:g}, more than any run can; "
            "take larger ones"
        )
    count = problem.steps if total is None else max(1, math.ceil(pace))
    begin, beside = problem.t0, [scale, -energy]
    if not scene.accounts:
        begin = float(call(scene.weight, problem.q0, v, t, problem.c, np.array([slowest]))[0][0])
        beside = [begin * scale]
    return problem._replace(
        q0=np.append(problem.q0, np.zeros(len(beside))),
        p0=np.append(problem.p0, beside),
        t0=0.0,
        steps=count,
        u=np.empty((count, 1, 0)),
        c=np.concatenate((problem.c, (begin, slowest, energy, scale))),
    )


def slowest_rate(pilot: RatePilot | None, total: float | None) -> float:
    """ω₀ of a scene's own time scale: a share of the mean rate over the first steps, and enough
    that no step leaps over the duration.

    Raises
    ------
    InputError
        If neither is known.
    """
    whole = 0.0 if total is None else RADIANS / abs(total)
    if pilot is None and total is None:
        raise InputError(
            "time_scale='auto' needs forces that change with q, and at the start there are none "
            "(or they are not finite); give duration in place of steps, or a time scale of your own"
        )
    return whole if pilot is None else max(SHARE * pilot.mean, whole)


def rate_at(system: System, scene: TransformedScene, start: Start) -> float:
    """The scene's own rate ω(q0)."""
    c = parameter_values(system, start.params)
    q = vector("q0", start.q0, system.q.numel(), system.names)
    t = np.array([number("t0", start.t0)])
    _, scale = call(scene.energy, q, np.zeros(len(q)), t, c, np.zeros(1))
    return 1 / float(scale[0])


def start_velocity(system: System, problem: InitialValueProblem, v0: Any) -> np.ndarray:
    """v at the start, as it was given or from p."""
    if v0 is not None:
        return np.array(v0, dtype=float).ravel()
    t = np.array([problem.t0])
    return call(velocity_function(system), problem.q0, problem.p0, t, problem.c)[0]
