"""Runs of scenes whose motion is linear, x' = A x + b with constant A, by Gauss rules: a step is
one map, which is made once, and all nodes are its powers where b is constant and energy is kept.
"""

from __future__ import annotations

from time import perf_counter

import casadi as ca
import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.cache import CompileError
from varint.codegen.driven import (
    FEW_COORDINATES,
    has_driven_map,
    is_driven,
    native_driven,
)
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel, LoopResult
from varint.discrete.legendre import velocity_function
from varint.discrete.linear_flow import is_gauss, moves_linearly
from varint.integration.problem import InitialValueProblem
from varint.integration.rule_choice import steps_of_map
from varint.integration.second_looks import has_steps
from varint.integration.two_runs import SAME_STEP, shows_its_error
from varint.numerics.arrays import call
from varint.numerics.linear_maps import gauss_change, orbit
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

MOST_STEPS = 2**17  # beyond, loops that watch the run on its way
# times the round-off of all steps, which the wanted error is, or they are solved one by one
FAR_ABOVE = 4.0
# of the motion, times the square of the steps, where a map is driven: what it makes of something
# that drifts adds up, all the way
REPEATED = 5e-17
# the rule of such runs, whose order costs nothing, and radians from which they take less time than
# steps that are solved one by one
MAPPED, TURNS = gauss(8), 60.0
TOLD = "powers of one linear map a step"


@per_scene
def is_one_map(system: System, rule: Rule) -> bool:
    """Whether steps of the rule are the same linear map, all along."""
    s = system.structure
    return s.autonomous and not s.forced and moves_linearly(system) and is_gauss(rule)


@per_scene
def runs_driven(system: System) -> bool:
    """Whether energies tell nothing of its runs, whose steps are one map of the motion, and one of
    what drives it.
    """
    if system.structure.controls or shows_its_error(system) or has_steps(system):
        return False
    return is_driven(system)


def _is_controlled(system: System) -> bool:
    """Whether controls drive its motion so."""
    return system.structure.controls > 0 and not has_steps(system) and is_driven(system)


@per_scene
def driven_kernel(system: System, rule: Rule) -> Kernel | None:
    """The loop of such runs, and of those of one map alone; None where there is none."""
    same = runs_driven(system) or is_one_map(system, rule) or _is_controlled(system)
    if not (same and has_driven_map(system, rule)):
        return None
    try:
        return native_driven(system, rule)
    except (NotCompilable, CompileError):
        return None


@per_scene
def map_alone(system: System, rule: Rule) -> Kernel | None:
    """The same of scenes of many coordinates: nothing that solves their steps need be built before
    it is wanted.
    """
    return driven_kernel(system, rule) if system.structure.n > FEW_COORDINATES else None


def first_of_map(rule: Rule, radians: float, tol: float) -> int | None:
    """Steps to begin with where they are one map; None where they are to be solved one by one."""
    few = steps_of_map(rule, radians, tol)
    return few if few < MOST_STEPS and tol > FAR_ABOVE * SAME_STEP * few else None


def nodes_by_map(system: System, rule: Rule, problem: InitialValueProblem) -> LoopResult | None:
    """The run as a loop would find it, which carries nothing along and looks for no velocities;
    None where it is not finite, or products are so large that libraries divide them.
    """
    if system.structure.n > FEW_COORDINATES:
        return None
    began, n, steps, h = perf_counter(), len(problem.q0), problem.steps, problem.h
    slopes, rates, mass = (
        x.reshape(shape, order="F")
        for x, shape in zip(
            call(_flow(system), problem.c), ((2 * n, 2 * n), (2 * n,), (n,)), strict=True
        )
    )
    # momenta in the unit of coordinates: h p/m, and the constant rates times one
    unit = np.concatenate((np.ones(n), np.abs(mass) / abs(h), [1.0]))
    a = np.zeros((2 * n + 1, 2 * n + 1))
    a[:-1, :-1], a[:-1, -1] = h * slopes, h * rates
    x = np.concatenate((problem.q0, problem.p0, [1.0]))
    try:
        change = gauss_change(a * unit / unit[:, None], len(rule.nodes))
    except np.linalg.LinAlgError:
        return None
    found = orbit(change, x / unit, steps)[:, :-1] * unit[:-1]
    found[0] = x[:-1]
    if not np.isfinite(found[-1]).all():
        return None
    rows, none = np.full((steps + 1, 3, n), np.nan), np.empty(0)
    rows[:, :2] = found.reshape(-1, 2, n)
    told = DONE, steps, 0, 0, 0.0, 0.0, 0.0
    return LoopResult(rows, *told, none, rows[-1].ravel(), none, perf_counter() - began)


@per_scene
def _flow(system: System) -> ca.Function:
    """c → A, b and the diagonal of the mass matrix, of q' and p' by x = (q, p)."""
    s, n = system, system.structure.n
    x, c = ca.SX.sym("x", 2 * n), ca.SX.sym("c", s.c.numel())
    v = velocity_function(s)(x[:n], x[n:], ca.SX.zeros(1), c)
    push = ca.Function("push", [s.q, s.v, s.c], [ca.gradient(s.lagrangian, s.q)])
    rate = ca.vertcat(v, push(x[:n], v, c))
    a = ca.jacobian(rate, x)
    b = ca.substitute(rate, x, ca.SX.zeros(2 * n))
    mass = ca.substitute(ca.diag(s.mass_matrix), s.c, c)
    return ca.Function("flow", [c], [ca.densify(a), ca.densify(b), ca.densify(mass)])
