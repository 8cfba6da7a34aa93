"""An SX function as a list of elementary operations, and back: arithmetic and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError, VarintError

# What an expression may be made of: each takes numbers and gives a number, and that is all it does.
_UNARY = """
    assign neg exp log sqrt sq twice inv sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh
    not floor ceil fabs sign erf erfinv log1p expm1
"""
_BINARY = """
    add sub mul div pow constpow lt le eq ne and or fmod remainder copysign if_else_zero fmin fmax
    atan2 hypot lift
"""
# what has steps or kinks; of `if_else_zero` in its condition alone
_WITH_STEPS = """
    not floor ceil fabs sign lt le eq ne and or fmod remainder copysign if_else_zero fmin fmax
"""
WITH_STEPS = frozenset(_WITH_STEPS.split())
KINKS = frozenset(("fabs", "fmin", "fmax"))  # steps of slopes alone
FOLDS = {"asin": "sin", "acos": "cos", "atan": "tan"}  # with kinks or steps, of what each undoes
ZERO = "zero"
UNARY, BINARY = frozenset(_UNARY.split()), frozenset(_BINARY.split())
CODES = {name: getattr(ca, f"OP_{name.upper()}") for name in UNARY | BINARY}
_UNARY_NAMES = {CODES[name]: name for name in UNARY}
_BINARY_NAMES = {CODES[name]: name for name in BINARY}
OUTPUT, CONST, INPUT = ca.OP_OUTPUT, ca.OP_CONST, ca.OP_INPUT
_KNOWN = frozenset((*CODES.values(), OUTPUT, CONST, INPUT))
_OTHERS = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
# Rows and columns of an output. Sparse matrices have memory for every column, whatever they hold.
MOST_ROWS = 10**6


class Output(NamedTuple):
    """One result: its shape, the places (column by column) that are not structural zeros, and the
    nodes whose values stand there.
    """

    shape: tuple[int, int]
    places: list[int]
    nodes: list[int]


class Operations(NamedTuple):
    """Operations in the order of evaluation.

    Node i is ``nodes[i]``: ``("input", k, j)`` is number j of argument k, ``("const", x)`` a
    number, and everything else a name of `UNARY` or `BINARY` with the nodes that it takes, all of
    them before i.
    """

    nodes: list[tuple[Any, ...]]
    outputs: list[Output]


class Instructions(NamedTuple):
    """What CasADi does when it evaluates a function, in turn.

    Attributes
    ----------
    codes : list of int
        Of the operations, as CasADi numbers them.
    taken : list of list of int
        Places of its memory that are read; of an input its argument and number.
    places : list of int or None
        Where each value goes that is no output; None where they are not used again: those go to
        places 0, 1, … in turn.
    """

    codes: list[int]
    taken: list[list[int]]
    places: list[int] | None


def instructions_of(f: ca.Function) -> Instructions:
    """What an SX function does; raises `VarintError` as `operations_of` does."""
    count = range(f.n_instructions())
    codes = [*map(_of_each(f, "instruction_id"), count)]
    strange = {*codes} - _KNOWN
    if strange:
        names = [repr(_OTHERS.get(code, code)) for code in sorted(strange)]
        raise VarintError(
            f"the scene holds the operation {', '.join(names)}, which is no arithmetic; write it "
            "with CasADi's elementary functions (a function that is called must be inlined, "
            "without never_inline)"
        )
    places = None
    if _places_are_reused(f, codes):
        given = f.instruction_output
        places = [given(k)[0] for k, code in enumerate(codes) if code != OUTPUT]
    return Instructions(codes, [*map(_of_each(f, "instruction_input"), count)], places)


def _of_each(f: ca.Function, name: str) -> Callable[[int], Any]:
    """A method of the function without the one around it in Python, which takes as long."""
    inner = getattr(getattr(ca, "_casadi", None), f"Function_{name}", None)
    return getattr(f, name) if inner is None else partial(inner, f)


def constants_of(x: ca.SX) -> np.ndarray:
    """The numbers that an expression holds."""
    f = ca.Function("constants", [], [x], {"allow_free": True})
    codes = enumerate(map(_of_each(f, "instruction_id"), range(f.n_instructions())))
    return np.array([f.instruction_constant(k) for k, code in codes if code == CONST])


def operations_of(f: ca.Function) -> Operations:
    """The operations of an SX function of dense arguments, each as CasADi evaluates it.

    Raises
    ------
    VarintError
        If it holds what is no elementary operation, as the call of another function.
    """
    nodes: list[tuple[Any, ...]] = []
    codes, inputs, places = instructions_of(f)
    # for each place in CasADi's work vector the node whose value it holds now
    at = [*range(len(codes))] if places is None else [0] * f.sz_w()
    found: list[list[int]] = [[0] * f.nnz_out(k) for k in range(f.n_out())]
    for k, (code, taken) in enumerate(zip(codes, inputs, strict=True)):
        if code in _BINARY_NAMES:
            nodes.append((_BINARY_NAMES[code], at[taken[0]], at[taken[1]]))
        elif code in _UNARY_NAMES:
            nodes.append((_UNARY_NAMES[code], at[taken[0]]))
        elif code == OUTPUT:
            which, place = f.instruction_output(k)
            found[which][place] = at[taken[0]]
            continue
        elif code == CONST:
            nodes.append(("const", f.instruction_constant(k)))
        else:
            nodes.append(("input", *taken))
        if places is not None:
            at[places[len(nodes) - 1]] = len(nodes) - 1
    outputs = [
        Output(f.size_out(k), list(f.sparsity_out(k).find()), found[k]) for k in range(f.n_out())
    ]
    return Operations(nodes, outputs)


def _places_are_reused(f: ca.Function, codes: list[int]) -> bool:
    """Whether a value is ever written over another (see CasADi's option `live_variables`). New
    places are taken in turn, so that the last value stands in the last place if none is.
    """
    last = next((k for k in range(len(codes) - 1, -1, -1) if codes[k] != OUTPUT), None)
    values = len(codes) - codes.count(OUTPUT)
    return last is not None and f.instruction_output(last)[0] != values - 1


def expressions_of(operations: Operations, inputs: Sequence[ca.SX]) -> list[ca.SX]:
    """The outputs as expressions of other symbols: operation by operation what was read.

    Raises
    ------
    InputError
        If a node is none of the known operations, or takes what is not there before it.
    """
    work = values_of(operations.nodes, inputs)
    return [_matrix(output, work) for output in operations.outputs]


def values_of(nodes: Sequence[tuple[Any, ...]], inputs: Sequence[ca.SX]) -> list[ca.SX]:
    """Every node as an expression of other symbols; raises as `expressions_of` does."""
    given = [ca.vertsplit(ca.vec(x)) for x in inputs]
    work: list[ca.SX] = []
    for i, (name, *operands) in enumerate(nodes):
        if name == "const":
            work.append(ca.SX(operands[0]))
        elif name == "input":
            if not (
                len(operands) == 2
                and _within(operands[0], len(given))
                and _within(operands[1], len(given[operands[0]]))
            ):
                raise InputError(f"operation {i} takes the input {operands}, which there is not")
            work.append(given[operands[0]][operands[1]])
        else:
            arity = 1 if name in UNARY else 2 if name in BINARY else 0
            if not arity or len(operands) != arity or not all(_within(j, i) for j in operands):
                raise InputError(
                    f"operation {i} is {name!r} of {operands}; it must be one of the known "
                    "operations of nodes before it"
                )
            work.append(operation(name, *(work[j] for j in operands)))
    return work


def operation(name: str, *taken: ca.SX) -> ca.SX:
    """One of `UNARY` or `BINARY` of what it takes."""
    make = ca.SX.unary if len(taken) == 1 else ca.SX.binary
    return make(CODES[name], *taken)


def takes(name: str, expression: ca.SX) -> bool:
    """Whether an operation is among those of an expression."""
    function = ca.Function("some", ca.symvar(expression), [expression])
    return CODES[name] in map(function.instruction_id, range(function.n_instructions()))


def has_step(name: str, *inner: str) -> bool:
    """Whether an operation of what is made by others has steps or kinks; a zero is made by ZERO."""
    return name in WITH_STEPS or (name == "hypot" and ZERO in inner) or inner[0] == FOLDS.get(name)


def _within(j: Any, count: int) -> bool:
    return type(j) is int and 0 <= j < count


def _matrix(output: Output, work: list[ca.SX]) -> ca.SX:
    """An output with exactly its structural zeros."""
    (rows, columns), places, nodes = output
    if not (_within(rows, MOST_ROWS) and _within(columns, MOST_ROWS)):
        raise InputError(f"an output has the shape {(rows, columns)}; at most {MOST_ROWS} each way")
    if len(places) != len(nodes) or not all(_within(j, len(work)) for j in nodes):
        raise InputError("an output takes operations that there are not")
    increasing = all(a < b for a, b in pairwise(places))
    if not (increasing and all(_within(j, rows * columns) for j in places)):
        raise InputError("the places of an output must increase and lie within its shape")
    if not places:
        return ca.SX(rows, columns)
    sparsity = ca.Sparsity.triplet(
        rows, columns, [j % rows for j in places], [j // rows for j in places]
    )
    return ca.SX(sparsity, ca.vertcat(*(work[j] for j in nodes)))
