"""One branch of a scene with switches: the smooth scene that moves there, how far each switch is,
and what it does next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.rows import RowFunction, row_function_or_none
from varint.discrete.constraints import ActiveSet, velocity_rows
from varint.integration.switches.accelerations import acceleration, push_without_force, rate_of
from varint.integration.switches.frozen import FrozenScene, frozen_scene, with_force
from varint.integration.switches.holding import force_by_numbers, held_force
from varint.integration.switches.timetable import timed
from varint.numerics.arrays import call, over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

DERIVATIVES = 3  # in time of what switches, that tell on which side the motion goes on
MANY = 3  # switches that may hold a motion, in 2³ ways
SOME, APART = 3, 1e-9  # states and smallest singular value by which directions are told apart
SEEN = 30_000  # operations of an acceleration at most
SHORT = 5_000  # operations of a function that is soon data
ROUNDED = 64 * np.finfo(float).eps  # of what a switch can hold: at its end it still does


class Branch(NamedTuple):
    """The numbers behind all switches, those that hold the motion, the controls, and the contacts
    that hold, in scenes that have any.
    """

    values: tuple[float, ...]
    sliding: tuple[int, ...] = ()
    controls: tuple[float, ...] = ()
    active_set: ActiveSet | None = None


@dataclass(frozen=True, eq=False)
class BranchScene:
    """What moves while the same switches hold the motion.

    Attributes
    ----------
    system : System
        Its parameters are those of the scene and the numbers behind the switches.
    watched : tuple of (int, float)
        Switch and what its number is beyond (a change of ±1 where it counts), of each margin;
        −1 − i for contact i.
    margins : Function
        (q, v, t, c) → margins, positive in the branch, and their rates.
    ahead : Function
        (q, v, t, c) → what switches, (m,), and its rate.
    shares : Function
        (q, v, t, c) → how much of the upper branch switches have that hold or may hold.
    rows : tuple of int
        Which of these are of those that hold.
    """

    system: System
    watched: tuple[tuple[int, float], ...]
    margins: ca.Function
    ahead: ca.Function
    shares: ca.Function
    rows: tuple[int, ...]

    def margins_along(
        self, c: np.ndarray, q: np.ndarray, v: np.ndarray, t: np.ndarray
    ) -> list[np.ndarray]:
        """Margins and their rates, (M, margins) each, at q and v (M, n) and t (M, 1)."""
        if self.margin_rows is None:
            return over_columns(self.margins, q, v, t, c)
        return self.margin_rows.values(c, q, v, t)

    @cached_property
    def margin_rows(self) -> RowFunction | None:
        """`margins` as data, where that has few operations."""
        return _as_rows(self.system, self.margins)

    @cached_property
    def ahead_rows(self) -> RowFunction | None:
        """`ahead` as data, where that has few operations."""
        return _as_rows(self.system, self.ahead)

    def shares_at(self, *arguments: np.ndarray) -> np.ndarray:
        """The shares of the switches that hold, at (q, v, t, c)."""
        return call(self.shares, *arguments)[0][list(self.rows)]


@per_system
def slidable(system: System) -> tuple[int, ...]:
    """Switches that may hold the motion: of velocities, by forces alone, and by none of the other
    switches.
    """
    frozen = _frozen(system)
    found = []
    for j in range(frozen.s.numel()):
        s = frozen.s[j]
        if frozen.counts[j] or not ca.depends_on(frozen.sigma[j], system.v):
            continue
        if not ca.depends_on(ca.vertcat(frozen.system.lagrangian, frozen.sigma), s):
            found.append(j)
    return tuple(found)


@per_system
def _slopes_somewhere(system: System) -> list[tuple[np.ndarray, np.ndarray]]:
    """Gradients by velocities of rows and of what switches, at some random states."""
    frozen = _frozen(system)
    s, random = frozen.system, np.random.default_rng(1)
    x = [ca.jacobian(y, s.v) for y in (velocity_rows(s), frozen.sigma)]
    function, found = _function("slopes", [s.q, s.v, s.t, s.c], x), []
    for _ in range(SOME):
        at = [random.uniform(0.1, 1.0, y.numel()) for y in (s.q, s.v, s.t)]
        rows, sigma = (np.array(y) for y in function(*at, s.default_vector))
        found.append((rows, sigma))
    return found


@per_system
def hold_apart(system: System, sliding: tuple[int, ...]) -> bool:
    """Whether each of some switches holds the motion in a direction of its own, that neither
    constraints nor the others do: if not, it is not determined how much each of them holds.
    """
    for rows, sigma in _slopes_somewhere(system):
        own = sigma[list(sliding)]
        size = np.linalg.norm(own, axis=1, keepdims=True)
        every = np.vstack([rows, own / np.where(size > 0, size, 1)])
        before = np.linalg.matrix_rank(rows) if len(rows) else 0
        if np.linalg.matrix_rank(every, tol=APART) == before + len(sliding):
            return True
    return False


@per_system
def passed_straight(system: System) -> tuple[int, ...]:
    """Switches of coordinates and time that none of the others knows of: the motion comes out on
    the other side, whatever the forces.
    """
    frozen, found = _frozen(system), []
    for j in range(frozen.s.numel()):
        alone = not ca.depends_on(frozen.sigma, frozen.s[j])
        if alone and not frozen.counts[j] and not ca.depends_on(frozen.sigma[j], system.v):
            found.append(j)
    return tuple(found)


@per_system
def branch_scene(system: System, sliding: tuple[int, ...] = ()) -> BranchScene | None:
    """The scene that moves while these switches hold the motion; None where it is not known."""
    frozen = _frozen(system)
    if not sliding:
        return _watched(system, frozen.system, {})
    if not set(sliding) <= set(slidable(system)):
        return _resting(system)
    if many_may_hold(system):
        every = _any_held(system)
        return every and _of_those(every, slidable(system), sliding)
    force = held_force(frozen, sliding)
    if force is None:
        return None
    shares = dict(zip(sliding, ca.vertsplit(force[1]), strict=True))
    return _watched(system, with_force(frozen.system, force[0]), shares, sliding)


@per_system
def _resting(system: System) -> BranchScene:
    """The scene of one coordinate in which nothing pushes, at rest where switches meet that hold it
    together.
    """
    s = _frozen(system).system
    moving = with_force(s, -push_without_force(s))
    inputs, nothing = [s.q, s.v, s.t, s.c], ca.SX(0, 1)
    sigma = _frozen(system).sigma
    margins, ahead, shares = (
        _function("resting", inputs, outputs)
        for outputs in ([nothing, nothing], [sigma, 0 * sigma], [nothing])
    )
    return BranchScene(moving, (), margins, ahead, shares, ())


@per_system
def many_may_hold(system: System) -> bool:
    """Whether so many switches may hold a motion, in so many ways, that all of them are one scene
    in which the numbers behind the switches tell which do.
    """
    return len(slidable(system)) >= MANY and not system.structure.diagonal_mass


@per_system
def _any_held(system: System) -> BranchScene | None:
    """The scene in which any of the switches hold the motion: of each that may there are two
    margins, its own and a one where it is free, those of its share where it holds.
    """
    frozen, may_hold = _frozen(system), slidable(system)
    force = force_by_numbers(frozen, may_hold)
    if force is None:
        return None
    shares = dict(zip(may_hold, ca.vertsplit(force[1]), strict=True))
    return _watched(system, with_force(frozen.system, force[0]), shares)


def _of_those(every: BranchScene, may_hold: Sequence[int], sliding: Sequence[int]) -> BranchScene:
    """The scene of all switches that may hold, where these do."""
    watched = list(every.watched)
    for place in range(0, 2 * len(may_hold), 2):
        j = watched[place][0]
        watched[place] = (j, -1.0 if j in sliding else 0.0)
    rows = tuple(may_hold.index(j) for j in sliding)
    return replace(every, watched=tuple(watched), rows=rows)


def _watched(
    system: System, moving: System, shares: dict[int, ca.SX], sliding: tuple[int, ...] = ()
) -> BranchScene | None:
    """A scene that moves, with what ends its branch."""
    frozen, a = _frozen(system), acceleration(moving, moving.force)
    if a is None or ca.Function("a", ca.symvar(a), [a]).n_instructions() > SEEN:
        return None
    inputs, clocks = [moving.q, moving.v, moving.t, moving.c], set(timed(system).places)
    watched: list[tuple[int, float]] = []
    margins = []
    for j, x in shares.items():
        s, sigma = frozen.s[j], frozen.sigma[j]
        holds = 1 if j in sliding else 1 - s**2
        margins += [
            holds * (x + ROUNDED) + (1 - holds) * s * sigma,
            holds * (1 - x + ROUNDED) + (1 - holds),
        ]
        watched += [(j, -1.0), (j, 1.0)]
    for j in range(frozen.s.numel()):
        s, sigma = frozen.s[j], frozen.sigma[j]
        if j in clocks or j in shares:
            continue
        if frozen.counts[j]:
            margins += [sigma - s, s + 1 - sigma]
            watched += [(j, -1.0), (j, 1.0)]
        else:
            margins.append(s * sigma)
            watched.append((j, 0.0))
    margin = ca.vertcat(ca.SX(0, 1), *margins)
    rate = rate_of(moving, frozen.sigma, a)
    margins_at, ahead, shares_at = (
        _function(name, inputs, outputs)
        for name, outputs in (
            ("margins", [margin, rate_of(moving, margin, a)]),
            ("ahead", [frozen.sigma, rate]),
            ("shares", [ca.vertcat(ca.SX(0, 1), *shares.values())]),
        )
    )
    rows = tuple(range(len(sliding)))
    return BranchScene(moving, tuple(watched), margins_at, ahead, shares_at, rows)


@per_system
def slope_size(system: System, switch: int) -> int:
    """Operations of the slopes ∂F/∂(q, v) while this switch holds the motion."""
    scene = branch_scene(system, (switch,))
    if scene is None:
        return 0
    s = scene.system
    slopes = ca.jacobian(s.force, ca.vertcat(s.q, s.v))
    return int(
        ca.Function("slopes", [s.q, s.v, s.t, s.c], [slopes], {"cse": True}).n_instructions()
    )


@per_system
def later_rates(system: System, sliding: tuple[int, ...], order: int) -> ca.Function:
    """(q, v, t, c) → a derivative in time of what switches, of this order."""
    frozen, scene = _frozen(system), branch_scene(system, sliding)
    assert scene is not None
    moving, rate = scene.system, frozen.sigma
    a = acceleration(moving, moving.force)
    assert a is not None
    for _ in range(order):
        rate = rate_of(moving, rate, a)
    return _function("later", [moving.q, moving.v, moving.t, moving.c], [rate])


def _as_rows(system: System, function: ca.Function) -> RowFunction | None:
    """A function of (q, v, t, c) as data."""
    s = system
    if function.n_instructions() > SHORT:
        return None
    found = function(s.q, s.v, s.t, s.c)
    return row_function_or_none(function.name(), [s.q, s.v, s.t], s.c, list(found))


def _function(name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ca.Function:
    return ca.Function(name, list(inputs), [ca.densify(x) for x in outputs], {"cse": True})


def _frozen(system: System) -> FrozenScene:
    found = frozen_scene(system)
    assert found is not None
    return found
