"""What is watched for along runs of a few steps: looked for by the core in the call that makes the
run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.sought import Sought, sought_by
from varint.discrete.lagrangian import energy_function
from varint.integration.energy_check import SAMPLES, places_looked_at
from varint.integration.events.crossings import (
    REMEMBERED,
    Watch,
    crossing_search,
    parse_watch,
    parse_watches,
)
from varint.integration.events.isolation import CrossingSearch
from varint.integration.events.native_crossings import NUMBERS
from varint.integration.trajectories import in_order
from varint.numerics.arrays import over_columns
from varint.results.records import Event
from varint.scene.memory import per_system
from varint.scene.system import System


class Search(NamedTuple):
    """What is looked for in runs by a loop: None where it is to be looked for elsewhere; what was
    asked for, kept so that no other expressions are taken for these.
    """

    kernel: Kernel
    sought: Sought | None
    asked: tuple


@per_system
def searches_known(system: System) -> dict[tuple, Search]:
    """Searches by what was asked for, see `key_of`."""
    return {}


def key_of(until: Any, events: Any) -> tuple | None:
    """What tells whether the same was asked for before; None where it is to be read."""
    if events is not None and type(events) is not dict:
        return None
    key: list[Any] = [until is not None]
    for wanted in (*(() if until is None else (until,)), *(events or {}).values()):
        expression, direction = (
            wanted if type(wanted) is tuple and len(wanted) == 2 else (wanted, 0)
        )
        if type(expression) is not ca.SX or type(direction) is not int:
            return None
        if not expression.is_scalar(True):
            return None
        key += expression.element_hash(), direction
    return tuple(key)


def search_for(
    system: System, kernel: Kernel, key: tuple | None, until: Any, events: Any
) -> Sought | None:
    """What is to be looked for in runs by a loop; None where it is to be looked for elsewhere."""
    known = searches_known(system)
    search = None if key is None else known.get(key)
    if search is None or search.kernel is not kernel:
        watches = [] if until is None else [parse_watch("until", until)]
        watches += parse_watches(events)
        search = _search(system, kernel, watches, until is not None)
        if key is not None:
            _keep(system, key, search)
    return search.sought


def _search(system: System, kernel: Kernel, watches: Sequence[Watch], stops: bool) -> Search:
    """The search for these, which is the same where they are written anew."""
    searches = [crossing_search(system, watch) for watch in watches]
    say = (stops, *((search.as_data, search.direction) for search in searches))
    found = searches_known(system).get(say)
    if found is None or found.kernel is not kernel:
        sought = _sought(kernel, searches, stops)
        found = Search(kernel, sought, ())
        _keep(system, say, found)
    # no one else changes copies of what was asked for
    return found._replace(asked=tuple(ca.SX(watch.expression) for watch in watches))


def _keep(system: System, key: tuple, search: Search) -> None:
    known = searches_known(system)
    if len(known) >= REMEMBERED:
        known.clear()
    known[key] = search


def _sought(kernel: Kernel, searches: Sequence[CrossingSearch], stops: bool) -> Sought | None:
    functions = [search.as_data() for search in searches]
    watched = [
        (*data, search.direction)
        for data, search in zip(functions, searches, strict=True)
        if data is not None
    ]
    if not watched or len(watched) < len(searches):
        return None
    try:
        return sought_by(kernel, watched, stops, places_looked_at(SAMPLES), NUMBERS)
    except CompileError:
        return None


def events_along(
    system: System,
    names: Sequence[str],
    zeros: np.ndarray,
    c: np.ndarray,
    h: float,
    end: float | None,
) -> tuple[Event, ...]:
    """The zeros of the expressions with these names as records, up to the time at which the run
    ends.

    Parameters
    ----------
    system : System
    names : sequence of str
        Of the zeros' expressions, by their numbers.
    zeros : array
        See `Sought`.
    c : array
        Parameters.
    h, end : float
    """
    if not len(zeros):
        return ()
    n = system.structure.n
    x = zeros[:, 5:]
    states = x[:, :n], x[:, n : 2 * n], zeros[:, 2:3]
    energies = over_columns(energy_function(system), *states, c)[0][:, 0].tolist()
    found = []
    for energy, row in zip(energies, zeros.tolist(), strict=True):
        time = row[2]
        if end is None or (end - time) * h >= 0:
            q, v, p = (tuple(row[i : i + n]) for i in (5, 5 + n, 5 + 2 * n))
            name = names[int(row[1])]
            found.append(Event(time, name, None, 0.0, energy, energy, q, v, p, v, p))
    return in_order(found, h)
