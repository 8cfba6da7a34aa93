"""Motions that fly between impacts, in C (c/contacts.c): the loop of a scene without its contacts,
and these as data beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import CFUNCTYPE, Structure, c_double, c_int, c_int64, c_void_p
from dataclasses import dataclass
from enum import IntEnum
from time import perf_counter
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.arguments import c_names, c_number, c_source, packing
from varint.codegen.block import block_of, start_of
from varint.codegen.core import contacts_entry, rows_entry
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.native import MOST_COORDINATES, TOO_LARGE, members_by_name, tapes_of
from varint.codegen.routines import routines
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_SOURCE = c_source("contacts.c")
# between two looks at the gaps, and before the first
MOST_STEPS, FEW_STEPS = (c_number(_SOURCE, name) for name in ("MOST_STEPS", "FEW_STEPS"))
MOST_ROWS, MOST_HITS = 20_000, 2_000  # of a call
Expressions = Mapping[str, tuple[list[ca.SX], list[ca.SX]]]


Ended = IntEnum("Ended", c_names(_SOURCE, "enum Ended {"), start=0)  # type: ignore[misc]  # how a call ends
ENDED, FULL, BESIDE, SETTLED = Ended
HIT = c_number(_SOURCE, "HIT_HEAD")  # numbers of a hit before its states
STATE_HEAD = c_number(_SOURCE, "STATE_Q")  # and of a state before q


class ContactArguments(Structure):
    """One motion with contacts; see c/contacts.c."""

    _fields_ = [
        ("run", c_void_p),
        ("loop", c_void_p),
        ("many", c_void_p),
        ("carry_size", c_int64),
        ("last", c_int64),
        ("save_every", c_int64),
        ("most", c_int64),
        ("room", c_int64),
        ("hits", c_int64),
        ("steps", c_int64),
        ("begins", c_int64),
        ("t0", c_double),
        ("h", c_double),
        ("level", c_double),
        ("held", c_int64),
        ("rows_held", c_void_p),
        ("holds", c_void_p),
        ("c", c_void_p),
        ("scale", c_void_p),
        ("state", c_void_p),
        ("rows", c_void_p),
        ("hit", c_void_p),
        ("stats", c_void_p),
        ("scene", c_void_p),
        ("change", c_void_p),
        ("begun", c_void_p),
        ("sizes", c_void_p),
        ("fewer", c_int64),
        ("apart", c_void_p),
    ]


_CHANGE = CFUNCTYPE(c_int, c_int64, c_int64, c_int64)
_ARGUMENTS = packing(ContactArguments)


@dataclass(frozen=True, eq=False)
class ContactData:
    """The contacts of a scene as data: address, and the memory there; rows of constraints and
    contacts.
    """

    scene: int
    block: np.ndarray
    rows: int


class Begun(NamedTuple):
    """What other contacts begin with: the loop of the scene in which they hold, the rows that do
    (see `fly`), velocities (n,) and behind them typical sizes (2n,).
    """

    kernel: Kernel
    held: tuple[int, ...]
    sizes: np.ndarray


# (the row that follows, its step, the last of the run, `Flight.located`, contacts that hold) → the
# rest, where it is there
Change = Callable[[int, int, int, np.ndarray, tuple[int, ...]], Begun | None]


class Flight(NamedTuple):
    """What a call found.

    Attributes
    ----------
    status : int
        ENDED at the last node; FULL: to be called again; BESIDE: before something that is not dealt
        with there; SETTLED: after impacts other contacts hold.
    t, k : array (rows,)
    q, p, v : array (rows, n)
        Nodes of the grid, and those of impacts as the motion leaves them.
    hits : array (impacts, HIT + 5 n)
        Row, contact, whether it is stopped (1) or lets go (2), when, impulse, energies before and
        after, q, v and p before, v and p after. Those of a call that is SETTLED lie behind the last
        row.
    state : array
        Hand it to the next call to go on as if the run had not stopped: k, t, impacts in step k,
        steps of the next look; q, p, v, rounding errors of q and p; and what the loop carries.
    iterations : int
    residual : float
    seconds : float
    located : array (2 + 5n,) or None
        Of what ends a call BESIDE, where its instant is known: the time, whether the step ends
        there, and q, p, v, rounding errors of q and p as they are before it; after it, where the
        call is SETTLED.
    holding : tuple of int
        Contacts that hold then.
    apart : array (n,) or None
        How far a run in fewer steps is from this one, coordinate by coordinate, at the nodes of
        both; infinitely where one of them does not come to its end.
    """

    status: int
    t: np.ndarray
    k: np.ndarray
    q: np.ndarray
    p: np.ndarray
    v: np.ndarray
    hits: np.ndarray
    state: np.ndarray
    iterations: int
    residual: float
    seconds: float
    located: np.ndarray | None = None
    holding: tuple[int, ...] = ()
    apart: np.ndarray | None = None


def contact_data(
    n: int,
    rows: int,
    contacts: int,
    constants: ca.SX,
    expressions: Expressions,
    **numbers: float,
) -> ContactData:
    """The contacts as data, from the functions and numbers that c/contacts_scene.h lists; `rows`
    are those of constraints and contacts.

    Raises
    ------
    NotCompilable
        If they are too many, or an operation has no form there.
    CompileError
        If c/contacts.c was not built with the package and cannot be compiled.
    """
    contacts_entry()
    if n > MOST_COORDINATES:
        raise NotCompilable(TOO_LARGE)
    given = {"N": n, "ROWS": rows, "CONTACTS": contacts, **numbers}
    tapes = tapes_of(routines(constants, expressions))
    block = block_of(members_by_name("contacts_scene.h", given, {}, {}, tapes))
    return ContactData(start_of(block), block, rows)


def first_flight_state(
    kernel: Kernel, k: int, t: float, impacts: int, *state: np.ndarray
) -> np.ndarray:
    """`Flight.state` at an instant in step k: q, p, v, rounding errors of q and p."""
    return np.concatenate([[k, t, impacts, FEW_STEPS], *state, np.zeros(kernel.carry_size)])


def fly(
    kernel: Kernel,
    data: ContactData,
    state: np.ndarray,
    held: tuple[int, ...],
    holds: np.ndarray,
    scale: np.ndarray,
    c: np.ndarray,
    *,
    t0: float,
    h: float,
    last: int,
    save_every: int,
    steps: int,
    level: float = 0.0,
    begins: bool = False,
    fewer: int = 0,
    change: Change | None = None,
) -> Flight:
    """Steps of the loop of the scene without contacts from a state on, and clean impacts.

    Parameters
    ----------
    kernel : Kernel
        By Newton's method, of the scene with what holds and no other contacts.
    data : ContactData
    state : array
    held : tuple of int
        Rows of constraints and contacts that hold, in their order.
    holds : array (contacts,) of bool
        Which contacts are closed for now.
    scale : array (2n,)
        Typical sizes of velocities and momenta.
    c : array
        Parameter values.
    t0, h : float
        Time of node 0 and step.
    last, save_every, steps : int
        The last node, distance of the kept ones, and after how many steps the call ends.
    level : float
        See `run_loop`.
    begins : bool
        Whether the motion begins at the state, which becomes its first node.
    fewer : int
        Steps, a whole part of them all, of a run to compare; 0 for none.
    change : callable, optional
        What goes on in the same call where other contacts hold. What it raises ends the call.
    """
    n = kernel.n
    many = min(last // save_every + MOST_HITS, MOST_ROWS) + MOST_STEPS + 2
    state = state.copy()
    rows, hits = np.empty((many, 2 + 3 * n)), np.empty((MOST_HITS, HIT + 5 * n))
    stats = np.zeros(7 + 5 * n)  # as they are where there is no memory for the call
    rows_held, closed = np.array([*held, 0], dtype=np.int64), holds.astype(np.int64)
    c, scale = (np.ascontiguousarray(x, dtype=float) for x in (c, scale))
    begun, sizes = np.empty(5 + data.rows, dtype=np.int64), np.empty(3 * n)
    apart = np.empty(n)
    # of each run, by its last node: the core uses it until there is another one
    carried, raised = {last: state[STATE_HEAD + 5 * n :]}, list[BaseException]()
    told, heads = stats[5:], dict[tuple[int, tuple[int, ...]], np.ndarray]()

    def asked(row: int, k: int, end: int) -> int:
        try:
            found = change and change(row, k, end, told, _holding(closed))
        except BaseException as error:
            raised.append(error)
            return 0
        if not found:
            return 0
        loop, held, sizes[:] = found
        size = loop.carry_size
        carry = np.zeros(2 * size)  # of the run, and of shorter steps
        carried[end] = carry[:size]
        head = heads.get((id(loop), held))
        if head is None:
            numbers = [_place_of(loop.entry), loop.scene, 0, size, len(held), *held]
            head = heads[id(loop), held] = np.array(numbers, dtype=np.int64)
        begun[: len(head)] = head
        begun[2] = new_address(carry)
        return 1

    asking = _CHANGE(asked) if change else None
    began = perf_counter()
    status = contacts_entry()(
        _ARGUMENTS.pack(
            _place_of(kernel.entry),
            kernel.scene,
            _place_of(rows_entry()),
            kernel.carry_size,
            last,
            save_every,
            FIXED_POINT_ITERATIONS,
            many,
            MOST_HITS,
            steps,
            begins,
            t0,
            h,
            level,
            len(held),
            new_address(rows_held),
            new_address(closed),
            c.ctypes.data,  # there may be none
            *map(address_of, (scale, state, rows, hits, stats)),
            data.scene,
            _place_of(asking) if asking else 0,
            new_address(begun),
            new_address(sizes),
            fewer,
            new_address(apart),
        )
    )
    seconds = perf_counter() - began
    if raised:
        raise raised[0]
    state = np.concatenate([state[: STATE_HEAD + 5 * n], carried[last]])
    made, struck, iterations = (int(x) for x in stats[:3])
    rows, hits = rows[:made].copy(), hits[:struck].copy()
    q, p, v = (rows[:, i : i + n] for i in range(2, 2 + 3 * n, n))
    nodes = rows[:, 0].copy(), rows[:, 1].astype(int), q, p, v
    located = stats[5:] if stats[4] else None
    work = iterations, float(stats[3]), seconds
    holding = _holding(closed)
    return Flight(status, *nodes, hits, state, *work, located, holding, apart if fewer else None)


def _place_of(entry: Callable) -> int:
    """The address of a compiled function, in a fifth of the time of a cast."""
    return c_void_p.from_buffer(entry).value or 0  # type: ignore[arg-type]


def _holding(closed: np.ndarray) -> tuple[int, ...]:
    return tuple([i for i, x in enumerate(closed.tolist()) if x])
