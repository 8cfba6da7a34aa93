"""Other runs of a motion for what two runs that agree may both miss: a transient within the first
steps, and agreement by chance where a force jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from varint.integration.error_scale import careful_scales
from varint.integration.round_off import FAR_BELOW, PARTED, parted
from varint.integration.run_distance import distance, distance_between_nodes
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.structure import jumps
from varint.scene.system import System

# times the steps of a run over forces that jump, and how far its last step goes beyond the end:
# runs of fewer steps cost less and err by more
OTHER_STEPS = (0.87, 0.38), (0.77, -0.38), (0.67, 0.62), (0.81, -0.24), (0.73, 0.24), (0.93, -0.62)
DRAWS = 3  # of them, that come to their end
CHANCE = 1.5  # of the largest difference: the other runs err as well
TRANSIENT_STEPS, TRANSIENT_PARTS = 4, 2  # most first steps done once more, in so many parts

# (rule, steps, one of so many parts of them, `beyond` the end, the way of the start's last
# `digits`; `count` of them from another `node`) → the run; None where it failed
Trial = Callable[..., Trajectory | None]


def before_shared(coarse: int, steps: int) -> int:
    """How many of so many steps end before the first node that a coarser run has, too; one at
    least, TRANSIENT_STEPS at most.
    """
    return min(max(steps // math.gcd(coarse, steps) - 1, 1), TRANSIENT_STEPS)


def transient(
    trial: Trial,
    rule: Rule,
    coarse: int,
    steps: int,
    motion: Trajectory,
    scales: np.ndarray,
) -> float:
    """Error of the first nodes, which are no nodes of the coarser run."""
    few = before_shared(coarse, steps)
    fine = trial(rule, steps * TRANSIENT_PARTS, steps // few)
    if fine is None:
        return math.inf
    return distance(motion, 1, fine, TRANSIENT_PARTS, scales)


def start_rounding(
    trial: Trial,
    rule: Rule,
    steps: int,
    motion: Trajectory,
    scales: np.ndarray,
    known: float,
    tol: float,
) -> float:
    """What round-off grows to, that of the first momentum included, with which all runs begin; see
    `parted`.
    """

    def apart(way: int) -> float:
        other = trial(rule, steps, digits=way)
        return math.inf if other is None else distance(motion, steps, other, steps, scales)

    return parted(apart, known, tol)[0]


def by_last_digits(
    trial: Trial, rule: Rule, steps: int, motion: Trajectory, scales: np.ndarray, wanted: float
) -> float:
    """How far a run is from one whose start has other last digits; 0 where there is none."""
    other = trial(rule, steps, wanted=wanted, digits=0)
    return 0.0 if other is None else distance(motion, steps, other, steps, scales)


def blown_apart(
    trial: Trial, rule: Rule, sample: tuple[int, Trajectory], scale: Any, tol: float
) -> bool:
    """Whether impacts make so much of last digits that it counts, by a run of few steps and one
    from a start with other ones.
    """
    steps, motion = sample
    other = trial(rule, steps, wanted=tol, digits=0)
    if other is None:
        return True
    scales = careful_scales(motion.system, motion, scale)
    return PARTED * distance(motion, steps, other, steps, scales) > FAR_BELOW * tol


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

    Their steps are no whole part of the duration: a jump near a half, or a third of it is misplaced
    alike by all that are. Dry friction does not let every number of steps through; where hardly
    any does nothing is known.
    """
    if not has_steps(system):
        return 0.0
    others = [(round(share * steps), beyond) for share, beyond in OTHER_STEPS]
    if rows > 1:  # controls have the times of their table
        parts = dict.fromkeys(many // rows for many, _ in others)
        whole = [*(x for x in parts if x), *(steps // rows + i for i in (1, 2, 3))]
        others = [(rows * x, 0.0) for x in whole]
    draws, apart = 0, 0.0
    for many, beyond in others:
        other = trial(rule, many, beyond=beyond)
        if other is not None and np.isfinite(other.q).all():
            apart = max(apart, distance_between_nodes(motion, other, scales))
            draws += 1
        if draws == DRAWS:
            return apart * CHANCE
    return math.inf


@per_scene
def has_steps(system: System) -> bool:
    """Whether forces or momenta have steps or kinks."""
    s = system
    state = ca.vertcat(s.q, s.v)
    values = ca.vertcat(ca.gradient(s.lagrangian, state), s.force)
    return jumps(values, ca.vertcat(state, s.t, s.control))


@per_scene
def has_switches(system: System) -> bool:
    """Whether the Lagrangian, forces or momenta have steps or kinks."""
    s = system
    return has_steps(s) or jumps(s.lagrangian, ca.vertcat(s.q, s.v, s.t, s.control))
