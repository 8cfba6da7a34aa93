"""What is known of a motion by its start alone, for the choice of steps."""

from __future__ import annotations

import math

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.run import trajectory_of
from varint.integration.second_looks import has_steps
from varint.integration.small_motions import (
    decay_rates,
    frequencies,
    is_looked_at,
    small_motions_at_start,
)
from varint.integration.trajectories import Run, first_node
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System


def fastest_at_start(
    system: System, rule: Rule, start: InitialValueProblem
) -> tuple[float, np.ndarray | None]:
    """Frequency of the fastest small motion about the start, 0 where it is not known, and the
    diagonal of the mass matrix where it is known from that.
    """
    s = system.structure
    fastest: float | None = 0.0
    mass = None
    if s.degenerate or s.constraints or s.nonholonomic or system.rays:
        fastest = frequencies(_at_start(system, rule, start)).max(initial=0.0)
    elif is_looked_at(system):
        fastest, mass = small_motions_at_start(system, start.q0, start.p0, start.t0, start.c)
    return float(fastest or 0.0), mass


def stiff_at_start(system: System, rule: Rule, start: InitialValueProblem, radians: float) -> float:
    """Steps up to which the start tells that they are long for springs or dampers, where it is for
    Newton's method to solve them: iterations that fail elsewhere ask for shorter ones, which take
    less time. Infinitely many where forces jump, or other rows than those of motion are solved.
    """
    if has_steps(system) or not is_free(system):
        return math.inf
    decays = decay_rates(_at_start(system, rule, start)) * abs(start.h * start.steps)
    return max(radians, decays.max(initial=0.0))


def is_free(system: System) -> bool:
    s = system.structure
    return not (s.degenerate or s.constraints or s.nonholonomic or s.contacts or system.rays)


def _at_start(system: System, rule: Rule, start: InitialValueProblem) -> Trajectory:
    """The start alone."""
    every_row = ActiveSet(tuple(range(system.structure.constraints)))
    node = first_node(start)._replace(active_set=start.active_set or every_row)
    rest = Run(system, plan(system, rule), start, [node], iter(()), None, 0.0)
    return trajectory_of(rest, rest.nodes)
