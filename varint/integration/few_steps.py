"""Runs of a few steps, with a look at their energy, in one call of the core."""

from __future__ import annotations

from time import perf_counter

from varint.codegen.cache import CompileError
from varint.codegen.few_steps import Entries, entries_of, few_steps
from varint.codegen.kernel import Kernel
from varint.integration.backend import kernel_for
from varint.integration.compiled_loop import POOR, scheme_of
from varint.integration.energy_check import NOTHING, energy_rows
from varint.integration.gears import BY_STAGES, Scheme, gears_with, kernel_after
from varint.integration.plan import Plan
from varint.integration.problem import InitialValueProblem
from varint.integration.trajectories import Run, motion_of
from varint.integration.work_bound import keeps_energy
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System


def motion_of_few_steps(
    system: System, chosen: Plan, problem: InitialValueProblem, began: float, backend: str
) -> tuple[Trajectory, bool] | None:
    """The motion, and whether its energy stays; None where it is no such run, or comes to no good
    end.
    """
    if problem.save_every > 1 or not _is_plain(system):
        return None
    kernel = kernel_for(system, chosen.rule, problem, backend)
    called = None if kernel is None else _called(system, chosen.rule, kernel)
    if kernel is None or called is None:
        return None
    entries, scheme, most = called
    now = perf_counter()
    found = few_steps(
        entries,
        problem.q0,
        problem.p0,
        problem.c,
        t0=problem.t0,
        h=problem.h,
        steps=problem.steps,
        level=problem.level,
    )
    gears = gears_with(system, chosen.rule, scheme, kernel)
    if gears:
        kernel_after(gears, perf_counter() - now, 0.0)
    if found is None or found.iterations > most * problem.steps:
        return None
    run = Run(system, chosen, problem, [], iter(()), kernel, began)
    motion = motion_of(run, found[:4], (int(found.iterations), found.residual))
    return motion, found.change <= NOTHING * found.largest


@per_scene
def _is_plain(system: System) -> bool:
    """Whether nothing but coordinates and momenta makes the motion, and its energy stays."""
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.degenerate
    return keeps_energy(system) and not (held or s.controls or system.rays)


@per_scene
def _called(system: System, rule: Rule, kernel: Kernel) -> tuple[Entries, Scheme, float] | None:
    """What is called, how it steps, and how many iterations a step may take; None where the core
    cannot.
    """
    energy = energy_rows(system)
    if kernel.opening or kernel.note[0] or energy is None:
        return None
    scheme = scheme_of(system, rule)
    try:
        return entries_of(kernel, energy), scheme, POOR if scheme is BY_STAGES else float("inf")
    except CompileError:
        return None
