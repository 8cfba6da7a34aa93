"""What the nodes of a run do not show: forces that act for less than a step."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

MOST_LOOKS = 200_000  # times at which the force is looked at
LEAST_LOOKS, MOST_IN_A_STEP = 16, 4096
TIMES = 4.0  # as large as what the rule sees: a force that acts between its nodes


@per_system
def _push_function(system: System) -> ca.Function:
    """(q, v, t, c) → ∂L/∂q + F without controls, and the diagonal of M."""
    s = system
    force = ca.substitute(s.force, s.control, ca.SX.zeros(s.control.shape))
    generalised_force = ca.gradient(s.lagrangian, s.q) + force
    outputs = [ca.densify(generalised_force), ca.densify(ca.fabs(ca.diag(s.mass_matrix)))]
    return ca.Function("push", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


def missed_impulse(
    system: System,
    rule: Rule,
    motion: Trajectory,
    scales: np.ndarray,
    most_looks: int = MOST_LOOKS,
) -> float:
    """What a force that depends on time does between the times at which the rule looks at it.

    Where many looks within a step find a force several times as large as the rule finds at its
    nodes in that step and beside it, a pulse is stepped over: its impulse, carried on to the end of
    the run, relative to the scales. Zero for autonomous scenes, whose forces are met wherever the
    motion goes.
    """
    if system.structure.autonomous or len(motion) < 2:
        return 0.0
    looks = int(np.clip(most_looks // (len(motion) - 1), LEAST_LOOKS, MOST_IN_A_STEP))
    seen, _ = _force_within(system, motion, np.array(rule.nodes))
    true, impulse = _force_within(system, motion, (np.arange(looks) + 0.5) / looks)
    around = np.maximum(seen, np.maximum(np.roll(seen, 1, axis=0), np.roll(seen, -1, axis=0)))
    over = true > TIMES * np.maximum(around, np.median(true, axis=0))
    mass = over_columns(
        _push_function(system), motion.q[:1], motion.v[:1], motion.t[:1, None], motion.c
    )[1]
    mass = np.where(mass > 0, mass, mass.max(initial=0.0) or 1.0)
    left = abs(motion.t[-1] - motion.t[:-1])[:, None]
    return float((np.where(over, impulse, 0.0) * left / mass / scales).sum(axis=0).max())


def _force_within(
    system: System, motion: Trajectory, nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest |F| and mean |F| times h at fractions of every step, on the straight line between
    its nodes, (N, n) each.
    """
    h = np.diff(motion.t)[:, None]
    largest, total = np.zeros((2, len(h), motion.q.shape[1]))
    for x in nodes:
        q = (1 - x) * motion.q[:-1] + x * motion.q[1:]
        v = (1 - x) * motion.v[:-1] + x * motion.v[1:]
        t = motion.t[:-1, None] + x * h
        size = np.abs(over_columns(_push_function(system), q, v, t, motion.c)[0])
        largest, total = np.maximum(largest, size), total + size
    return largest, total * np.abs(h) / len(nodes)
