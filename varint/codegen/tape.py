"""An SX function as data for the machine of c/tape.h: nothing is compiled for it."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from varint.codegen.core import arrange_entry
from varint.codegen.graph import (
    TOO_MANY_VALUES,
    Graph,
    NotCompilable,
    flat,
    operation_codes,
    raise_unless_arranged,
)

MOST = 65_535  # registers, operands are numbers of 16 bits
EXACT, ITERATED = "rsqrt_exact", "rsqrt_iterated"  # 1/√x where roots are few, and many
# as in c/tape_core.c
_ARRANGED = struct.Struct("8P3q")


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


def tape_of(graph: Graph, last: int) -> Tape:
    """The tape of a graph on inputs 0 to `last`, the last of which is the same all the time, for
    few square roots; c/tape_core.c arranges it.

    Raises
    ------
    NotCompilable
        If there are too many operations.
    CompileError
        If the core was not built with the package and cannot be compiled.
    """
    count, wanted = len(graph), flat(graph.outputs)
    once, often = np.empty((2, count + 1, 6), np.uint16)
    inputs, places = np.empty((count, 3), np.uint16), np.empty(len(wanted), np.int32)
    numbers, told = np.empty(count, np.int32), np.zeros(9, np.int64)
    arrays = graph.rows, wanted, once, often, inputs, numbers, places, told
    asked = _ARRANGED.pack(*(x.ctypes.data for x in arrays), count, len(wanted), last)
    raise_unless_arranged(arrange_entry()(asked), count)
    of = [(k, r) for k, output in enumerate(graph.outputs) for r in range(len(output))]
    if max(chain(*of), default=0) > MOST:
        raise NotCompilable(TOO_MANY_VALUES)
    uniforms, many, registers, *ends, operations, roots = told.tolist()
    constants = np.append(graph.numbers[numbers[: ends[3]]], 0.0)
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


def with_many_roots(tape: Tape) -> Tape:
    """The same where reciprocal square roots count by their number, not by their latency."""
    codes, often = operation_codes(), tape.often.copy()
    often[often[:, 0] == codes[EXACT], 0] = codes[ITERATED]
    return replace(tape, often=often)
