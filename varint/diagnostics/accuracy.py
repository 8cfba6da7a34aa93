"""Accuracy against steps: observed orders, plateaus, and what is right at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.diagnostics.runs import EPS, Scene, march, mark, scene
from varint.discrete.lagrangian import point_function
from varint.errors import ConvergenceError, InputError
from varint.integration.plan import default_rule
from varint.integration.problem import Start
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.inputs import number, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = (8, 11, 16, 23, 32, 45, 64, 91, 128, 181, 256, 362, 512)
ABOVE = 100.0  # times the floor: errors below mix with round-off
TOLERANCE = 0.2  # of an observed order
POINTS = 4  # finest ones that an order is fitted to
FINEST_REFERENCE = 16_384
COARSE = 0.1  # relative errors above say nothing of the order

Reference = Trajectory | Callable[[float], tuple[Any, Any]] | tuple[Any, Any] | None


@dataclass(frozen=True, eq=False)
class Convergence:
    """Errors at the end of a run against the step.

    Attributes
    ----------
    method : str
    h : ndarray (k,)
        Steps, coarse to fine.
    q_error, p_error : ndarray (k,)
        Errors relative to the sizes of q and p; NaN where a run failed.
    q_order, p_order : float
        Observed orders, from the finest points above the floor; NaN with fewer than three.
    expected : float
    floor : float
        Accuracy of the reference, relative.
    passed : bool or None
        None if there are too few points to fit.
    """

    method: str
    h: np.ndarray
    q_error: np.ndarray
    p_error: np.ndarray
    q_order: float
    p_order: float
    expected: float
    floor: float
    passed: bool | None

    @property
    def plateau(self) -> float:
        """Smallest error reached."""
        return float(np.nanmin(np.maximum(self.q_error, self.p_error)))

    def __str__(self) -> str:
        if self.passed is None:
            limits = f"{COARSE:g} and {ABOVE * self.floor:.0e}"
            return f"{mark(None)} order: fewer than three steps have errors between {limits}"
        return (
            f"{mark(self.passed)} order {self.q_order:.2f} in q, {self.p_order:.2f} in p (expected "
            f"{self.expected:g}); smallest error {self.plateau:.1e}"
        )

    def plot(self) -> Figure:
        """Errors over the step, double logarithmic, with the expected slope."""
        from varint.drawing.diagnostic_figures import convergence_figure

        return convergence_figure(
            self.method,
            self.h,
            {"q": (self.q_error, self.q_order), "p": (self.p_error, self.p_order)},
            self.expected,
            self.floor,
        )


def convergence(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    duration: float,
    steps: Sequence[int] = LEVELS,
    order: float | None = None,
    reference: Reference = None,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> Convergence:
    """Observed order: slope of log error over log h at the end of a run.

    Parameters
    ----------
    system, method, q0, v0, p0, params, t0, u
        As in `symplectic_defect`.
    duration : float
    steps : sequence of int
        Numbers of steps.
    order : float, optional
        Expected order; needed for a step function.
    reference : Trajectory, (q, p), or callable, optional
        The solution at the end: a trajectory that ends there, its q and p, or ``q, v = exact(t)``.
        Default: made with a rule of order 16, refined until nothing changes.

    Returns
    -------
    Convergence
        Passed if both orders are at least the expected one less 0.2 (linear scenes may
        super-converge).
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    if order is None:
        if not isinstance(start.method, Rule):
            raise InputError("give order=, the order that this step function is expected to have")
        order = start.method.order
    duration, order = number("duration", duration), number("order", order)
    q, p, floor = end_of(start, duration, reference)
    counts = counts_of(steps)
    errors = np.array([error_at_end(start, duration, int(k), q, p) for k in counts])
    orders = [_order(duration / counts, e, floor) for e in errors.T]
    known = not np.isnan(orders).any()
    good = bool(min(orders) >= order - TOLERANCE) if known else None
    return Convergence(
        start.name,
        duration / counts,
        errors[:, 0],
        errors[:, 1],
        orders[0],
        orders[1],
        order,
        floor,
        good,
    )


def counts_of(steps: Sequence[int]) -> np.ndarray:
    """Numbers of steps in order, each once."""
    try:
        counts = sorted({positive_integer("every number of steps", k) for k in steps})
    except TypeError:
        counts = []
    if not counts:
        raise InputError(f"steps must be a sequence of numbers of steps, got {steps!r}")
    return np.array(counts)


def _order(h: np.ndarray, error: np.ndarray, floor: float) -> float:
    usable = np.flatnonzero((error > ABOVE * floor) & (error < COARSE))[-POINTS:]
    if len(usable) < 3:
        return float("nan")
    return float(np.polyfit(np.log(np.abs(h[usable])), np.log(error[usable]), 1)[0])


def error_at_end(
    start: Scene, duration: float, steps: int, q: np.ndarray, p: np.ndarray
) -> tuple[float, float]:
    """Errors of q and p at the end, relative to their sizes."""
    try:
        found_q, found_p, _ = march(start, duration / steps, steps)
    except ConvergenceError:
        return float("nan"), float("nan")
    sizes = [
        max(np.abs(x).max(), EPS)
        for x in (np.concatenate([found_q, q[None]]), np.concatenate([found_p, p[None]]))
    ]
    return float(np.abs(found_q[-1] - q).max() / sizes[0]), float(
        np.abs(found_p[-1] - p).max() / sizes[1]
    )


def end_of(
    start: Scene, duration: float, reference: Reference
) -> tuple[np.ndarray, np.ndarray, float]:
    """q, p at the end and their relative accuracy."""
    n = len(start.q)
    if reference is None:
        return tight(start, duration)
    if isinstance(reference, Trajectory):
        end = reference.at(start.t + duration)
        return end.q, end.p, EPS
    if callable(reference):
        q, v = (np.asarray(x, dtype=float).reshape(n) for x in reference(start.t + duration))
        p = np.array(
            point_function(start.system)(q, v, start.u, start.t + duration, start.c)[1]
        ).ravel()
        return q, p, EPS
    try:
        q, p = (np.asarray(x, dtype=float).reshape(n) for x in reference)
    except (TypeError, ValueError):
        raise InputError(
            f"reference must be a Trajectory, (q, p), or q, v = exact(t); got {reference!r}"
        ) from None
    return q, p, EPS


def tight(start: Scene, duration: float) -> tuple[np.ndarray, np.ndarray, float]:
    """q and p at the end by a rule of order 16 (14 with constraints), doubled until nothing
    changes; last change.

    Scenes that have rules of order 2 only take the scene's own.
    """
    s = start.system.structure
    rule = lobatto(8) if s.constraints or s.contacts else gauss(8)
    if s.degenerate or s.nonholonomic:
        rule = default_rule(start.system)
    fine = replace(start, method=rule, rule=rule)
    best: tuple[np.ndarray, np.ndarray, float] | None = None
    q, p = None, None
    steps = 32
    while steps <= FINEST_REFERENCE:
        try:
            path_q, path_p, _ = march(fine, duration / steps, steps)
        except ConvergenceError:
            steps *= 2
            continue
        if q is not None:
            sizes = np.abs(path_q).max(), np.abs(path_p).max()
            change = max(
                np.abs(path_q[-1] - q).max() / max(sizes[0], EPS),
                np.abs(path_p[-1] - p).max() / max(sizes[1], EPS),
            )
            if best is not None and change >= best[2] / 2 and best[2] < 1e-9:
                return best
            best = path_q[-1], path_p[-1], max(float(change), EPS)
            if change < 4 * EPS:
                return best
        q, p = path_q[-1], path_p[-1]
        steps *= 2
    if best is None:
        raise InputError(
            "no reference solution was found: every step failed; give reference= or a shorter "
            "duration"
        )
    return best
