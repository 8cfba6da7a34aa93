"""Compiled loops that carry derivatives over the steps of a Gauss rule, all stages at once in
vectors.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.codegen.gauss import gauss_form, lanes_for
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.mechanics import force, velocity
from varint.codegen.routines import MOST_OPERATIONS, routines
from varint.codegen.sweep import LEAST_SPEED, SweepKernel, SweepScheme, compiled_sweep
from varint.codegen.tableau import gauss_tableau
from varint.discrete.legendre import full_inertia
from varint.numerics.limits import FIXED_POINT_ITERATIONS
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

# nodes around a step whose q and v tell its stages, of few stages and of more: these are nearer to
# the path through the nodes
WINDOWS = 4, 8
FEW_STAGES = 4
# relative: stages that miss their equations by this much have slopes that err by no more, in a step
# of which they change the state by its angle only
CLOSE = 1e-13
CONTINUED_DEGREE = (
    6  # of the adjoints of a step continued over the one before; more amplifies errors
)
MORE = 3  # nodes behind that step which tell the adjoints, too
FEWEST = 3


@per_scene
def has_stage_sweep(system: System, rule: Rule) -> bool:
    """Whether the stages' iteration is the way to derivatives: that of nonstiff scenes."""
    stages = len(rule.nodes)
    return (
        rule == gauss(min(stages, MOST_STAGES))
        and bool(gauss_form(system))
        and system.structure.quadratic_kinetic
        and not system.structure.linear
        and not full_inertia(system)
        and stages * system.structure.n >= FEWEST
    )


@kernel_per_system
def stage_sweep_kernel(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The compiled loops; `density` as in `sweep_kernel`.

    Raises
    ------
    NotCompilable
        If the scene or the rule is not of this kind, or a stage has too many operations.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    return compiled_sweep(
        stage_sweep_scheme(system, rule, density), shape_for(len(rule.nodes)), "sweep_gauss.c"
    )


def shape_for(stages: int) -> dict[str, int]:
    """Numbers in a vector, and vectors for so many stages."""
    lanes, padded = lanes_for(stages)
    return {"LANES": lanes, "STRIDE": padded // lanes}


@kernel_per_system
def stage_sweep_scheme(system: System, rule: Rule, density: str | None = None) -> SweepScheme:
    """Of c/sweep_gauss.c; raises NotCompilable."""
    if not has_stage_sweep(system, rule):
        raise NotCompilable("the stages' iteration needs a Gauss rule and a regular scene")
    s, stages = system, len(rule.nodes)
    _, padded = lanes_for(stages)
    p = ca.SX.sym("p", s.structure.n)
    speed = velocity(s, p)
    rates = ca.densify(ca.vertcat(speed, ca.substitute(force(s), s.v, speed)))
    state, outside = ca.vertcat(s.q, p), ca.vertcat(s.c, s.t, s.control)
    slope, by_outside = ca.jacobian(rates, state), ca.jacobian(rates, outside)
    m = ca.SX.sym("m", rates.numel())
    inputs = [s.q, p, s.t, s.control]
    expressions = {
        "slopes": (inputs, [rates, slope.nz[:]]),
        "outside": (inputs, [by_outside.nz[:]]),
        "momentum": ([s.q, s.v, s.t], [s.momentum]),
        "pull": ([*inputs, m], [ca.gradient(ca.dot(m, rates), outside)]),
    }
    expressions["density"] = inputs, [ca.SX(0, 1)] * 3
    if density is not None:
        loss = ca.Function.deserialize(density)(s.q, speed, s.t, s.control, s.c)
        of_loss = [ca.densify(ca.gradient(loss, x)) for x in (state, outside)]
        expressions["density"] = inputs, [loss, *of_loss]
    expressions |= _products(slope.sparsity(), s.structure.n)
    rows, columns = by_outside.sparsity().get_triplet()
    return SweepScheme(
        routines(s.c, expressions, MOST_OPERATIONS),
        {
            "STAGES": stages,
            "N": s.structure.n,
            "NU": s.control.numel(),
            "C": s.c.numel(),
            "NJ": slope.nnz(),
            "FE": by_outside.nnz(),
            "WINDOW": _window(stages),
            "LOSS": int(density is not None),
            "MORE": MORE,
            "MOST_ITERATIONS": FIXED_POINT_ITERATIONS,
        },
        {"ROUNDED": CLOSE, "LEAST_SPEED": LEAST_SPEED},
        {"FE_ROW": np.array(rows, dtype=int), "FE_COLUMN": np.array(columns, dtype=int)},
        _stage_tables(stages, padded),
    )


def _products(pattern: ca.Sparsity, n: int) -> dict[str, tuple[list[ca.SX], list[ca.SX]]]:
    """J x + source and Jᵀ x + source from the nonzeros of J, halves of them: straight-line code,
    for it is all that an iteration does.
    """
    nonzeros, x, source = ca.SX.sym("j", pattern.nnz()), ca.SX.sym("x", 2 * n), ca.SX.sym("s", n)
    matrix, found = ca.SX(pattern, nonzeros), {}
    for name, product in (("turn", matrix @ x), ("back", matrix.T @ x)):
        for half, part in zip("qp", ca.vertsplit(ca.densify(product), n), strict=True):
            found[f"{name}_{half}"] = [nonzeros, x, source], [source + part]
    return found


def _window(stages: int) -> int:
    return WINDOWS[stages > FEW_STAGES]


def _stage_tables(stages: int, padded: int) -> dict[str, np.ndarray]:
    """Columns of the tableau and of its adjoint, weights, nodes, start values; lanes beyond the
    stages repeat the last one, with weight 0.
    """
    constants = gauss_tableau(stages)
    b, c = constants["STAGE_B"][0], constants["STAGE_C"][0]
    a = constants["STAGE_M1"] * b  # m_ij = a_ij / b_j
    repeat = np.minimum(np.arange(padded), stages - 1)
    window = _window(stages)
    guess_q, guess_v = np.zeros((2, window, 2 * window, padded))
    for place in range(window):
        nodes = np.arange(window) - place if place < window - 1 else np.array([0, 1])
        guess_q[place, : 2 * len(nodes)], guess_v[place, : 2 * len(nodes)] = _hermite(
            nodes.astype(float), c[repeat]
        )
    weights, backwards = np.append(b, np.zeros(padded - stages)), _continued(c)
    return {
        "COLUMN_A": a[repeat].T,
        "COLUMN_M": (b - a)[repeat].T,
        "STAGE_B": weights,
        "STAGE_C": c[repeat],
        "GUESS_Q": guess_q,
        "GUESS_V": guess_v,
        "CONTINUED": backwards[repeat].T,
        "AHEAD": _continued(c, np.arange(1, MORE + 1))[repeat].T,
        "ONWARDS": backwards[::-1, ::-1][repeat].T,  # nodes lie alike seen from either end
    }


def _hermite(nodes: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Polynomials at x that are 1 in value, or else in slope, at one node and 0 in both at all
    others: values and slopes in turn, node by node; and their derivatives.
    """
    found, rates = np.empty((2, 2 * len(nodes), len(x)))
    for j, at in enumerate(nodes):
        others = np.delete(nodes, j)
        factors = (x[:, None] - others) / (at - others)
        single = np.prod(factors, axis=1)
        parts = [np.prod(np.delete(factors, i, 1), axis=1) / (at - b) for i, b in enumerate(others)]
        rate, steep, ahead = sum(parts), 2 * (1 / (at - others)).sum(), x - at
        found[2 * j] = (1 - steep * ahead) * single**2
        found[2 * j + 1] = ahead * single**2
        rates[2 * j] = -steep * single**2 + (1 - steep * ahead) * 2 * single * rate
        rates[2 * j + 1] = single**2 + ahead * 2 * single * rate
    return found, rates


def _continued(c: np.ndarray, nodes: Sequence[int] | np.ndarray = ()) -> np.ndarray:
    """What the stages at c of a step, and the ends of steps behind it at `nodes`, make of stages at
    c − 1, all less the value between: the polynomial through it that fits best, a row for each of
    the latter.
    """
    known = np.append(c, nodes)
    powers = np.arange(1, min(len(known), CONTINUED_DEGREE) + 1)
    return (c[:, None] - 1) ** powers @ np.linalg.pinv(known[:, None] ** powers)
