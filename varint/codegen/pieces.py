"""A long C function in pieces: blocks that repeat, each form once, or parts one after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from varint.codegen.dependence import sine_and_cosine
from varint.codegen.graph import Graph
from varint.codegen.joined import join
from varint.codegen.parts import LARGEST, Statement, c_parts, calls_of
from varint.codegen.repeats import Repeats
from varint.codegen.repeats_in_c import c_repeats

APART = "static __attribute__((noinline, noclone, unused))"
REPEATED = 0.6  # of the statements at most, where blocks that repeat are written once
# of what the same without blocks executes, at most: many bodies, whose pairs take more to fetch
# than to compute, would be slower by half
MORE = 1.2
SHORT = 16  # operations of a block on average: to call shorter ones takes as long as what they do


class Pieces(NamedTuple):
    """The body of a function, the C source before it that it calls, the statements of both, most
    of them in one C function, and those that a call executes.
    """

    before: str
    body: list[str]
    length: int
    largest: int
    executed: int


def repeats_of(graph: Graph, live: list[int], uniform: list[bool]) -> Repeats | None:
    """The operations in blocks, where these are long enough and many of one form."""
    pairs = sine_and_cosine(graph, live, uniform)
    varying = [i for i in live if not uniform[i] and graph.nodes[i][0] != "input"]
    units = [pairs.get(i, (i,)) for i in varying if pairs.get(i) != (0, 0)]
    found = Repeats(graph, units, uniform)
    if found.written() > REPEATED * len(units):
        return None
    join(found)
    return found if len(units) > SHORT * len(found.order) else None


def worth_it(blocks: Pieces, parts: Pieces) -> bool:
    """Are the blocks much shorter to compile than the parts, and hardly slower to run?"""
    return (
        blocks.length <= REPEATED * parts.length
        and blocks.largest <= LARGEST
        and blocks.executed <= MORE * parts.executed
    )


def in_blocks(
    name: str,
    found: Repeats,
    arguments: list[str],
    stride: str,
    constant: Callable[[int], str],
    place: Callable[[int], int],
) -> Pieces:
    """The function as blocks that repeat, each form once."""
    blocks = c_repeats(name, found, _called(arguments), stride, constant, place)
    before = blocks.tables + "".join(
        c_function(APART, part, [*arguments, "const int32_t *at", "const double *c", "V *m"], text)
        for part, text in blocks.functions.items()
    )
    largest = max(len(blocks.calls), *map(len, blocks.functions.values()))
    return Pieces(before, blocks.calls, blocks.length, largest, blocks.executed)


def in_parts(
    name: str, statements: list[Statement], stores: list[Statement], arguments: list[str]
) -> Pieces:
    """The function as parts of bounded length, one after the other."""
    parts = c_parts(name, statements, stores)
    before = "".join(c_function(APART, x.name, [*arguments, "V *m"], x.body) for x in parts)
    length, largest = sum(len(x.body) for x in parts), max(len(x.body) for x in parts)
    return Pieces(before, calls_of(parts, _called(arguments)), length, largest, length)


def _called(arguments: list[str]) -> str:
    """The arguments as those who call the function's parts write them."""
    return ", ".join(x.split("*")[-1].split()[-1] for x in arguments)


def c_function(kind: str, name: str, arguments: list[str], body: list[str]) -> str:
    """A C function that may leave arguments unused."""
    unused = " ".join(f"(void){x.split('*')[-1].split()[-1]};" for x in arguments)
    head = f"{kind} void {name}({', '.join(arguments)}) {{"
    return "\n    ".join([head, unused, *body]) + "\n}\n"
