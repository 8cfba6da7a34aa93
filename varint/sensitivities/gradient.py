"""The gradient of one number of a whole run, by adjoints carried backwards through its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.inputs import finite_array
from varint.scene.system import System, parameters_by_name, per_system
from varint.sensitivities.pieces import pieces, scene_of
from varint.sensitivities.start import start_slopes, state_function
from varint.sensitivities.sweeps import Sweeper, backwards, sweeper


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
        By the step and the duration at a fixed number of steps, None where steps differ, and by the
        time at which everything begins.
    """

    value: float
    q0: np.ndarray
    v0: np.ndarray
    p0: np.ndarray
    params: dict[str, np.ndarray]
    u: np.ndarray
    h: float | None
    duration: float | None
    t0: float

    def __repr__(self) -> str:
        parts = [f"value={self.value:.6g}", f"q0={self.q0}", f"v0={self.v0}"]
        parts += [f"{name}={x}" for name, x in self.params.items()]
        return f"Gradient({', '.join(parts)})"


class _AtNodes(NamedTuple):
    """Derivatives of what is summed at the kept nodes: by (q, p) of each (N + 1, 2n), by the
    parameters and the time of each.
    """

    value: float
    x: np.ndarray
    c: np.ndarray
    t: np.ndarray


def gradient(
    motion: Trajectory,
    loss: Any = None,
    terminal_loss: Any = None,
    *,
    nodes: Any = None,
    weights: Any = None,
    held: str = "v0",
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
        From `simulate` with h, steps and duration. Nodes that were left out (`save_every`) are
        computed once more, piece by piece: with every √N-th of N steps kept, 2√N states stand in
        memory at a time.
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
    backend : {"auto", "compiled", "interpreted"}
        As in `simulate`.

    Returns
    -------
    Gradient
        With constraints only products with variations that keep to them have a meaning.

    Raises
    ------
    InputError
        If no loss is given, or one has unknown symbols or is not scalar; or the run has impacts, a
        fictitious time or nodes within steps.
    ConvergenceError
        If a step has no regular derivative.

    Notes
    -----
    Hager, Runge–Kutta methods in optimal control and the transformed adjoint system, 2000; Griewank
    & Walther, Evaluating Derivatives, 2008, chapter 12 (checkpoints).

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
    scene, c = scene_of(motion), motion.c
    if held not in ("v0", "p0"):
        raise InputError(f"held must be 'v0' or 'p0', what stays at the start, got {held!r}")
    density = None if loss is None else _serialised(scene, _scalar("loss", loss, scene))
    at_nodes = _at_nodes(motion, scene, terminal_loss, nodes, weights)
    if density is None and terminal_loss is None and nodes is None:
        raise InputError("give loss, terminal_loss or nodes: there is nothing to differentiate")
    n, k = motion.q.shape[1], motion.k - motion.k[0]
    by = sweeper(scene, motion.rule, int(k[-1]), backend, density)
    outer = np.concatenate([at_nodes.c.sum(0), [(k * at_nodes.t).sum(), at_nodes.t.sum()]])
    adjoint, u, value = _swept(motion, by, at_nodes, outer)
    of_q, of_v, of_c, of_t = start_slopes(motion)
    of_p0, of_q0 = adjoint[n:], adjoint[:n]
    if held == "v0":
        of_q0 = of_q0 + of_q.T @ of_p0
        outer[:-2] += of_c.T @ of_p0
        outer[-1] += of_t[:, 0] @ of_p0
    h = None if motion.sizes is not None else float(outer[-2])
    return Gradient(
        at_nodes.value + value,
        of_q0,
        of_v.T @ of_p0,
        of_p0,
        parameters_by_name(motion.system, outer[: len(c)]),
        u,
        h,
        None if h is None else h / float(k[-1]),
        float(outer[-1]),
    )


def _swept(
    motion: Trajectory, by: Sweeper, at_nodes: _AtNodes, outer: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """The adjoint at the start, the derivatives by controls, the running loss; `outer` is added
    to.
    """
    u, value = np.zeros(motion.u.shape), 0.0
    begin, adjoint = int(motion.k[0]), at_nodes.x[-1].copy()
    for piece in pieces(motion, backwards=True):
        seeds = np.zeros((len(piece.t), at_nodes.x.shape[1]))
        seeds[piece.kept[:-1]] = at_nodes.x[piece.node : piece.last]
        adjoint, pulled = backwards(by, piece, motion.c, adjoint, seeds, motion.u.shape[1])
        outer += pulled.outer
        at = begin + piece.first
        u[at : at + len(piece.t)] = pulled.controls
        value += pulled.loss
    return adjoint, u, value


def _serialised(scene: System, expression: ca.SX) -> str:
    """The function (q, v, t, u, c) → an expression, as text: the same for the same expression."""
    s = scene
    inputs = [s.q, s.v, s.t, s.control, s.c]
    return ca.Function("density", inputs, [expression], {"cse": True}).serialize()


def _scalar(what: str, expression: Any, scene: System) -> ca.SX:
    own = in_own_symbols(expression, scene, what)
    if own.numel() != 1:
        raise InputError(f"{what} must be one number, got an expression of shape {own.shape}")
    return ca.densify(own)


def _at_nodes(
    motion: Trajectory, scene: System, terminal: Any, nodes: Any, weights: Any
) -> _AtNodes:
    """Of all nodes and of the last one."""
    count, n = motion.q.shape
    if weights is not None and nodes is None:
        raise InputError("weights belong to nodes=, an expression of every node; give that too")
    total = _AtNodes(
        0.0, np.zeros((count, 2 * n)), np.zeros((count, len(motion.c))), np.zeros(count)
    )
    if nodes is not None:
        own = ca.vec(ca.densify(in_own_symbols(nodes, scene, "nodes")))
        by = np.ones((count, own.numel())) if weights is None else _weights(weights, count, own)
        total = _add(total, _weighted(motion, scene, own, by, slice(None)), slice(None))
    if terminal is not None:
        own = _scalar("terminal_loss", terminal, scene)
        last = slice(count - 1, count)
        total = _add(total, _weighted(motion, scene, own, np.ones((1, 1)), last), last)
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


def _add(total: _AtNodes, part: _AtNodes, at: slice) -> _AtNodes:
    total.x[at] += part.x
    total.c[at] += part.c
    total.t[at] += part.t
    return total._replace(value=total.value + part.value)


def _weighted(
    motion: Trajectory, scene: System, expression: ca.SX, weights: np.ndarray, at: slice
) -> _AtNodes:
    """Σ_k w_k·ψ at some nodes with its derivatives."""
    function = _weighted_function(scene, _serialised(scene, expression))
    found = over_columns(
        function, motion.q[at], motion.p[at], motion.t[at, None], motion.c, weights
    )
    return _AtNodes(float(found[0].sum()), found[1], found[2], found[3][:, 0])


@per_system
def _weighted_function(scene: System, expression: str) -> ca.Function:
    """(q, p, t, c, w) → w·ψ and its derivatives with respect to (q, p), c and t."""
    s = scene
    own = ca.Function.deserialize(expression)(s.q, s.v, s.t, s.control, s.c)
    of_state = state_function(s, own)
    inputs = [ca.MX.sym(f"a{i}", of_state.numel_in(i)) for i in range(4)]
    q, p, t, c = inputs
    w = ca.MX.sym("w", own.numel())
    value = ca.dot(w, of_state(*inputs))
    slopes = [ca.densify(ca.gradient(value, x)) for x in (ca.vertcat(q, p), c, t)]
    return ca.Function("weighted", [*inputs, w], [value, *slopes])
