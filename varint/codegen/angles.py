"""Sines and cosines of several angles by one call, which takes a vector of them at a time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from varint.codegen.arguments import c_number, c_source
from varint.codegen.parts import Statement

AT_ONCE = c_number(c_source("newton_table.h"), "ANGLES")  # angles of a call


class Line(Protocol):
    """Something that is done, the values it defines and those it takes."""

    @property
    def defined(self) -> tuple[int, ...]: ...

    @property
    def taken(self) -> tuple[int, ...]: ...


Some = TypeVar("Some", bound=Line)


def with_angles_together(statements: Sequence[Statement], fewest: int) -> list[Statement]:
    """`together` of statements in C."""
    return together(statements, fewest, _call)


def together(
    lines: Sequence[Some], fewest: int, call: Callable[[Sequence[Some]], Some]
) -> list[Some]:
    """The lines with the sines and cosines of angles that do not wait for one another in one
    place, before the first of them is needed, where they are so many at least; those define two
    values. `call` makes one of several.
    """
    calls = _calls(lines, fewest)
    result: list[Some] = []
    written = [False] * len(lines)
    for i, x in enumerate(lines):
        if written[i]:
            continue
        if i in calls:
            for j in _needed(lines, calls[i], written):
                result.append(lines[j])
                written[j] = True
            result.append(call([lines[j] for j in calls[i]]))
            for j in calls[i]:
                written[j] = True
        else:
            result.append(x)
            written[i] = True
    return result


def _calls(lines: Sequence[Line], fewest: int) -> dict[int, list[int]]:
    """Line of an angle → all those whose angles go with it."""
    depth: dict[int, int] = {}  # of a value: how many sines lie before it
    alike: dict[int, list[int]] = defaultdict(list)
    for i, x in enumerate(lines):
        deepest = max([depth.get(j, 0) for j in x.taken], default=0)
        if len(x.defined) == 2:
            alike[deepest].append(i)
            deepest += 1
        for j in x.defined:
            depth[j] = deepest
    calls: dict[int, list[int]] = {}
    for found in alike.values():
        for k in range(0, len(found), AT_ONCE):
            if len(group := found[k : k + AT_ONCE]) >= fewest:
                calls |= dict.fromkeys(group, group)
    return calls


def _needed(lines: Sequence[Line], wanted: Sequence[int], written: Sequence[bool]) -> list[int]:
    """What is still to be written before the lines that are wanted, in its order."""
    values = {j for i in wanted for j in lines[i].taken}
    found = []
    for i in range(max(wanted), -1, -1):
        x = lines[i]
        if not written[i] and i not in wanted and not values.isdisjoint(x.defined):
            found.append(i)
            values.update(x.taken)
    return found[::-1]


def _call(pairs: Sequence[Statement]) -> Statement:
    angles = [x.taken[0] for x in pairs]
    a, s, c = (f"{name}{pairs[0].defined[0]}" for name in "asc")
    values = ", ".join(
        f"x{x.defined[0]} = {s}[{k}], x{x.defined[1]} = {c}[{k}]" for k, x in enumerate(pairs)
    )
    text = (
        f"V {a}[{AT_ONCE}] = {{{', '.join(f'x{i}' for i in angles)}}}, {s}[{AT_ONCE}], "
        f"{c}[{AT_ONCE}]; sines_and_cosines(w, {a}, {s}, {c}); const V {values};"
    )
    defined = tuple(i for x in pairs for i in x.defined)
    return Statement(text, defined, tuple(dict.fromkeys(angles)))
