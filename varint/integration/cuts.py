"""Angles of atan2(y, x), which jump by 2π on the negative x axis, their cut. A motion that may
keep away from there is made as that of a smooth scene, and then looked at; one that meets the cut
is followed from switch to switch.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.numerics.operations import operations_of, takes, values_of
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

LOOKS = np.arange(4)[:, None, None] / 4  # within a step
POSITIVE = frozenset(("sqrt", "sq", "exp", "fabs", "hypot"))


@per_scene
def cuts_of(system: System) -> ca.Function | None:
    """(q, v, t, c) → y and x of each angle that forces or momenta depend on; None where there is
    none whose x may be negative.
    """
    s, state = system, ca.vertcat(system.q, system.v)
    if not takes("atan2", ca.vertcat(s.lagrangian, s.force)):
        return None
    rates = ca.densify(ca.vertcat(ca.gradient(s.lagrangian, state), s.force))
    inputs = [s.q, s.v, s.t, s.c, s.control]
    nodes = operations_of(ca.Function("rates", inputs, [rates])).nodes
    angles = [
        taken for name, *taken in nodes if name == "atan2" and nodes[taken[1]][0] not in POSITIVE
    ]
    if not angles:
        return None
    values = values_of(nodes, inputs)
    pairs = [(values[y], values[x]) for y, x in angles if _may_jump(s, values[y], values[x])]
    if not pairs:
        return None
    rows = (ca.densify(ca.horzcat(*part)) for part in zip(*pairs, strict=True))
    return ca.Function("cuts", inputs[:4], [*rows], {"cse": True})


def _may_jump(system: System, y: ca.SX, x: ca.SX) -> bool:
    """As far as no controls are in it."""
    s, both = system, ca.vertcat(y, x)
    if x.is_constant() and float(x) >= 0:
        return False
    moves = ca.depends_on(both, ca.vertcat(s.q, s.v, s.t))
    return moves and not ca.depends_on(both, s.control)


def meets_cut(motion: Trajectory) -> bool:
    """Whether an angle of the motion's forces jumps on the way: y changes its sign where x is
    negative, at nodes or between them.
    """
    cuts = cuts_of(motion.system)
    if cuts is None:
        return False
    t, q, v, h = motion.t, motion.q, motion.v, np.diff(motion.t)[:, None]
    a, d = LOOKS, np.diff(q, axis=0)
    bend = h * (v[:-1] + v[1:]) - 2 * d  # of the cubic through both ends
    lean = 3 * d - h * (2 * v[:-1] + v[1:])
    places = q[:-1] + a * (h * v[:-1] + a * (lean + a * bend))
    speeds = v[:-1] + a * (2 * lean + 3 * a * bend) / h
    times = t[:-1, None] + a * h

    def in_turn(between: np.ndarray, last: np.ndarray) -> np.ndarray:
        return np.append(between.swapaxes(0, 1).reshape(-1, len(last)), last[None], axis=0)

    states = (in_turn(*x) for x in ((places, q[-1]), (speeds, v[-1]), (times, t[-1:])))
    y, x = over_columns(cuts, *states, motion.c)
    behind = np.minimum(x[:-1], x[1:]) < 0
    return bool((behind & (np.signbit(y[:-1]) != np.signbit(y[1:]))).any())


def clear_of_cuts(found: Any) -> Any:
    """What was found; None where that is a motion that meets a cut."""
    return None if type(found) is Trajectory and meets_cut(found) else found
