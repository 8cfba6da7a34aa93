"""What is watched for along runs of a few steps: looked for by the core in the call that makes the
run.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.sought import Sought, sought_by
from varint.discrete.lagrangian import energy_function
from varint.integration.energy_check import SAMPLES, places_looked_at
from varint.integration.events.crossings import (
    DEEP,
    LATELY,
    REMEMBERED,
    Watch,
    crossing_search,
    parse_watch,
    parse_watches,
)
from varint.integration.events.isolation import CrossingSearch
from varint.integration.events.native_crossings import NUMBERS
from varint.integration.plain_start import wanted_of
from varint.integration.trajectories import in_order
from varint.numerics.arrays import over_columns
from varint.results.records import Event
from varint.scene.expressions import Written, as_written, is_written_so
from varint.scene.memory import per_system
from varint.scene.system import System


class Search(NamedTuple):
    """What is looked for in runs by a loop: None where it is to be looked for elsewhere; what was
    asked for, kept so that no other expressions are taken for these, and what that says.
    """

    kernel: Kernel
    sought: Sought | None
    asked: tuple
    written: tuple[Written, ...] = ()


@per_system
def searches_known(system: System) -> dict[tuple, Search]:
    """Searches by what was asked for, see `key_of`."""
    return {}


def key_of(until: Any, events: Any) -> tuple | None:
    """What tells whether the same was asked for before; None where it is to be read."""
    if events is not None and type(events) is not dict:
        return None
    key: list[Any] = [until is not None]
    for wanted in wanted_of(until, events):
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
    search = None if key is None else known.get(key) or _written_alike(known, key, until, events)
    if search is None or search.kernel is not kernel:
        watches = [] if until is None else [parse_watch("until", until)]
        watches += parse_watches(events)
        search = _search(system, kernel, watches, until is not None)
        if key is not None:
            _keep(system, key, search)
    return search.sought


def _written_alike(
    known: dict[tuple, Search], key: tuple, until: Any, events: Any
) -> Search | None:
    """A search for the same small expressions, which were written anew for this call."""
    asked = [wanted[0] if type(wanted) is tuple else wanted for wanted in wanted_of(until, events)]
    for other, search in islice(reversed(known.copy().items()), LATELY):  # threads may ask for more
        same = search.written and (other[0], *other[2::2]) == (key[0], *key[2::2])
        if same and all(map(is_written_so, asked, search.written)):
            return search
    return None


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
    asked = tuple(ca.SX(watch.expression) for watch in watches)
    return found._replace(asked=asked, written=tuple(as_written(x, DEEP) for x in asked))


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
    c: np.ndarray,
    names: Sequence[str],
    zeros: np.ndarray,
    h: float,
    end: float | None,
) -> tuple[Event, ...]:
    """The zeros of the expressions with these names as records, up to the time at which the run
    ends.

    Parameters
    ----------
    system : System
    c : array
        Parameters.
    names : sequence of str
        Of the zeros' expressions, by their numbers.
    zeros : array
        See `Sought`.
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
