"""How many radians the fastest small motion about a start turns during a run."""

from __future__ import annotations

import math

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.discrete.legendre import velocity_function
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.small_motions import (
    MOST_COORDINATES,
    frequencies,
    frequency_at_start,
)
from varint.integration.trajectories import Run, first_node, trajectory_of
from varint.numerics.arrays import call
from varint.rules.rule import Rule
from varint.scene.system import System


def radians_of(system: System, rule: Rule, start: InitialValueProblem) -> float:
    """How many radians the fastest small motion about the start turns in the duration."""
    s = system.structure
    fastest: float | None
    if s.degenerate or s.constraints or s.nonholonomic or s.contacts or system.rays:
        every_row = ActiveSet(tuple(range(s.constraints)))
        node = first_node(start)._replace(active_set=start.active_set or every_row)
        rest = Run(system, plan(system, rule), start, [node], iter(()), None, 0.0)
        fastest = frequencies(trajectory_of(rest, rest.nodes)).max(initial=0.0)
    elif s.n > MOST_COORDINATES:
        fastest = 0.0
    else:
        velocity = velocity_function(system)
        v = call(velocity, start.q0, start.p0, np.array((start.t0,)), start.c)[0]
        fastest = frequency_at_start(system, start.q0, v, start.t0, start.c)
    turned = abs(start.h * start.steps) * (fastest or 0.0)
    return min(float(turned), 1e6) if math.isfinite(turned) else 0.0
