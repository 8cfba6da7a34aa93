"""The course of a run: legs from node to node, each by whole steps or by a part of one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.events.contact_loop import contact_run
from varint.integration.flight_choice import flights_for
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.trajectories import Run, trajectory_of
from varint.numerics.limits import check_steps_again
from varint.results.dense_output import node_tolerance, with_all_nodes
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.system import System
from varint.sensitivities.checkpoints import pieces_backwards
from varint.sensitivities.event_nodes import events_at_nodes, without_arrivals
from varint.sensitivities.grazing import require_no_touch
from varint.sensitivities.pieces import (
    LONGEST_PIECE,
    OFF_GRID,
    Piece,
    piece_between,
    pieces,
    run_once_more,
    scene_of,
)


class Leg(NamedTuple):
    """What lies between two nodes of a run.

    Attributes
    ----------
    scene : System
        What moves there.
    piece : Piece
        Its steps; a part of one as a step of its own.
    held : ActiveSet or None
        What holds there, in scenes with contacts.
    part : bool
        Whether it is part of a step, whose ends are no nodes of the grid both.
    on_grid : bool
        Whether a part ends with the step.
    events : tuple of Event
        What happens where a part ends.
    """

    scene: System
    piece: Piece
    held: ActiveSet | None = None
    part: bool = False
    on_grid: bool = True
    events: tuple[Event, ...] = ()


class Course(NamedTuple):
    """A run as it was taken: with nodes at whole steps, and at events, wherever its own nodes lie.

    Attributes
    ----------
    motion : Trajectory
        The nodes of the course.
    rows : Trajectory
        Those whose derivatives are wanted.
    """

    motion: Trajectory
    rows: Trajectory


def course_of(motion: Trajectory) -> Course:
    """The course of a run, its steps taken once more where nodes lie within them.

    Raises
    ------
    InputError
        If the first node lies within a step, or a step was taken in parts.
    ConvergenceError
        If a contact is touched without a blow.
    """
    if motion.whole is not None and motion.whole.sizes is not None:
        return course_of(with_all_nodes(motion)[0])._replace(rows=motion)
    scene_of(motion)
    check_steps_again(int(motion.k[-1] - motion.k[0]) - len(motion), "derivatives")
    if any(event.kind.startswith("divided in") for event in motion.events):
        raise InputError(
            "a step of this run failed and was taken in parts: its derivatives are not available; "
            "run it with a smaller h"
        )
    older = motion.stats.get("switches_by_motion")  # files that do not tell which of them jump
    if switches := motion.stats.get("jumps_by_motion", older):
        raise InputError(
            f"the forces or potentials jump or kink {switches} times along this run, where its "
            "motion has it so: its derivatives are not available there; smooth what jumps, such as "
            "sign(v) to tanh(v/ε)"
        )
    if motion.stats.get("pieces_unwritten"):
        raise InputError(
            "switches hold this motion, as dry friction does what rests, or it begins where forces "
            "jump, as those of sign(v) do at v = 0, or a node of its rule lies where they jump in "
            "time: the scene as it is written is another one there, so its derivatives are not "
            "available; smooth what jumps, such as sign(v) to tanh(v/ε), begin with a velocity, or "
            "hand jumps in time over as controls"
        )
    if not motion.system.structure.contacts:
        return Course(_of_grid(motion), motion)
    found = without_arrivals(_of_contacts(motion))
    require_no_touch(found, events_at_nodes(found) or {})
    return Course(found, motion)


def grid_times(motion: Trajectory, k: np.ndarray) -> np.ndarray:
    """Times of whole steps."""
    if motion.sizes is None:
        ends = motion.h * k
    else:
        ends = np.append(0.0, np.cumsum(motion.sizes))[k]
    if motion.origin is not None:
        return motion.origin + ends
    return motion.t[0] - _first_end(motion) + ends


def _first_end(motion: Trajectory) -> float:
    k = int(motion.k[0])
    return motion.h * k if motion.sizes is None else float(motion.sizes[:k].sum())


def _at_whole_steps(motion: Trajectory) -> np.ndarray:
    """Which nodes lie at whole steps."""
    off = np.abs(motion.t - grid_times(motion, motion.k))
    return off <= OFF_GRID * abs(motion.h)


def ends_whole(motion: Trajectory) -> bool:
    """Whether the last node lies at a whole step."""
    return bool(_at_whole_steps(motion)[-1])


def _of_grid(motion: Trajectory) -> Trajectory:
    """The run's nodes at whole steps, all steps that are missing behind the last of these, and the
    run's end.
    """
    whole = _at_whole_steps(motion)
    _require_start(motion, whole)
    if whole.all() and (np.diff(motion.k) > 0).all():
        return motion
    nodes = np.flatnonzero(whole)
    base = motion[nodes[np.append(True, np.diff(motion.k[nodes]) > 0)]]
    parts, last = [(base.t, base.q, base.p, base.k)], int(motion.k[-1])
    if last > base.k[-1]:
        x, _, _ = run_once_more(base, scene_of(motion), len(base) - 1, int(base.k[-1]), last)
        n, k = motion.q.shape[1], np.arange(base.k[-1] + 1, last + 1)
        parts.append((grid_times(motion, k), x[1:, :n], x[1:, n:], k))
    if not whole[-1]:
        parts.append((motion.t[-1:], motion.q[-1:], motion.p[-1:], motion.k[-1:]))
    t, q, p, k = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    held = base.active_set
    if held is not None:
        held = np.append(held, np.full(len(k) - len(held), held[-1]))
    return replace(base, t=t, q=q, p=p, k=k, active_set=held)


def _require_start(motion: Trajectory, whole: np.ndarray) -> None:
    if not whole[0]:
        raise InputError(
            f"the first node, t = {motion.t[0]:g}, lies within a step: how the motion came there "
            "is not known; keep the start among the nodes (at=[t0, …])"
        )


def _of_contacts(motion: Trajectory) -> Trajectory:
    """The run with every node at whole steps and events; that it ends within a step it keeps."""
    whole, events = _at_whole_steps(motion), events_at_nodes(motion)
    if events is not None and 0 in events and whole[0] and not motion.k[0]:
        raise InputError(
            "an impact happens at the very start: its derivative by the start does not exist; "
            "begin a moment later"
        )
    stops = set(events or ()) | {0, len(motion) - 1}
    apart = np.diff(motion.k)
    if events is not None and (apart <= 1).all() and (apart >= 0).all():
        strange = [i for i in np.flatnonzero(~whole).tolist() if i not in stops]
        if all(motion.t[i] == motion.t[i - 1] for i in strange) and _has_whole(motion, whole):
            return motion
    _require_start(motion, whole)
    assert motion.active_set is not None
    problem = InitialValueProblem(
        motion.q[0],
        motion.p[0],
        float(grid_times(motion, np.zeros(1, int))[0]),
        motion.h,
        int(motion.k[-1]) + int(not whole[-1]),
        1,
        motion.u,
        motion.c,
        len(motion.rule.nodes),
        motion.active_sets[motion.active_set[0]],
        first=int(motion.k[0]),
    )
    backend = "interpreted" if motion.stats.get("backend") == "interpreted" else "auto"
    flights = flights_for(motion.system, motion.rule, problem, backend)
    blocks = list(contact_run(motion.system, motion.rule, problem, flights=flights))
    chosen = plan(motion.active_sets[motion.active_set[0]].scene(motion.system), motion.rule)
    run = Run(motion.system, chosen, problem, blocks, iter(()), None, 0.0)
    return _until_last(trajectory_of(run, blocks), motion)


def _until_last(course: Trajectory, motion: Trajectory) -> Trajectory:
    """The course without what comes behind the motion's last node, which ends it."""
    forward, near = np.sign(motion.h), node_tolerance(motion) * abs(motion.h)
    end = forward * motion.t[-1]
    part = course[: np.searchsorted(forward * course.t, end + near, side="right")]
    if forward * part.t[-1] >= end - near:
        return part
    ends = {name: np.append(getattr(part, name), getattr(motion, name)[-1:], 0) for name in "tqpk"}
    assert part.active_set is not None
    return replace(part, **ends, active_set=np.append(part.active_set, part.active_set[-1]))


def _has_whole(motion: Trajectory, whole: np.ndarray) -> bool:
    """Whether every whole step between the ends has its node."""
    return bool(np.isin(np.arange(motion.k[0] + 1, motion.k[-1] + 1), motion.k[whole]).all())


def legs(course: Course) -> Iterator[Leg]:
    """The legs of a course in order."""
    motion = course.motion
    if motion.system.structure.contacts:
        yield from _legs_of_contacts(motion, _stretches(motion))
        return
    scene, last, whole = scene_of(motion), len(motion) - 1, ends_whole(motion)
    yield from (Leg(scene, x) for x in pieces(motion, 0, last - (not whole)))
    if not whole:
        yield _part(motion, scene, None, last - 1, False, ())


def legs_backwards(course: Course, states: int | None = None) -> Iterator[Leg]:
    """The legs of a course from the last to the first, with so many states in memory where nodes
    were left out; see `checkpoints`.

    Raises
    ------
    InputError
        If states are counted and the scene has contacts: its course has all nodes.
    """
    motion = course.motion
    if motion.system.structure.contacts:
        if states is not None:
            raise InputError(
                "states= is for runs without contacts; a run through contacts is differentiated "
                "with all of its nodes"
            )
        yield from _legs_of_contacts(motion, _stretches(motion)[::-1])
        return
    scene, last, whole = scene_of(motion), len(motion) - 1, ends_whole(motion)
    if not whole:
        yield _part(motion, scene, None, last - 1, False, ())
    # as they come: a piece that is held on to stands in memory beside the next one
    yield from map(partial(Leg, scene), pieces_backwards(motion, 0, last - (not whole), states))


def _legs_of_contacts(motion: Trajectory, stretches: list[tuple[int, int]]) -> Iterator[Leg]:
    events, whole = events_at_nodes(motion), _at_whole_steps(motion)
    assert events is not None and motion.active_set is not None
    for a, b in stretches:
        held = motion.active_sets[motion.active_set[a]]
        scene = held.scene(motion.system)
        if b < 0:
            yield _part(motion, scene, held, a, bool(whole[a + 1]), events.get(a + 1, ()))
        else:
            first = int(motion.k[a] - motion.k[0])
            yield Leg(scene, piece_between(motion, scene, a, b, first), held)


def _stretches(motion: Trajectory) -> list[tuple[int, int]]:
    """First and last node of each stretch of whole steps, and of parts of steps: (first, −1)."""
    events, whole, last = events_at_nodes(motion) or {}, _at_whole_steps(motion), len(motion) - 1
    free = whole.copy()
    free[[i for i in events if i]] = False
    held = motion.active_set
    assert held is not None
    regular = free[:-1] & free[1:] & (np.diff(motion.k) == 1) & (held[1:] == held[:-1])
    found, a = [], 0
    while a < last:
        if not regular[a]:
            found.append((a, -1))
            a += 1
            continue
        odd = np.flatnonzero(~regular[a : min(a + LONGEST_PIECE, last)])
        b = a + int(odd[0]) if len(odd) else min(a + LONGEST_PIECE, last)
        found.append((a, b))
        a = b
    return found


def _part(
    motion: Trajectory,
    scene: System,
    held: ActiveSet | None,
    a: int,
    whole: bool,
    events: tuple[Event, ...],
) -> Leg:
    """The part of a step from node a to the next one, which may be at a whole step."""
    b = a + 1
    end, speed = np.hstack([motion.q[b], motion.p[b]]), motion.v[b]
    if events:
        end, speed = np.hstack([events[0].q, events[0].p_before]), np.array(events[0].v_before)
    x = np.array([np.hstack([motion.q[a], motion.p[a]]), end])
    v = np.array([motion.v[a], speed])
    step = motion.k[a : a + 1]
    piece = Piece(
        a,
        b,
        int(motion.k[a] - motion.k[0]),
        x,
        v,
        motion.t[a : a + 1].copy(),
        motion.t[b : b + 1] - motion.t[a : a + 1],
        motion.u[np.minimum(step, len(motion.u) - 1)],
        np.array([0, 1]),
    )
    return Leg(scene, piece, held, True, whole and not events, events)


def with_last(items: Iterator[Leg]) -> Iterator[tuple[Leg, bool]]:
    """Each leg, and whether it is the last one."""
    before = None
    for item in items:
        if before is not None:
            yield before, False
        before = item
    assert before is not None
    yield before, True
