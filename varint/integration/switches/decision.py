"""On which branch a motion goes on from a switch: the one into which it leads, or the switch
itself where every one of them leads back to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import casadi as ca
import numpy as np

from varint.integration.switches.branch import (
    DERIVATIVES,
    ROUNDED,
    Branch,
    branch_scene,
    hold_apart,
    later_rates,
    slidable,
)
from varint.integration.switches.complementarity import numbers_at_zero
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import call
from varint.results.records import State
from varint.scene.memory import per_system
from varint.scene.system import System

MOST_AT_ONCE = 40  # switches at one instant
ALL = 3  # of them of which every combination is tried
MOST_NESTED = 40  # times that a switch may change what another one switches by
BETWEEN = 1e-9  # beyond the shares 0 and 1, by round-off


def decide(
    system: System,
    state: State,
    c: np.ndarray,
    direction: float,
    branch: Branch,
    open_ones: Sequence[int],
    fixed: Sequence[int],
) -> Branch | None:
    """The branch on which the motion goes on; None where none is known, or more than one.

    Parameters
    ----------
    system : System
        The user's scene.
    state : State
    c : array
        Parameters of the user's scene.
    direction : float
        Sign of the steps.
    branch : Branch
        Numbers behind the switches that are not at zero, as far as known.
    open_ones : sequence of int
        Switches at zero, those that held the motion included.
    fixed : sequence of int
        Switches whose numbers are known whatever they are signs of.
    """
    frozen = frozen_scene(system)
    assert frozen is not None
    at_zero = [j for j in open_ones if j not in fixed]
    if len(at_zero) > MOST_AT_ONCE:
        return None
    found: list[Branch] = []
    may_hold = [j for j in slidable(system) if j in at_zero]
    if len(may_hold) > 1 or set(may_hold) & set(branch.sliding):
        known = (*at_zero, *fixed)
        one = _held_together(system, state, c, direction, branch, may_hold, known)
        if one and _fits(system, state, c, direction, one, at_zero)[0]:
            return one
    if len(at_zero) > ALL:
        return None
    for one in _candidates(system, branch, at_zero, frozen.counts, state, c):
        settled = _settled(system, state, c, one, (*at_zero, *fixed))
        if settled is None or settled in found:
            continue
        fits, strictly = _fits(system, state, c, direction, settled, at_zero)
        if fits and (settled.sliding or not strictly):
            return found[0] if found else settled
        if fits:
            found.append(settled)
    return found[0] if len(found) == 1 else None


def decided_alone(
    system: System, state: State, c: np.ndarray, direction: float, branch: Branch, switch: int
) -> Branch | None:
    """The branch where one switch that may hold the motion is at zero, and no other: through it
    where both sides push the same way, held where both push back, or one does and the other does
    not push; None where they do neither.
    """
    below, above = call(_both_sides(system, switch), *_arguments(state, c, branch))[0] * direction
    values = list(branch.values)
    values[switch] = 1.0 if above > 0 else -1.0
    least = ROUNDED * max(abs(below), abs(above))
    if below * above > 0 and min(abs(below), abs(above)) > least:
        return branch._replace(values=tuple(values))
    if not (below >= -least and above <= least and below > above):
        return None
    values[switch] = 0.0
    return branch._replace(values=tuple(values), sliding=(switch,))


@per_system
def _both_sides(system: System, switch: int) -> ca.Function:
    """(q, v, t, c) → rates of what switches, below and above it."""
    frozen, scene = frozen_scene(system), branch_scene(system)
    assert frozen is not None and scene is not None
    s = frozen.system
    inputs, number = [s.q, s.v, s.t, s.c], frozen.s[switch]
    rate = scene.ahead(*inputs)[1][switch]
    sides = [ca.substitute(rate, number, ca.SX(x)) for x in (-1.0, 1.0)]
    return ca.Function("sides", inputs, [ca.densify(ca.vertcat(*sides))], {"cse": True})


def _held_together(
    system: System,
    state: State,
    c: np.ndarray,
    direction: float,
    branch: Branch,
    may_hold: Sequence[int],
    known: Sequence[int],
) -> Branch | None:
    """Those that hold the motion do, and the others give way to the side to which they are
    pulled.
    """
    inputs = _arguments(state, c, branch)
    x = numbers_at_zero(system, branch.values, may_hold, direction, inputs)
    if x is None:
        return None
    inside = np.abs(x) < 1
    values = np.array(branch.values)
    values[list(may_hold)] = np.where(inside, 0.0, x)
    held = tuple(j for j, holds in zip(may_hold, inside, strict=True) if holds)
    if not hold_apart(system, held):
        return None
    one = branch._replace(values=tuple(values.tolist()), sliding=held)
    return _settled(system, state, c, one, known)


def _candidates(
    system: System,
    branch: Branch,
    at_zero: Sequence[int],
    counts: np.ndarray,
    state: State,
    c: np.ndarray,
) -> Iterator[Branch]:
    """Branches to try: those in which what held the motion still does, then those in which nothing
    does, then more and more.
    """
    may_hold = [j for j in slidable(system) if j in at_zero]
    held = tuple(j for j in branch.sliding if j in at_zero)
    some = [x for size in range(len(may_hold) + 1) for x in combinations(may_hold, size)]
    order = [held, *(x for x in some if x != held)] if held else some
    found = ahead_at(system, state, c, branch._replace(sliding=()))
    assert found is not None
    sigma = found[0]
    for sliding in order:
        if not hold_apart(system, sliding):
            continue
        free = [j for j in at_zero if j not in sliding]
        sides = []
        for j in free:
            if counts[j]:
                nearest = float(np.round(sigma[j]))
                sides.append((nearest, nearest - 1))
            else:
                before = branch.values[j] or 1.0
                sides.append((-before, before))
        for chosen in product(*sides):
            values = list(branch.values)
            for j in sliding:
                values[j] = 0.0
            for j, x in zip(free, chosen, strict=True):
                values[j] = x
            yield branch._replace(values=tuple(values), sliding=sliding)


def _settled(
    system: System, state: State, c: np.ndarray, branch: Branch, known: Sequence[int]
) -> Branch | None:
    """The branch with the numbers of all other switches as they are there."""
    frozen = frozen_scene(system)
    assert frozen is not None
    for _ in range(MOST_NESTED):
        found = ahead_at(system, state, c, branch)
        if found is None:
            return None
        own = np.where(frozen.counts, np.floor(found[0]), np.sign(found[0]))
        values = list(branch.values)
        for j, x in enumerate(own):
            if j not in known and j not in branch.sliding and x != values[j]:
                values[j] = float(x) or values[j]
                if frozen.counts[j]:
                    values[j] = float(x)
        if tuple(values) == branch.values:
            return branch
        branch = branch._replace(values=tuple(values))
    return None


def _fits(
    system: System,
    state: State,
    c: np.ndarray,
    direction: float,
    branch: Branch,
    at_zero: Sequence[int],
) -> tuple[bool, bool]:
    """Whether the motion stays in the branch at first, and whether that is sure of all switches."""
    frozen = frozen_scene(system)
    assert frozen is not None
    found = ahead_at(system, state, c, branch)
    if found is None:
        return False, False
    strictly = True
    for j in at_zero:
        if j in branch.sliding:
            continue
        side = branch.values[j]
        if frozen.counts[j]:
            side = 1.0 if branch.values[j] == np.round(found[0][j]) else -1.0
        first, rests = float(found[1][j]) * direction, False
        if j in slidable(system) and len(at_zero) == 1:
            values = list(branch.values)
            values[j] = -side
            other = ahead_at(system, state, c, branch._replace(values=tuple(values)))
            # at the end of what it can hold
            push = 0.0 if other is None else abs(float(other[1][j]))
            rests = bool(push > 0 and abs(first) <= ROUNDED * push)
            if abs(first) <= BETWEEN * push:
                first = 0.0
        for order in range(2, DERIVATIVES + 1):
            if first != 0:
                break
            later = later_rates(system, branch.sliding, order)
            first = float(call(later, *_arguments(state, c, branch))[0][j]) * direction**order
        if not np.isfinite(first) or first * side < 0 or (rests and first == 0):
            return False, False
        strictly &= first != 0
    if branch.sliding:
        scene = branch_scene(system, branch.sliding)
        assert scene is not None
        share = scene.shares_at(*_arguments(state, c, branch))
        if not ((share >= -BETWEEN) & (share <= 1 + BETWEEN)).all():
            return False, False
        own = [i for i, (j, _) in enumerate(scene.watched) if j in branch.sliding]
        margin, rate = (x[own] for x in call(scene.margins, *_arguments(state, c, branch)))
        if ((margin <= BETWEEN) & (rate * direction < 0)).any():  # about to give way
            return False, False
    return True, strictly


def ahead_at(
    system: System, state: State, c: np.ndarray, branch: Branch
) -> list[np.ndarray] | None:
    """What switches and its rate on a branch; None where they are not known."""
    scene = branch_scene(system, branch.sliding)
    if scene is None:
        return None
    return call(scene.ahead, *_arguments(state, c, branch))


def _arguments(state: State, c: np.ndarray, branch: Branch) -> tuple[np.ndarray, ...]:
    return state.q, state.v, np.array([state.t]), all_parameters(c, branch)


def all_parameters(c: np.ndarray, branch: Branch) -> np.ndarray:
    """Those of the user's scene, then the controls, then the numbers behind the switches."""
    return np.concatenate([c, branch.controls, branch.values])
