"""The gradient of one number of a whole run, by adjoints carried backwards through its steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.rows import at_many_points
from varint.errors import InputError
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.inputs import finite_array
from varint.scene.memory import per_system
from varint.scene.system import System, parameters_by_name
from varint.sensitivities.carrier import Carrier, rows_of
from varint.sensitivities.carry import Adjoint, carried_back
from varint.sensitivities.course import course_of, ends_whole, legs_backwards
from varint.sensitivities.rescaled import (
    inner_of,
    pulled_to_start,
    rescaled_loss,
    rescaled_seeds,
)
from varint.sensitivities.start import (
    as_text,
    scenes_at,
    start_slopes,
    state_function,
    symbols_for,
)


@dataclass(frozen=True, eq=False)
class Gradient:
    """A loss J of a run and its derivatives.

    Attributes
    ----------
    value : float
        J.
    q0, v0, p0 : ndarray (n,)
        By the start: q0 at fixed velocities, or at fixed momenta where ``held="p0"`` was given.
    params : dict of ndarray
        By the parameters, in their shapes; with velocities at the start held, or momenta.
    u : ndarray
        By the controls, in the shape of ``motion.u``.
    h, duration, t0 : float or None
        By the step and the duration at a fixed number of steps, and by the time at which everything
        begins; None where the run has no such number: h where steps differ, the duration where it
        ends within a step, duration and t0 in a fictitious time.
    restitution : ndarray (contacts,)
        By the coefficients of restitution.
    """

    value: float
    q0: np.ndarray
    v0: np.ndarray
    p0: np.ndarray
    params: dict[str, np.ndarray]
    u: np.ndarray
    h: float | None
    duration: float | None
    t0: float | None
    restitution: np.ndarray

    def __repr__(self) -> str:
        parts = [f"value={self.value:.6g}", f"q0={self.q0}", f"v0={self.v0}"]
        parts += [f"{name}={x}" for name, x in self.params.items()]
        return f"Gradient({', '.join(parts)})"


class _AtNodes(NamedTuple):
    """Derivatives of what is summed at the nodes: by (q, p, t) of the last, (…, 2n + 1), before
    which none counts, and by the parameters (C,).
    """

    value: float
    x: np.ndarray
    c: np.ndarray


def gradient(
    motion: Trajectory,
    loss: Any = None,
    terminal_loss: Any = None,
    *,
    nodes: Any = None,
    weights: Any = None,
    held: str = "v0",
    states: int | None = None,
    backend: str = "auto",
) -> Gradient:
    """Exact gradient of J = Σ_k h Σ_i b_i ℓ(q_i, v_i, u_i, t_i) + Σ_k w_k·ψ(q_k, v_k, t_k) + φ(q_N,
    v_N, t_N).

    Adjoints μ_k = ∂J/∂(q, p)_k are carried backwards, with one solve by the transposed equations
    of every step: η = −F_y⁻ᵀ (G_yᵀ μ_{k+1} + ∂ℓ/∂y), μ_k = G_xᵀ μ_{k+1} + F_xᵀ η + ∂ℓ/∂x. The cost
    is a few runs, whatever the number of parameters. It is the gradient of the discrete motion,
    to round-off.

    Parameters
    ----------
    motion : Trajectory
        From `simulate`, its start among the nodes. Nodes that were left out (`save_every`) are
        computed once more, piece by piece, from checkpoints.
    loss : SX, optional
        ℓ, an expression of q, v, t, u and parameters, summed with the rule's weights along the
        steps. Of explicit compositions the sum is taken at the kicks, with the mean of the
        velocities before and behind each.
    terminal_loss : SX, optional
        φ, of the last node.
    nodes : SX (o,), optional
        ψ, an expression of q, v, t and parameters, of all nodes of `motion`.
    weights : array (N + 1,) or (N + 1, o), optional
        w, of the nodes. Default: 1.
    held : {"v0", "p0"}
        What is held at the start while q0 and parameters vary.
    states : int, optional
        States (q, p) that may stand in memory at a time where nodes were left out, beside those
        kept; 2√N of N steps cost one run more, fewer some more by a binomial schedule. Default:
        all steps where what is stored of them, 5n + 3 numbers and the controls each, takes no more
        than 64 MB; else 2√N, or √N and a piece of 64 MB, whichever is more.
    backend : {"auto", "compiled", "native", "interpreted"}
        As in `simulate`.

    Returns
    -------
    Gradient
        With constraints only products with variations that keep to them have a meaning.

    Raises
    ------
    InputError
        If no loss is given, or one has unknown symbols or is not scalar; or the first node of the
        run lies within a step.
    ConvergenceError
        If a step has no regular derivative, or the motion grazes a contact.

    Notes
    -----
    Hager, Runge–Kutta methods in optimal control and the transformed adjoint system, 2000; Griewank
    & Walther, Evaluating Derivatives, 2008, chapter 12 (checkpoints), and Algorithm 799, 2000.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> c = vi.Parameters(g=9.81)
    >>> ball = vi.System(q, v, v**2 / 2 - c.g * q, params=c)
    >>> motion = vi.simulate(ball, q0=0.0, v0=3.0, h=0.01, steps=100)
    >>> of = vi.gradient(motion, terminal_loss=q)  # q0 + v0 t − g t²/2 at t = 1
    >>> [round(float(x), 12) for x in (of.q0[0], of.v0[0], of.params["g"], of.duration)]
    [1.0, 1.0, -0.5, -6.81]
    """
    require_trajectory(motion)
    system, c = motion.system, motion.c
    if held not in ("v0", "p0"):
        raise InputError(f"held must be 'v0' or 'p0', what stays at the start, got {held!r}")
    density = None if loss is None else _density(motion, _scalar("loss", loss, system))
    course = course_of(inner_of(motion))
    at_nodes = _at_nodes(motion, terminal_loss, nodes, weights)
    if density is None and terminal_loss is None and nodes is None:
        raise InputError("give loss, terminal_loss or nodes: there is nothing to differentiate")
    found = pulled_back(motion, Carrier(course, backend, density), at_nodes.x, states)
    n, many = motion.q.shape[1], len(c)
    at_start, outer = found.z[: 2 * n], found.z[2 * n + 1 :]
    outer[:many] += at_nodes.c
    outer[many + 1] += found.z[2 * n]  # the first node is where everything begins
    of_q, of_v, of_c, of_t = start_slopes(motion)
    of_q0, of_p0 = at_start[:n], at_start[n:]
    if held == "v0":
        of_q0 = of_q0 + of_q.T @ of_p0
        outer[:many] += of_c.T @ of_p0
        outer[many + 1] += of_t[:, 0] @ of_p0
    h = None if (motion.whole or motion).sizes is not None else float(outer[many])
    lasting = motion.fictitious is None and ends_whole(motion)
    return Gradient(
        at_nodes.value + found.loss,
        of_q0,
        of_v.T @ of_p0,
        of_p0,
        parameters_by_name(system, outer[:many]),
        found.u,
        h,
        h / float(motion.k[-1] - motion.k[0]) if h is not None and lasting else None,
        float(outer[many + 1]) if motion.fictitious is None else None,
        outer[many + 2 :],
    )


def pulled_back(
    motion: Trajectory, carrier: Carrier, seeds: np.ndarray, states: int | None = None
) -> Adjoint:
    """The adjoint at the first node, from derivatives by (q, p, t) of the last nodes (…, 2n + 1);
    those before them have none.
    """
    none = len(motion) - len(seeds)
    if motion.fictitious is not None:
        seeds = rescaled_seeds(motion, seeds)
    at = Adjoint(np.zeros(carrier.size), np.zeros(motion.u.shape))
    for leg in legs_backwards(carrier.course, states):
        rows = rows_of(carrier, leg, not leg.piece.node and not leg.piece.first)
        rows = rows.since(none)
        some = slice(rows.which.start - none, rows.which.stop - none)
        at = carried_back(carrier, leg, seeds[some], rows, at)
        del leg  # before the next one is made
    if motion.fictitious is None:
        return at
    return replace(at, z=pulled_to_start(motion, at.z))


def _density(motion: Trajectory, loss: ca.SX) -> str:
    """The running loss as the time of the steps has it."""
    if motion.fictitious is None:
        return as_text(motion.system, loss)
    return as_text(motion.fictitious.system, rescaled_loss(motion, loss))


def _scalar(what: str, expression: Any, scene: System) -> ca.SX:
    own = in_own_symbols(expression, scene, what)
    if own.numel() != 1:
        raise InputError(f"{what} must be one number, got an expression of shape {own.shape}")
    return own if own.is_dense() else ca.densify(own)


def _at_nodes(motion: Trajectory, terminal: Any, nodes: Any, weights: Any) -> _AtNodes:
    """Of all nodes and of the last one."""
    (count, n), system = motion.q.shape, motion.system
    if weights is not None and nodes is None:
        raise InputError("weights belong to nodes=, an expression of every node; give that too")
    last = count if nodes is not None else 1
    total = _AtNodes(0.0, np.zeros((last, 2 * n + 1)), np.zeros(len(motion.c)))
    if nodes is not None:
        own = ca.vec(ca.densify(in_own_symbols(nodes, system, "nodes")))
        by = np.ones((count, own.numel())) if weights is None else _weights(weights, count, own)
        total = _add(total, motion, own, by, slice(None))
    if terminal is not None:
        own = _scalar("terminal_loss", terminal, system)
        total = _add(total, motion, own, np.ones((1, 1)), slice(count - 1, None))
    return total


def _weights(weights: Any, count: int, expression: ca.SX) -> np.ndarray:
    given, size = finite_array("weights", weights), expression.numel()
    if given.shape == (count,):
        given = np.repeat(given[:, None], size, axis=1)
    if given.shape != (count, size):
        raise InputError(
            f"weights has shape {given.shape}; it must be ({count},) or ({count}, {size}): a row "
            "for each node of the run"
        )
    return given


def _add(
    total: _AtNodes, motion: Trajectory, expression: ca.SX, weights: np.ndarray, at: slice
) -> _AtNodes:
    """With Σ_k w_k·ψ of the nodes `at`."""
    value, text = total.value, as_text(motion.system, expression)
    q, p, t = motion.q[at], motion.p[at], motion.t[at, None]
    for some, scene in scenes_at(motion, at):
        weighted = _weighted_function(scene, text)
        of_psi, of_x, of_c = weighted(motion.c, q[some], p[some], t[some], weights[some])
        value += float(of_psi.sum())
        total.x[-len(q) :][some] += of_x
        total.c[:] += of_c.sum(0)
    return total._replace(value=value)


@per_system
def _weighted_function(scene: System, expression: str) -> Callable[..., list[np.ndarray]]:
    """c and rows of q, p, t, w → w·ψ and its derivatives with respect to (q, p, t) and c."""
    s = scene
    own = ca.Function.deserialize(expression)(s.q, s.v, s.t, s.control, s.c)
    of_state = state_function(s, own)
    q, p, t, c = symbols_for(of_state)
    w = type(q).sym("w", own.numel())
    value = ca.dot(w, of_state(q, p, t, c))
    slopes = [ca.densify(ca.gradient(value, x)) for x in (ca.vertcat(q, p, t), c)]
    return at_many_points("weighted", [q, p, t, w], c, [value, *slopes])
