"""Short motions that Python makes of what the core has proved: held ones, and those that are
watched on the way.
"""

from __future__ import annotations

import warnings
from functools import cache
from time import perf_counter
from types import ModuleType

import numpy as np

from varint.codegen.kernel import Kernel
from varint.codegen.two_runs import NO_OPENING, NOT_PROVED, UNSEARCHED, Rates
from varint.integration.energy_leap import energy_leap
from varint.integration.even_motion import Made, even_motion_of
from varint.integration.gears import Gears
from varint.integration.linear_run import is_one_map
from varint.integration.plain_start import Room, Watched, opening_in
from varint.integration.short_refinement import looked_at_closely
from varint.integration.short_scenes import Known
from varint.integration.short_trials import two_short_runs
from varint.integration.trajectories import with_stats
from varint.integration.two_runs import shows_its_error
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System


def by_python(
    system: System,
    known: Known,
    made: Made,
    kernel: Kernel,
    room: Room,
    c: np.ndarray,
    asked: tuple[float, float, int, float, float],
    low: Gears | None,
    rates: list[Rates],
    began: float,
    watched: Watched | None,
) -> Trajectory | int | None:
    """The motion from the start that is there, or what the core says; None where another way is to
    be taken.
    """
    (t0, duration, *_, tol), opening, search = asked, NO_OPENING, UNSEARCHED
    if watched is not None:
        mapped = made.course.kernel is not kernel
        wanted = _watched_runs().watched_in(system, kernel, mapped, room, c, watched)
        if wanted is None:
            return None
        search = wanted
    if known.held:
        opening = opening_in(room, system).by_core
    how = made.course, low, room.places, asked, rates
    found = two_short_runs(system, *how, opening, search)
    if room.opening is not None and room.opening.raised:
        raise room.opening.raised.pop()
    if isinstance(found, int):
        elsewhere = known.held or (found == NOT_PROVED and is_one_map(system, made.blank["rule"]))
        return None if elsewhere else found
    steps, runs, estimate, iterations, residual, nodes, doubted, zeros = found
    h = duration / steps
    grid = h, t0, steps, iterations, residual
    told, end = (perf_counter() - began, tol, estimate, made.name, runs), None
    if watched is not None and zeros is not None:
        end = _watched_runs().end_of(watched, zeros)
    motion = even_motion_of(system, made, nodes, c, grid, told, end)
    if watched is not None and zeros is not None and len(zeros):
        happened = _watched_runs().events_of(system, watched, zeros, c, h, end)
        motion.__dict__["events"] = happened
    if not doubted:
        return motion
    if not shows_its_error(system):
        seen = looked_at(motion.rule, motion, estimate, tol)
        return None if known.held and seen == NOT_PROVED else seen
    if (leap := energy_leap(motion, tol)) and (alarm := leap.alarm()):
        warnings.warn(alarm, stacklevel=5)
    return motion


@cache
def _watched_runs() -> ModuleType:
    """Loaded when something is watched for."""
    from varint.integration import watched_runs

    return watched_runs


def looked_at(rule: Rule, motion: Trajectory, estimate: float, tol: float) -> Trajectory | int:
    """The motion with what a closer look says of its error; NOT_PROVED where that is too much."""
    estimate = max(estimate, looked_at_closely(rule, motion, None, tol))
    return NOT_PROVED if estimate > tol else with_stats(motion, error_estimate=estimate)
