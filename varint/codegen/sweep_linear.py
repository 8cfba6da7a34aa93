"""Loops that carry derivatives over the steps of a linear scene, many at once in vectors."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.routines import routines
from varint.codegen.sweep import SweepKernel, SweepScheme, compiled_sweep, sweep_scheme
from varint.codegen.sweep_explicit import steps_at_once
from varint.discrete.step_map import StepMap, step_map
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

MOST_UNKNOWNS = 128  # a product with a full matrix is cheaper than a solve in a band


@per_scene
def has_linear_sweep(system: System, rule: Rule) -> bool:
    """Whether a step is an affine map of so few unknowns that full matrices are worth it, which are
    the same all the time.
    """
    if not system.structure.linear or (system.structure.explicit and rule.kicks):
        return False
    s = step_map(system, rule)
    if not 0 < s.y.numel() <= MOST_UNKNOWNS:
        return False
    at = ca.vertcat(s.y, s.state, s.t, s.u)
    return not ca.depends_on(_slopes(system, rule), at)


@kernel_per_system
def linear_sweep_kernel(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The compiled loops; `density` as in `sweep_kernel`.

    Raises
    ------
    NotCompilable
        If the scene or the rule is not of this kind, or a step has too many operations.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    scheme = linear_sweep_scheme(system, rule, density)
    return compiled_sweep(scheme, steps_at_once(), "sweep_linear.c")


@kernel_per_system
def linear_sweep_scheme(system: System, rule: Rule, density: str | None = None) -> SweepScheme:
    """Of c/sweep_linear.c: what is outside as in c/sweep.c; raises NotCompilable."""
    if not has_linear_sweep(system, rule):
        raise NotCompilable("one map for all steps needs a linear scene of few unknowns")
    any_scene, s = sweep_scheme(system, rule, density), step_map(system, rule)
    slopes = _slopes(system, rule)
    rows, columns = map(np.array, slopes.sparsity().get_triplet())
    shared = {name: any_scene.functions[name] for name in ("outside", "pull", "density")}
    expressions = {
        "matrices": ([], [ca.vertcat(*slopes.nonzeros())]),
        "rest": ([s.q, s.p, s.t, s.u], [_rest(s)]),
    }
    names = ("N", "NU", "CONTROLS", "Y", "C", "E", "LOSS", "FE", "GE")
    return SweepScheme(
        routines(ca.vertcat(s.c, s.h), expressions) | shared,
        {name: any_scene.counts[name] for name in names} | {"S": len(rows)},
        {},
        {f"{x}_{end}": any_scene.places[f"{x}_{end}"] for x in ("FE", "GE") for end in _ENDS}
        | {"S_ROW": rows, "S_COLUMN": columns},
        {},
    )


_ENDS = ("ROW", "COLUMN")


def _rest(s: StepMap) -> ca.SX:
    """F where the unknowns are zero."""
    return ca.densify(ca.substitute(s.left, s.y, ca.SX.zeros(s.y.shape)))


@per_system
def _slopes(system: System, rule: Rule) -> ca.SX:
    """[F_y F_x; G_y G_x]"""
    s = step_map(system, rule)
    return ca.jacobian(ca.vertcat(s.left, s.after), ca.vertcat(s.y, s.state))
