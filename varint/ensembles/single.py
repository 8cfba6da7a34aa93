"""One member of an ensemble as a trajectory, and its error if it failed."""

from __future__ import annotations

import warnings
from types import MappingProxyType

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.ensembles.batch import on_grid, run_member
from varint.ensembles.chosen import chosen_member, chosen_nodes, run_chosen
from varint.ensembles.chunk import Chunk
from varint.ensembles.members import Members, options_of, start_of
from varint.errors import ConvergenceError
from varint.integration.failures import failure
from varint.integration.many_steps import steps_again
from varint.integration.plan import plan
from varint.integration.problem import controls, initial_value_problem
from varint.integration.trajectories import with_stats
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System


def member_of(
    system: System, rule: Rule | None, members: Members, chunk: Chunk, j: int
) -> Trajectory:
    """The trajectory of member j of a chunk; one with contacts, or whose steps are chosen, is run
    again.
    """
    i, s = chunk.first + j, system.structure
    if members.asked is not None:
        return chosen_member(system, rule, members, i)
    assert rule is not None  # where steps are given it is the scene's own
    if s.contacts:
        return with_stats(_again(system, rule, members, i)[0], member=i)
    good = int(chunk.good[j])
    active_sets: tuple[ActiveSet, ...] = ()
    active_set = None
    if s.constraints or s.nonholonomic:
        with warnings.catch_warnings():  # of redundant rows: said when the ensemble was made
            warnings.simplefilter("ignore", UserWarning)
            start, options = start_of(system, members, i), options_of(members)
            held = initial_value_problem(system, rule, start, options).active_set
        if held is not None and held.scene(system) is not system:
            active_sets, active_set = (held,), np.zeros(good, dtype=int)
    stats = {
        "plan": _plan_in_words(system, rule),
        "steps": int(chunk.step[j]),
        "residual": float(chunk.residual[j]),
        "member": i,
    }
    return Trajectory(
        system=system,
        rule=rule,
        t=members.t[:good],
        q=chunk.q[j, :good],
        p=chunk.p[j, :good],
        h=members.h,
        origin=members.t0,
        k=members.k[:good],
        u=controls(system, rule, members.of("u", i), members.steps),
        c=members.of("c", i),
        functions=steps_again(rule),
        active_sets=active_sets,
        active_set=active_set,
        stats=MappingProxyType(stats),
    )


@per_scene
def _plan_in_words(system: System, rule: Rule) -> str:
    return str(plan(system, rule))


def nodes_of(
    system: System, rule: Rule | None, members: Members, chunk: Chunk, j: int
) -> tuple[Trajectory | None, np.ndarray]:
    """A motion of member j of a chunk that has the nodes of all members, and their indices in it;
    None where it has none of them.
    """
    if members.asked is not None:
        nodes = chosen_nodes(system, rule, members, chunk.first + j)
        return nodes, np.arange(chunk.good[j])
    motion = member_of(system, rule, members, chunk, j)
    return motion, on_grid(members, motion)


def error_of(
    system: System, rule: Rule | None, members: Members, chunk: Chunk, j: int
) -> ConvergenceError:
    """The error of member j of a chunk, which failed, as `simulate` raises it."""
    alone = members.asked is not None or system.structure.contacts
    if alone and (error := _again(system, rule, members, chunk.first + j)[1]):
        return error
    left, motion = float(chunk.failed[j]), member_of(system, rule, members, chunk, j)
    left = left if np.isfinite(left) else float("nan")
    return failure(motion, int(chunk.step[j]), left, "raise")


def _again(
    system: System, rule: Rule | None, members: Members, i: int
) -> tuple[Trajectory, ConvergenceError | None]:
    """A member run once more, quietly, and its error if it failed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            if rule is None or members.asked is not None:
                return run_chosen(system, rule, members, i), None
            return run_member(system, rule, members, i), None
        except ConvergenceError as error:
            return error.trajectory, error
