"""What judges the answers of lessons 1 to 4: from least action to multipliers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.boundary.least_action import least_action
from varint.course.judges import (
    CLOSE,
    conserved,
    expression_of,
    number,
    numbers_of,
    random_states,
    same_motion,
    values_of,
)
from varint.errors import InputError
from varint.integration.simulate import simulate
from varint.scene.system import System, coordinates
from varint.symmetry.noether import noether

GRAVITY = 9.81
STEPS = 60  # of a path whose minimum is in question
ASIDE = 0.02  # relative: how far beside the claimed end of the minima two paths are tried


def hanging_mass(answer: Any) -> str:
    x, v = coordinates("x")
    return same_motion(answer, System(x, v, v**2 / 4 - 20 * x**2 + GRAVITY * x / 2))


def longest_minimum(answer: Any) -> str:
    """A path just shorter has no direction that lowers the action, one just longer has."""
    [duration] = numbers_of(answer, 1)
    if not duration > 0:
        return f"{duration:.6g} is no duration"
    x, v = coordinates("x")
    scene = System(x, v, v**2 / 2 - 9 * x**2 / 2)
    shorter, longer = (
        least_action(scene, q0=0.0, q_end=1.0, duration=duration * (1 + aside), steps=STEPS)
        for aside in (-ASIDE, ASIDE)
    )
    if shorter.morse_index:
        return f"a path of {shorter.duration:.4g} s is no minimum any more"
    return "" if longer.morse_index else f"a path of {longer.duration:.4g} s is a minimum still"


def bead_on_parabola(answer: Any) -> str:
    x, v = coordinates("x")
    return same_motion(answer, System(x, v, (1 + x**2) * v**2 / 2 - GRAVITY * x**2 / 2))


def bead_as_constraint(answer: Any) -> str:
    """Compared at states on the parabola; any constraint that vanishes there is right."""
    q, v = coordinates("x", "y")
    wire = q[1] - q[0] ** 2 / 2
    scene = System(q, v, ca.sumsqr(v) / 2 - GRAVITY * q[1], constraint=wire)
    if isinstance(answer, System) and not answer.structure.constraints:
        return "there is no constraint"
    x, along = random_states(2).T
    return same_motion(answer, scene, np.column_stack([x, x**2 / 2, along, x * along]))


def ends_of_ladder(answer: Any) -> str:
    """Any coordinate is right that keeps the length and moves the ends."""
    s = ca.SX.sym("s")
    ends = expression_of(answer, (s,), 2, "ends(s)")
    tested = ca.horzcat(ends, ca.jacobian(ends, s))
    for [at] in random_states(1, 0.2, 1.2):
        place, slope = values_of(tested, (s,), (at,)).T
        if not abs(place @ place - 4) <= CLOSE:
            return f"at s = {at:.3g} the ladder has the length {np.hypot(*place):.6g}"
        if not np.abs(slope).max() > CLOSE:
            return f"at s = {at:.3g} the ends do not move with s"
    return ""


def charge_in_field(answer: Any) -> str:
    q, v = coordinates("x", "y")
    return conserved(answer, System(q, v, ca.sumsqr(v) / 2 + q[0] * v[1] - q[1] * v[0]))


def screw(answer: Any) -> str:
    direction = numbers_of(answer, 2)
    if not direction.any():
        return "nothing moves in the direction 0"
    q, v = coordinates("phi", "z")
    scene = System(q, v, ca.sumsqr(v) / 2 - ca.cos(3 * q[0] - 2 * q[1]))
    try:
        noether(scene, direction)
    except InputError as refused:
        return f"this direction changes L: {refused}"
    return ""


def largest_tension(answer: Any) -> str:
    """The pull where the rod hangs straight, from the multiplier of a simulation."""
    q, v = coordinates("x", "y")
    mass, lowest = 0.2, q[0]
    rod = (ca.sumsqr(q) - 1) / 2  # whose gradient has the length 1 on the circle
    scene = System(q, v, mass * (ca.sumsqr(v) / 2 - GRAVITY * q[1]), constraint=rod)
    fall = simulate(scene, q0=[1, 0], v0=[0, 0], h=0.005, duration=2.0, until=lowest)
    return number(answer, -fall.multipliers[-1, 0], "N")
