"""The start of a run that coordinates and momenta at nodes are all of: memory in which the core
finds it, and functions of the scene that write there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.kernel import address_of
from varint.codegen.two_runs import FOUND, Places, places_of
from varint.discrete.legendre import velocity_function
from varint.integration.problem import RunOptions, Start
from varint.integration.small_motions import local_function_of_momentum
from varint.integration.start import check_mass, regular_at, start_function
from varint.numerics.arrays import hand_over
from varint.rules.rule import Rule
from varint.scene.inputs import vector
from varint.scene.memory import per_scene
from varint.scene.system import System, parameter_values

LARGE = 2.0**53  # whole numbers below are numbers of double precision
FLOAT = np.dtype(float)


class Room(NamedTuple):
    """One block of memory, its parts, and what writes there.

    Attributes
    ----------
    q, v, t, c : array
        To be written: coordinates, velocities, the time, parameters.
    values : array
        p, ∂L/∂q + F, L and M, by `begin`; p lies behind q.
    local : array
        M and the derivatives of forces by coordinates, by `look`.
    told : array
        q, values and v, one behind the other.
    regular : set of bytes
        Parameters for which the mass matrix is known to be regular; `check_mass` adds to it.
    at, c_at : int
        Addresses of q and of the parameters.
    places : Places
        What two runs are handed.
    begin, look : callable
        `look` is None in a room without.
    held : tuple
        What lies behind them.
    """

    q: np.ndarray
    v: np.ndarray
    t: np.ndarray
    c: np.ndarray
    values: np.ndarray
    local: np.ndarray
    told: np.ndarray
    regular: set[bytes]
    at: int
    c_at: int
    places: Places
    begin: Callable[[], object]
    look: Callable[[], object] | None
    held: tuple


def asks_for_no_more(rule: Rule | None, start: Start, options: RunOptions) -> bool:
    """Whether a rule, coordinates, velocities, parameters and how long are all that is given."""
    o = options
    return asks_for_nodes(rule, start, o) and o.save_every == 1 and o.backend == "auto"


def asks_for_nodes(rule: Rule | None, start: Start, options: RunOptions) -> bool:
    """The same, but for how many of the nodes are kept and by which loop."""
    o = options
    return (
        (rule is None or isinstance(rule, Rule))
        and o.until is o.events is o.scale is o.checkpoint is o.at is start.u is start.p0 is None
        and start.v0 is not None
        and type(o.save_every) is int
        and o.on_failure == "raise"
        and is_plain_number(start.t0)
    )


def is_plain_number(x: Any) -> bool:
    """Whether a number is one of Python's own that needs no closer look."""
    return type(x) in (float, int) and abs(x) < LARGE


@per_scene
def is_plain(system: System) -> bool:
    """Whether nothing but coordinates and momenta at nodes makes the motion, and a start is
    functions of symbols.
    """
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.degenerate
    if held or s.controls or system.rays:
        return False
    return velocity_function(system).is_a("SXFunction")


@per_scene
def rooms(system: System, looks: bool) -> list[Room]:
    """Those that nobody uses: take the last one, and give it back."""
    return []


def room_of(system: System, looks: bool) -> Room:
    """A room for the scene, whose functions are made of symbols alone."""
    n, many = system.structure.n, system.c.numel()
    sizes = n, 2 * n + 1 + n * n, n, 2 * n * n, FOUND, 1, many
    ends = np.cumsum(sizes)
    block = np.zeros(ends[-1])
    q, values, v, local, found, t, c = np.split(block, ends[:-1])
    at = address_of(block)
    mass_at, found_at, c_at = (at + 8 * int(ends[i]) for i in (2, 3, 5))
    begin, one = _on(start_function(system), (q, v, np.empty(0), t, c), (values,))
    look, other, half = None, (), n * n
    if looks:
        inputs = q, values[:n], t, c
        look, other = _on(local_function_of_momentum(system), inputs, (local[:half], local[half:]))
    parts = q, v, t, c, values, local, block[: ends[2]]
    places = places_of(at, (mass_at, n + 1), c_at, found_at, found)
    return Room(*parts, regular_at(system), at, c_at, places, begin, look, (block, one, other))


def begin_in(room: Room, system: System, start: Start) -> np.ndarray | None:
    """Write the start; the parameters, or None where something of the start is not finite.

    Raises
    ------
    InputError
        If coordinates, velocities or parameters are no such numbers, or the mass matrix is
        singular.
    """
    params = start.params
    c = system.default_vector if params is None else parameter_values(system, params)
    _put(room.q, "q0", start.q0, system)
    _put(room.v, "v0", start.v0, system)
    room.t[0] = start.t0
    room.c[:] = c
    room.begin()
    if not math.isfinite(sum(room.told.tolist())):
        for what, x in (("q0", start.q0), ("v0", start.v0)):
            vector(what, x, len(room.q), system.names)
        return None
    if c.tobytes() not in room.regular:
        check_mass(system, room.values[2 * len(room.q) + 1 :], c)
    return c


def _put(place: np.ndarray, what: str, x: Any, system: System) -> None:
    """Numbers into their place; whether they are finite is seen when all of them are there."""
    if type(x) is np.ndarray and x.dtype is FLOAT and x.shape == place.shape:
        place[:] = x
    else:
        place[:] = vector(what, x, len(place), system.names)


def _on(
    function: ca.Function, inputs: tuple[np.ndarray, ...], outputs: tuple[np.ndarray, ...]
) -> tuple[Callable[[], object], tuple]:
    buffer, trigger = function.buffer()
    hand_over(buffer, inputs, outputs)
    return trigger, (buffer, inputs, outputs)
