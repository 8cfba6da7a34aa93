"""Runs until an expression's zero beside stiff dampers: the end is looked for along the motion of
the whole duration, whose steps grow to what lasts, so that few are made behind the end.

An error ε of the coordinates moves the end by δt = Σ |∂g/∂q| ε / |dg/dt|, and where the motion is
then by δt |v|: near a place where g hardly changes that is much more. The motion is found once more
where this asks for it, for that much less.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import casadi as ca
import numpy as np

from varint.integration.backend import kernel_for
from varint.integration.choice import Choice
from varint.integration.damped_motions import may_be_damped
from varint.integration.damped_trials import by_damped_trials
from varint.integration.error_scale import error_scales
from varint.integration.events.crossings import Watch
from varint.integration.known_at_start import fastest_at_start
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.run import looked_along
from varint.integration.small_motions import angle_turned
from varint.numerics.arrays import call
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System

SURELY = 2.0  # times less than what just does, where the motion is found once more
FARTHEST = 1e3  # times as large as that of the motion may be the error of its end


def damped_until(
    system: System,
    rule: Rule | None,
    start: InitialValueProblem,
    tol: float,
    watched: tuple[Watch, list[Watch]],
    backend: str,
) -> Choice | None:
    """The choice of `by_damped_trials`, whose motion ends where the first that is watched crosses
    zero, with events of the others until then; None where there is none, or the error of its end
    cannot be told.
    """
    stop, watches = watched
    changes = _changes(system, stop) if may_be_damped(system) else None
    if changes is None:
        return None
    began, own = perf_counter(), plan(system, rule).rule
    fastest, _ = fastest_at_start(system, own, start)
    radians, wanted, runs = angle_turned(start.h, fastest), tol, 0
    for _ in range(2):
        found = by_damped_trials(system, rule, start, wanted, radians, backend, began)
        if found is None:
            return None
        runs += found.runs
        kernel = kernel_for(system, found.rule, start, backend)
        motion = looked_along(found.motion, found.motion.v, kernel, stop, watches)
        ended = motion.t[-1] != found.motion.t[-1]
        moved = _moved(changes, motion, found.motion) if ended else 1.0
        if found.estimate * moved <= tol:
            return replace(found, motion=motion, estimate=found.estimate * moved, runs=runs)
        if not moved <= FARTHEST:
            return None
        wanted = tol / (SURELY * moved)
    return None


def _changes(system: System, stop: Watch) -> ca.Function | None:
    """(q, v, t, c) → ∂g/∂q and dg/dt; None where g depends on velocities or controls."""
    s, g = system, in_own_symbols(stop.expression, system)
    if ca.depends_on(g, ca.vertcat(s.v, s.control)):
        return None
    slope = ca.gradient(g, s.q)
    rate = ca.dot(slope, s.v) + ca.jacobian(g, s.t)
    return ca.Function("changes", [s.q, s.v, s.t, s.c], [ca.densify(slope), ca.densify(rate)])


def _moved(changes: ca.Function, motion: Trajectory, whole: Trajectory) -> float:
    """How many times the error of the whole motion, by its scales, the end errs by its own."""
    own, scales = (error_scales(x.system, x) for x in (motion, whole))
    last = motion[-1:]
    speed = last.v[0]
    slope, rate = call(changes, last.q[0].copy(), speed.copy(), last.t.copy(), motion.c)
    with np.errstate(divide="ignore", invalid="ignore"):
        late = np.abs(slope) @ scales / abs(float(rate[0]))
        moved = float(((scales + late * np.abs(speed)) / own).max())
    return moved if np.isfinite(moved) else np.inf
