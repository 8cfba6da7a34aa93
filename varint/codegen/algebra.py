"""The operations of an SX function arranged for speed: c/algebra_core.c says how."""

from __future__ import annotations

import struct
from functools import cache
from itertools import accumulate, chain

import casadi as ca
import numpy as np

from varint.codegen import graph
from varint.codegen.core import algebra_entries
from varint.codegen.graph import (
    Graph,
    NotCompilable,
    as_outputs,
    operation_codes,
    raise_unless_arranged,
)
from varint.errors import VarintError
from varint.numerics.operations import CODES, CONST, INPUT, OUTPUT, UNARY, instructions_of

# as in c/raw_graph.h and c/algebra_core.c
_ASKED, _TAKEN = struct.Struct("9P5q"), struct.Struct("3P")
_OUTPUT = -11
_OTHER_NAMES = {"assign": -10, "lift": -10, "sq": -9, "twice": -8, "inv": -7}
_WITHOUT_C = "erfinv"  # the only elementary operation that has no form in C


def graph_of(f: ca.Function, constants: int = -1, roots: bool = False) -> Graph:
    """The operations of the SX function f, rearranged for speed; outputs are dense.

    The argument with the index `constants` is the same all the time. With `roots` these stay what
    they are where they are divided by, too: x/√x is faster, and none where x is zero.

    Raises
    ------
    NotCompilable
        If an operation has no form in C.
    CompileError
        If the core was not built with the package and cannot be compiled.
    """
    try:
        codes, taken, places = instructions_of(f)
    except VarintError as error:
        raise NotCompilable(f"{error}; or use backend='interpreted'") from None
    if CODES[_WITHOUT_C] in codes:
        raise NotCompilable(f"{_WITHOUT_C} has no form in C; use backend='interpreted'")
    if f.nnz_in() != f.numel_in():
        taken = _dense(f, codes, taken)
    sizes = [*map(f.numel_out, range(f.n_out()))]
    wanted, told = np.empty(sum(sizes), np.int32), np.zeros(2, np.int64)
    numbers = [f.instruction_constant(k) for k, code in enumerate(codes) if code == CONST]
    read = codes, [*chain.from_iterable(taken)], places or [0], _ends(f, codes, sizes)
    integers = [np.array(x, np.int32) for x in read]
    arrays = *_kinds(), *integers[1:], np.array([*numbers, 0.0]), wanted, told
    at = [x.ctypes.data for x in (integers[0], *arrays)]
    at[4] = at[4] if places else 0
    counts = len(codes), f.sz_w() if places else len(codes), len(wanted)
    rearrange, take = algebra_entries()
    asked = _ASKED.pack(*at, *counts, constants % f.n_in(), roots)
    raise_unless_arranged(rearrange(asked), len(codes))
    found, count = told.tolist()
    nodes, values = np.empty((count, 4), np.int32), np.empty(count)
    take(_TAKEN.pack(found, nodes.ctypes.data, values.ctypes.data))
    return Graph(nodes, values, as_outputs(wanted, sizes))


def _dense(f: ca.Function, codes: list[int], taken: list[list[int]]) -> list[list[int]]:
    """What is taken, numbers of sparse arguments as they are in dense ones."""
    places = [f.sparsity_in(k).find() for k in range(f.n_in())]
    return [
        [x[0], places[x[0]][x[1]]] if code == INPUT else x
        for code, x in zip(codes, taken, strict=True)
    ]


def _ends(f: ca.Function, codes: list[int], sizes: list[int]) -> list[int]:
    """Where the outputs' numbers stand when all are dense and one after the other."""
    begins, given = [0, *accumulate(sizes)], f.instruction_output
    found = [given(k) for k, code in enumerate(codes) if code == OUTPUT]
    if f.nnz_out() == begins[-1]:
        return [begins[which] + place for which, place in found]
    places = [f.sparsity_out(k).find() for k in range(f.n_out())]
    return [begins[which] + places[which][place] for which, place in found]


@cache
def _kinds() -> tuple[np.ndarray, np.ndarray]:
    """CasADi's operations as in c/raw_graph.h, and how many values they take, by their codes."""
    named = operation_codes() | _OTHER_NAMES
    named["constpow"] = named["pow"]
    found = {
        code: (named[name], 1 if name in UNARY else 2)
        for name, code in CODES.items()
        if name != _WITHOUT_C
    }
    found |= {OUTPUT: (_OUTPUT, 1), CONST: (graph.NUMBER, 0), INPUT: (graph.INPUT, 2)}
    table = np.zeros((2, max(found) + 1), np.int32)
    table[:, [*found]] = np.transpose([*found.values()])
    return table[0], table[1]
