"""A run of few steps and a look at its energies in one call of c/few_steps_core.c."""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import few_steps_entry, rows_entry
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

if TYPE_CHECKING:
    from varint.codegen.sought import Sought

# FewSteps, what belongs to the loop and to what is asked; between them the place of the start
_LOOP, _ASKED = struct.Struct("6P9q"), struct.Struct("6P5q3d3Pq2P")
_PLACE, _TOLD = struct.Struct("3P"), struct.Struct("5d")
TOLD = 9  # numbers that there is room for where something is told
_FLOAT, _WHOLE = np.dtype(float), np.dtype(np.int64)


class Entries(NamedTuple):
    """Addresses of a loop and of a function of nodes, (q, p, t) → H, |p·v|, of its scene, and what
    lies there.
    """

    n: int
    carry: int
    scene: int
    run: int
    rows: int
    energy: int
    held: tuple


def entries_of(kernel: Kernel, energy: RowFunction) -> Entries:
    """Where they are.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (kernel.entry, rows_entry())
    run, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    return Entries(
        kernel.n, kernel.carry_size, kernel.scene, run, rows, energy.at, (kernel, energy)
    )


class Looks(NamedTuple):
    """How energies of nodes are looked at.

    Attributes
    ----------
    energy : RowFunction
        (q, p, t) → H, |p·v|; of scenes whose energy may change (q, p, t, u) → H and the power of
        what changes it. By velocity (q, v, t).
    by_velocity, works : bool
    limits : array
        Limits in c/few_steps_core.c.
    leaps : bool
        Whether energies may leap from one node to the next.
    pivots : RowFunction, optional
        (q, t) → the least pivot of constraint rows that may come to depend on one another.
    """

    energy: RowFunction
    by_velocity: bool
    works: bool
    limits: np.ndarray
    leaps: bool = False
    pivots: RowFunction | None = None


class FewSteps(NamedTuple):
    """A loop, as the core is told of it, and what lies there."""

    n: int
    head: bytes
    held: tuple


def few_steps_of(kernel: Kernel, looks: Looks) -> FewSteps:
    """How runs by a loop are made and looked at; raises as `entries_of`."""
    on, limits = entries_of(kernel, looks.energy), looks.limits
    counts = on.n, on.carry, FIXED_POINT_ITERATIONS, kernel.nodes, kernel.controls
    pivots = 0 if looks.pivots is None else looks.pivots.at
    places = on.run, on.scene, on.rows, on.energy, address_of(limits), pivots
    kinds = looks.by_velocity, looks.works, kernel.note[1], looks.leaps
    return FewSteps(on.n, _LOOP.pack(*places, *counts, *kinds), (on, looks))


class Place(NamedTuple):
    """Where a start lies, as the core is told of it, and the `TOLD` numbers that it tells."""

    head: bytes
    told: memoryview


def place_of(start: int, c: int, told_at: int, told: memoryview) -> Place:
    """Addresses of q and p at the start, of parameters, and of the numbers that are told, which are
    this memory.
    """
    return Place(_PLACE.pack(start, c, told_at), told)


Nodes = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def nodes_of(n: int, nodes: int, room: int = 0) -> tuple[int, Nodes]:
    """Memory in one piece for a run as the core writes it: its address; numbers, times, coordinates
    and momenta of the nodes, and room for so many more numbers behind.
    """
    block, size, both = np.empty(2 * nodes * (n + 1) + room), 8 * nodes, (nodes, n)
    array = np.ndarray  # half the time of slices
    return new_address(block), (
        array(nodes, _WHOLE, block, (2 * n + 1) * size),
        array(nodes, _FLOAT, block, 2 * n * size),
        array(both, _FLOAT, block),
        array(both, _FLOAT, block, n * size),
    )


class Controlled(NamedTuple):
    """Controls of a run.

    Attributes
    ----------
    u : array (steps, 1 or r, k)
        As they are given.
    each : array (steps, r, k)
        At the nodes of all steps.
    mean : array (steps, 1, k) or (steps, k)
        Their means over each.
    """

    u: np.ndarray
    each: np.ndarray
    mean: np.ndarray


# addresses of a function that tells typical sizes at so many nodes, and of memory for these
Typical = tuple[int, int]
UNTOLD: Typical = 0, 0


class Seen(NamedTuple):
    """What a run of few steps told.

    Attributes
    ----------
    nodes : tuple of array
        Numbers, times, coordinates and momenta, up to where it ends.
    iterations, residual : float
    quiet : bool
        Whether the energies of the nodes are.
    v : array, optional
        Velocities of the nodes, where they were asked for.
    zeros : array, optional
        What was sought, a row each; see `Sought`.
    """

    nodes: Nodes
    iterations: float
    residual: float
    quiet: bool
    v: np.ndarray | None
    zeros: np.ndarray | None


def few_steps(
    how: FewSteps,
    place: Place,
    asked: tuple[float, float, int, int, float, int],
    looked: tuple[int, int, np.ndarray],
    controlled: Controlled | None,
    opening: np.ndarray | None,
    moving: bool = False,
    sought: tuple[Sought, np.ndarray, Typical] | None = None,
) -> Seen | None:
    """The motion from a start; None where a step cannot be solved, or another loop or search should
    go on.

    Parameters
    ----------
    how : FewSteps
    place : Place
        The start, and parameters.
    asked : tuple
        t0, h, steps, how many of them lie between two nodes that are kept, where iterations stop,
        and after how many steps they must have contracted (0: they need not).
    looked : tuple
        Where the numbers of the nodes lie whose energies are looked at, how many they are, and what
        lies there.
    controlled : Controlled, optional
    opening : array, optional
        What the loop is told at a fresh start.
    moving : bool, optional
        Whether it is to tell velocities of the nodes.
    sought : tuple, optional
        What is looked for on the way, all of whose nodes are kept, the velocity at the start, and
        how the loop is told typical sizes (`UNTOLD` where it need not be).
    """
    t0, h, steps, every, level, pilot = asked
    many = steps // every + 1
    at, nodes = nodes_of(how.n, many)
    v = zeros = None
    u, mean, told, opens, v_at, sought_at, speed, zeros_at, room = 0, 0, 0, 0, 0, 0, 0, 0, 0
    typical = UNTOLD
    if controlled is not None:
        u, mean = address_of(controlled.each), address_of(controlled.mean)
    if opening is not None:
        told, opens = address_of(opening), opening.size
    if sought is not None:
        what, begin, typical = sought
        rows = np.empty(many * how.n + what.room * what.width)  # velocities before the zeros
        v_at = new_address(rows)
        sought_at, speed, room = what.at, address_of(begin), what.room
        zeros_at = v_at + 8 * many * how.n
    elif moving:
        v = np.empty_like(nodes[2])
        v_at = new_address(v)
    places = at, v_at, u, mean, told, looked[0]
    search = sought_at, speed, zeros_at, room, *typical
    numbers = _ASKED.pack(*places, opens, looked[1], steps, every, pilot, t0, h, level, *search)
    if few_steps_entry()(how.head + place.head + numbers) != DONE:
        return None
    iterations, residual, quiet, last, found = _TOLD.unpack_from(place.told)
    if sought is not None:
        width, begin_at = what.width, 8 * many * how.n
        zeros = np.ndarray((int(found), width), _FLOAT, rows, begin_at)
        if last < many:
            nodes = tuple(x[: int(last)] for x in nodes)  # type: ignore[assignment]
    return Seen(nodes, iterations, residual, quiet == 1, v, zeros)
