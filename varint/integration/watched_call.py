"""Runs for a wanted accuracy that are watched on their way, as most are asked for: steps that two
short runs prove, and the run with these steps along which zeros are looked for.
"""

from __future__ import annotations

import warnings
from time import perf_counter
from typing import Any

from varint.integration.few_steps import few_steps_call
from varint.integration.held_rows import is_held
from varint.integration.rule_choice import iteration_level
from varint.integration.run_distance import apart_from_proved
from varint.integration.short_call import short_call
from varint.integration.tolerance import DEFAULT_TOL
from varint.integration.trajectories import with_stats
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def call_with_events(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    p0: Any,
    duration: Any,
    tol: float | None,
    began: float,
    events: Any,
) -> Trajectory | int | None:
    """`short_call` with what is watched for."""
    asked = system, rule, start, p0, duration, tol, began
    if is_held(system):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what the run that is watched says as well
            proved = short_call(*asked)
    else:
        proved = short_call(*asked)
    if type(proved) is not Trajectory:
        return proved
    if proved.fictitious is not None:  # its steps follow the scene
        return None
    tol, told = DEFAULT_TOL if tol is None else tol, proved.stats
    (q0, v0, t0, params), steps = start, told["steps"]
    known, grid = (q0, v0, p0, t0, params, None), (None, steps, duration)
    watched, level = (None, events), iteration_level(tol, steps)
    motion = few_steps_call(system, proved.rule, known, grid, 1, level, began, watched)
    if motion is None:
        return None
    estimate = told["error_estimate"] + apart_from_proved(motion, proved)
    if not estimate <= tol:  # iterations of the run that is proved have gone on for longer
        return None
    more = {name: told[name] for name in ("tol", "error_estimate", "rule", "runs")}
    more |= {"error_estimate": estimate, "seconds": perf_counter() - began}
    return with_stats(motion, **more)
