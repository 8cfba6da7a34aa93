"""A chunk of members stepped together: the same functions as one run's, mapped over the members."""

from __future__ import annotations

import numpy as np

from varint.ensembles.chosen import chosen_chunk
from varint.ensembles.chunk import ARRAYS, Chunk, empty_chunk
from varint.ensembles.members import Members, is_plain, momenta, start_of
from varint.errors import ConvergenceError, InputError
from varint.integration.cost import steps_at_once
from varint.integration.interpreted_loop import (
    count_good_nodes,
    is_saved,
    next_block,
    renew_scales,
    residual_of,
    rollout,
    start_states,
)
from varint.integration.problem import controls
from varint.integration.simulate import simulate
from varint.integration.state import RunState
from varint.integration.steppers.stepper import RESIDUAL, state_layout
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_NUMBERS = 4_000_000  # in the states of one block of nodes


def step_chunk(system: System, rule: Rule | None, members: Members, backend: str) -> Chunk:
    """All members of a chunk; interpreted, each is bit for bit what `simulate` makes of it, as are
    those whose steps are chosen, for which no rule need be given.
    """
    if members.asked is not None:
        return chosen_chunk(system, rule, members)
    assert rule is not None  # where steps are given it is the scene's own
    if backend == "compiled":
        return _step_compiled(system, rule, members)
    chunk = empty_chunk(system, members)
    if not is_plain(system):
        _one_by_one(system, rule, members, chunk)
        return chunk
    _together(system, rule, members, chunk)
    failed = np.flatnonzero(chunk.failed >= 0)
    if len(failed):  # alone, a member is taken once more from there with sizes of its own
        alone = members.picked(failed)
        other = empty_chunk(system, alone)
        _one_by_one(system, rule, alone, other)
        _replace(chunk, failed, other)
    return chunk


def _replace(chunk: Chunk, members: np.ndarray, other: Chunk) -> None:
    """Put the motions of another chunk in the place of those of these members."""
    for name in ARRAYS:
        getattr(chunk, name)[members] = getattr(other, name)


def _step_compiled(system: System, rule: Rule, members: Members) -> Chunk:
    """Members in the lanes of vectors; implicit rules do those that fail there again, by
    Newton's method.
    """
    from varint.codegen.members import members_kernel, run_members

    p0, k, kernel = momenta(system, members), members.k, members_kernel(system, rule)
    u = control_tables(system, rule, members)
    u = np.broadcast_to(u, (*u.shape[:2], len(rule.nodes), u.shape[3]))
    q, p, good = run_members(
        kernel,
        members.q0,
        p0,
        members.c,
        u,
        t0=members.t0,
        h=members.h,
        steps=members.steps,
        save_every=members.save_every,
        nodes=len(k),
    )
    failed = np.where(good < len(k), np.inf, -1.0)
    none, unknown = np.zeros(len(members)), np.full(len(members), np.nan)
    chunk = Chunk(members.first, q, p, good, k[good - 1], none, failed, unknown)
    again = np.flatnonzero(failed >= 0)
    if len(again) and not rule.kicks:
        _replace(chunk, again, step_chunk(system, rule, members.picked(again), "interpreted"))
    return chunk


def _one_by_one(system: System, rule: Rule, members: Members, chunk: Chunk) -> None:
    """Scenes whose start or active sets differ from member to member."""
    for i in range(len(members)):
        try:
            motion, failed = run_member(system, rule, members, i), -1.0
        except ConvergenceError as error:
            motion, failed = (
                error.trajectory,
                error.residual if np.isfinite(error.residual) else np.inf,
            )
            chunk.step[i] = error.step
        except InputError as error:
            raise InputError(f"member {members.first + i}: {error}") from None
        at = on_grid(members, motion)
        good = len(at)
        chunk.q[i, :good], chunk.p[i, :good] = motion.q[at], motion.p[at]
        chunk.good[i], chunk.residual[i], chunk.failed[i] = good, motion.stats["residual"], failed
        if failed < 0:
            chunk.step[i] = members.steps


def run_member(system: System, rule: Rule, members: Members, i: int) -> Trajectory:
    """One member alone; flights between impacts are those of the native core."""
    return simulate(
        system,
        rule,
        h=members.h,
        steps=members.steps,
        save_every=members.save_every,
        progress=False,
        backend="auto" if system.structure.contacts else "interpreted",
        **start_of(system, members, i)._asdict(),
    )


def on_grid(members: Members, motion: Trajectory) -> np.ndarray:
    """Indices of the nodes on the grid of all members; nodes of events come after the one of
    their step's start.
    """
    return np.searchsorted(motion.k, members.k[members.k <= motion.k[-1]])


def _together(system: System, rule: Rule, members: Members, chunk: Chunk) -> None:
    layout, every, k = state_layout(system.structure.n), members.save_every, 0
    p0 = momenta(system, members)
    chunk.q[:, 0], chunk.p[:, 0], chunk.good[:] = members.q0, p0, 1
    u = control_tables(system, rule, members)
    h, c = np.array([members.h]), members.c
    typical = np.abs(u).max(axis=(1, 2), initial=0.0)
    at = start_states(
        system, rule, members.q0, p0, _nodes(u, rule, 0, 1), typical, members.t0, h, c
    )
    going, node = np.arange(len(members)), 1
    while k < members.steps and len(going):
        count, apart = next_block(k, members.steps, every, at.largest, steps_at_once(system, rule))
        total = count * apart
        times = members.t0 + members.h * np.arange(k, k + total)
        function = rollout(system, rule, count, apart)
        after = np.empty((len(going), at.x.shape[1]))
        scale, good = np.empty_like(at.scale), np.empty(len(going), dtype=int)
        most = max(MOST_NUMBERS // (count * at.x.shape[1]), 1)
        for a in range(0, len(going), most):
            part = slice(a, a + most)
            rows = going[part]
            controls_now = _nodes(u if len(u) == 1 else u[rows], rule, k, total)
            here = RunState(at.x[part], at.scale[part], at.inertia[part], k, at.largest)
            states = over_columns(function, here.x, controls_now, times, h, c[rows], here.scale)[0]
            states = states.reshape(len(rows), count, -1)
            good[part] = count_good_nodes(states)
            after[part], scale[part] = (
                states[:, -1],
                renew_scales(here, states, abs(members.h) * apart),
            )
            last = k + apart * good[part]
            chunk.step[rows] = last
            solved = np.arange(count) < good[part, None]
            chunk.residual[rows] = np.maximum(
                chunk.residual[rows],
                np.where(solved, states[:, :, RESIDUAL], 0).max(axis=1, initial=0),
            )
            if is_saved(k + total, members.steps, every):
                keep = np.where(solved[:, :, None], states, 0)
                chunk.q[rows, node : node + count] = keep[:, :, layout.q]
                chunk.p[rows, node : node + count] = keep[:, :, layout.p]
                chunk.good[rows] += good[part]
            for j in np.flatnonzero(good[part] < count):
                left = residual_of(states[j, good[part][j]])
                chunk.failed[rows[j]] = left if np.isfinite(left) else np.inf
        node += count if is_saved(k + total, members.steps, every) else 0
        k += total
        on = good == count
        after[:, RESIDUAL] = 0.0
        going = going[on]
        at = RunState(after[on], scale[on], at.inertia[on], k, at.largest)


def control_tables(system: System, rule: Rule, members: Members) -> np.ndarray:
    """Controls (1 or members, steps, r or 1, k)."""
    tables = [None] if members.u is None else members.u
    return np.array([controls(system, rule, u, members.steps) for u in tables])


def _nodes(u: np.ndarray, rule: Rule, k: int, count: int) -> np.ndarray:
    """Controls of `count` steps from step k on at every node, (1 or members, count r k)."""
    part = u[:, k : k + count]
    part = np.broadcast_to(part, (*part.shape[:2], len(rule.nodes), part.shape[3]))
    return np.ascontiguousarray(part).reshape(len(part), -1)
