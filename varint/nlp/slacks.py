"""Unknowns that make a problem smooth: what soft bounds are violated by, and largest values.

A soft bound low ≤ e ≤ high of price w costs ∫ w (max(low − e, 0) + max(e − high, 0)) dt, an exact
penalty: with slacks s ≥ 0, low ≤ e + s_below − s_above ≤ high and the running cost w (s_below +
s_above). Where w exceeds the bound's multiplier (per unit of time) the solution is that of the hard
bound; where it does not, the violation is where the rest of the cost gains w by it (Fletcher,
Practical Methods of Optimization, §12.3). `abs` and `max` get the rows of their epigraphs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.nlp.expressions import column, limits
from varint.scene.epigraph import Largest, largest_in, with_values


@dataclass(frozen=True, eq=False)
class Soft:
    """A bound that may be violated at a price; `soft` makes it."""

    expression: Any
    low: Any
    high: Any
    weight: float


def soft(expression: Any, low: Any, high: Any, weight: float) -> Soft:
    """A bound along the path that may be violated at a price, ∫ weight × violation dt.

    Parameters
    ----------
    expression : SX (k,)
        Of q, v, controls, t and parameters; it is held at the quadrature nodes.
    low, high : float, array (k,) or None
        The bounds; None is no bound.
    weight : float
        Price of a violation of one during a unit of time. Above the multiplier of the hard bound
        the hard solution is found, as far as it exists.

    Returns
    -------
    Soft
        An entry of ``bounds=[…]``. The solution's ``stats["softened"]`` has the largest violation
        of every soft bound that is violated, by name.

    Raises
    ------
    InputError
        If the weight is not positive.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> move = vi.optimal_control(
    ...     cart, vi.gauss(3), duration=1, steps=20, cost=force**2, start=dict(q=[0], v=[0]),
    ...     end=dict(q=[1], v=[0]), bounds=[vi.soft(v, None, 1.2, 30.0)])
    >>> move.stats["softened"]  # doctest: +ELLIPSIS
    {'x_dot above': 0.1...}
    """
    price = parsed_or_refused(
        lambda: float(weight), lambda: f"the weight of soft must be a number, got {weight!r}"
    )
    if not (np.isfinite(price) and price > 0):
        raise InputError(f"the weight of soft must be positive and finite, got {weight!r}")
    return Soft(expression, low, high, price)


@dataclass(frozen=True, eq=False)
class Slacks:
    """Unknowns at every node, and what holds for them there.

    Attributes
    ----------
    symbols : SX (w,)
    low : ndarray (w,)
        Their lower bounds.
    rows, rows_low, rows_high : SX (e,), ndarray (e,), ndarray (e,)
        Rows that tie them to the path.
    price : SX
        What they cost.
    values : SX (w,)
        What they are at a solution, in terms of the path.
    names : tuple of str
        What each of the first of them says of a soft bound.
    largest : list of Largest
        Those that stand for largest values.
    """

    symbols: ca.SX
    low: np.ndarray
    rows: ca.SX
    rows_low: np.ndarray
    rows_high: np.ndarray
    price: ca.SX
    values: ca.SX
    names: tuple[str, ...]
    largest: list[Largest]

    @property
    def count(self) -> int:
        """Number of unknowns at a node."""
        return self.symbols.numel()


def separate(bounds: Any) -> tuple[Any, list[Soft]]:
    """The hard bounds and the soft ones of a list."""
    if isinstance(bounds, Soft):
        return [], [bounds]
    if not isinstance(bounds, Sequence) or isinstance(bounds, (str, tuple)):
        return bounds, []
    return [b for b in bounds if not isinstance(b, Soft)], [
        b for b in bounds if isinstance(b, Soft)
    ]


def slacks(
    cost: ca.SX, soft_bounds: Sequence[Soft], path: ca.SX, rest: ca.SX, words: str
) -> Slacks:
    """The slacks of a cost and of soft bounds: expressions of the path, of time and parameters."""
    symbols, values, names = [], [], []
    rows: list[tuple[ca.SX, float, float]] = []
    price = ca.SX(0)
    for bound in soft_bounds:
        found = column("an expression in soft", bound.expression, ca.vertcat(path, rest), words)
        low, high = limits(str(found), bound.low, bound.high, found.numel())
        for x, a, b in zip(ca.vertsplit(found), low, high, strict=True):
            if not ca.depends_on(x, path):
                raise InputError(f"the soft bound on {x} does not depend on the path")
            held = x
            for side, limit, sign in (("below", a, 1), ("above", b, -1)):
                if np.isfinite(limit):
                    slack = ca.SX.sym(f"{x} {side}")
                    held = held + sign * slack
                    price += bound.weight * slack
                    symbols.append(slack)
                    values.append(ca.fmax(sign * (limit - x), 0))
                    names.append(f"{x} {side}")
            if np.isfinite(a) or np.isfinite(b):
                rows.append((held, a, b))
    largest = largest_in(cost)
    allowed = ca.vertcat(path, rest, *(x.symbol for x in largest))
    for one in largest:
        for argument in one.arguments:
            column(one.symbol.name(), argument, allowed, words)
            if not argument.is_constant():
                rows.append((one.symbol - argument, 0.0, np.inf))
        symbols.append(one.symbol)
        values.append(with_values(largest, one.symbol))
    expressions, lows, highs = ([row[i] for row in rows] for i in range(3))
    return Slacks(
        symbols=ca.vertcat(ca.SX(0, 1), *symbols),
        low=np.array([0.0] * len(names) + [_least(one) for one in largest]),
        rows=ca.vertcat(ca.SX(0, 1), *expressions),
        rows_low=np.array(lows, dtype=float),
        rows_high=np.array(highs, dtype=float),
        price=price,
        values=ca.vertcat(ca.SX(0, 1), *values),
        names=tuple(names),
        largest=largest,
    )


def _least(one: Largest) -> float:
    """The largest of its constant arguments: a plain bound instead of rows."""
    return max([-np.inf, *(float(x) for x in one.arguments if x.is_constant())])


def refuse_concave(what: str, cost: ca.SX, found: Slacks, c: ca.SX, values: np.ndarray) -> None:
    """A cost, or an outer largest value, that falls with a largest value has no smooth split."""
    for one in found.largest:
        outer = [x for other in found.largest for x in other.arguments]
        slope = ca.jacobian(ca.vertcat(cost, *outer), one.symbol)
        if {x.element_hash() for x in ca.symvar(slope)} - {x.element_hash() for x in ca.symvar(c)}:
            continue  # judged at the solution
        at = np.array(ca.Function("slope", [c], [ca.densify(slope)])(values))
        if (at < 0).any():
            raise InputError(
                f"{what} falls with {one.symbol.name()}: vi.abs and vi.max must stand where the "
                "cost grows with them (a convex cost), not with a minus sign"
            )
