"""Other runs of a motion for what two runs that agree may both miss: a transient within the first
steps, and agreement by chance where a force jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np

from varint.integration.run_distance import distance
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.structure import jumps
from varint.scene.system import System, per_system

OTHER_STEPS = 1.25, 1.5  # times the steps of a run over forces that jump: two more draws
CHANCE = 1.5  # of the largest difference: the other runs err as well
TRANSIENT_STEPS, TRANSIENT_PARTS = 4, 16  # first steps that are done once more, in so many parts

# (rule, steps, optionally one of so many parts of them) → the run; None where it failed
Trial = Callable[..., Trajectory | None]


def transient(
    trial: Trial,
    rule: Rule,
    steps: int,
    motion: Trajectory,
    scales: np.ndarray,
) -> float:
    """Error of the first nodes, which lie within the first step of a coarser run."""
    few = min(TRANSIENT_STEPS, steps)
    fine = trial(rule, steps * TRANSIENT_PARTS, steps // few)
    if fine is None:
        return math.inf
    return distance(motion, 1, fine, TRANSIENT_PARTS, scales)


def luck(
    system: System,
    trial: Trial,
    rule: Rule,
    rows: int,
    steps: int,
    motion: Trajectory,
    scales: np.ndarray,
) -> float:
    """Where a force jumps the error is what the place of the jump within its step makes of it, and
    two runs may agree by chance: the largest difference from runs of other numbers of steps.
    """
    if not _has_steps(system):
        return 0.0
    largest = 0.0
    for share in OTHER_STEPS:
        many = rows * round(share * steps / rows)
        other = trial(rule, many)
        if other is not None:  # dry friction does not let every number of steps through
            largest = max(largest, distance(motion, steps, other, many, scales))
    return largest * CHANCE


@per_system
def _has_steps(system: System) -> bool:
    """Whether forces or momenta have steps or kinks."""
    s = system
    state = ca.vertcat(s.q, s.v)
    values = ca.vertcat(ca.gradient(s.lagrangian, state), s.force)
    return jumps(values, ca.vertcat(state, s.t, s.control))
