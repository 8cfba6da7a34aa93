"""States beside the mechanics: a mass that burns, the energy of a battery.

A control x that is declared a state obeys dx/dt = f(q, v, u, t), collocated at the nodes of the
rule: with x_k at the node of the path and X_i at the quadrature nodes c_i,

    X_i = x_k + h Σ_j a_ij f_j,    x_{k+1} = x_k + h Σ_i b_i f_i.

For `gauss` these are the Gauss stages, the same discretisation as that of the mechanics; so the
order is the rule's (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, §II.7). The
force, the cost and the bounds see X_i where they see controls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.nlp.expressions import scalar
from varint.scene.parameters import pairs
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class States:
    """The controls that are states.

    Attributes
    ----------
    index : ndarray of int (m,)
        Which controls they are.
    rates : SX (m,)
        Their rates f, expressions of q, v, u, t, c.
    """

    index: np.ndarray
    rates: ca.SX

    def symbols(self, system: System) -> ca.SX:
        """Their symbols (m,)."""
        return ca.vertcat(ca.SX(0, 1), *(system.control[int(i)] for i in self.index))

    def names(self, system: System) -> tuple[str, ...]:
        """Their names."""
        return tuple(system.control_names[i] for i in self.index)


def check_states(system: System, given: Any, control: str) -> States:
    """The states as the user wrote them, {symbol: rate}."""
    s = system
    places = {x.element_hash(): i for i, x in enumerate(ca.vertsplit(s.control))}
    allowed = ca.vertcat(s.q, s.v, s.control, s.t, s.c)
    index, rates = [], []
    for symbol, rate in pairs("states", given or {}, "a dictionary of controls and their rates"):
        place = places.get(symbol.element_hash()) if _is_symbol(symbol) else None
        if place is None:
            raise InputError(
                f"states= takes controls of the system, {list(s.control_names)}, with their "
                f"rates; got {symbol!r}"
            )
        if place in index:
            raise InputError(f"states= has two rates for {s.control_names[place]!r}; give one")
        index.append(place)
        words = "q, v, the controls, t and the parameters"
        rates.append(scalar(f"the rate of {s.control_names[place]}", rate, allowed, words))
    if index and control != "nodes":
        raise InputError(f'states need a value at every node: control="nodes", not {control!r}')
    order = np.argsort(index)
    return States(
        np.array(index, dtype=int)[order], ca.vertcat(ca.SX(0, 1), *(rates[i] for i in order))
    )


def _is_symbol(x: Any) -> bool:
    return isinstance(x, ca.SX) and x.numel() == 1 and x.is_symbolic()
