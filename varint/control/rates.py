"""Rates of change of controls: which controls have them, and where they make sense."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.control_rate import rates_in
from varint.scene.epigraph import largest_in
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates that cost or bounds hold.

    Attributes
    ----------
    index : ndarray of int (m,)
        The controls whose rates they are.
    symbols : SX (m,)
    """

    index: np.ndarray
    symbols: ca.SX

    def controls(self, system: System) -> ca.SX:
        """The controls whose rates they are, (m,)."""
        return ca.vertcat(ca.SX(0, 1), *(system.control[int(i)] for i in self.index))


def check_rates(system: System, given: Sequence[Any], control: str) -> Rates:
    """The rates in what the user wrote of cost, bounds and integrals."""
    expressions = [x for part in given for x in _expressions(part)]
    places = {x.element_hash(): i for i, x in enumerate(ca.vertsplit(system.control))}
    index, symbols = [], []
    for rate, one in rates_in(*expressions):
        if one.element_hash() not in places:
            raise InputError(
                f"{rate} is the rate of {one}, which is no control of this system; its controls: "
                f"{list(system.control_names)}"
            )
        index.append(places[one.element_hash()])
        symbols.append(rate)
    if index and control == "nodes":
        raise InputError(
            f'control_rate needs control="linear" or "constant": controls with a value at every '
            f"node jump where steps meet, and {symbols[0]} is not defined there"
        )
    return Rates(np.array(index, dtype=int), ca.vertcat(ca.SX(0, 1), *symbols))


def _expressions(given: Any) -> Iterator[ca.SX]:
    """The SX expressions in numbers, tuples and lists of them."""
    if isinstance(given, ca.SX):
        yield given
        for one in largest_in(given):
            yield from one.arguments
    elif isinstance(given, (list, tuple)):
        for part in given:
            yield from _expressions(part)
