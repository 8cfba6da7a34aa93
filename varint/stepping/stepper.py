"""The record that every stepper fills in, and the compensated update they share.

The state vector x of a run is [q, q's compensation, p, p's compensation, the stepper's own memory, worst residual].
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Stepper:
    """One step of one system by one rule.

    Attributes
    ----------
    step : Function
        (x, u, t, h, c, scale) → x after the step; u has the controls at the rule's nodes, column by column.
    start : Function
        (q0, p0, u, t, h, c) → x at the start.
    path : Function
        (x, u, t, h, c, scale) → increments Q_j − q0 of the step's control points, column by column.
    reactions : Function or None
        (x, u, t, h, c, scale) → momenta that constraints give at the step's control points, (n, d + 1); the last column
        is the projection at the end. None where nothing is constrained.
    counts : bool
        Whether a root finder iterates in the step; the last number of the memory, x[-2], then counts its iterations.
    """

    step: ca.Function
    start: ca.Function
    path: ca.Function
    reactions: ca.Function | None = None
    counts: bool = False


def compensated(x: ca.SX, carry: ca.SX, increment: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """x + increment and the round-off to carry along (Kahan; Hairer–Lubich–Wanner VIII.5), in a step of size h ≠ 0.

    CasADi would simplify x − (x + increment) to −increment, so the sum is hidden behind a condition on h that always
    holds. (Its global option against simplification would change what other threads build at the same time.)
    """
    increment = increment + carry
    total = x + increment
    hidden = ca.SX.binary(ca.OP_IF_ELSE_ZERO, ca.repmat(h, *x.shape), total)
    return total, (x - hidden) + increment


def zeros(n: int) -> ca.SX:
    """A dense column of zeros."""
    return ca.SX.zeros(n, 1)
