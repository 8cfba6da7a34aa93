"""Second derivatives of single steps, along an adjoint: what the Hessian of a run is the sum of.

Of L = Σ w·(q, v) at the nodes, with tangents T_k = ∂(x_k, e_k)/∂z and adjoints μ_k = ∂L/∂x_k,

    ∂²L/∂z² = Σ_k T_kᵀ ∂²(μ_{k+1}·x_{k+1}(x_k, e_k)) T_k + what nodes and the start curve.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.composed import base_of
from varint.discrete.legendre import velocity_function
from varint.discrete.step_map import StepMap, step_map
from varint.integration.step_function import step_function
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.sensitivities.linear_steps import unknowns
from varint.sensitivities.loops import curvature_loop
from varint.sensitivities.pieces import Piece
from varint.sensitivities.steps_at_once import Directions, Sweeper, adjoints_at_nodes
from varint.sensitivities.sweeps import arguments, failed_step


def curvature(
    by: Sweeper,
    piece: Piece,
    c: np.ndarray,
    seeds: np.ndarray,
    tangent: np.ndarray,
    directions: Directions,
) -> tuple[np.ndarray, np.ndarray]:
    """Σ_k T_kᵀ ∂²(μ_{k+1}·x_{k+1}) T_k of the steps of a piece (m, m), and the adjoint at its first
    node; from the derivatives by every node (S + 1, 2n) and the tangents there (S + 1, 2n, m).

    Raises
    ------
    ConvergenceError
        If a step's equations cannot be solved again or have no regular derivative.
    """
    loop, m = curvature_loop(by), tangent.shape[2]
    if loop is None:
        return _interpreted(by, piece, c, seeds, tangent, directions)
    mu, found, failed = seeds[-1].copy(), np.zeros((m, m)), np.zeros(1)
    told = arguments(piece, c, directions, seeds[:-1], failed)
    along = np.ascontiguousarray(tangent)
    if status := loop(told | dict(tangent=mu, along=along, hessian=found)):
        raise failed_step(piece, failed, status)
    return found + np.tril(found, -1).T, mu


def _interpreted(
    by: Sweeper,
    piece: Piece,
    c: np.ndarray,
    seeds: np.ndarray,
    tangent: np.ndarray,
    directions: Directions,
) -> tuple[np.ndarray, np.ndarray]:
    mu = adjoints_at_nodes(by, piece, c, seeds)
    x, v, count = piece.x, piece.v, len(piece.t)
    ends = x[:-1], x[1:], v[:-1], v[1:], piece.t[:, None], piece.h[:, None]
    u = piece.u.reshape(count, -1)
    flat = over_columns(step_hessian(by.system, by.rule), *ends, u, c, mu[1:])[0]
    constant = np.broadcast_to(directions.outer[: len(c)], (count, len(c), tangent.shape[2]))
    of_u = _held_controls(piece, directions, tangent.shape[2])
    return twice(flat, np.concatenate([tangent[:-1], constant, of_u], 1)), mu[0]


def _held_controls(piece: Piece, directions: Directions, columns: int) -> np.ndarray:
    """How the controls at the nodes of every step depend on those held over it, (S, nodes·k,
    columns).
    """
    steps, nodes, k = piece.u.shape
    of_u = np.zeros((steps, nodes, k, columns))
    at = directions.controls + (piece.first * k + np.arange(steps * k)).reshape(steps, 1, k)
    np.put_along_axis(of_u, np.broadcast_to(at, (steps, nodes, k))[..., None], 1.0, 3)
    return of_u.reshape(steps, nodes * k, columns)


def twice(flat: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Σ Tᵀ H T of symmetric matrices, (N, rows²), and their columns T (N, rows, columns)."""
    count, rows, columns = along.shape
    turned = flat.reshape(count, rows, rows) @ along
    return along.reshape(count * rows, columns).T @ turned.reshape(count * rows, columns)


def step_hessian(system: System, rule: Rule) -> ca.Function:
    """(x, x', v, v', t, h, u, c, μ) → ∂²(μ·x')/∂(x, c, u)², with the controls of all nodes."""
    return _hessian_by(system, rule, "xcu")


def part_hessian(system: System, rule: Rule) -> ca.Function:
    """`step_hessian` by (x, c, u, t, h): of a step whose time and size vary, too."""
    return _hessian_by(system, rule, "xcuth")


@per_system
def _hessian_by(system: System, rule: Rule, varied: str) -> ca.Function:
    s, n = step_map(system, rule), system.structure.n
    width = len(rule.nodes) * system.structure.controls
    sizes = (2 * n, 2 * n, n, n, 1, 1, width, s.c.numel(), 2 * n)
    inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    if base_of(system, rule):
        found = _of_step(system, rule, inputs, varied)
    else:
        found = (_of_equations if s.y.numel() else _of_parts)(s, inputs, varied)
    return ca.Function("step_hessian", inputs, [ca.densify(found)])


def _of_parts(s: StepMap, inputs: list[ca.MX], varied: str) -> ca.MX:
    """Of an explicit step, part after part."""
    x, _, _, _, t, h, u, c, _ = inputs
    part = ca.Function("part", [s.q, s.p, s.t, s.u, s.part, s.c, s.h], [s.after], {"cse": True})
    state, width = x, s.u.numel()
    for r, row in enumerate(s.parts):
        mine = u[r * width : (r + 1) * width] if width else ca.MX(0, 1)
        state = part(*ca.vertsplit(state, s.q.numel()), t, mine, ca.MX(row), c, h)
    return _by_all(inputs, varied, state)


def _of_step(system: System, rule: Rule, inputs: list[ca.MX], varied: str) -> ca.MX:
    """Of a step in parts, each with equations of its own, by the derivatives of its roots."""
    x, _, _, _, t, h, u, c, _ = inputs
    step, n = step_function(system, rule), system.structure.n
    u = ca.reshape(u, system.structure.controls, len(rule.nodes))
    return _by_all(inputs, varied, ca.vertcat(*step(*ca.vertsplit(x, n), u, c, t, h)[:2]))


def _by_all(inputs: list[ca.MX], varied: str, state: ca.MX) -> ca.MX:
    """Of μ·state."""
    x, _, _, _, t, h, u, c, mu = inputs
    given = dict(zip("xcuth", (x, c, u, t, h), strict=True))
    others = [given[name] for name in given if name not in varied]
    return second_derivatives([given[name] for name in varied], ca.dot(mu, state), *others, mu)


def second_derivatives(by: list[ca.MX], value: ca.MX, *others: ca.MX) -> ca.MX:
    """∂²/∂(by)² of a number that depends on these symbols and on others."""
    ends = np.cumsum([0, *(x.numel() for x in by)]).tolist()
    of = ca.Function("value", [*by, *others], [value])
    z = ca.MX.sym("z", ends[-1])
    hessian = ca.densify(ca.hessian(of(*ca.vertsplit(z, ends), *others), z)[0])
    return ca.Function("hessian", [z, *others], [hessian])(ca.vertcat(*by), *others)


def _of_equations(s: StepMap, inputs: list[ca.MX], varied: str) -> ca.MX:
    """Of F(y, z) = 0, x' = G(y, z): with S = μ·G + η·F and η = −F_y⁻ᵀ G_yᵀ μ it is Dᵀ S'' D, D =
    [−F_y⁻¹ F_z; 1].
    """
    x, x1, v, v1, t, h, u, c, mu = inputs
    q, p = ca.vertsplit(x, s.q.numel())
    arguments = [q, p, t, u, ca.MX(s.part.numel(), 1), c, h]
    y, _ = unknowns(s, arguments, x, x1, v, v1, h)
    eta_symbol, mu_symbol = ca.SX.sym("eta", s.y.numel()), ca.SX.sym("mu", 2 * s.q.numel())
    symbols = dict(zip("xcuth", (s.state, s.c, s.u, s.t, s.h), strict=True))
    z = ca.vertcat(*(symbols[name] for name in varied))
    both = ca.vertcat(s.y, z)
    twisted = ca.dot(mu_symbol, s.after) + ca.dot(eta_symbol, s.left)
    given = [*s.inputs, s.c, s.h]
    slopes = [ca.jacobian(s.left, s.y), ca.jacobian(s.left, z), ca.jacobian(s.after, s.y)]
    first = ca.Function("first", given, slopes, {"cse": True})
    second = ca.Function(
        "second", [*given, mu_symbol, eta_symbol], [ca.hessian(twisted, both)[0]], {"cse": True}
    )
    fy, fz, gy = first(y, *arguments)
    eta = -ca.solve(fy.T, ca.mtimes(gy.T, mu), "csparse")
    along = ca.vertcat(-ca.solve(fy, ca.densify(fz), "csparse"), ca.MX.eye(z.numel()))
    return ca.mtimes([along.T, second(y, *arguments, mu, eta), along])


@per_system
def node_hessian(system: System) -> ca.Function:
    """(q, p, t, c, w) → ∂²(w·(q, v))/∂(q, p, c)²."""
    n, many = system.structure.n, system.c.numel()
    inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate((n, n, 1, many, 2 * n))]
    q, p, t, c, w = inputs
    value = ca.dot(w, ca.vertcat(q, velocity_function(system)(q, p, t, c)))
    found = second_derivatives([q, p, c], value, t, w)
    return ca.Function("node_hessian", inputs, [found])


@per_system
def start_hessian(system: System) -> ca.Function:
    """(q, v, t, c, w) → ∂²(w·p)/∂(q, v, c)², p = ∂L/∂v."""
    s, w = system, ca.SX.sym("w", system.structure.n)
    curved = ca.hessian(ca.dot(w, s.momentum), ca.vertcat(s.q, s.v, s.c))[0]
    return ca.Function("start_hessian", [s.q, s.v, s.t, s.c, w], [ca.densify(curved)])
