"""The start of a run in fictitious time: energy, time scale, the slowest rate that it may have."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.integration.backend import blocks_of, kernel_for
from varint.integration.plan import Plan
from varint.integration.problem import InitialValueProblem, Start
from varint.integration.time_transformation.time_scale import TransformedScene
from varint.numerics.arrays import call
from varint.numerics.limits import MOST_STEPS, check_steps
from varint.scene.inputs import vector
from varint.scene.system import System, parameter_values

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

RADIANS = 10.0  # at least, that a run turns: no step leaps over it
PILOT = 200  # steps that tell the mean rate of a motion
# of the mean rate: where the forces' change vanishes, and far out where nothing pulls, no step is
# longer than 1/SHARE of those that a motion at its mean rate would take
SHARE = 0.15
# of the start's rate, as long as the mean is not known: the first with which steps do not leap
LEAST = (1e-4, 1e-3, 1e-2, 0.1, 1.0)
LEAP = 30.0  # times the step before


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
    energy, scale = _energy_and_scale(system, scene, problem, v0, slowest)
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
    return problem._replace(
        q0=np.append(problem.q0, 0.0),
        p0=np.append(problem.p0, scale),
        t0=0.0,
        steps=count,
        u=np.empty((count, 1, 0)),
        c=np.append(problem.c, (slowest, energy, scale)),
    )


def slowest_rate(
    system: System,
    scene: TransformedScene,
    chosen: Plan,
    problem: InitialValueProblem,
    v0: Any,
    total: float | None,
    backend: str,
) -> float:
    """ω₀ of a scene's own time scale: a share of the mean rate over the first steps.

    The mean of ω over time is τ/t: a few hundred steps tell it, whichever phase of the motion the
    start is in.
    """
    _, scale = _energy_and_scale(system, scene, problem, v0, 0.0)
    whole = 0.0 if total is None else RADIANS / abs(total)
    if not math.isfinite(scale):  # nothing pulls at the start
        if total is None:
            raise InputError(
                "time_scale='auto' needs forces that change with q, and at the start there are "
                "none; give duration in place of steps, or a time scale of your own"
            )
        return whole
    if not scale > 0:
        raise InputError(
            "the rate of the scene is not finite at the start: a collision; move the start"
        )
    for least in LEAST:
        pilot = in_fictitious_time(system, scene, problem, v0, least / scale, total)
        kernel = kernel_for(scene.system, chosen.rule, pilot, backend)
        times = _clock(scene, chosen, pilot, kernel, total)
        passed = np.diff(times)
        leap = np.abs(passed[1:] / passed[:-1])
        if np.isfinite(passed).all() and ((leap < LEAP) & (leap > 1 / LEAP)).all():
            return max(SHARE * abs(problem.h) * len(passed) / abs(times[-1]), whole)
    return max(SHARE / scale, whole)


def _clock(
    scene: TransformedScene,
    chosen: Plan,
    problem: InitialValueProblem,
    kernel: Kernel | None,
    total: float | None,
) -> np.ndarray:
    """Physical times of the first nodes, those within the duration."""
    pilot = problem._replace(steps=PILOT, u=np.empty((PILOT, 1, 0)), save_every=1)
    times = [np.zeros(1)]
    with np.errstate(all="ignore"):
        for block in blocks_of(scene.system, chosen.rule, pilot, kernel):
            times.append(block.q[: block.good, -1])
            if block.good < len(block.k):
                times.append(np.full(1, np.nan))
                break
    found = np.concatenate(times)
    if total is None:
        return found
    beyond = np.flatnonzero(np.abs(found) >= abs(total))
    return found[: beyond[0] + 1] if len(beyond) else found


def rate_at(system: System, scene: TransformedScene, start: Start) -> float:
    """The scene's own rate ω(q0)."""
    c = parameter_values(system, start.params)
    q = vector("q0", start.q0, system.q.numel(), system.names)
    _, scale = call(scene.energy, q, np.zeros(len(q)), np.zeros(1), c, np.zeros(1))
    return 1 / float(scale[0])


def _energy_and_scale(
    system: System, scene: TransformedScene, problem: InitialValueProblem, v0: Any, slowest: float
) -> tuple[float, float]:
    t, rate = np.array([problem.t0]), np.array([slowest])
    if v0 is None:
        (velocity,) = call(velocity_function(system), problem.q0, problem.p0, t, problem.c)
    else:
        velocity = np.array(v0, dtype=float).ravel()
    (energy,), (scale,) = call(scene.energy, problem.q0, velocity, t, problem.c, rate)
    return energy, scale
