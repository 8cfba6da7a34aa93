"""Runs in fictitious time until a physical one as numbers alone, without what a trajectory is made
of around each, where nothing is watched on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.kernel import address_of
from varint.codegen.rows import RowFunction, at_many_points, row_function_or_none
from varint.codegen.until import clock_momenta, physical_states, physical_times
from varint.discrete.legendre import velocity_function
from varint.integration.energy_check import energies_along, energy_rows
from varint.integration.problem import InitialValueProblem
from varint.integration.time_transformation.inner_run import (
    BACKENDS,
    asked_until_end,
    called_on,
    until_end,
)
from varint.integration.time_transformation.physical_call import physical_motion
from varint.integration.time_transformation.transformed_run import Prepared, run_prepared
from varint.integration.work_bound import keeps_energy
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System


class PhysicalRun(NamedTuple):
    """Nodes of a run at physical times, (N + 1,) and (N + 1, n), the momenta of the clock there,
    which keep account of the energy where it changes, and what makes the trajectory.
    """

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    account: np.ndarray
    motion: Callable[[], Trajectory]


def physical_run(prepared: Prepared, problem: InitialValueProblem) -> PhysicalRun:
    """`run_prepared`, the same numbers.

    Raises
    ------
    ConvergenceError, InputError
        Those of `run_prepared`.
    KeyboardInterrupt
        By Ctrl-C: no part of a run says what a whole one errs by.
    """
    found = _plain(prepared, problem)
    if found is not None:
        return found
    motion = run_prepared(prepared, problem)
    if motion.stats["interrupted"]:
        raise KeyboardInterrupt
    assert motion.fictitious is not None
    account = motion.fictitious.p[:, -1]
    return PhysicalRun(motion.t, motion.q, motion.p, account, lambda: motion)


def energies_of_nodes(
    system: System, c: np.ndarray, run: PhysicalRun, some: slice
) -> tuple[np.ndarray, np.ndarray]:
    """What stays of the energy at some nodes, and |p·v|."""
    if keeps_energy(system):
        return energies_along(system, run.q[some], run.p[some], run.t[:1], c)
    rows, q, p, t = level_rows(system), run.q[some], run.p[some], run.t[some]
    account = run.account[some, None]
    if rows is None:
        energy, moving = energies_along(system, q, p, t, c)
        return energy + account[:, 0], moving
    none = np.zeros_like(account)
    found = rows.values(c, np.hstack((q, none, none)), np.hstack((p, none, account)), t[:, None])
    return found[0][:, 0], found[1][:, 0]


@per_scene
def level_rows(system: System) -> RowFunction | None:
    """(q, p, t) → the same as data; q and p of all that nodes have where the energy changes."""
    rows = energy_rows(system)
    if rows is None or keeps_energy(system):
        return rows
    n = system.structure.n
    q, p = ca.vertcat(system.q, ca.SX.sym("of the clock", 2)), ca.SX.sym("p", n + 2)
    v = velocity_function(system)(system.q, p[:n], system.t, system.c)
    energy = ca.substitute(system.energy, system.v, v)
    results = [ca.densify(energy + p[-1]), ca.densify(ca.fabs(ca.dot(p[:n], v)))]
    return row_function_or_none("energy", [q, p, system.t], system.c, results)


def velocities(system: System, c: np.ndarray, nodes: PhysicalRun, some: slice) -> np.ndarray:
    """Physical ones at some nodes."""
    return velocity_rows(system)(c, nodes.q[some], nodes.p[some], nodes.t[some, None])[0]


@per_scene
def velocity_rows(system: System) -> Callable[..., list[np.ndarray]]:
    """(c, q, p, t) at many nodes → v."""
    p = ca.SX.sym("p", system.structure.n)
    function = velocity_function(system)
    if not function.is_a("SXFunction"):
        return lambda c, *at: over_columns(function, *at, c)
    v = ca.densify(function(system.q, p, system.t, system.c))
    return at_many_points("velocity", [system.q, p, system.t], system.c, [v])


def _plain(prepared: Prepared, problem: InitialValueProblem) -> PhysicalRun | None:
    """The run by one call of the core; None where it is another one, or comes to no good end."""
    system, scene, chosen, _, t0, total, stop, watches, options, _ = prepared
    began, s = perf_counter(), scene.system.structure
    if total is None or stop or watches or options.progress or options.save_every != 1:
        return None
    if options.backend not in BACKENDS:
        return None
    if s.constraints or s.nonholonomic or s.contacts or s.controls or scene.system.rays:
        return None
    called = called_on(scene.system, scene, chosen.rule)
    x, c, h = np.concatenate((problem.q0, problem.p0)), problem.c, problem.h
    at = address_of(x), address_of(c)
    span, energy = (t0, total), float(c[-2])
    asked = asked_until_end(at, h, problem.level, span, float(problem.steps), energy, 1)
    found = until_end(called, scene.system, asked, options.backend)
    if found is None:
        return None
    seconds = perf_counter() - began
    own, (_, t), account = c[: system.c.numel()], physical_times(found), clock_momenta(found)
    motion = partial(physical_motion, system, called, scene.system, own, (h, c, found, seconds))
    return PhysicalRun(t, *physical_states(found, system.structure.n), account, motion)
