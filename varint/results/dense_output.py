"""Between the nodes of a trajectory: shorter steps of the same rule, and the controls that act
in them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

from varint.discrete.linear_flow import has_powers, powers
from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.numerics.limits import check_steps_again
from varint.numerics.linear_maps import moved
from varint.results.records import changed, require_motion, require_order, whole_of
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_values
from varint.scene.rays import with_unit_rays
from varint.scene.system import System

ROUNDING = 8 * float(np.finfo(float).eps)  # of t0 + k h
FAR = 64  # whole steps from a node that a scene with dampers takes at once, where it is linear


def node_tolerance(motion: Trajectory) -> float:
    """Of a step: a time this close to a node is the node. It is the round-off of the times
    themselves.
    """
    first, last, size = abs(motion.t.item(0)), abs(motion.t.item(-1)), abs(motion.h)
    return ROUNDING * max(first, last, size) / size


def nodes_at(motion: Trajectory, times: np.ndarray, side: str) -> Trajectory:
    """The motion with nodes at these times; see `states_at`."""
    q, p, k, active_set = states_at(motion, times, side)
    found = dict(t=times, q=q, p=p, k=k, active_set=active_set, whole=whole_of(motion))
    return changed(motion, **found, events=(), solution=None, closure=None)


def states_at(
    motion: Trajectory, times: np.ndarray, side: str = "after"
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """q, p, whole steps before, and active set at any times of the motion, by steps from the node
    at or before each; for the side "before" from the one before it, where there is one.

    Raises
    ------
    InputError
        If a time lies outside the trajectory.
    """
    slack = require_within(motion, times)
    if motion.whole is not None:
        return states_at(motion.whole, times, side)
    at_once = motion.functions.at_once if side == "after" else None
    if at_once is not None and (found := at_once(motion, times)) is not None:
        q, p, k = found
        return q, p, k, None
    slack = slack if side == "after" else -slack
    if motion.h > 0:
        node = motion.t.searchsorted(times + slack, side="right") - 1
    else:
        node = (-motion.t).searchsorted(slack - times, side="right") - 1
    np.maximum(node, 0, out=node)
    states = [motion.q[node], motion.p[node], motion.k[node]]
    begin = motion.t[node]
    ahead = times - begin
    if not (
        _within_a_step(motion, begin, ahead, states) or _by_powers(motion, node, ahead, states)
    ):
        _require_steps(motion, node, ahead)
        for _ in steps_ahead(motion, node, ahead, states):
            continue
    q, p = with_unit_rays(motion.system.rays, *states[:2])
    return q, p, states[2], None if motion.active_set is None else motion.active_set[node]


def require_within(motion: Trajectory, times: np.ndarray) -> float:
    """Refuse times before the first and after the last node; the round-off allowed for."""
    first, last = motion.t.item(0), motion.t.item(-1)
    low, high = min(first, last), max(first, last)
    slack = node_tolerance(motion) * abs(motion.h)
    if len(times) and not (times.min() >= low - slack and times.max() <= high + slack):
        raise InputError(f"times must lie between {low:g} and {high:g}, got {times}")
    return slack


def _within_a_step(
    motion: Trajectory, begin: np.ndarray, ahead: np.ndarray, states: list[np.ndarray]
) -> bool:
    """`steps_ahead` in half the time where all times are less than a whole step ahead of their
    nodes, no controls act and always the same rows hold; False, and nothing done, elsewhere.
    """
    if motion.active_set is not None or motion.sizes is not None:
        return False
    if motion.system.structure.controls or not len(ahead):
        return False
    part, close = ahead / motion.h, node_tolerance(motion)
    if not (part.min() > -1 and part.max() <= 1 - close):
        return False
    going = part > close
    count = np.count_nonzero(going)
    if not count:
        return True
    some = slice(None) if count == len(going) else going
    q, p, _ = states
    none = np.empty((count, 0))
    ends = motion.functions.ends(motion.system, motion.c)
    q[some], p[some] = ends(q[some], p[some], none, begin[some], ahead[some])
    return True


def _by_powers(
    motion: Trajectory, node: np.ndarray, ahead: np.ndarray, states: list[np.ndarray]
) -> bool:
    """`steps_ahead` of scenes whose steps are one map, any number of them at once, and then the
    shorter one; False, and nothing done, elsewhere, and where nodes are close.
    """
    whole = np.floor(ahead / motion.h + node_tolerance(motion))
    most, s = whole.max(initial=0.0), motion.system.structure
    if most < FAR or motion.sizes is not None or not s.force_on_velocity:
        return False
    if motion.dense_output is not None or not has_powers(motion.system, motion.rule):
        return False
    _require_steps(motion, node, ahead)
    map_of = powers(motion.system, motion.rule, motion.c, motion.h)
    if map_of is None:
        return False
    (q, p, k), steps, far = states, whole.astype(np.int64), whole > 0
    changes = map_of.up_to(int(most).bit_length())
    q[far], p[far] = map_of.states(moved(changes, map_of.within(q[far], p[far]), steps[far]))
    k += steps
    rest = ahead - whole * motion.h
    return _within_a_step(motion, motion.t[node] + whole * motion.h, rest, states)


def _require_steps(motion: Trajectory, node: np.ndarray, ahead: np.ndarray) -> None:
    """Refuse nodes that lie further apart than the steps between them reach."""
    size = abs(motion.h) if motion.sizes is None else np.abs(motion.sizes).max()
    after = np.minimum(node + 1, len(motion) - 1)
    steps = motion.k[after] - motion.k[node] + 2  # parts of the first and last one
    if (far := np.abs(ahead) > steps * size).any():
        raise InputError(
            f"the time {motion.t[node[far]][0] + ahead[far][0]:g} is further from its node than "
            f"{steps[far][0]} steps of {size:g}: the motion's times do not fit its steps"
        )


def steps_ahead(
    motion: Trajectory, node: np.ndarray, ahead: np.ndarray, states: list[np.ndarray] | None = None
) -> Iterator[tuple[np.ndarray, System, tuple[np.ndarray, ...]]]:
    """From each node ahead by a time: whole steps, then a shorter one, round after round.

    Yields which of them step now, the scene that holds for them, and their arguments of its step
    function. `states` (q, p, k at the nodes) are advanced in place.
    """
    q, p, k = states or [motion.q[node], motion.p[node], motion.k[node]]
    t, active_set, close = (
        motion.t[node],
        None if motion.active_set is None else motion.active_set[node],
        node_tolerance(motion),
    )
    first, done = k.copy(), np.zeros(len(t))
    while True:
        left, full = ahead - done, _sizes(motion, k)
        part = left / full
        going = part > close
        if not going.any():
            return
        whole = going & (part > 1 - close)
        size = np.where(whole, full, left)
        for i, held in enumerate((None,) if active_set is None else motion.active_sets):
            active = going if active_set is None else going & (active_set == i)
            if not active.any():
                continue
            scene = motion.system if held is None else held.scene(motion.system)
            begin, each = (t + done)[active], size[active]
            u = step_controls(motion, k[active], (size / full)[active], begin)
            start = q[active], p[active], u
            yield active, scene, (*start, motion.c, begin[:, None], each[:, None])
            ends = motion.functions.ends(scene, motion.c)
            q[active], p[active] = ends(*start, begin, each)
        if not whole.any():  # these were the last parts
            return
        k += whole
        done = np.where(
            whole, (k - first) * motion.h if motion.sizes is None else done + size, done
        )
        done = np.where(going & ~whole, ahead, done)


def sums_between(motion: Trajectory, integrand: Callable[[System], ca.Function]) -> np.ndarray:
    """Sums over the steps between nodes; see `Trajectory.sums`."""
    require_motion(motion, "steps from its nodes do not know of them, and have no sums")
    require_order(motion)
    if motion.whole is not None:
        every, own = with_all_nodes(motion)
        before = np.cumsum(sums_between(every, integrand), axis=0)
        before = np.concatenate((np.zeros((1, before.shape[1])), before))
        return np.diff(before[own], axis=0)
    check_steps_again(int(motion.k[-1] - motion.k[0]) - len(motion), "sums such as the action")
    total = np.zeros((len(motion) - 1, 1))
    for active, scene, arguments in steps_ahead(
        motion, np.arange(len(motion) - 1), np.diff(motion.t)
    ):
        # a scene with contacts has no step of its own
        values = over_columns(integrand(scene), *arguments)[0]
        if total.shape[1] != values.shape[1]:
            total = np.zeros((len(total), values.shape[1]))
        total[active] += values
    return total


def with_all_nodes(motion: Trajectory) -> tuple[Trajectory, np.ndarray]:
    """A motion with those nodes of the whole one besides that lie between its own, and which of
    them are its own.
    """
    whole, direction = motion.whole or motion, 1.0 if motion.h > 0 else -1.0
    slack = node_tolerance(motion) * abs(motion.h)
    own, others = direction * motion.t, direction * whole.t
    behind = np.searchsorted(own, others)
    near = np.abs(others[:, None] - own[np.clip(behind[:, None] - [0, 1], 0, len(own) - 1)])
    between = (behind > 0) & (behind < len(own)) & (near > slack).all(axis=1)
    kept = np.flatnonzero(between)
    order = np.argsort(np.concatenate((own, others[kept])), kind="stable")
    names = [x for x in ("t", "q", "p", "k", "active_set") if getattr(whole, x) is not None]
    own_nodes = {x: getattr(motion, x) for x in names}
    if whole.sizes is not None:  # all of its steps have nodes
        begun = np.searchsorted(others, own + slack, side="right") - 1
        own_nodes["k"] = whole.k[np.clip(begun, 0, len(whole) - 1)]
    found = {x: np.concatenate((own_nodes[x], getattr(whole, x)[kept]))[order] for x in names}
    return changed(whole, **found), np.flatnonzero(order < len(own))


def _sizes(motion: Trajectory, k: np.ndarray) -> np.ndarray:
    """Sizes of the steps k."""
    sizes = motion.sizes
    return np.full(len(k), motion.h) if sizes is None else sizes[np.clip(k, 0, len(sizes) - 1)]


def step_controls(
    motion: Trajectory, steps: np.ndarray, fraction: np.ndarray, times: np.ndarray | None = None
) -> np.ndarray:
    """Controls at the rule's nodes of parts of steps, (len(steps), r·k), that begin at `times`
    or with the step.
    """
    count, r = len(steps), len(motion.rule.nodes)
    if not motion.system.structure.controls:
        return np.empty((count, 0))
    u = motion.u[np.clip(steps, 0, len(motion.u) - 1)]
    if u.shape[1] == 1:
        return np.repeat(u, r, axis=1).reshape(count, -1)
    nodes = np.array(motion.rule.nodes)
    short = fraction < 1 - node_tolerance(motion)
    begin = _elapsed(motion, steps, times)[short, None]
    tables = lagrange_values(nodes, (begin + nodes * fraction[short, None]).ravel()).reshape(
        -1, r, r
    )
    u = u.copy()
    u[short] = tables @ u[short]
    return u.reshape(count, -1)


def _elapsed(motion: Trajectory, steps: np.ndarray, times: np.ndarray | None) -> np.ndarray:
    """How much of the steps has passed at the times: none at the nodes of the grid, but at those
    of events.
    """
    if times is None or motion.origin is None:
        return np.zeros(len(steps))
    if (sizes := motion.sizes) is not None:
        steps = np.clip(steps, 0, len(sizes) - 1)
        begin = motion.origin + np.append(0.0, np.cumsum(sizes))[steps]
        return np.clip((times - begin) / sizes[steps], 0.0, 1.0)
    return np.clip((times - motion.origin) / motion.h - steps, 0.0, 1.0)


def controls_at_nodes(motion: Trajectory) -> np.ndarray:
    """Controls at every node: those of the step that begins there; at the last node of the step
    that ends there.
    """
    if not motion.system.structure.controls:
        return np.empty((len(motion), 0))
    last = motion.k >= len(motion.u)
    u = motion.u[np.minimum(motion.k, len(motion.u) - 1)]
    if u.shape[1] == 1:
        return u[:, 0]
    within = np.where(last, 1.0, _elapsed(motion, motion.k, motion.t))
    return np.einsum("ki,kij->kj", lagrange_values(np.array(motion.rule.nodes), within), u)
