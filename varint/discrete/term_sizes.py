"""How large the terms are that a function adds up: a sum may vanish, its round-off does not.

Running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, §3.3), operation by
operation: an input has its own size, a sum that of its operands together, any other result the
largest of its own, |∂f/∂a| size(a) and |∂f/∂b| size(b). So 1 − cos(q) has the size 2 near q = 0,
and 200 (1.5 − q) the size 600 near q = 1.5. Double precision leaves an error of about 1e-16 times
the size in each result, however small the result is.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np


class _Term(NamedTuple):
    value: float
    size: float


def term_sizes(function: ca.Function, *arguments: np.ndarray) -> np.ndarray:
    """Sizes of the terms in the nonzeros of the first output of an SX function at one point.

    Parameters
    ----------
    function : Function
        Of SX expressions; dense inputs.
    *arguments : ndarray
        One for each input.

    Returns
    -------
    ndarray
        Not finite where the function is not.
    """
    given = [np.asarray(a, dtype=float).reshape(-1).tolist() for a in arguments]
    work: dict[int, _Term] = {}
    found = np.zeros(function.nnz_out(0))
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        out, source = function.instruction_output(k), function.instruction_input(k)
        if code == ca.OP_CONST:
            number = function.instruction_constant(k)
            work[out[0]] = _Term(number, abs(number))
        elif code == ca.OP_INPUT:
            number = given[source[0]][source[1]]
            work[out[0]] = _Term(number, abs(number))
        elif code != ca.OP_OUTPUT:
            work[out[0]] = _result(code, [work[i] for i in source])
        elif out[0] == 0:
            found[out[1]] = work[source[0]].size
    return found


def _result(code: int, operands: list[_Term]) -> _Term:
    if code in _COMMON:
        return _COMMON[code](*operands)
    value, *slopes = (float(x) for x in _slopes(code, len(operands))(*(a.value for a in operands)))
    parts = [abs(slope) * a.size for slope, a in zip(slopes, operands, strict=True)]
    return _Term(value, max([abs(value), *(x for x in parts if np.isfinite(x))]))


# what most expressions are made of: no result is larger than these sizes
_COMMON: dict[int, Callable[..., _Term]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: _Term(-a.value, a.size),
    ca.OP_TWICE: lambda a: _Term(2 * a.value, 2 * a.size),
    ca.OP_SQ: lambda a: _Term(a.value * a.value, 2 * abs(a.value) * a.size),
    ca.OP_ADD: lambda a, b: _Term(a.value + b.value, a.size + b.size),
    ca.OP_SUB: lambda a, b: _Term(a.value - b.value, a.size + b.size),
    ca.OP_MUL: lambda a, b: _Term(
        a.value * b.value, max(abs(a.value) * b.size, a.size * abs(b.value))
    ),
}


@cache
def _slopes(code: int, operands: int) -> ca.Function:
    """Operands → the result of an operation and its derivatives."""
    symbols = [ca.SX.sym("a"), ca.SX.sym("b")][:operands]
    value = ca.SX.binary(code, *symbols) if operands == 2 else ca.SX.unary(code, *symbols)
    slopes = [ca.densify(ca.jacobian(value, x)) for x in symbols]
    return ca.Function("slopes", symbols, [value, *slopes])
