"""The start of a run that coordinates and momenta at nodes are all of: memory in which the core
finds it, and functions of the scene that write there.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.codegen.few_steps import TOLD, UNTOLD, Place, Typical, place_of
from varint.codegen.kernel import address_of
from varint.codegen.two_runs import Places, places_of
from varint.discrete.legendre import velocity_function
from varint.integration.damped_motions import look_function, may_be_damped
from varint.integration.held_rows import is_held, momentum_put_on_rows
from varint.integration.start import check_mass, regular_at, start_function
from varint.numerics.arrays import call, is_clearly_definite, trigger_on
from varint.scene.inputs import vector
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values

if TYPE_CHECKING:
    from varint.codegen.beside import Beside
    from varint.codegen.opening import Opening
    from varint.codegen.sought import Sought

LARGE = 2.0**53  # whole numbers below are numbers of double precision
FLOAT = np.dtype(float)
_ARRAY = np.ndarray
_TIME = struct.Struct("d")


@dataclass(eq=False, slots=True)
class Room:
    """One block of memory, its parts, and what writes there.

    Attributes
    ----------
    n : int
        Coordinates.
    q, v, t, u, c : array
        To be written: coordinates, velocities, the time, controls, parameters.
    start : array
        q and v, one behind the other.
    values : array
        p, ∂L/∂q + F, L and M, by `begin`; p lies behind q, which is there a second time for that.
    local : array
        M and the derivatives of forces by coordinates, and where dampers may be stiff those by
        velocities, by `look`.
    block : memoryview
        All of it.
    pack : callable
        q and v as bytes.
    put : memoryview
        Where q, v, t and q are to be written.
    begun : callable
        (block) → all numbers that are there when it has begun.
    regular : set of bytes
        Parameters for which the mass matrix is known to be regular; `check_mass` adds to it.
    constant : bool
        Whether that is all that it depends on.
    place : Place
        What a few steps are handed.
    places : Places
        What two runs are.
    begin, look : callable
        `look` is None in a room without.
    put_on_rows : callable, optional
        () → whether constraint rows hold the start beyond doubt, and p is along them.
    held : tuple
        What lies behind them.
    given : array, optional
        The parameters that are there, known to be good once; a system's own are always the same.
    opening : Opening, optional
        What loops of Newton's method are told besides, once it was asked for.
    known : bytes, float, optional
        The start that is there, known to be good with them: q and v, and the time.
    met : bytes, float, optional
        The last start that a motion was made from.
    seen : tuple, optional
        A `known` start that was looked at ahead of a run, and what was seen.
    divided : tuple, optional
        A `known` start, a duration and the pieces of it that runs from there are over.
    chosen : tuple, optional
        The loop and its first steps, for what was seen and a tolerance.
    over : tuple, optional
        Parameters and a duration, and whether dampers are over so soon that runs are powers.
    watched : tuple, optional
        What was watched for along runs from here, and how the core is told of it.
    """

    n: int
    q: np.ndarray
    v: np.ndarray
    t: np.ndarray
    u: np.ndarray
    c: np.ndarray
    start: np.ndarray
    values: np.ndarray
    local: np.ndarray
    block: memoryview
    pack: Callable[..., bytes]
    put: memoryview
    begun: Callable[[memoryview], tuple[float, ...]]
    regular: set[bytes]
    constant: bool
    place: Place
    places: Places
    begin: Callable[[], object]
    look: Callable[[], object] | None
    put_on_rows: Callable[[], bool] | None
    held: tuple
    given: np.ndarray | None = None
    opening: Opening | None = None
    known: tuple[bytes, float] | None = None
    met: tuple[bytes, float] | None = None
    seen: tuple | None = None
    divided: tuple | None = None
    chosen: tuple | None = None
    over: tuple | None = None
    watched: tuple[Sought, tuple, Beside] | None = None


class Watched(NamedTuple):
    """What is watched for along a run, `until` one expression crosses zero and for `events`,
    whether the run begins with momenta, and whether it is over all of the duration that is asked
    for.
    """

    until: Any
    events: Any
    by_momentum: bool
    whole: bool = True

    def expressions(self) -> tuple[Any, ...]:
        """As they were asked for."""
        return wanted_of(self.until, self.events)


def wanted_of(until: Any, events: Any) -> tuple[Any, ...]:
    """What ends a run, if something does, and the events."""
    return (*(() if until is None else (until,)), *(events or {}).values())


def is_plain_number(x: Any) -> bool:
    """Whether a number is one of Python's own that needs no closer look."""
    return type(x) in (float, int) and abs(x) < LARGE


@per_scene
def moves_freely(system: System) -> bool:
    """Whether nothing but coordinates and momenta at nodes and controls makes the motion."""
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.degenerate
    return not (held or system.rays)


def has_plain_nodes(system: System) -> bool:
    """Whether the same, without controls."""
    return moves_freely(system) and not system.structure.controls


@per_scene
def is_plain(system: System) -> bool:
    """Whether that is so, and velocities are functions of symbols."""
    return has_plain_nodes(system) and velocity_function(system).is_a("SXFunction")


@per_scene
def rooms(system: System, looks: bool) -> list[Room]:
    """Those that nobody uses: take the last one, and give it back."""
    return []


def room_of(system: System, looks: bool) -> Room:
    """A room for the scene, whose functions are made of symbols alone."""
    n, many = system.structure.n, system.c.numel()
    looked = (3 if may_be_damped(system) else 2) * n * n
    sizes = n, n, 1, n, 2 * n + 1 + n * n, looked, TOLD, many
    ends = np.cumsum(sizes).tolist()
    block = np.zeros(ends[-1])
    q, v, t, _, values, local, told, c = np.split(block, ends[:-1])
    at, mass_at, told_at, c_at = (address_of(block) + 8 * ends[i] for i in (2, 4, 5, 6))
    u = np.zeros(system.structure.controls)
    begin, one = trigger_on(start_function(system), (q, v, u, t, c), (values,))
    look, other = None, ()
    if looks:
        at_start = values[:n] if system.structure.quadratic_kinetic else v
        look, other = trigger_on(
            look_function(system), (q, at_start, t, c), tuple(local.reshape(-1, n * n))
        )
    put_on_rows, rows = None, ()
    if is_held(system):
        put_on_rows, rows = momentum_put_on_rows(
            system, q, v, t, c, values[:n], values[2 * n + 1 :]
        )
    parts = n, q, v, t, u, c, block[: 2 * n], values, local, block.data
    pack, begun = (struct.Struct(f"{count}d") for count in (2 * n, ends[4]))
    put = block.data.cast("B")[: 8 * ends[3]]
    regular, constant = regular_at(system), system.structure.constant_mass
    place = place_of(at, c_at, told_at, told.data)
    how = pack.pack, put, begun.unpack_from, regular, constant, place
    behind = places_of(place, mass_at, n + 1), begin, look, put_on_rows, (one, other, rows)
    return Room(*parts, *how, *behind)


def opening_in(room: Room, system: System) -> Opening:
    """What loops of Newton's method are told besides at the start that is there."""
    if room.opening is None:
        from varint.codegen.opening import opening_on

        room.opening = opening_on(system, room.q, room.values[: room.n], room.t, room.c)
    return room.opening


def begin_at(
    room: Room, system: System, q0: Any, v0: Any, t0: float, params: ParameterValues | None
) -> np.ndarray | None:
    """Write the start; the parameters, or None where something of the start is not finite, or it is
    in doubt whether constraint rows hold it. Where it is there already nothing is to be done.

    Raises
    ------
    InputError
        If coordinates, velocities or parameters are no such numbers, or the mass matrix is
        singular.
    """
    c = system.default_vector if params is None else parameter_values(system, params)
    n = room.n
    shape = (n,)
    if (
        type(q0) is _ARRAY  # one by one: in less time than as chains
        and type(v0) is _ARRAY
        and q0.dtype is FLOAT
        and v0.dtype is FLOAT
        and q0.shape == shape
        and v0.shape == shape
    ):
        state = q0.tobytes() + v0.tobytes()
    else:
        names = system.names
        state = room.pack(*_numbers("q0", q0, n, names), *_numbers("v0", v0, n, names))
    asked, there = (state, t0), c is room.given
    if there and asked == room.known:
        return c
    room.put[:], room.known = state + _TIME.pack(t0) + state[: 8 * n], None
    if not there:
        room.given, room.c[:] = None, c
    room.begin()
    begun = room.begun(room.block)
    if not math.isfinite(sum(begun)):
        for what, x in (("q0", q0), ("v0", v0)):
            vector(what, x, n, system.names)
        return None
    if room.put_on_rows is not None:
        if not room.put_on_rows():
            return None
    else:
        sure = (there and room.constant) or is_clearly_definite(begun[-n * n :])
        if not sure and c.tobytes() not in room.regular:
            check_mass(system, room.values[2 * n + 1 :], c)
    if params is None:
        room.given, room.known = c, asked
    return c


def begin_by_momentum(
    room: Room, system: System, q0: Any, p0: Any, t0: float, params: ParameterValues | None
) -> np.ndarray | None:
    """`begin_at` from momenta, looked at as if nothing moved."""
    c = begin_at(room, system, q0, [0.0] * room.n, t0, params)
    if c is not None:
        room.known = None  # these are not what belongs to that start
        room.values[: room.n] = vector("p0", p0, room.n, system.names)
    return c


def begin_in(
    room: Room, system: System, start: tuple[Any, Any, Any, ParameterValues | None], p0: Any
) -> np.ndarray | None:
    """`begin_at` a start (q0, v0, t0, params), or by momenta in place of v0."""
    if p0 is None:
        return begin_at(room, system, *start)
    return begin_by_momentum(room, system, start[0], p0, start[2], start[3])


def velocities_in(room: Room, system: System, c: np.ndarray) -> np.ndarray:
    """Those that belong to the momenta that are there."""
    return call(velocity_function(system), room.q, room.values[: room.n], room.t, c)[0]


def moving_in(
    room: Room, system: System, c: np.ndarray, opened: bool
) -> tuple[np.ndarray, Typical]:
    """How fast the start moves that is there, and how its loop is told typical sizes on the way, if
    it was told at the start what it must be, and that was `opened`.
    """
    if not opened or room.opening is None:
        return velocities_in(room, system, c), UNTOLD
    return room.opening.told[2 * room.n :], room.opening.typical


def _numbers(what: str, x: Any, n: int, names: tuple[str, ...]) -> Sequence[float]:
    """n numbers of Python's own, with a closer look where that is needed. Whether they are finite
    is seen when all of them are there.
    """
    kind = type(x)
    if kind is list or kind is tuple:
        for one in x:
            if type(one) is not float and not (type(one) is int and abs(one) < LARGE):
                break
        else:
            if len(x) == n:
                return x
    elif n == 1 and (kind is float or is_plain_number(x)):
        return (x,)
    return vector(what, x, n, names).tolist()
