"""Powers that are no whole ones and begin at a switch, as of a contact ``fmax(0, x)**1.5``: behind
it forces grow by (t − t0)ⁿ, which no polynomial follows, and a step that begins or ends there errs
by its power n + 1 alone, whatever the order of its rule. Such steps are halved towards the switch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from random import Random
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.switches.branch import Branch
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import FrozenScene, frozen_scene
from varint.numerics.arrays import over_columns
from varint.numerics.operations import operations_of, values_of
from varint.numerics.places import normal_numbers
from varint.scene.memory import per_system
from varint.scene.system import System

NOTHING = 1e-6  # of the largest base on the way: it is zero there
SPARED = 0.5  # of the order: where nodes lie beside the switch varies from run to run
PLACES, NEARER, SEEN, ALIKE = 32, 4, 3, 1e-9  # looks, of so many sizes; of the same ratio, relative
# of a step; digits, of two, beside those that are wanted; of what these leave, for all runs alike
MOST_HALVINGS, BITS, LEFT = 40, 14, 4.0


STIFF = 2.0  # order of steps beside a force that grows linearly


class Fractional(NamedTuple):
    """Bases of such powers, by (q, v, t, c); by which power of its size a step that begins or ends
    at a zero of theirs errs; and which of them, (base, switch, side), are zero exactly where a
    switch is, seen from this side.
    """

    bases: ca.Function
    orders: np.ndarray
    meet: frozenset[tuple[int, int, float]]


def halvings(course: Course, branch: Branch) -> int:
    """How often steps that begin or end at the switches of a branch are halved towards them; 0
    where no powers begin, or steps are given.
    """
    least = _least_order(course, branch)
    if not math.isfinite(least) or course.grid is not None:
        return 0
    return min(math.ceil((BITS - math.log2(course.tol)) / least), MOST_HALVINGS)


def stiff_at_first(course: Course, branch: Branch) -> bool:
    """Whether stiffness is infinite at a switch of a branch, as of a contact by powers below one:
    its small motions there tell nothing.
    """
    return _least_order(course, branch) < STIFF


def _least_order(course: Course, branch: Branch) -> float:
    """Of steps beside the switches of a branch; infinite where no power begins."""
    known = _fractional(course.system)
    if known is None:
        return math.inf
    met = (known.orders[k] for k, j, side in known.meet if branch.values[j] == side)
    return float(min(met, default=math.inf))


def left_by_halvings(course: Course, pieces: Sequence[Piece]) -> float:
    """What steps that are halved towards switches err by, which is the same in all runs."""
    ends = sum(halvings(course, piece.branch) > 0 for piece in pieces)
    return LEFT * ends * course.tol * 2.0**-BITS


def order_at_switches(course: Course, pieces: Sequence[Piece]) -> float:
    """The order that steps at switches leave, where they are not halved towards them; infinite
    where no power begins there.
    """
    known = _fractional(course.system)
    if known is None:
        return math.inf
    orders = known.orders - SPARED
    orders[[k for k, _, _ in known.meet]] = math.inf
    at_ends, largest = np.full(len(orders), np.inf), np.zeros(len(orders))
    for piece in pieces:
        q, _, v = piece.states.transpose(1, 0, 2)
        c = all_parameters(course.problem.c, piece.branch)
        found = np.abs(over_columns(known.bases, q, v, piece.t[:, None], c)[0])
        some = found.max(axis=0, initial=0.0, where=np.isfinite(found))
        ends = np.where(some > 0, found[[0, -1]].min(axis=0), np.inf)
        at_ends, largest = np.fmin(at_ends, ends), np.maximum(largest, some)
    return float(orders[at_ends <= NOTHING * largest].min(initial=np.inf))


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
                orders.append(exponent + more)
    if not bases:
        return None
    row = ca.densify(ca.horzcat(*bases))
    function = ca.Function("bases", inputs, [row], {"cse": True})
    return Fractional(function, np.array(orders), _met(frozen, row))


def _met(frozen: FrozenScene, row: ca.SX) -> frozenset[tuple[int, int, float]]:
    """Which bases are, beside what switches, of one ratio wherever they are not zero: by looks at
    some places, on the branch that each lies on.
    """
    s, m = frozen.system, frozen.s.numel()
    look = ca.Function("look", [s.q, s.v, s.t, s.c], [row, ca.densify(frozen.sigma)])
    random, c = Random(1), s.default_vector.copy()
    ratios: dict[tuple[int, int, float], list[float]] = {}
    for place in range(PLACES):
        size = 0.1 ** (place % NEARER)
        at = [size * normal_numbers(random, x.numel()) for x in (s.q, s.v, s.t)]
        for _ in range(1 + m):  # switches may depend on those before
            base, sigma = (np.array(x).ravel() for x in look(*at, c))
            c[-m:] = np.sign(sigma)
        for k in np.flatnonzero(np.isfinite(base) & (base != 0)).tolist():
            for j in np.flatnonzero(~frozen.counts & (sigma != 0)).tolist():
                seen = ratios.setdefault((k, j, float(np.sign(sigma[j]))), [])
                seen.append(base[k] / sigma[j])
    return frozenset(
        x
        for x, seen in ratios.items()
        if len(seen) >= SEEN and np.ptp(seen) <= ALIKE * abs(seen[0])
    )


def _exponent(nodes: list[tuple], name: str, taken: list[int]) -> float | None:
    """That of a power that is no whole one."""
    if name not in ("pow", "constpow"):
        return None
    kind, *value = nodes[taken[1]]
    if kind != "const":
        return 1.0
    return None if float(value[0]).is_integer() else float(value[0])
