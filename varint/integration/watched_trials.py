"""Steps for a wanted error from two runs that are watched on their way: of scenes with constraint
rows or contacts, or until something happens.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from varint.integration.attempts import Attempt, energy_errors
from varint.integration.choice import Choice
from varint.integration.error_scale import error_scales
from varint.integration.held_rows import is_held
from varint.integration.rule_choice import steps_for
from varint.integration.run_distance import beyond_shared, ends_apart, shared_nodes, with_early
from varint.integration.trajectories import Run, with_velocities
from varint.integration.two_runs import FLOOR, Course, run_twice
from varint.results.records import changed
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

# (rule, steps, one of so many parts of them, the wanted error, the way of the last `digits`)
# → the motion, and the run that made it where it was not over at once; None where it failed
Attempts = Callable[..., tuple[Trajectory, Run | None] | None]


def by_watched_trials(
    system: System,
    rule: Rule,
    tol: float,
    turned: tuple[float, float],
    attempt: Attempts,
    scale: Any,
    ends_early: bool,
) -> Choice | None:
    """The choice that two runs and their energies prove, where they do.

    `turned` is by how much the motion turns, and the one that the first steps are for; runs may end
    early, at an event.
    """
    radians, begin = turned

    def apart(
        one: Trajectory, few: int, other: Trajectory, many: int
    ) -> tuple[float, float, float]:
        scales = error_scales(system, other, scale)
        i, j = shared_nodes(one, few, other, many)
        off = np.abs(one.q[i] - other.q[j]) / scales
        seen, half = with_early(off)
        beyond = beyond_shared(off, other.q, j, other.t)
        return max(seen, ends_apart(one, other, scales)) if ends_early else seen, half, beyond

    def run(steps: int, wanted: float, part: int) -> Attempt | None:
        found = attempt(rule, steps, part, wanted)
        if found is None:
            return None
        motion, made = found
        v = None
        if made is not None and made.kernel is not None and is_held(system) and not ends_early:
            v = with_velocities(changed(motion), made.nodes).v  # the loop has solved for them
        return Attempt(motion, energy_errors(motion, v))

    def parted(steps: int, wanted: float, way: int) -> Attempt | None:
        found = attempt(rule, steps, 1, wanted, digits=way)
        return None if found is None else Attempt(found[0], [])

    s = system.structure
    free = not (s.nonholonomic or system.rays)
    course = Course(run, apart, radians, s.linear, parted=parted if free else None)
    found = run_twice(rule, course, steps_for(rule, begin, tol), tol, FLOOR)
    if found is None:
        return None
    reached = found.estimate <= tol
    return Choice(rule, found.steps, found.run, found.estimate, found.runs, reached, True)
