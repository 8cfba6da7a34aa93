"""The record that every stepper fills in, and the compensated update they share.

The state vector x of a run is [q, q's compensation, p, p's compensation, the stepper's own memory, worst residual].
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import casadi as ca

_LOCK = threading.RLock()


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
    solve : Function or None
        The root finder inside, for its iteration count; None for explicit steppers.
    """

    step: ca.Function
    start: ca.Function
    path: ca.Function
    solve: ca.Function | None = None


@contextmanager
def verbatim() -> Iterator[None]:
    """Within: SX expressions are kept as written. Otherwise (a + b) − a becomes b and compensation is lost."""
    with _LOCK:
        was = ca.GlobalOptions.getSimplificationOnTheFly()
        ca.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            yield
        finally:
            ca.GlobalOptions.setSimplificationOnTheFly(was)


def compensated(x: ca.SX, carry: ca.SX, increment: ca.SX) -> tuple[ca.SX, ca.SX]:
    """x + increment and the round-off to carry along (Kahan; Hairer–Lubich–Wanner VIII.5). Call within `verbatim`."""
    increment = increment + carry
    total = x + increment
    return total, (x - total) + increment


def zeros(n: int) -> ca.SX:
    """A dense column of zeros."""
    return ca.SX.zeros(n, 1)
