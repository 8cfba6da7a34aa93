"""Long straight-line code as several C functions one after the other.

The time of a C compiler grows faster than the length of a function, for its values live across all
of it. In parts of bounded length it grows with the number of parts; what one part leaves for
another lies in an array, as most values of a long function would in any case.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

LARGEST = 2_000  # statements of a function that is left whole
PART = 500  # statements of a part, besides what is read and left


class Statement(NamedTuple):
    """A C statement, the values it defines and those it takes; inputs are read anew in every
    part.
    """

    text: str
    defined: tuple[int, ...]
    taken: tuple[int, ...]
    is_input: bool = False


class Part(NamedTuple):
    """A C function: its name, its statements, and the length of the array `m` when it returns."""

    name: str
    body: list[str]
    room: int


def c_parts(name: str, statements: Sequence[Statement], stores: Sequence[Statement]) -> list[Part]:
    """The statements in parts; every output is stored where its value is known.

    Parameters
    ----------
    name : str
        Of the function; parts are numbered.
    statements, stores : sequence of Statement
        In the order of evaluation; what is stored in the outputs.
    """
    inputs = {i: x.text for x in statements if x.is_input for i in x.defined}
    work = _with_stores([x for x in statements if not x.is_input], stores, inputs)
    pieces = [work[k : k + PART] for k in range(0, len(work), PART)]
    last = {i: k for k, piece in enumerate(pieces) for x in piece for i in x.taken}
    places: dict[int, int] = {}
    free: list[int] = []
    room, result = 0, []
    for k, piece in enumerate(pieces):
        body, here = [], set()
        for x in piece:
            for i in x.taken:
                if i not in here:
                    body.append(inputs.get(i) or f"const V x{i} = m[{places[i]}];")
                    here.add(i)
            body.append(x.text)
            here.update(x.defined)
        ended = [i for i in places if last[i] == k]
        for x in piece:
            for i in x.defined:
                if last.get(i, k) > k:
                    if not free:
                        free.append(room)
                        room += 1
                    places[i] = free.pop()
                    body.append(f"m[{places[i]}] = x{i};")
        free += [places.pop(i) for i in ended]  # not within the part: it reads them anywhere
        result.append(Part(f"{name}_{k}", body, room))
    return result


def _with_stores(
    work: Sequence[Statement], stores: Sequence[Statement], known: dict[int, str]
) -> list[Statement]:
    """The stores of outputs behind the statements that define them."""
    waiting: dict[int, list[Statement]] = {}
    result = []
    for x in stores:
        if x.taken and x.taken[0] not in known:
            waiting.setdefault(x.taken[0], []).append(x)
        else:
            result.append(x)
    for x in work:
        result.append(x)
        for i in x.defined:
            result += waiting.pop(i, [])
    return result


def calls_of(parts: Sequence[Part], arguments: str) -> list[str]:
    """C statements that call the parts one after the other."""
    room = max(parts[-1].room, 1)
    return [f"V m[{room}];", *(f"{part.name}({arguments}, m);" for part in parts)]
