"""CasADi's elementary operations as SymPy expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from varint.errors import InputError
from varint.notation.extra import sympy_module
from varint.notation.numbers import exact_number
from varint.numerics.operations import Operations, operations_of

# functions of one name in CasADi and in SymPy
_SAME = """
    exp log sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh floor sign erf erfinv atan2
"""
SAME = tuple(_SAME.split())
LONGEST = 1000  # operations written out that somebody may want to read


def sympy_of(inputs: Sequence[ca.SX], letters: Sequence[Any], outputs: Sequence[ca.SX]) -> list:
    """SX expressions as SymPy expressions, operation by operation; each output a list of its
    entries, column by column.

    Parameters
    ----------
    inputs : sequence of SX
        Columns of symbols.
    letters : sequence of sequences of sympy.Expr
        What stands for each of these symbols.
    outputs : sequence of SX
        Expressions of the inputs.

    Raises
    ------
    InputError
        If an operation has no counterpart in SymPy, or there are too many to be read.
    """
    sp = sympy_module("sympy_of()")
    found = operations_of(ca.Function("read", list(inputs), list(outputs), {"cse": True}))
    long = max(lengths(found), default=0)
    if long > LONGEST:
        raise InputError(
            f"an expression has {long} operations when it is written out, more than anybody reads "
            f"(at most {LONGEST}); take fewer bodies or links"
        )
    table, tests = _table(sp), _tests(sp)
    work: list[Any] = []
    conditions: dict[int, Any] = {}  # of nodes that are 1 where something holds, else 0
    branches: dict[int, tuple[Any, Any]] = {}  # of nodes that are a value where something holds

    def holds(j: int) -> Any:
        return conditions[j] if j in conditions else sp.Ne(work[j], 0)

    for i, (name, *operands) in enumerate(found.nodes):
        if name == "const":
            work.append(exact_number(operands[0]))
        elif name == "input":
            work.append(letters[operands[0]][operands[1]])
        elif name == "if_else_zero":
            branches[i] = holds(operands[0]), work[operands[1]]
            work.append(sp.Piecewise(branches[i][::-1], (0, True)))
        elif name == "add" and _are_complements(sp, branches, operands):
            (condition, one), (_, other) = (branches[j] for j in operands)
            work.append(sp.Piecewise((one, condition), (other, True)))
        elif name in tests or name in ("and", "or", "not"):
            if name in tests:
                conditions[i] = tests[name](*(work[j] for j in operands))
            else:
                join = {"and": sp.And, "or": sp.Or, "not": sp.Not}[name]
                conditions[i] = join(*(holds(j) for j in operands))
            work.append(sp.Piecewise((1, conditions[i]), (0, True)))
        elif name in table:
            work.append(table[name](*(work[j] for j in operands)))
        else:
            raise InputError(f"the operation {name!r} of CasADi has no counterpart in SymPy")
    entries = []
    for output in found.outputs:
        entries.append([sp.Integer(0)] * (output.shape[0] * output.shape[1]))
        for place, node in zip(output.places, output.nodes, strict=True):
            entries[-1][place] = work[node]
    return entries


def lengths(operations: Operations) -> list[int]:
    """Operations of each output when it is written out, shared parts as often as they occur."""
    size: list[int] = []
    for name, *operands in operations.nodes:
        size.append(1 if name in ("const", "input") else 1 + sum(size[j] for j in operands))
    return [sum(size[j] for j in output.nodes) for output in operations.outputs]


def _are_complements(
    sp: Any, branches: Mapping[int, tuple[Any, Any]], operands: Sequence[int]
) -> bool:
    """Whether two values are added that hold one where the other does not: CasADi's `if_else`."""
    if not all(j in branches for j in operands):
        return False
    one, other = (branches[j][0] for j in operands)
    return bool(other == sp.Not(one))


def _table(sp: Any) -> Mapping[str, Callable[..., Any]]:
    """What is made of CasADi's operations by name."""
    half = sp.Rational(1, 2)
    return {name: getattr(sp, name) for name in (*SAME, "sqrt")} | {
        "assign": lambda x: x,
        "lift": lambda x, guess: x,
        "neg": lambda x: -x,
        "sq": lambda x: x**2,
        "twice": lambda x: 2 * x,
        "inv": lambda x: 1 / x,
        "ceil": sp.ceiling,
        "fabs": sp.Abs,
        "log1p": lambda x: sp.log(1 + x),
        "expm1": lambda x: sp.exp(x) - 1,
        "add": lambda x, y: x + y,
        "sub": lambda x, y: x - y,
        "mul": lambda x, y: x * y,
        "div": lambda x, y: x / y,
        "pow": lambda x, y: x**y,
        "constpow": lambda x, y: x**y,
        "fmin": sp.Min,
        "fmax": sp.Max,
        "hypot": lambda x, y: (x**2 + y**2) ** half,
        "copysign": lambda x, y: sp.Piecewise((sp.Abs(x), y >= 0), (-sp.Abs(x), True)),
        # the remainder has the sign of x, as in C
        "fmod": lambda x, y: x - y * sp.sign(x / y) * sp.floor(sp.Abs(x / y)),
    }


def _tests(sp: Any) -> Mapping[str, Callable[..., Any]]:
    return {"lt": sp.Lt, "le": sp.Le, "eq": sp.Eq, "ne": sp.Ne}
