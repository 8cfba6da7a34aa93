"""Powers that are no whole ones and begin at a switch, as of a contact ``fmax(0, x)**1.5``: behind
it forces grow by (t − t0)ⁿ, which no polynomial follows, and a step that begins or ends there errs
by its power n + 1 alone, whatever the order of its rule.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import over_columns
from varint.numerics.operations import operations_of, values_of
from varint.scene.memory import per_system
from varint.scene.system import System

NOTHING = 1e-6  # of the largest base on the way: it is zero there
SPARED = 0.5  # of the order: where nodes lie beside the switch varies from run to run


class Fractional(NamedTuple):
    """Bases of such powers, by (q, v, t, c), and orders that steps from their zeros have."""

    bases: ca.Function
    orders: np.ndarray


def order_at_switches(course: Course, pieces: Sequence[Piece]) -> float:
    """The order that steps at switches leave; infinite where no power begins there."""
    known = _fractional(course.system)
    if known is None:
        return math.inf
    at_ends, largest = np.full(len(known.orders), np.inf), np.zeros(len(known.orders))
    for piece in pieces:
        q, _, v = piece.states.transpose(1, 0, 2)
        c = all_parameters(course.problem.c, piece.branch)
        found = np.abs(over_columns(known.bases, q, v, piece.t[:, None], c)[0])
        some = found.max(axis=0, initial=0.0, where=np.isfinite(found))
        ends = np.where(some > 0, found[[0, -1]].min(axis=0), np.inf)
        at_ends, largest = np.fmin(at_ends, ends), np.maximum(largest, some)
    return float(known.orders[at_ends <= NOTHING * largest].min(initial=np.inf))


@per_system
def _fractional(system: System) -> Fractional | None:
    """None where the smooth scene has none that depend on the motion."""
    frozen = frozen_scene(system)
    assert frozen is not None
    s = frozen.system
    inputs, moving = [s.q, s.v, s.t, s.c], ca.vertcat(s.q, s.v, s.t)
    bases, orders = list[ca.SX](), list[float]()
    for part, more in ((s.lagrangian, 0.0), (ca.densify(s.force), 1.0)):
        nodes = operations_of(ca.Function("part", inputs, [part])).nodes
        values = values_of(nodes, inputs)
        for name, *taken in nodes:
            exponent = 0.5 if name == "sqrt" else _exponent(nodes, name, taken)
            if exponent is not None and ca.depends_on(values[taken[0]], moving):
                bases.append(values[taken[0]])
                orders.append(exponent + more - SPARED)
    if not bases:
        return None
    row = ca.densify(ca.horzcat(*bases))
    return Fractional(ca.Function("bases", inputs, [row], {"cse": True}), np.array(orders))


def _exponent(nodes: list[tuple], name: str, taken: list[int]) -> float | None:
    """That of a power that is no whole one."""
    if name not in ("pow", "constpow"):
        return None
    kind, *value = nodes[taken[1]]
    if kind != "const":
        return 1.0
    return None if float(value[0]).is_integer() else float(value[0])
