"""Steps that are halved towards a switch where no polynomial follows the forces: what a step errs
by that begins or ends there falls with a power of its size, and steps beside it are as long as they
are far from it.
"""

from __future__ import annotations

import math

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.switches.branch import BranchScene
from varint.integration.switches.crossing import (
    Crossing,
    Nodes,
    NoWayIn,
    first_crossing,
    step_from,
    zero_in_step,
)
from varint.integration.switches.loop import Loop
from varint.numerics.arrays import call
from varint.results.records import State
from varint.scene.system import System

BEYOND = 8  # doublings of the last step, until it leads over the switch


def velocity_at(system: System, start: State, c: np.ndarray) -> np.ndarray:
    """Of a smooth scene with all its parameters."""
    return call(velocity_function(system), start.q, start.p, np.array([start.t]), c)[0]


def begin(
    scene: BranchScene, loop: Loop, start: State, h: float, halvings: int
) -> tuple[Nodes, Crossing | None] | None:
    """The nodes of a step from a switch, and a margin's zero among them; None where they are not
    solved.
    """
    first = np.stack([start.q, start.p, velocity_at(loop.system, start, loop.c)])
    try:
        nodes = _first_step(scene, loop, first, start.t, h, halvings)
        return nodes, first_crossing(scene, loop, nodes)
    except NoWayIn:
        return None


def end(
    scene: BranchScene,
    loop: Loop,
    even: Nodes,
    head: Nodes,
    found: Crossing | None,
    halvings: int,
) -> tuple[Nodes, Nodes] | None:
    """The even nodes of a piece that are kept with the margin's zero that it ends at, and all of
    its nodes; None where they are not solved.
    """
    within = found is not None and len(even.t) == 1  # of the first step
    some = head if found is None or not within else _first_ones(head, found.step + 1)
    every = _joined(some, even.t[2:], even.states[2:])
    if found is None:
        return even, every
    try:
        kept, tail = _towards_zero(scene, loop, every, found, halvings)
    except NoWayIn:
        return None
    every = _joined(_first_ones(every, kept), *tail)
    before = np.abs(even.t - even.t[0]) <= abs(every.t[kept - 1] - every.t[0])
    even = Nodes(even.t[before], even.states[before], True)
    return _joined(even, tail[0][-1:], tail[1][-1:]), every


def _first_ones(nodes: Nodes, count: int) -> Nodes:
    return Nodes(nodes.t[:count], nodes.states[:count], True)


def _joined(nodes: Nodes, t: np.ndarray, states: np.ndarray) -> Nodes:
    return Nodes(np.append(nodes.t, t), np.concatenate([nodes.states, states]), True)


def _first_step(
    scene: BranchScene, loop: Loop, state: np.ndarray, t: float, h: float, halvings: int
) -> Nodes:
    """The nodes of a step from a switch: each step is as long as all before it.

    Raises
    ------
    NoWayIn
        If one is not solved.
    """
    times, states = [t], [state]
    for i in range(halvings + 1):
        ahead = t + math.ldexp(h, i - halvings)
        step = step_from(scene, loop, states[-1], times[-1], ahead - times[-1])
        states.append(step.part(1.0)[0])
        times.append(ahead)
    return Nodes(np.array(times), np.array(states), True)


def _towards_zero(
    scene: BranchScene, loop: Loop, nodes: Nodes, found: Crossing, halvings: int
) -> tuple[int, tuple[np.ndarray, np.ndarray]]:
    """How many of the nodes before a margin's zero are kept, and those that follow to the zero; a
    step that ends close to it is taken again.

    Raises
    ------
    NoWayIn
        As `_last_step`.
    """
    t, last = nodes.t, len(nodes.t) - 1
    if not last:  # within the first of the steps from a switch
        return 1, (np.array([found.t]), found.state[None])
    if abs(found.t - t[last]) < abs(t[last] - t[last - 1]) / 2:
        last -= 1
    return last + 1, _last_step(scene, loop, nodes.states[last], float(t[last]), found, halvings)


def _last_step(
    scene: BranchScene, loop: Loop, state: np.ndarray, t: float, found: Crossing, halvings: int
) -> tuple[np.ndarray, np.ndarray]:
    """The nodes behind a state to a margin's zero that was `found` roughly: each step is half as
    long as it is far; the last of them is at the zero.

    Raises
    ------
    NoWayIn
        If one is not solved, or the zero is not there.
    """
    margin, end, least = found.margin, found.t, math.ldexp(abs(found.t - t), -halvings)
    value, rate = (
        float(x[0, margin])
        for x in scene.margins_along(loop.c, state[:1], state[2:], np.array([[t]]))
    )
    times, states = [t], [state]
    for _ in range(4 * halvings):
        t, size = times[-1], (end - times[-1]) / 2
        if not abs(size) > least:
            break
        reached, values, rates = step_from(scene, loop, states[-1], t, size).part(1.0)
        if not values[margin] > 0:
            end = t + size
            continue
        times.append(t + size)
        states.append(reached)
        value, rate = float(values[margin]), float(rates[margin]) / size
        ahead = -value / rate if rate * size < 0 else size
        if abs(ahead) < 2 * abs(size):
            end = times[-1] + ahead
    if not value > 0:
        raise NoWayIn
    t, size = times[-1], 2 * (end - times[-1])
    for _ in range(BEYOND):
        step = step_from(scene, loop, states[-1], t, size)
        _, values, rates = step.part(1.0)
        if not values[margin] > 0:
            ends = [value, float(values[margin]), rate * size, float(rates[margin])]
            zero = zero_in_step(step, margin, ends, False)
            assert zero is not None
            return np.array([*times[1:], t + zero[0]]), np.array([*states[1:], zero[1]])
        size *= 2
    raise NoWayIn
