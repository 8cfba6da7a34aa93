"""How the C files are written: comments, arrays of numbers, calls of CasADi's functions."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from varint.standalone.c_text import CFunction

WIDTH = 96  # columns of a comment
OPENING = """#ifdef __cplusplus
extern "C" {
#endif

"""
CLOSING = """
#ifdef __cplusplus
}
#endif
"""


class Files(NamedTuple):
    """Texts of the header, the source and the test program."""

    header: str
    source: str
    test: str


def comment(lines: Sequence[str]) -> str:
    """Sentences as a comment of C; what would end it is parted."""
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(line, WIDTH, subsequent_indent=_indent(line)) or [""]
    ]
    return "/* " + "\n   ".join(wrapped).replace("*/", "* /") + " */\n"


def _indent(line: str) -> str:
    return " " * (len(line) - len(line.lstrip()) + 2)


def numbers(values: Any) -> str:
    """Numbers that C reads back to the last bit."""
    return ", ".join(repr(float(x)) for x in np.ravel(values))


def array(name: str, values: Any, static: bool = True) -> str:
    """A constant array of doubles."""
    kind, size = "static const" if static else "const", np.size(values)
    return f"{kind} double {name}[{size}] = {{\n{textwrap.fill(numbers(values), WIDTH)}\n}};\n"


def work_bytes(f: CFunction) -> int:
    """Bytes of the arrays that a call works on: pointers and doubles of eight, integers of four."""
    return 8 * (f.arguments + f.results + f.numbers) + 4 * f.integers


def calls(
    head: str,
    f: CFunction,
    arguments: Sequence[str],
    results: Sequence[str],
    body: str = "\n@CALL@\n",
) -> str:
    """A C function with this head that calls f where its body says ``@CALL@``; its arrays to work
    on lie on the stack.
    """
    declared = [
        f"    const double *arg[{max(f.arguments, 1)}];",
        f"    double *res[{max(f.results, 1)}];",
        f"    double w[{max(f.numbers, 1)}];",
        f"    int iw[{max(f.integers, 1)}];",
    ]
    given = [f"    arg[{i}] = {x};" for i, x in enumerate(arguments)]
    given += [f"    res[{i}] = {x};" for i, x in enumerate(results)]
    call = "\n".join([*given, f"    {f.called}(arg, res, iw, w, 0);"])
    inside = body.replace("@CALL@", call).strip("\n")
    return "\n".join([f"\n{head} {{", *declared, inside, "}", ""])
