"""The smooth pieces of a motion as trajectories of their own, and as the one that users see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.many_steps import steps_again, steps_of
from varint.integration.plan import plan
from varint.integration.switches.branch import Branch, slidable
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.jumping import jumping_times, switching_times, unwritten
from varint.integration.switches.loop import kernel_of
from varint.integration.switches.touching import scene_in
from varint.results.dense_output import node_tolerance, require_within
from varint.results.records import whole_of
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

HOLDS, SOLVED = 1, 2  # contacts on a branch, in files
NAMES = {"t", "q", "p", "branch", "values", "held"}  # of arrays of all scenes there


def piece_motion(course: Course, piece: Piece) -> Trajectory:
    """A piece as a motion of the scene of its branch."""
    t, states = piece.nodes
    k, within = np.arange(len(t)), abs(piece.h) * (len(t) - 1.5)
    if piece.every is None and (k[-1] < piece.steps or abs(t[-1] - t[0]) < within):
        k[-1] -= 1  # the switch lies within the step
    return _motion_of(course, piece, t, states, k)


def pieces_motion(course: Course, pieces: Sequence[Piece]) -> tuple[Trajectory, np.ndarray]:
    """Pieces of one branch, one after the other, and from which nodes to the next steps lead."""
    lengths = [len(x.nodes[0]) for x in pieces]
    t, states = (np.concatenate(x) for x in zip(*(x.nodes for x in pieces), strict=True))
    steps = np.ones(len(t) - 1, dtype=bool)
    steps[np.cumsum(lengths)[:-1] - 1] = False
    return _motion_of(course, pieces[0], t, states, np.arange(len(t))), steps


def _motion_of(
    course: Course, piece: Piece, t: np.ndarray, states: np.ndarray, k: np.ndarray
) -> Trajectory:
    """Nodes of pieces of one branch as a motion."""
    scene = scene_in(course.system, piece.branch)
    assert scene is not None
    motion = Trajectory(
        system=scene.system,
        rule=course.rule,
        t=t,
        q=states[:, 0],
        p=states[:, 1],
        h=piece.h,
        k=k,
        u=np.empty((piece.steps, 1, 0)),
        c=all_parameters(course.problem.c, piece.branch),
        functions=steps_again(course.rule),
        sizes=None if piece.every is None else np.diff(t),
        origin=float(t[0]),
    )
    motion.__dict__["v"] = states[:, 2]
    return motion


@dataclass(frozen=True, eq=False)
class BetweenNodes:
    """Dense output of a motion from switch to switch: shorter steps of the branch that begins or
    goes on at the node before.

    Attributes
    ----------
    rule : Rule
    t, q, p : array
        The nodes that were computed, whichever are kept.
    branch : array of int (N + 1,)
        Which of the branches holds from each node on.
    branches : tuple of Branch
    """

    rule: Rule
    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    branch: np.ndarray
    branches: tuple[Branch, ...]

    def to_arrays(self) -> dict[str, np.ndarray]:
        """What a file holds of it."""
        values = np.array([x.values for x in self.branches])
        held = np.zeros(values.shape, dtype=int)
        for row, x in zip(held, self.branches, strict=True):
            row[list(x.sliding)] = 1
        nodes = {"t": self.t, "q": self.q, "p": self.p, "branch": self.branch}
        controls = np.array([x.controls for x in self.branches]).reshape(len(values), -1)
        found = nodes | {"values": values, "held": held, "controls": controls}
        sets = active_sets(self.branches)
        if not sets:
            return found
        touch = np.zeros((len(values), 1 + max(max(x.holding, default=-1) for x in sets)), int)
        for row, active_set in zip(touch, sets, strict=True):
            row[list(active_set.holding)] = HOLDS
            row[list(active_set.contacts)] = SOLVED
        return found | {"contacts": touch}

    def __call__(self, motion: Trajectory, times: np.ndarray) -> Trajectory:
        slack = require_within(motion, times)
        direction = np.sign(motion.h)
        node = np.searchsorted(direction * self.t, direction * times + slack, side="right") - 1
        node = np.clip(node, 0, len(self.t) - 1)
        q, p, ahead = self.q[node], self.p[node], times - self.t[node]
        inside = np.abs(ahead) > node_tolerance(motion) * abs(motion.h)
        for i, branch in enumerate(self.branches):
            some = np.flatnonzero(inside & (self.branch[node] == i))
            if not len(some):
                continue
            scene = scene_in(motion.system, branch)
            assert scene is not None
            c = all_parameters(motion.c, branch)
            kernel, none = kernel_of(scene.system, self.rule), np.empty((len(some), 0))
            ends = steps_of(scene.system, self.rule, kernel, c)
            q[some], p[some] = ends(q[some], p[some], none, self.t[node[some]], ahead[some])
        sets = active_sets(self.branches)
        return replace(
            motion,
            t=times,
            q=q,
            p=p,
            k=node,
            active_sets=tuple(dict.fromkeys(sets)),
            active_set=_places(sets, self.branch[node]),
            sizes=None,
            events=(),
            solution=None,
            closure=None,
            whole=whole_of(motion),
        )


def active_sets(branches: Sequence[Branch]) -> list[ActiveSet]:
    """What holds on each of the branches, where contacts may."""
    return [x.active_set for x in branches if x.active_set is not None]


def _places(sets: Sequence[ActiveSet], branch: np.ndarray) -> np.ndarray | None:
    """Which of the different active sets each of these branches has."""
    known = list(dict.fromkeys(sets))
    return np.array([known.index(x) for x in sets])[branch] if known else None


def between_nodes(system: System, rule: Rule, arrays: dict[str, np.ndarray]) -> BetweenNodes:
    """The dense output that `BetweenNodes.to_arrays` wrote down.

    Raises
    ------
    InputError
        If the arrays are none of this system.
    """
    frozen, n = frozen_scene(system), system.structure.n
    if frozen is None or set(arrays) - {"controls", "contacts"} != NAMES:
        raise InputError("switches are told of that the system does not have")
    t, q, p, branch, values, held = (arrays[x] for x in ("t", "q", "p", "branch", "values", "held"))
    controls = arrays.get("controls", np.empty((len(values), 0)))  # older files have none
    nodes, rows = t.shape[:1], values.shape[:1]
    wanted = [nodes, (*nodes, n), (*nodes, n), nodes, (*rows, frozen.s.numel())]
    wanted.append((*rows, system.structure.controls))
    given = [x.shape for x in (t, q, p, branch, values, controls)]
    if given != wanted or held.shape != values.shape or not len(t) or not len(values):
        raise InputError(f"the switches have shapes {given}; they must be {wanted}")
    if branch.dtype.kind not in "iu" or held.dtype.kind not in "iu":
        raise InputError("the branches of the switches are no whole numbers")
    if not (branch.min() >= 0 and branch.max() < len(values)):
        raise InputError(f"the branches of the switches are not between 0 and {len(values) - 1}")
    if not all(x.dtype.kind == "f" and np.isfinite(x).all() for x in (t, q, p, values, controls)):
        raise InputError("the switches are not finite")
    sliding = [tuple(np.flatnonzero(row).tolist()) for row in held]
    may_hold = slidable(system) if n > 1 else range(frozen.s.numel())  # or rest, see zeno.py
    known = all(j in may_hold for held_ones in sliding for j in held_ones)
    if not known or values[held != 0].any():
        raise InputError("a switch that holds the motion is none that can")
    branches = map(
        Branch,
        map(tuple, values.tolist()),
        sliding,
        map(tuple, controls.tolist()),
        _read_active_sets(system, arrays.get("contacts"), len(values)),
    )
    return BetweenNodes(rule, t, q, p, branch.astype(int), tuple(branches))


def _read_active_sets(
    system: System, touch: np.ndarray | None, count: int
) -> Sequence[ActiveSet | None]:
    """Which contacts hold on each of so many branches."""
    s = system.structure
    if not s.contacts:
        return [None] * count
    if touch is None or touch.shape[0] != count or touch.ndim != 2 or touch.shape[1] > s.contacts:
        raise InputError("the switches do not tell which contacts hold")
    rows = tuple(range(s.constraints))
    solved, held = (
        [tuple(np.flatnonzero(x).tolist()) for x in some] for some in (touch == SOLVED, touch > 0)
    )
    return [ActiveSet(rows, *x) for x in zip(solved, held, strict=True)]


def joined(course: Course, pieces: Sequence[Piece], kernel: Kernel | None) -> Trajectory:
    """All pieces as one motion of the user's scene, with a node at every switch."""
    # at a switch as the motion leaves it
    whole = [*[slice(None, -1)] * (len(pieces) - 1), slice(None)]
    t, states = (
        np.concatenate([x.nodes[i][part] for x, part in zip(pieces, whole, strict=True)])
        for i in range(2)
    )
    branches = tuple(dict.fromkeys(x.branch for x in pieces))
    places = {branch: i for i, branch in enumerate(branches)}
    counts = [len(x.nodes[0]) - 1 for x in pieces]
    each = np.repeat([places[x.branch] for x in pieces], counts)
    acting = np.array([x.branch.controls for x in pieces]).reshape(len(pieces), -1)
    q, p = np.ascontiguousarray(states[:, 0]), np.ascontiguousarray(states[:, 1])
    sets, branch = active_sets(branches), np.append(each, each[-1:])
    steps, ends = len(t) - 1, switching_times(pieces)
    jumps = jumping_times(course, pieces)
    system, rule = course.system, course.rule
    chosen = plan(scene_in(system, pieces[0].branch).system, rule)  # type: ignore[union-attr]
    motion = Trajectory(
        system=system,
        rule=rule,
        t=t,
        q=q,
        p=p,
        h=float(t[-1] - t[0]) / max(steps, 1),
        k=np.arange(steps + 1),
        u=np.repeat(acting, counts, axis=0)[:, None],
        c=course.problem.c,
        functions=steps_again(rule),
        dense_output=BetweenNodes(rule, t, q, p, branch, branches),
        active_sets=tuple(dict.fromkeys(sets)),
        active_set=_places(sets, branch),
        events=tuple(event for x in pieces for event in x.events),
        sizes=np.diff(t),
        origin=float(t[0]),
        stats=MappingProxyType(
            {
                "plan": chosen,
                "backend": "interpreted" if kernel is None else f"native: {kernel.about}",
                "steps": steps,
                "iterations": sum(x.iterations for x in pieces),
                "residual": max(x.residual for x in pieces),
                "switches": len(ends),
                "switches_by_motion": int((~np.isin(ends, course.timetable.times)).sum()),
                "jumps_by_motion": int((~np.isin(jumps, course.timetable.times)).sum()),
                "pieces_unwritten": sum(unwritten(course, x) for x in pieces),
                "interrupted": False,
            }
        ),
    )
    motion.__dict__["v"] = np.ascontiguousarray(states[:, 2])
    return motion


def nodes_apart(one: Sequence[Piece], other: Sequence[Piece]) -> np.ndarray | None:
    """Differences (M, n) of two runs from switch to switch at the nodes that both have, at the
    same time to first order; None where they pass other branches.
    """
    if [x.branch for x in one] != [x.branch for x in other]:
        return None
    steps, lengths = (
        np.array([[of(x) for x in pieces] for pieces in (one, other)])
        for of in (lambda x: x.steps, lambda x: len(x.t))
    )
    every = np.where(steps[1] % steps[0] == 0, steps[1] // steps[0], 0)
    count = np.minimum(lengths[0] - 1, (lengths[1] - 2) // np.maximum(every, 1) + 1)
    count[every == 0] = 0
    which = np.repeat(np.arange(len(count)), count)  # piece of each node that both have
    node = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    ends = np.cumsum(lengths, axis=1)
    i, j = (ends - lengths)[:, which] + np.stack([node, node * every[which]])
    i, j = np.append(i, ends[0] - 1), np.append(j, ends[1] - 1)
    (ta, a), (tb, b) = (
        (np.concatenate([x.t for x in pieces]), np.concatenate([x.states for x in pieces]))
        for pieces in (one, other)
    )
    late = (ta[i] - tb[j])[:, None]
    return np.asarray(a[i, 0] - b[j, 0] - late * b[j, 2])
