"""Kick and drift weights of the explicit compositions, in decimal arithmetic.

Each entry is a function returning (order, kicks, drifts): kick, drift, kick, …, drift, kick. Symmetric sequences are
given by their first half; what consistency fixes is computed, not tabulated.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext

D = Decimal
Sequence = tuple[int, list[Decimal], list[Decimal]]


def _of_verlet(order: int, gammas: list[Decimal]) -> Sequence:
    """Composition of Störmer–Verlet steps of lengths γ_1 h, γ_2 h, …: neighbouring half kicks merge."""
    ends = [D(0), *gammas, D(0)]
    return order, [(a + b) / 2 for a, b in zip(ends, ends[1:], strict=False)], list(gammas)


def _symmetric(half: list[Decimal]) -> list[Decimal]:
    """γ_1 … γ_m, the middle one that makes the sum 1, and the first half again backwards."""
    return [*half, 1 - 2 * sum(half), *reversed(half)]


def _verlet() -> Sequence:
    return _of_verlet(2, [D(1)])


def _yoshida4() -> Sequence:
    with localcontext() as context:
        context.prec = 50
        return _of_verlet(4, _symmetric([1 / (2 - D(2) ** (D(1) / 3))]))


def _suzuki4() -> Sequence:
    with localcontext() as context:
        context.prec = 50
        gamma = 1 / (4 - D(4) ** (D(1) / 3))
        return _of_verlet(4, _symmetric([gamma, gamma]))


COMPOSITIONS: dict[str, Callable[[], Sequence]] = {
    "verlet": _verlet,
    "yoshida4": _yoshida4,
    "suzuki4": _suzuki4,
}
