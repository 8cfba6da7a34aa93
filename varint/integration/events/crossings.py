"""Zero crossings along a trajectory, none lost within a step, located with the rule's own
accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.rows import RowFunction, row_function_or_none
from varint.discrete.lagrangian import energy_function
from varint.errors import InputError
from varint.integration.events.enclosures import box_function, enclosure_function
from varint.integration.events.isolation import (
    CrossingSearch,
    is_wanted,
    isolate,
    look_at_groups,
    points_at,
)
from varint.integration.events.roots import Points, join_points
from varint.integration.events.substeps import Substeps, interpreted_substeps
from varint.integration.events.touches import beside, touches
from varint.integration.state import NodeBlock
from varint.numerics.arrays import over_columns
from varint.results.records import IMPACTS, Event
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.memory import per_system
from varint.scene.serialisation import expression_as_data
from varint.scene.system import System
from varint.scene.validation import refuse_condition

REMEMBERED = 64  # expressions of a system whose functions are kept
LATELY = 8  # of them that a new one is compared with before it is read
DEEP = 8  # operations below one another as far as these are compared
WATCHED = "the expression"
ROUND_OFF = 1e-12  # of the value before a jump: so near to zero is zero after it


RowFunctions = Callable[[], tuple[RowFunction, RowFunction] | None]
SearchFunctions = tuple[ca.Function, ca.Function, ca.Function, RowFunctions]


@dataclass(frozen=True, eq=False)
class Watch:
    """An expression whose zeros are wanted: those where it rises (+1), falls (−1), or both (0)."""

    name: str
    expression: Any
    direction: int


def parse_watch(what: str, wanted: Any) -> Watch:
    """`expression` or `(expression, direction)` as the user gave it."""
    expression, direction = (
        wanted if isinstance(wanted, tuple) and len(wanted) == 2 else (wanted, 0)
    )
    if direction not in (-1, 0, 1):
        raise InputError(
            f"the direction of {what} must be +1 (rising), -1 (falling) or 0 (both), got "
            f"{direction!r}"
        )
    if not isinstance(expression, ca.SX) or expression.numel() != 1:
        raise InputError(
            f"{what} must be one SX expression, or (expression, direction), got {wanted!r}"
        )
    refuse_condition(
        what,
        expression,
        "which has no sign to change: give what crosses zero there, as x - 0.5 for x > 0.5",
    )
    return Watch(what, expression, direction)


def parse_watches(events: Any) -> list[Watch]:
    """The expressions of `events`, a dictionary by name or None."""
    if events is None:
        return []
    if not isinstance(events, Mapping):
        raise InputError(
            f"events must be a dictionary of names and expressions, got {type(events).__name__}"
        )
    return [parse_watch(name, wanted) for name, wanted in events.items()]


class Crossings(NamedTuple):
    """Zeros in the order of time: the states on both sides, and which are jumps at the node after
    their interval.
    """

    before: Points
    after: Points
    jump: np.ndarray


@per_system
def _functions_known(system: System) -> dict[str, SearchFunctions]:
    """Functions of expressions that were watched, by what these say."""
    return {}


@per_system
def _asked_for(system: System) -> dict[int, tuple[ca.SX, SearchFunctions]]:
    """The same functions by the very expression that was asked for, which is not read again."""
    return {}


def crossing_search(system: System, watch: Watch) -> CrossingSearch:
    """The search for the zeros of a watched expression in motions of the system."""
    known, asked = _functions_known(system), _asked_for(system)
    key = watch.expression.element_hash()  # of a node, which is kept and never changes
    found = asked.get(key) or _written_alike(asked, watch.expression)
    if found is None:
        text = expression_as_data(system, watch.expression, WATCHED)
        functions = known.get(text)
        if functions is None:
            if len(known) >= REMEMBERED:
                known.clear()
            functions = known[text] = _search_functions(system, watch.expression)
        if len(asked) >= REMEMBERED:
            asked.clear()
        found = asked[key] = ca.SX(watch.expression), functions
    return CrossingSearch(watch.name, watch.direction, *found[1])


def _written_alike(
    asked: dict[int, tuple[ca.SX, SearchFunctions]], expression: ca.SX
) -> tuple[ca.SX, SearchFunctions] | None:
    """What is known of the same small expression, written anew for this call, in a hundredth of the
    time that it takes to read it.
    """
    for other in islice(reversed(asked.copy().values()), LATELY):  # threads may ask for more
        if ca.is_equal(expression, other[0], DEEP):
            return other
    return None


def _search_functions(system: System, watched: ca.SX) -> SearchFunctions:
    """What a `CrossingSearch` has of an expression."""
    s, expression = system, in_own_symbols(watched, system)
    rate = ca.SX(np.nan)
    if not ca.depends_on(expression, ca.vertcat(s.v, s.control)):
        rate = ca.jtimes(expression, s.q, s.v) + ca.jacobian(expression, s.t)
    both = ca.densify(ca.vertcat(expression, rate))
    values = ca.Function("values", [s.q, s.v, s.t, s.control, s.c], [both], {"cse": True})
    bounds = enclosure_function(s, expression)
    as_data = cache(partial(_functions_as_data, s, both, bounds))
    return values, bounds, box_function(s, expression), as_data


def _functions_as_data(
    system: System, values: ca.SX, bounds: ca.Function
) -> tuple[RowFunction, RowFunction] | None:
    """Values and bounds for a search in C; None where an operation has no form there."""
    s, n = system, system.structure.n
    ends = [ca.SX.sym(name, n) for name in ("q0", "v0", "q1", "v1")]
    piece = [*ends, ca.SX.sym("t"), ca.SX.sym("w")]
    u = ca.SX.sym("u", 4 * s.control.numel())
    sides = ca.vertcat(*bounds(*piece, u, s.c))
    if ca.depends_on(ca.vertcat(values, sides), ca.vertcat(s.control, u)):
        return None
    at_nodes = row_function_or_none("values", [s.q, s.v, s.t], s.c, [values], roots=True)
    along = row_function_or_none("bounds", piece, s.c, [ca.densify(sides)], roots=True)
    return None if at_nodes is None or along is None else (at_nodes, along)


def find_crossings(
    search: CrossingSearch,
    motion: Trajectory,
    impacts: Mapping[int, Event],
    substeps: Substeps = interpreted_substeps,
) -> Crossings:
    """The zeros of a watched expression along a motion with impacts at some of its nodes.

    A zero at the first node does not count; a zero at a later node does, also where an impact turns
    the motion back, and so does a change of sign by an impact, at its time. A pole is no zero.
    """
    start, end, certain = _ends(search, motion, impacts)
    zeros = isolate(search, motion, start, end, certain, substeps)
    return in_time(search, motion, zeros, end, start.at(slice(1, None)))


def in_time(
    search: CrossingSearch, motion: Trajectory, zeros: Points, come: Points, leave: Points
) -> Crossings:
    """Zeros and, where the expression changes its sign between the states in which the motion comes
    to some nodes and leaves them, or touches zero there, jumps.
    """
    if not len(come.t):  # nothing jumps: in a quarter of the time
        late = zeros.t * np.sign(motion.h)
        if not (late[1:] >= late[:-1]).all():
            zeros = zeros.at(np.argsort(late, kind="stable"))
        return Crossings(zeros, zeros, np.zeros(len(late), dtype=bool))
    touched = touches(motion, come, leave)
    if touched.any():
        zeros = beside(motion, zeros, come.at(touched))
    before = after = zeros
    side = np.sign(np.where(touched, -come.rate, come.value))
    jumps = np.flatnonzero(touched | _jumps(come.value, leave.value))
    jumps = jumps[is_wanted(search, side[jumps])]
    if len(jumps):
        before = join_points(before, come.at(jumps))
        after = join_points(after, leave.at(jumps))
    jump = np.arange(len(before.t)) >= len(before.t) - len(jumps)
    order = np.lexsort((jump, before.t * np.sign(motion.h)))
    late = after.at(order)
    return Crossings(before.at(order) if len(jumps) else late, late, jump[order])


def impacts_in(blocks: Iterable[NodeBlock]) -> dict[int, Event]:
    """The first impact at each node that has one, by the node's number in these blocks; a block
    with impacts has but one node if it does not say which.
    """
    found: dict[int, Event] = {}
    first = 0
    for block in blocks:
        nodes = block.impacts or (0,) * len(block.events)
        for event, node in zip(block.events, nodes, strict=True):
            if event.kind in IMPACTS and block.good:
                found.setdefault(first + node, event)
        first += block.good
    return {i: impact for i, impact in found.items() if i}


def _ends(
    search: CrossingSearch, motion: Trajectory, impacts: Mapping[int, Event]
) -> tuple[Points, Points, np.ndarray]:
    """All nodes as the motion leaves them; all but the first as it comes to them; between which the
    signs tell how many zeros there are.
    """
    if not (motion.system.structure.contacts or motion.u.shape[2]):
        return _smooth_ends(search, motion)
    node = np.arange(len(motion))
    begin = points_at(search, motion, node, motion.t, motion.q, motion.v, motion.p)
    v, p = motion.v[1:].copy(), motion.p[1:].copy()
    for i, impact in impacts.items():
        v[i - 1], p[i - 1] = impact.v_before, impact.p_before
    end = points_at(search, motion, node[:-1], motion.t[1:].copy(), motion.q[1:].copy(), v, p)
    none = motion.t[1:] == motion.t[:-1]  # nothing happens between them
    if none.any():
        same = begin.at(slice(0, -1))
        which = np.flatnonzero(none)
        for kept, new in zip(end, same, strict=True):
            kept[which] = new[which]
    return begin, end, look_at_groups(search, motion, begin.at(slice(0, -1)), end)[1]


def _smooth_ends(search: CrossingSearch, motion: Trajectory) -> tuple[Points, Points, np.ndarray]:
    """`_ends` where nothing jumps; where the sign is known on both sides of a node, it stands for
    the value.
    """
    count = len(motion)
    value, rate = np.empty(count), np.full(count, np.nan)
    begin = Points(np.arange(count), motion.t, motion.q, motion.v, motion.p, value, rate)
    end = begin.at(slice(1, None))._replace(node=begin.node[:-1])
    sign, certain = look_at_groups(search, motion, begin.at(slice(0, -1)), end)
    value[:-1], value[-1:] = sign, sign[-1:]
    value[1:-1][sign[1:] != sign[:-1]] = 0.0
    some = np.flatnonzero(value == 0)
    states = (x[some] for x in (motion.t, motion.q, motion.v, motion.p))
    found = points_at(search, motion, some, *states)
    value[some], rate[some] = found.value, found.rate
    return begin, end, certain


def _jumps(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Where an impact changes the sign, or ends at zero."""
    jumps = (before * after < 0) | ((before != 0) & (np.abs(after) <= ROUND_OFF * np.abs(before)))
    found: np.ndarray = jumps & (before != after)
    return found


def events_at(search: CrossingSearch, motion: Trajectory, found: Crossings) -> list[Event]:
    """The zeros of a watched expression as records."""
    if not len(found.jump):
        return []
    columns = [_energies_and_states(motion, found.before)] * 2
    if found.after is not found.before:
        columns[1] = _energies_and_states(motion, found.after)
    times, (e0, q, v0, p0), (e1, _, v1, p1) = found.before.t.tolist(), *columns
    return [
        Event(t, search.name, None, 0.0, *numbers)
        for t, *numbers in zip(times, e0, e1, q, v0, p0, v1, p1, strict=True)
    ]


def _energies_and_states(motion: Trajectory, x: Points) -> tuple[list, ...]:
    """Energies, and q, v and p as tuples."""
    energies = over_columns(energy_function(motion.system), x.q, x.v, x.t[:, None], motion.c)[0]
    return energies[:, 0].tolist(), *(list(zip(*a.T.tolist(), strict=True)) for a in x[2:5])
