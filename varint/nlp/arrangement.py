"""How a solver sees a program: units of its unknowns and rows, and the order they come in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from varint.nlp.program import NonlinearProgram, Program


@dataclass(frozen=True, eq=False)
class Scales:
    """Sizes of the unknowns; factors of the cost and of the rows."""

    x: np.ndarray
    f: float
    g: np.ndarray

    @property
    def natural(self) -> bool:
        """Is there nothing to scale?"""
        return bool((self.x == 1).all() and self.f == 1 and (self.g == 1).all())


@dataclass(frozen=True, eq=False)
class Arrangement:
    """A program in unknowns z of its own order, and how z and its rows belong to those of the
    problem.

    Attributes
    ----------
    program : Program
        Value and derivatives in z; the constants are those of the problem.
    source : ndarray of int
        The unknown of the problem that starts z_i; −1 for none.
    bounded : ndarray of bool
        Does z_i carry the bounds of its source?
    row : ndarray of int
        The row of the problem whose bounds hold here; −1: the row is zero.
    x, g : ndarray of int
        Where the problem's unknowns are found in z, and its rows among these rows.
    start : callable
        (x, constants) → z.
    momenta, momentum : ndarray of int (N + 1, n), (n,)
        Where p_k sits in z; rows of the problem that have its units.
    started : ndarray of int (n,)
        The rows ∂L/∂v(q_0, v_0) − p_0.
    dynamics, states : ndarray of int (N, states)
        The rows x_{k+1} − F, and x_{k+1}, whose units are theirs.
    options : dict
        Sizes of the stages, for the solver.
    """

    program: Program
    source: np.ndarray
    bounded: np.ndarray
    row: np.ndarray
    x: np.ndarray
    g: np.ndarray
    start: Callable[[np.ndarray, np.ndarray], np.ndarray]
    momenta: np.ndarray
    momentum: np.ndarray
    started: np.ndarray
    dynamics: np.ndarray
    states: np.ndarray
    options: Mapping[str, Any] = field(default_factory=dict)

    def scales(self, x: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sizes of z and factors of the rows, from those of the problem."""
        size, factor = x[self.source], np.append(g, 1.0)[self.row]
        if self.momenta.size:
            size[self.momenta] = 1 / g[self.momentum]
            factor[self.started] = g[self.momentum]
            factor[self.dynamics] = 1 / size[self.states]
        return size, factor


def plain_order(nlp: NonlinearProgram) -> Arrangement:
    """The program as it is."""
    x, g, none = np.arange(nlp.unknowns), np.arange(nlp.rows), np.zeros((0, 0), dtype=int)
    every = np.ones(len(x), dtype=bool)
    return Arrangement(
        nlp.program, x, every, g, x, g, lambda start, _: start, none, none, none, none, none
    )


def natural_scales(nlp: NonlinearProgram) -> Scales:
    """Units of one, for a program of whose sizes nothing is known."""
    return Scales(np.ones(nlp.unknowns), 1.0, np.ones(nlp.rows))
