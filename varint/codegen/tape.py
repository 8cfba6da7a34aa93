"""An SX function as data for the machine of c/tape.h: nothing is compiled for it."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.core import arrange_entry
from varint.codegen.dependence import needed
from varint.codegen.graph import Graph, NotCompilable

MOST = 65_535  # registers, operands are numbers of 16 bits
EXACT, ITERATED = "rsqrt_exact", "rsqrt_iterated"  # 1/√x where roots are few, and many
# as in c/tape_core.c
_ARRANGED = struct.Struct("8P3q")
_UNKNOWN, _WITHOUT_MEMORY, _TOO_MANY, _WITHOUT_FORM = -1, 1, 2, 3


class Sizes(NamedTuple):
    """Of a graph: its nodes, those that do not depend on the parameters alone, and the square roots
    among them.
    """

    nodes: int
    operations: int
    roots: int


@dataclass(frozen=True, eq=False)
class Tape:
    """A function's operations; see c/tape.h.

    Attributes
    ----------
    sizes : Sizes
        Of the graph that they were.
    uniforms, numbers, registers : int
        Registers of what is the same all the time, numbers of `once`, registers in all.
    once, often : array (…, 6) of uint16
        Operations on the parameters alone, and those of a call.
    constants : array
    inputs, outputs : array (…, 3) of uint16
        (argument, component, register).
    """

    sizes: Sizes
    uniforms: int
    numbers: int
    registers: int
    once: np.ndarray
    often: np.ndarray
    constants: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


_NO_OPERATION, _NO_PLACES = np.zeros((1, 6), np.uint16), np.zeros((0, 3), np.uint16)
NOTHING_TO_DO = Tape(
    Sizes(0, 0, 0), 0, 0, 0, _NO_OPERATION, _NO_OPERATION, np.zeros(1), _NO_PLACES, _NO_PLACES
)


@cache
def operation_codes() -> dict[str, int]:
    """The machine's operations by name, as c/tape.h lists them."""
    text, names = c_source("tape.h").replace("\\\n", ""), list[str]()
    for name in ("OPERATIONS", "ONLY_ONCE", "ONLY_OFTEN"):
        calls = text.partition(f"#define {name}(")[2].partition("\n")[0].partition(")")[2]
        names += [call.partition("(")[2] for call in calls.split(")") if "(" in call]
    return {name: k for k, name in enumerate(["end", *names])}


def tape_of(graph: Graph, last: int) -> Tape:
    """The tape of a graph on inputs 0 to `last`, the last of which is the same all the time, for
    few square roots; c/tape_core.c arranges it.

    Raises
    ------
    NotCompilable
        If an operation has no form there, or there are too many.
    CompileError
        If the core was not built with the package and cannot be compiled.
    """
    kinds, count = _kinds(), len(graph.nodes)
    nodes = np.fromiter(chain.from_iterable([_as_row(kinds, x) for x in graph.nodes]), np.int32)
    wanted = np.fromiter(chain.from_iterable(graph.outputs), np.int32)
    once, often = np.empty((2, count + 1, 6), np.uint16)
    inputs, places = np.empty((count, 3), np.uint16), np.empty(len(wanted), np.int32)
    numbers, told = np.empty(count, np.int32), np.zeros(9, np.int64)
    arrays = nodes, wanted, once, often, inputs, numbers, places, told
    asked = _ARRANGED.pack(*(x.ctypes.data for x in arrays), count, len(wanted), last)
    answer = arrange_entry()(asked)
    if answer == _WITHOUT_FORM:
        names = {graph.nodes[i][0] for i in needed(graph)} - {*kinds}
        raise NotCompilable(f"{sorted(names)} have no form on a tape; use backend='compiled'")
    if answer == _WITHOUT_MEMORY:
        raise MemoryError(f"no memory to arrange {count} operations")
    of = [(k, r) for k, output in enumerate(graph.outputs) for r in range(len(output))]
    if answer == _TOO_MANY or max(chain(*of), default=0) > MOST:
        raise NotCompilable("too many values for a tape; use backend='compiled'")
    uniforms, many, registers, *ends, operations, roots = told.tolist()
    constants = np.array([*(graph.nodes[i][1] for i in numbers[: ends[3]].tolist()), 0.0])
    outputs = np.array(of, np.uint16).reshape(-1, 2)
    return Tape(
        Sizes(count, operations, roots),
        uniforms,
        many,
        registers,
        once[: ends[0]].copy(),
        often[: ends[1]].copy(),
        constants,
        inputs[: ends[2]].copy(),
        np.column_stack([outputs, places.astype(np.uint16)]),
    )


@cache
def _kinds() -> dict[str, int]:
    """What nodes may be, as in c/tape_core.c."""
    others = "fnma", "fms", "fma", "input", "const"
    return operation_codes() | {name: _UNKNOWN - k for k, name in enumerate(others, 1)}


def _as_row(kinds: dict[str, int], node: tuple) -> tuple[int, ...]:
    """A node as in c/tape_core.c."""
    if len(node) == 3:
        return kinds.get(node[0], _UNKNOWN), node[1], node[2], -1
    if node[0] == "const":
        return kinds["const"], -1, -1, -1
    return (kinds.get(node[0], _UNKNOWN), *node[1:], -1, -1)[:4]


def with_many_roots(tape: Tape) -> Tape:
    """The same where reciprocal square roots count by their number, not by their latency."""
    codes, often = operation_codes(), tape.often.copy()
    often[often[:, 0] == codes[EXACT], 0] = codes[ITERATED]
    return replace(tape, often=often)
