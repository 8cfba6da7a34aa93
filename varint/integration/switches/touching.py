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
    tied = ties(system, active_set)
    kept = [i for i, (j, _) in enumerate(inner.watched) if j not in tied]
    free = [i for i in range(system.contact.numel()) if i not in active_set.holding]
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
        kinetics=s.kinetics,
        rays=s.rays,
    )


@per_system
def ties(system: System, active_set: ActiveSet) -> dict[int, float]:
    """Switches that stay at zero as long as contacts hold, as velocities across a floor at rest
    do, and the signs that they have where these let go.
    """
    if not active_set.holding:
        return {}
    frozen = frozen_scene(active_set.scene(system))
    assert frozen is not None
    s, first = frozen.system, len(active_set.rows)
    rows = velocity_rows(s)
    outputs = [frozen.sigma, ca.jacobian(frozen.sigma, s.v), rows, ca.jacobian(rows, s.v)]
    function = ca.Function("ties", [s.q, s.v, s.t, s.c], [ca.densify(x) for x in outputs])
    random, seen = np.random.default_rng(1), []
    for _ in range(LOOKS):
        q, v, t = (random.uniform(0.1, 1.0, x.numel()) for x in (s.q, s.v, s.t))
        off, slope = (np.array(x) for x in function(q, v, t, s.default_vector)[2:])
        v = v - (np.linalg.pinv(slope) @ off).ravel()
        sigma, of_sigma = (np.array(x) for x in function(q, v, t, s.default_vector)[:2])
        parts = np.linalg.lstsq(slope.T, of_sigma.T, rcond=None)[0]
        left = np.abs(of_sigma.T - slope.T @ parts).max(axis=0)
        size = np.abs(of_sigma).max(axis=1)
        still = np.abs(sigma.ravel()) <= TIED * size * np.abs(v).max()
        seen.append((size > 0) & (left <= TIED * size) & still)
    signs = parts[first : first + len(active_set.contacts)].sum(axis=0)
    tied = np.all(seen, axis=0) & ~frozen.counts
    return {j: 1.0 if signs[j] >= 0 else -1.0 for j in np.flatnonzero(tied).tolist()}
