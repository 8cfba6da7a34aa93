"""Loops that carry derivatives over the steps of an explicit rule, many at once in vectors."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.codegen.cache import vector_length
from varint.codegen.dependence import needed
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.routines import routines
from varint.codegen.sweep import SweepKernel, SweepScheme, compiled_sweep, numbers_of, sweep_scheme
from varint.discrete.kick_drift import drift_function
from varint.discrete.step_map import StepMap, running, step_map
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@kernel_per_system
def has_explicit_sweep(system: System, rule: Rule) -> bool:
    """Whether Jacobians of many steps at once are the way: where they have no more numbers than the
    product of one of them with an adjoint has operations.
    """
    if not (system.structure.explicit and rule.kicks):
        return False
    numbers = sum(slope.nnz() for slope in _slopes(system, rule).values())
    return numbers <= len(needed(sweep_scheme(system, rule).functions["pull"].graph))


@kernel_per_system
def explicit_sweep_kernel(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The compiled loops; `density` as in `sweep_kernel`.

    Raises
    ------
    NotCompilable
        If the scene or the rule is not of this kind, or a step has too many operations.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    scheme = explicit_sweep_scheme(system, rule, density)
    return compiled_sweep(scheme, steps_at_once(), "sweep_explicit.c")


def steps_at_once() -> dict[str, int]:
    """As many as a vector has numbers."""
    return {"LANES": vector_length()}


@kernel_per_system
def explicit_sweep_scheme(system: System, rule: Rule, density: str | None = None) -> SweepScheme:
    """Of c/sweep_explicit.c; raises NotCompilable."""
    if not has_explicit_sweep(system, rule):
        raise NotCompilable("many steps at once need an explicit rule and sparse Jacobians")
    s, slopes = step_map(system, rule), _slopes(system, rule)
    inputs, none = s.inputs[1:], ca.SX(0, 1)
    kq, dp, ke, de = (slopes[name].nz[:] for name in ("KQ", "DP", "KE", "DE"))
    of_loss = [none] * 3
    if density is not None:
        loss = running(s, ca.Function.deserialize(density))
        of_loss = [loss, ca.gradient(loss, s.state), ca.gradient(loss, s.outside)]
    expressions = {
        "part_of": (inputs, [kq, dp, ke, de, s.after]),
        "density": (inputs, of_loss),
    }
    counts = numbers_of(system, s) | {"LOSS": int(density is not None), "SHARED": _shared(s)}
    places: dict[str, np.ndarray] = {"DRIFTS": (s.parts[:, 1] != 0).astype(int)}
    for name, slope in slopes.items():
        begin, rows = slope.sparsity().get_ccs()
        places |= {f"{name}_ROW": np.array(rows, int), f"{name}_BEGIN": np.array(begin, int)}
    for name in ("KE", "DE"):
        places[f"{name}_COLUMN"] = np.array(slopes[name].sparsity().get_triplet()[1], int)
    return SweepScheme(
        routines(ca.vertcat(s.c, s.h), expressions),
        counts | {name: slope.nnz() for name, slope in slopes.items()},
        {},
        places,
        {"PART_TABLE": s.parts},
    )


def _shared(s: StepMap) -> int:
    """Whether the last kick of a step is the first of the next, which nothing but its own place in
    time could tell from it.
    """
    of_time = ca.depends_on(s.after[s.q.numel() :], ca.vertcat(s.t, s.u))
    first, last = s.parts[0], s.parts[-1]
    return int(len(s.parts) > 1 and not of_time and first[0] == last[0] and not last[1])


@per_system
def _slopes(system: System, rule: Rule) -> dict[str, ca.SX]:
    """Derivatives of a part's kick by q and e, and of its drift by the momentum behind the kick and
    by e.
    """
    s, n = step_map(system, rule), system.structure.n
    gained, along, p = s.after[n:], s.part[1], ca.SX.sym("p", n)
    drift = along * s.h * drift_function(system)(p, s.c)
    by_outside = ca.substitute(ca.jacobian(drift, s.outside), p, gained)
    return {
        "KQ": ca.jacobian(gained, s.q),
        "DP": ca.jacobian(drift, p),
        "KE": ca.jacobian(gained, s.outside),
        "DE": by_outside,
    }
