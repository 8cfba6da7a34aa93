"""CasADi functions as machine code: generated, compiled once, kept in the cache, called as external
functions.

What is called thousands of times, like the one-interval kernels of a large program, costs CasADi's
virtual machine about 6 ns an operation and compiled code a tenth of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from varint.numerics.progress import notice

MOST = "#pragma GCC optimize (1)\n"  # more takes twice as long to compile and gains 5 %
SAVED = 5e-9  # seconds an operation and call
COMPILING = 0.15, 1.2e-4  # seconds for the compiler to start, and for each operation


def compiled_functions(functions: Sequence[ca.Function]) -> list[ca.Function]:
    """The same functions, compiled together; they cannot be differentiated.

    Raises
    ------
    CompileError
        If there is no compiler.
    """
    from varint.codegen.cache import library

    generator = ca.CodeGenerator("kernels.c", {"with_header": False})
    for f in functions:
        generator.add(f)
    with notice("compiling the functions of a step"):
        path = library(MOST + generator.dump())._name
    return [ca.external(f.name(), path) for f in functions]


def compiled_where_it_pays(
    functions: Sequence[ca.Function], calls: Sequence[float]
) -> list[ca.Function]:
    """The functions compiled if that saves more time over so many calls of each than compiling
    takes.

    By the number of operations, not by what the cache holds: the same input gives the same digits.

    Parameters
    ----------
    functions : sequence of Function
    calls : sequence of float
        How often each will be called, as far as one can tell.

    Returns
    -------
    list of Function
        As they were, where the calls are few or nothing can be compiled.
    """
    sizes = [f.n_instructions() for f in functions]
    saved = SAVED * sum(size * count for size, count in zip(sizes, calls, strict=True))
    if saved < COMPILING[0] + COMPILING[1] * sum(sizes):
        return list(functions)
    from varint.codegen.cache import CompileError, compiler  # a first solve goes without

    if compiler() is None:
        return list(functions)
    try:
        return compiled_functions(functions)
    except CompileError:
        return list(functions)
