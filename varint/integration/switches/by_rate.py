"""Motions between switches by time alone whose time scale varies: each leg from one switch to the
next is a run for an accuracy of its own, with steps that follow its rate. Its nodes are made so
dense that steps in physical time lead from one to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.kernel import Kernel, take_parts
from varint.discrete.legendre import velocity_function
from varint.errors import VarintError
from varint.integration.choice import Choice
from varint.integration.error_scale import error_scales, scales_of_nodes
from varint.integration.events.crossings import Watch
from varint.integration.problem import InitialValueProblem, RunOptions, Start
from varint.integration.switches.branch import Branch, branch_scene
from varint.integration.switches.compared import least_resolved
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.joined import joined
from varint.integration.switches.passage import EDGE
from varint.integration.switches.piece import loop_of
from varint.integration.time_transformation.fictitious_start import start_velocity
from varint.integration.time_transformation.rate_ahead import seen_ahead
from varint.integration.time_transformation.variable_course import (
    choose_varying_steps,
    looks_ahead,
)
from varint.integration.tolerance import choose_steps
from varint.integration.two_runs import FLOOR
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_LEGS = 64  # beyond, each is short beside what varies
CLOSER, FINER = 8.0, 16.0  # a leg of the first run than the whole motion; the second run
LEAST = 1e-12  # that a leg is asked for
BESIDE = 1.0, 4.0, 0.25, 16.0, 0.0625  # of what is wanted, where that cannot be shown by luck
SAFE = 4.0  # legs may err in other directions than those in which they are seen to grow
LOOKS = 16  # nodes of a leg at which runs are compared
HALVINGS = 24  # of a step in fictitious time, until steps in physical time lead over its parts
BETWEEN = 0.25  # of what is wanted: how far these may end beside the nodes


class _Leg(NamedTuple):
    """The motion on a branch, what it may err by, and whether its steps follow a rate."""

    branch: Branch
    motion: Trajectory
    estimate: float
    follows: bool


def by_rate(
    course: Course, options: RunOptions, tol: float, stop: Watch | None
) -> tuple[Choice, list[Piece]] | None:
    """A run whose legs follow their rates, and its pieces; None where no rate varies, or not time
    alone switches.
    """
    system, branches = course.system, _branches(course)
    scene = branch_scene(system) if not (system.structure.contacts or system.rays) else None
    if scene is None or scene.watched or len(branches) > MOST_LEGS:
        return None
    moving, c = scene.system, all_parameters(course.problem.c, branches[0])
    if not _follow(moving, course.rule, course.problem._replace(c=c)):
        return None
    kernel = loop_of(course, scene, branches[0])
    if kernel is None:
        return None
    options = options._replace(events=None, save_every=1, progress=False)
    try:
        return _proved(course, moving, kernel, options, tol, stop)
    except VarintError:
        return None


def _proved(
    course: Course,
    moving: System,
    kernel: Kernel,
    options: RunOptions,
    tol: float,
    stop: Watch | None,
) -> tuple[Choice, list[Piece]] | None:
    """Legs that each err by so little that it does not grow beyond what is wanted, as a first run
    shows whose legs begin beside the ends of those before.
    """
    given, wanted = options.scale, max(tol / CLOSER, LEAST)
    nudged = _legs(course, moving, options, wanted, stop, beside=1.0)
    if not any(leg.follows for leg in nudged):
        return None
    wanted = max(wanted / FINER, LEAST)
    options = options._replace(scale=_scales(moving, nudged, given))
    legs, runs = _legs(course, moving, options, wanted, stop), 2
    scales = _scales(moving, legs, given)
    growth = max(SAFE * _apart(nudged, legs, scales) / _most(nudged), 1.0)
    apart = growth * _most(legs)
    if not apart <= tol:
        needed, runs = tol / (2 * growth), 3
        if needed < wanted and wanted > LEAST:
            coarser, legs = legs, _legs(course, moving, options, max(needed, LEAST), stop)
        else:
            coarser = _legs(course, moving, options, wanted * FINER, stop)
        apart = min(growth * _most(legs), _apart(coarser, legs, scales))
    pieces = [_piece(leg, kernel, BETWEEN * tol * scales) for leg in legs]
    motion = joined(course, pieces, kernel)
    estimate = max(apart, least_resolved(motion, len(pieces), scales))
    return Choice(course.rule, len(motion) - 1, motion, estimate, runs, estimate <= tol), pieces


def _most(legs: Sequence[_Leg]) -> float:
    """That one of them may err by."""
    return max(FLOOR, *(leg.estimate for leg in legs))


def _branches(course: Course) -> list[Branch]:
    """One after the other."""
    values, controls = course.timetable.values.tolist(), course.timetable.controls.tolist()
    return [Branch(tuple(x), (), tuple(u)) for x, u in zip(values, controls, strict=True)]


def _follow(moving: System, rule: Rule, begun: InitialValueProblem) -> bool:
    """Whether a motion would follow a rate if it stayed on a branch."""
    if not looks_ahead(moving, rule):
        return False
    at = np.concatenate((begun.q0, start_velocity(moving, begun, None)))
    return seen_ahead(moving, at, begun.t0, begun.c, begun.h).pilot is not None


def _legs(
    course: Course,
    moving: System,
    options: RunOptions,
    tol: float,
    stop: Watch | None,
    beside: float = 0.0,
) -> list[_Leg]:
    """One after the other, until the end or the stop; each `beside` the end of the one before by so
    many times what the worst so far may err by: differences of runs then show how that grows.
    """
    begun, legs = course.problem, list[_Leg]()
    ends = [begun.t0, *course.timetable.times.tolist(), begun.t0 + begun.h]
    q, p, none = begun.q0, begun.p0, np.empty((1, 1, 0))
    for (begin, end), branch in zip(pairwise(ends), _branches(course), strict=True):
        c = all_parameters(begun.c, branch)
        problem = begun._replace(q0=q, p0=p, t0=begin, h=end - begin, c=c, u=none)
        legs.append(_leg(branch, moving, course.rule, problem, options, tol, stop))
        motion, off = legs[-1].motion, beside * _most(legs)
        early = abs(motion.t[-1] - end) > EDGE * max(abs(end), abs(begun.h))
        if stop is not None and early:
            break
        q = motion.q[-1] + off * error_scales(moving, motion, options.scale)
        p = motion.p[-1] * (1 + off)
    return legs


def _leg(
    branch: Branch,
    moving: System,
    rule: Rule,
    problem: InitialValueProblem,
    options: RunOptions,
    tol: float,
    stop: Watch | None,
) -> _Leg:
    """As close as is wanted, or about so where its rate leads no closer or not so far."""
    asked, start = options._replace(duration=problem.h), Start(problem.q0, p0=problem.p0)
    for part in BESIDE if _follow(moving, rule, problem) else ():
        found = choose_varying_steps(moving, rule, problem, start, asked, max(part * tol, LEAST))
        if isinstance(found, Choice):
            return _Leg(branch, found.motion, found.estimate, True)
    how: dict[str, Any] = {"stop": stop, "scale": options.scale, "backend": options.backend}
    found = choose_steps(moving, rule, problem, tol, **how)
    return _Leg(branch, found.motion, found.estimate, False)


def _scales(moving: System, legs: Sequence[_Leg], given: Any) -> np.ndarray:
    """What errors are measured by along all of them."""
    first = legs[0].motion
    if given is not None:
        return error_scales(moving, first, given)
    q = np.concatenate([leg.motion.q for leg in legs])
    return scales_of_nodes(moving, q, first[:1].v[0], first.t[:1], first.c)


def _apart(one: Sequence[_Leg], other: Sequence[_Leg], scales: np.ndarray) -> float:
    """How far two runs are apart at some nodes of the first, and at the ends of all legs."""
    if len(one) != len(other):
        return np.inf
    far = 0.0
    for a, b in ((x.motion, y.motion) for x, y in zip(one, other, strict=True)):
        some = np.unique(np.linspace(0, len(a) - 2, LOOKS).astype(int))
        some = some[np.abs(a.t[some] - b.t[0]) < abs(b.t[-1] - b.t[0])]
        off = np.abs(b.at(a.t[some]).q - a.q[some]).max(axis=0)
        late = abs(a.t[-1] - b.t[-1]) * np.abs(b[-1:].v[0])  # where the motion stops
        far = max(far, *(off / scales), *((np.abs(a.q[-1] - b.q[-1]) + late) / scales))
    return float(far)


def _piece(leg: _Leg, kernel: Kernel, limits: np.ndarray) -> Piece:
    """A leg as a piece, from each node of which a step in physical time leads to the next but for
    so much.
    """
    motion, system = leg.motion, leg.motion.system
    i = np.arange((len(motion) - 1) * leg.follows)  # nodes from which steps are to be looked at
    for _ in range(HALVINGS):
        t, q = motion.t, motion.q
        h, u = t[i + 1] - t[i], np.empty((len(i), 0))
        ends, good = take_parts(kernel, q[i], motion.p[i], motion.c, t=t[i], h=h, u=u)
        far = i[~good | (np.abs(ends[:, 0] - q[i + 1]) > limits).any(axis=1)]
        if not len(far):
            break
        motion = leg.motion.at(np.insert(t, far + 1, (t[far] + t[far + 1]) / 2))
        i = far + np.arange(len(far))
        i = np.sort(np.append(i, i + 1))
    t, q, p = motion.t, motion.q, motion.p
    v = over_columns(velocity_function(system), q, p, t[:, None], motion.c)[0]
    states, count, told = np.stack([q, p, v], axis=1), len(t) - 1, leg.motion.stats
    how = told.get("iterations", 0), told.get("residual", 0.0)
    even = not leg.follows and motion.sizes is None
    size, every = float(t[-1] - t[0]) / count, None if even else (t, states)
    return Piece(leg.branch, size, count, t, states, *how, every=every)
