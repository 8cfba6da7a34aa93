"""Speeds at the nodes at which nothing moves: Lobatto rules under damping that is far faster than
a step.

With an odd number of nodes their stability function tends to +1 where damping is infinitely fast:
what is damped stays. A force that saturates, such as friction, makes fixed points of it (spurious
ones: Iserles, SIAM J. Numer. Anal. 27 (1990)): the two outer nodes of a step push against each
other, and the inner ones alone hold the body.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

CALM = 0.01  # change of a speed over two steps, of the speed
APART = 0.5  # of it: so far are the places from what the speed makes of them


@per_scene
def _damped(system: System) -> bool:
    return bool(ca.depends_on(system.force, system.v))


def may_be_false(system: System, rule: Rule) -> bool:
    """Whether the rule leaves such speeds of the scene."""
    nodes = rule.nodes
    if len(nodes) < 3 or len(nodes) % 2 == 0 or nodes[0] != 0 or nodes[-1] != 1:
        return False
    return system.structure.forced and not system.rays and _damped(system)


def false_speed(motion: Trajectory) -> str | None:
    """What is wrong with the speeds at the end of a run, and what to do."""
    nodes = motion.rule.nodes
    if not may_be_false(motion.system, motion.rule) or motion.system.structure.contacts:
        return None
    if len(motion) < 3 or motion.k[-1] - motion.k[-3] != 2:
        return None
    last = motion[-3:]
    v, mean = last.v, (last.q[2] - last.q[0]) / (last.t[2] - last.t[0])
    size = np.abs(v[1])
    false = (np.abs(v[2] - v[0]) < CALM * size) & (np.abs(mean - v[1]) > APART * size)
    if not false.any():
        return None
    i = int(np.argmax(false * size))
    return (
        f"the speed of {motion.system.names[i]} is {v[1, i]:.3g} at the last nodes, and the places "
        f"go on by {mean[i]:.3g}: the damping is much faster than a step h = {motion.h:g} of "
        f"{motion.rule}, which leaves such speeds as they are; take lobatto({len(nodes) + 1}), a "
        "Gauss rule where there are no constraints, or a smaller h"
    )
