"""Contacts beside switches: the scene of a branch in which some contacts hold, watched for gaps
that close and contacts that let go.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, velocity_rows
from varint.integration.switches.accelerations import (
    acceleration_and_reactions,
    push_without_force,
    rate_of,
)
from varint.integration.switches.branch import Branch, BranchScene, branch_scene
from varint.integration.switches.frozen import frozen_scene
from varint.scene.memory import per_system
from varint.scene.system import System

# of the forces in play: a contact that pulls by less still holds, for round-off pulls, too
PULL = 1e-12
LOOKS = 3  # states at which it is looked at which switches contacts keep at zero
TIED = 1e-9  # of a gradient and of velocities: what is left of a switch that does


def held_scene(system: System, active_set: ActiveSet | None) -> System:
    """The user's scene with the contacts of an active set as constraints, the others left out."""
    return system if active_set is None else active_set.scene(system)


def scene_in(system: System, branch: Branch) -> BranchScene | None:
    """The scene that moves on a branch, contacts watched where the user's scene has any; None where
    it is not known.
    """
    if branch.active_set is None:
        return branch_scene(system, branch.sliding)
    return _with_contacts(system, branch.sliding, branch.active_set)


@per_system
def _with_contacts(
    system: System, sliding: tuple[int, ...], active_set: ActiveSet
) -> BranchScene | None:
    """A scene that moves while contacts hold, with margins for the gaps of the others and for how
    much these push; without those that contacts keep at zero.
    """
    inner = branch_scene(active_set.scene(system), sliding)
    if inner is None:
        return None
    s = inner.system
    found = acceleration_and_reactions(s, s.force)
    assert found is not None
    a, reactions = found
    inputs = [s.q, s.v, s.t, s.c]
    margin, rate = inner.margins(*inputs)
    tied = ties(system, active_set, sliding)
    kept = [i for i, (j, _) in enumerate(inner.watched) if j not in tied]
    rests = _still_gaps(system, active_set, sliding)
    free = [i for i, still in enumerate(rests) if not (still or i in active_set.holding)]
    first = len(active_set.rows)  # the rows of contacts come before the non-holonomic ones
    pushes = ca.vertcat(
        ca.SX(0, 1), *(reactions[first + i] for i in range(len(active_set.contacts)))
    )
    size = push_without_force(s) + s.force
    slack = PULL * ca.sqrt(ca.sumsqr(size) + ca.sumsqr(pushes) + ca.SX(1e-300))
    more = ca.vertcat(ca.SX(0, 1), *(system.contact[i] for i in free), pushes + slack)
    watched = [inner.watched[i] for i in kept]
    watched += [(-1 - i, 0.0) for i in (*free, *active_set.contacts)]
    own = [ca.vertcat(ca.SX(0, 1), *(x[i] for i in kept)) for x in (margin, rate)]
    outputs = [ca.vertcat(own[0], more), ca.vertcat(own[1], rate_of(s, more, a))]
    margins = ca.Function("margins", inputs, [ca.densify(x) for x in outputs], {"cse": True})
    return BranchScene(s, tuple(watched), margins, inner.ahead, inner.shares, inner.rows)


@per_system
def gap_function(system: System, sliding: tuple[int, ...], active_set: ActiveSet) -> ca.Function:
    """(q, v, t, c) → gaps of all contacts, their rates and second derivatives on a branch."""
    scene = branch_scene(active_set.scene(system), sliding)
    assert scene is not None
    s, gap = scene.system, system.contact
    found = acceleration_and_reactions(s, s.force)
    assert found is not None
    rate = rate_of(s, gap, found[0])
    outputs = [ca.densify(x) for x in (gap, rate, rate_of(s, rate, found[0]))]
    return ca.Function("gaps", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


@per_system
def with_contacts(system: System, sliding: tuple[int, ...], active_set: ActiveSet) -> System:
    """The user's scene with the forces of a branch: what deals with impacts takes it."""
    scene = branch_scene(active_set.scene(system), sliding)
    assert scene is not None
    s = system
    return System(
        s.q,
        s.v,
        scene.system.lagrangian,
        force=ca.sparsify(scene.system.force),
        constraint=s.constraint,
        nonholonomic=s.nonholonomic,
        contact=s.contact,
        restitution=s.bounce,
        params=scene.system.params,
        t=s.t,
        kinetics=scene.system.kinetics,
        rays=s.rays,
    )


@per_system
def ties(system: System, active_set: ActiveSet, sliding: tuple[int, ...] = ()) -> dict[int, float]:
    """Switches that stay at zero as long as contacts and other switches hold, as velocities across
    a floor at rest do, and the signs that they have where these contacts let go.
    """
    frozen = frozen_scene(active_set.scene(system))
    assert frozen is not None
    tied, parts = _kept_at_zero(system, active_set, sliding, frozen.sigma)
    tied[list(sliding)] = False
    tied &= ~frozen.counts
    return {j: 1.0 if parts[j] >= 0 else -1.0 for j in np.flatnonzero(tied).tolist()}


def _still_gaps(system: System, active_set: ActiveSet, sliding: tuple[int, ...]) -> np.ndarray:
    """Which gaps stay as they are as long as contacts and switches hold."""
    s = system
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    return _kept_at_zero(system, active_set, sliding, rate)[0]


def _kept_at_zero(
    system: System, active_set: ActiveSet, sliding: tuple[int, ...], x: ca.SX
) -> tuple[np.ndarray, np.ndarray]:
    """Which expressions of velocities are zero wherever contacts and switches hold, as far as some
    random states tell, and how much of the contacts' rates is in them.
    """
    frozen = frozen_scene(active_set.scene(system))
    assert frozen is not None
    s, first = frozen.system, len(active_set.rows)
    rows = ca.vertcat(velocity_rows(s), *(frozen.sigma[j] for j in sliding))
    if not rows.numel():
        return np.zeros(x.numel(), dtype=bool), np.zeros(x.numel())
    outputs = [x, ca.jacobian(x, s.v), rows, ca.jacobian(rows, s.v)]
    function = ca.Function("kept", [s.q, s.v, s.t, s.c], [ca.densify(y) for y in outputs])
    random, seen = np.random.default_rng(1), []
    for _ in range(LOOKS):
        q, v, t = (random.uniform(0.1, 1.0, y.numel()) for y in (s.q, s.v, s.t))
        off, slope = (np.array(y) for y in function(q, v, t, s.default_vector)[2:])
        fast = np.abs(v).max()
        v = v - (np.linalg.pinv(slope) @ off).ravel()
        value, of_x = (np.array(y) for y in function(q, v, t, s.default_vector)[:2])
        parts = np.linalg.lstsq(slope.T, of_x.T, rcond=None)[0]
        left = np.abs(of_x.T - slope.T @ parts).max(axis=0)
        size = np.abs(of_x).max(axis=1)
        still = np.abs(value.ravel()) <= TIED * size * fast
        seen.append((size > 0) & (left <= TIED * size) & still)
    return np.all(seen, axis=0), parts[first : first + len(active_set.contacts)].sum(axis=0)
