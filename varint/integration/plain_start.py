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
from varint.codegen.two_runs import FOUND
from varint.discrete.legendre import velocity_function
from varint.integration.problem import RunOptions, Start
from varint.integration.small_motions import local_function_of_momentum
from varint.integration.start import check_mass, start_function
from varint.numerics.arrays import hand_over
from varint.rules.rule import Rule
from varint.scene.inputs import vector
from varint.scene.memory import per_scene
from varint.scene.system import System, parameter_values

LARGE = 2.0**53  # whole numbers below are numbers of double precision


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
    mass : array (n,)
        To be written: the diagonal of M.
    found : array
        What the core tells.
    at, mass_at, found_at, c_at : int
        Addresses.
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
    mass: np.ndarray
    found: np.ndarray
    at: int
    mass_at: int
    found_at: int
    c_at: int
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
    sizes = n, 2 * n + 1 + n * n, n, 2 * n * n, n, FOUND, 1, many
    ends = np.cumsum(sizes)
    block = np.zeros(ends[-1])
    q, values, v, local, mass, found, t, c = np.split(block, ends[:-1])
    at = address_of(block)
    mass_at, found_at, c_at = (at + 8 * int(ends[i]) for i in (3, 4, 6))
    begin, one = _on(start_function(system), (q, v, np.empty(0), t, c), (values,))
    look, other, half = None, (), n * n
    if looks:
        inputs = q, values[:n], t, c
        look, other = _on(local_function_of_momentum(system), inputs, (local[:half], local[half:]))
    addresses = at, mass_at, found_at, c_at
    parts = q, v, t, c, values, local, mass, found
    return Room(*parts, *addresses, begin, look, (block, one, other))


def begin_in(room: Room, system: System, start: Start) -> np.ndarray | None:
    """Write the start; the parameters, or None where something of the start is not finite.

    Raises
    ------
    InputError
        If coordinates, velocities or parameters are no such numbers, or the mass matrix is
        singular.
    """
    n, names, c = system.structure.n, system.names, parameter_values(system, start.params)
    room.q[:], room.v[:] = vector("q0", start.q0, n, names), vector("v0", start.v0, n, names)
    room.t[0], room.c[:] = start.t0, c
    room.begin()
    if not math.isfinite(sum(room.values.tolist())):
        return None
    check_mass(system, room.values[2 * n + 1 :], c)
    return c


def _on(
    function: ca.Function, inputs: tuple[np.ndarray, ...], outputs: tuple[np.ndarray, ...]
) -> tuple[Callable[[], object], tuple]:
    buffer, trigger = function.buffer()
    hand_over(buffer, inputs, outputs)
    return trigger, (buffer, inputs, outputs)
