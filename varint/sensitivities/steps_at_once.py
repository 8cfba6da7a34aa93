"""Tangents and adjoints of a piece of a run by CasADi's own loops, its steps differentiated all at
once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.numerics.arrays import blocks, over_columns
from varint.rules.rule import Rule
from varint.scene.system import System
from varint.sensitivities.linear_steps import equations_at_guess, linear_step, lossy_step
from varint.sensitivities.pieces import Piece

if TYPE_CHECKING:
    from varint.codegen.sweep import SweepKernel

LOOSE = 1e-6  # relative: unknowns whose last correction is larger were not found
TURNS = 1000  # of CasADi's own loops at a time


@dataclass(frozen=True, eq=False)
class Sweeper:
    """How the derivatives of a scene's steps are taken.

    Attributes
    ----------
    system, rule : System, Rule
    density : str or None
        Running loss, the function (q, v, t, u, c) → ℓ, serialised.
    kernels : tuple of SweepKernel
        Loops in C, each there where the one before it fails; where there are none,
        `linear_step` or `lossy_step` is evaluated at many steps at once.
    native : bool
        Whether they are those for scenes as data.
    """

    system: System
    rule: Rule
    density: str | None
    kernels: tuple[SweepKernel, ...] = ()
    native: bool = False


class Directions(NamedTuple):
    """What a run is varied by, a column each.

    Attributes
    ----------
    outer : ndarray (C + 2, m)
        Changes of the parameters, of the step and of the start time.
    controls : int
        The first of the columns that are the controls of every step in turn; −1 where there are
        none.
    nodes : int
        Control values a step: 1 where they are held over it.
    """

    outer: np.ndarray
    controls: int = -1
    nodes: int = 1


class Pulled(NamedTuple):
    """Derivatives of a loss with respect to what is outside, summed over a piece: parameters, step,
    start time; controls (S, nodes, k); the running loss itself.
    """

    outer: np.ndarray
    controls: np.ndarray
    loss: float


NOT_REGULAR = (
    "its equations have no regular derivative there (a grazing contact, dependent constraints)"
)
NOT_SOLVED = (
    "its equations could not be solved once more: the nodes are not those of this rule, or h is "
    "too large"
)
NO_NUMBERS = "its equations are not finite there (a division by zero, a root of a negative number)"


def failure(step: int, time: float, why: str) -> ConvergenceError:
    """What is to be said of a step without a derivative."""
    return ConvergenceError(
        f"the derivative of step {step} at t={time:g} cannot be taken: {why}",
        step=step,
        time=time,
        residual=float("nan"),
        cause=why,
    )


def _told(error: RuntimeError) -> str:
    """Why CasADi ended an evaluation."""
    words = str(error).strip()
    if "factorization failed" in words:
        return NOT_REGULAR
    if "not-a-number" in words:
        return NO_NUMBERS
    return f"CasADi ended its evaluation: {words.splitlines()[-1]}"


def step_slopes(
    by: Sweeper,
    x: np.ndarray,
    after: np.ndarray,
    v: np.ndarray,
    v_after: np.ndarray,
    t: np.ndarray,
    h: np.ndarray,
    u: np.ndarray,
    c: np.ndarray,
    first: int = 0,
) -> list[np.ndarray]:
    """Outputs of `linear_step`, or of `lossy_step` where there is a loss, of steps (S,) with ends x
    and `after` (S, 2n), controls u (S, nodes, k): matrices as (S, columns, rows). `first` numbers
    the first of them.

    Raises
    ------
    ConvergenceError
        If a step's equations cannot be solved again or have no regular derivative.
    """
    count = len(t)
    columns = x, after, v, v_after, t[:, None], h[:, None], u.reshape(count, -1)
    try:
        found = over_columns(interpreted(by), *columns, c)
    except RuntimeError as error:
        k, cause = _first_failure(by, columns, c, error)
        raise failure(first + k, float(t[k]), _told(cause)) from cause
    finite = np.isfinite(found[0].sum(1) + found[2][:, 0])
    bad = np.flatnonzero(~(finite & (found[2][:, 0] <= LOOSE)))
    if len(bad):
        step = int(bad[0])
        why = NOT_SOLVED if finite[step] else _not_finite(by, columns, c, step)
        raise failure(first + step, float(t[step]), why)
    size = x.shape[1]
    return [found[0].reshape(count, size, size), found[1].reshape(count, -1, size), *found[2:]]


def _not_finite(by: Sweeper, columns: tuple[np.ndarray, ...], c: np.ndarray, k: int) -> str:
    """Why the derivative of a step has no numbers: a diagonal slope is divided by unasked."""
    equations = equations_at_guess(by.system, by.rule)
    begin = over_columns(equations, *(x[k : k + 1] for x in columns), c)
    return NOT_REGULAR if all(np.isfinite(x).all() for x in begin) else NO_NUMBERS


def _first_failure(
    by: Sweeper, columns: tuple[np.ndarray, ...], c: np.ndarray, error: RuntimeError
) -> tuple[int, RuntimeError]:
    """The first of the steps whose evaluation fails, and its error, by bisection."""
    low, high = 0, len(columns[0])
    while high - low > 1:
        middle = (low + high) // 2
        try:
            over_columns(interpreted(by), *(x[low:middle] for x in columns), c)
            low = middle
        except RuntimeError as of_first:
            high, error = middle, of_first
    return low, error


def interpreted(by: Sweeper) -> ca.Function:
    """The derivatives of single steps."""
    if by.density is None:
        return linear_step(by.system, by.rule)
    return lossy_step(by.system, by.rule, by.density)


def _steps(by: Sweeper, piece: Piece, c: np.ndarray) -> list[np.ndarray]:
    x, v = piece.x, piece.v
    ends = x[:-1], x[1:], v[:-1], v[1:]
    return step_slopes(by, *ends, piece.t, piece.h, piece.u, c, piece.first)


@lru_cache(maxsize=64)
def _carry(n: int, columns: int, count: int) -> ca.Function:
    """X ← A X + S, so many times."""
    x, s = ca.MX.sym("x", n, columns), ca.MX.sym("s", n, columns)
    a = ca.MX.sym("a", n, n)
    once = ca.Function("carry", [x, a, s], [a @ x + s])
    return once.mapaccum("carried", count) if count > 1 else once


def _accumulate(matrices: np.ndarray, sources: np.ndarray, start: np.ndarray) -> np.ndarray:
    """X_{k+1} = A_k X_k + S_k: every X, the first included, (S + 1, n, m); A and S have columns
    first, (S, n, n), (S, m, n).
    """
    n, m = start.shape
    out, done = [start.T[None]], 0
    for count in blocks(len(matrices), TURNS):
        a, s = (x[done : done + count].reshape(-1, n).T for x in (matrices, sources))
        found = np.array(_carry(n, m, count)(out[-1][-1].T, a, s))
        out.append(found.T.reshape(count, m, n))
        done += count
    return np.concatenate(out).transpose(0, 2, 1)


def adjoints_at_nodes(by: Sweeper, piece: Piece, c: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """The adjoint at every node of the piece, (S + 1, 2n), to each of which its seed adds."""
    phi = _steps(by, piece, c)[0].transpose(0, 2, 1)
    back = _accumulate(phi[::-1], seeds[-2::-1, None], seeds[-1:].T)
    return back[::-1, :, 0]


def forwards_interpreted(
    by: Sweeper, piece: Piece, c: np.ndarray, directions: Directions, tangent: np.ndarray
) -> np.ndarray:
    """∂x at every node of the piece, (S + 1, 2n, m), from that at its first, (2n, m)."""
    phi, outside, *_ = _steps(by, piece, c)
    outer, m, count = len(c) + 2, tangent.shape[1], len(piece.t)
    along = np.repeat(directions.outer.T[None], count, axis=0)  # (S, m, outer)
    along[:, :, -1] += (piece.first + np.arange(count))[:, None] * directions.outer[-2]
    sources = along @ outside[:, :outer]
    if directions.controls >= 0:
        of_controls = _by_values(outside[:, outer:], directions.nodes, piece.u.shape[2])
        width = of_controls.shape[1]
        for j in range(width):
            steps = np.arange(count)
            at = directions.controls + (piece.first + steps) * width + j
            sources[steps, at] += of_controls[:, j]
    assert sources.shape[1] == m
    return _accumulate(phi, sources, tangent)


def _by_values(of_nodes: np.ndarray, values: int, k: int) -> np.ndarray:
    """Derivatives by the controls of all nodes (S, nodes·k, …) as those by the values given."""
    if values > 1 or not k:
        return of_nodes
    count, _, *rest = of_nodes.shape
    return of_nodes.reshape(count, -1, k, *rest).sum(1)


def backwards_interpreted(
    by: Sweeper,
    piece: Piece,
    c: np.ndarray,
    adjoint: np.ndarray,
    seeds: np.ndarray | None,
    nodes: int,
) -> tuple[np.ndarray, Pulled]:
    """`sweeps.backwards` without a compiled loop."""
    phi, outside, _, *lossy = _steps(by, piece, c)
    outer, (count, size) = len(c) + 2, phi.shape[:2]
    sources = np.zeros((count, size))
    if seeds is not None:
        sources += seeds
    if lossy:
        sources += lossy[1]
    transposed = phi.transpose(0, 2, 1)
    mu = _accumulate(transposed[::-1], sources[::-1, None], adjoint[:, None])[::-1, :, 0]
    pulled = np.einsum("kei,ki->ke", outside, mu[1:])
    if lossy:
        pulled = pulled + lossy[2]
    total = pulled[:, :outer].sum(0)
    total[-2] += ((piece.first + np.arange(count)) * pulled[:, outer - 1]).sum()
    k = piece.u.shape[2]
    controls = _by_values(pulled[:, outer:], nodes, k).reshape(count, nodes, k)
    return mu[0], Pulled(total, controls, float(lossy[0].sum()) if lossy else 0.0)
