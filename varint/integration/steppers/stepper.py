"""The record that every stepper fills in, the state it works on, and the compensated update they
share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import casadi as ca

from varint.rules.rule import Rule
from varint.scene.system import System

ITERATIONS, RESIDUAL = -2, -1  # where these two stand in every state vector


class StateLayout(NamedTuple):
    """Where the parts of the state vector of a run stand: ``x[..., layout.p]`` are its momenta.

    x = [q, q's compensation, p, p's compensation, the stepper's own memory, iterations so far,
    worst residual]. `moving` is x without what belongs to the stepper: what goes on from one
    stepper to another.
    """

    q: slice
    q_rest: slice
    p: slice
    p_rest: slice
    moving: slice
    memory: slice


@cache
def state_layout(n: int) -> StateLayout:
    """The layout of the state of n coordinates."""
    q, q_rest, p, p_rest = (slice(i * n, (i + 1) * n) for i in range(4))
    return StateLayout(q, q_rest, p, p_rest, slice(4 * n), slice(4 * n, ITERATIONS))


class State(NamedTuple):
    """The parts of a state as CasADi expressions, in their order."""

    q: Any
    q_rest: Any
    p: Any
    p_rest: Any
    memory: Any
    iterations: Any = 0
    residual: Any = 0

    @property
    def vector(self) -> Any:
        """The state vector x."""
        return ca.vertcat(*self)


def state_symbols(n: int, memory: int) -> State:
    """The state of n coordinates with so many numbers of the stepper's own, as SX symbols."""
    sizes = zip(State._fields, _sizes(n, memory), strict=True)
    return State(*(ca.SX.sym(name, k) for name, k in sizes))


def state_parts(x: ca.MX, n: int) -> State:
    """The parts of the state vector x of n coordinates."""
    sizes = _sizes(n, x.numel() - 4 * n - 2)
    return State(*ca.vertsplit(x, [sum(sizes[:i]) for i in range(len(sizes) + 1)]))


def _sizes(n: int, memory: int) -> tuple[int, ...]:
    return n, n, n, n, memory, 1, 1


def state_size(n: int, memory: int) -> int:
    """Numbers in the state of n coordinates with so many of the stepper's own."""
    return sum(_sizes(n, memory))


def first_state(q: Any, p: Any, memory: Any) -> Any:
    """The state vector at the start of a run: nothing to compensate, no iterations, no residual."""
    zeros = ca.DM.zeros(q.numel())
    return State(q, zeros, p, zeros, memory).vector


@dataclass(frozen=True, eq=False)
class Stepper:
    """One step of one system by one rule.

    Attributes
    ----------
    step : Function
        (x, u, t, h, c, scale) → x after the step; u has the controls at the rule's nodes, column by
        column.
    start : Function
        (q0, p0, u, t, h, c) → x at the start.
    path : Function
        (x, u, t, h, c, scale) → increments Q_j − q0 of the step's control points, column by column.
    reactions : Function or None
        (x, u, t, h, c, scale) → momenta that constraints give at the step's control points, (n, d +
        1); the last column is the projection at the end. None where nothing is constrained.
    guided : bool
        Whether the memory begins with mean velocities (Q_j − q0)/h at the control points, which its
        iterations start from.
    """

    step: ca.Function
    start: ca.Function
    path: ca.Function
    reactions: ca.Function | None = None
    guided: bool = False


@dataclass(frozen=True)
class Method:
    """A way to step a scene, an entry of the table in `varint.integration.plan`.

    Attributes
    ----------
    name : str
        What `Plan.method` says.
    applies : callable
        (system, rule) → whether it is correct for them.
    runs, skips : callable
        (system, rule) → what a step does, and what it leaves out because the scene lacks it.
    build : callable
        (system, rule) → Stepper.
    """

    name: str
    applies: Callable[[System, Rule], bool]
    runs: Callable[[System, Rule], tuple[str, ...]]
    skips: Callable[[System, Rule], tuple[str, ...]]
    build: Callable[[System, Rule], Stepper]


def compensated_sum(x: ca.SX, carry: ca.SX, increment: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """x + increment and the round-off to carry along (Kahan; Hairer–Lubich–Wanner VIII.5), in a
    step of size h ≠ 0.

    CasADi would simplify x − (x + increment) to −increment, so the sum is hidden behind a condition
    on h that always holds. (Its global option against simplification would change what other
    threads build at the same time.)
    """
    increment = increment + carry
    total = x + increment
    hidden = ca.SX.binary(ca.OP_IF_ELSE_ZERO, ca.repmat(h, *x.shape), total)
    return total, (x - hidden) + increment


def zeros(n: int) -> ca.SX:
    """A dense column of zeros."""
    return ca.SX.zeros(n, 1)


def sum_function(n: int) -> ca.Function:
    """(p, carry, gain, h) → compensated p + gain."""
    p, carry, gain = (ca.SX.sym(name, n) for name in ("p", "carry", "gain"))
    h = ca.SX.sym("h")
    return ca.Function("gained", [p, carry, gain, h], list(compensated_sum(p, carry, gain, h)))
