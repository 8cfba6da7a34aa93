"""One smooth piece of a motion from switch to switch: its steps, in units of time that suit it, and
the switch that it ends at.
"""

from __future__ import annotations

import math

import numpy as np

from varint.codegen.kernel import Kernel, told_of
from varint.integration.switches import halved
from varint.integration.switches.branch import Branch, BranchScene, branch_scene
from varint.integration.switches.course import Course, Piece, which_moves
from varint.integration.switches.crossing import Crossing, Nodes, NoWayIn, first_crossing
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.drive import drive_frequency, fastest_small_motion
from varint.integration.switches.fractional import halvings, stiff_at_first
from varint.integration.switches.loop import Grid, Loop, Part, kernel_of, loop_steps, other_steps
from varint.integration.switches.touching import held_scene
from varint.results.records import State
from varint.scene.system import System

ANGLE = 4.0  # radians of the fastest small motion in a unit, which has as many steps as asked for
UNITS = 4  # in the duration at least
LEAST_UNIT = 1 / 16  # of a unit, after a piece that is shorter
LONGER = 4.0  # units, a piece of which makes them longer again
FIRST, MOST_IN_BLOCK = 16, 256  # steps of a block, after each of which switches are looked for
MOST_NODES = 20_000_000
BORDER = 1e-6  # of a unit: so much more than whole ones is whole ones


def next_piece(
    course: Course,
    scene: BranchScene,
    branch: Branch,
    start: State,
    until: float,
    parts: int,
    shortest: float,
    count: int | None,
) -> tuple[Piece, tuple[int, float] | None] | None:
    """The piece from a state until a time or a switch, and which switch that is; None where its
    steps are too large or do not enter the branch. A unit is no longer than `shortest`, and the
    number of steps may be given.
    """
    c, span = all_parameters(course.problem.c, branch), until - start.t
    kernel = loop_of(course, scene, branch)
    if kernel is None:
        return None
    unit = min(unit_of(course, branch, start), shortest)
    if not abs(span) / unit * parts < MOST_NODES:
        return None
    steps = count or parts * max(math.ceil(abs(span) / unit - BORDER), 1)
    h, k, carry, size = span / steps, 0, None, min(FIRST, parts + 1)
    told = told_of(kernel, np.stack([start.q, start.p]), c, start.t, h)
    loop = Loop(scene.system, course.rule, kernel, c, told)
    q, p = start.q, start.p
    times, states = [np.array([start.t])], list[np.ndarray]()
    iterations, residual, found, halves = 0, 0.0, None, halvings(course, branch)
    head: Nodes | None = None
    if halves:
        begun = halved.begin(scene, loop, start, h if steps > 1 else span, halves)
        if begun is None:
            return None
        head, found = begun
        (q, p), k = head.states[-1, :2], 1
        states.append(head.states[:1])
        if found is None:
            times.append(head.t[-1:])
            states.append(head.states[-1:])
    while k < steps and found is None:
        some = min(size, steps - k)
        t = start.t + h * np.arange(k, k + some + 1)
        if k + some == steps:
            t[-1] = until
        block = _block(scene, loop, (q, p), Grid(start.t, h, some, k), carry, t)
        if block is None:
            return None
        part, found = block
        if not states:
            states.append(part.rows[:1])
        iterations += part.iterations
        residual = max(residual, part.residual)
        last = some + 1 if found is None else found.step + 1
        times.append(t[1:last])
        states.append(part.rows[1:last])
        k, carry, size = k + some, part.carry, min(4 * size, MOST_IN_BLOCK)
        q, p = part.rows[-1, :2]
    even, every = Nodes(np.concatenate(times), np.concatenate(states), True), None
    if head is not None:
        ends = halved.end(scene, loop, even, head, found, halves)
        if ends is None:
            return None
        even, every = ends
    elif found is not None:
        states_there = np.concatenate([even.states, found.state[None]])
        even = Nodes(np.append(even.t, found.t), states_there, True)
    alike = of_one_unit(branch)
    # the next piece on this branch is as long, more or less
    if found is not None and unit != shortest:
        length, most = abs(found.t - start.t), course.known.setdefault(alike, unit)
        if most == unit or length > LONGER * unit:
            course.units[alike] = min(most, max(length, most * LEAST_UNIT))
    for nodes in (even, every or even):
        _make_rays_unit(course.system, nodes.states)
    how = even.t, even.states, iterations, residual
    piece = Piece(branch, h, steps, *how, every=every and (every.t, every.states))
    return piece, None if found is None else scene.watched[found.margin]


def _make_rays_unit(system: System, states: np.ndarray) -> None:
    """States (q, p, v), (N, 3, n), of unit quaternions."""
    for group in system.rays:
        at = list(group)
        q, p, v = (states[:, i, at] for i in range(3))
        length = np.linalg.norm(q, axis=-1, keepdims=True)
        states[:, :, at] = np.stack([q / length, p * length, v / length], axis=1)


def _block(
    scene: BranchScene,
    loop: Loop,
    start: tuple[np.ndarray, np.ndarray],
    grid: Grid,
    carry: np.ndarray | None,
    t: np.ndarray,
) -> tuple[Part, Crossing | None] | None:
    """Some steps of a piece, and the switch in them: steps after it need not be possible. None
    where those before it are not, or the motion does not enter the branch.
    """
    part: Part | None = loop_steps(loop, *start, grid, carry)
    assert part is not None
    try:
        count = len(part.rows)
        found = first_crossing(scene, loop, Nodes(t[:count], part.rows, grid.first == 0))
        if found is None and not part.whole:
            part = other_steps(loop, *start, grid)
            found = part and first_crossing(scene, loop, Nodes(t, part.rows, grid.first == 0))
    except NoWayIn:
        return None
    return None if part is None else (part, found)


def loop_of(course: Course, scene: BranchScene, branch: Branch) -> Kernel | None:
    """The loop in C of a branch; None where there is none."""
    which = which_moves(branch)
    if which not in course.kernels:
        course.kernels[which] = kernel_of(scene.system, course.rule, course.backend)
    return course.kernels[which]


def of_one_unit(branch: Branch) -> Branch:
    """What stands for all branches that differ by their controls alone."""
    return branch._replace(controls=()) if branch.controls else branch


def unit_of(course: Course, branch: Branch, start: State) -> float:
    """Time in which the fastest small motion turns by `ANGLE`, or a part of the duration."""
    alike = of_one_unit(branch)
    if alike not in course.units:
        system = held_scene(course.system, branch.active_set)
        scene = branch_scene(system)
        assert scene is not None
        c, total = all_parameters(course.problem.c, branch), course.problem.h
        v = halved.velocity_at(scene.system, start, c)
        # what holds the motion slows it down
        fastest = 0.0
        if not stiff_at_first(course, branch):
            fastest = fastest_small_motion(scene.system, start._replace(v=v), c)
        drive = drive_frequency(course.system, start._replace(v=v, t=course.problem.t0), c, total)
        fastest = max(fastest, drive)
        most = abs(total) / UNITS
        course.units[alike] = min(most, ANGLE / fastest) if fastest > 0 else most
    return course.units[alike]
