"""How the run loops are called: the layouts of c/run.h, and what they answer."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Mapping
from ctypes import Structure, c_double, c_int64, c_void_p
from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


@cache
def c_source(name: str) -> str:
    """A C file of this package, with those of its own that it includes in their places."""
    before, ours, after = '#include "', '"\n', _text(name)
    return "".join(
        [
            c_source(line[len(before) : -len(ours)])
            if line.startswith(before) and line.endswith(ours)
            else line
            for line in after.splitlines(keepends=True)
        ]
    )


def _text(name: str) -> str:
    with open(os.path.join(os.path.dirname(__file__), "c", name)) as file:
        return file.read()


def c_number(text: str, name: str) -> int:
    """A whole number that C source defines."""
    return int(text.partition(f"#define {name} ")[2].split(maxsplit=1)[0])


def c_names(text: str, before: str) -> list[str]:
    """Names of an enumeration in C source."""
    return [name.strip() for name in text.partition(before)[2].partition("}")[0].split(",")]


def c_table(kind: str, name: str, values: Iterable[str]) -> str:
    """A constant array in C, of one zero where there are no values."""
    entries = ", ".join(values) or "0"
    return f"static const {kind} {name}[] __attribute__((unused)) = {{{entries}}};\n"


def c_tables(arrays: Mapping[str, np.ndarray]) -> str:
    """Arrays of whole or other numbers in C."""
    return "".join(
        c_table("int", name, map(str, x.tolist()))
        if x.dtype.kind == "i"
        else c_table("double", name, map(float.hex, x.tolist()))
        for name, x in arrays.items()
    )


Status = IntEnum("Status", c_names(c_source("run.h"), "enum Status {"), start=0)  # type: ignore[misc]  # how a run ended
DONE, NOT_CONVERGED, NOT_FINITE = Status
LATELY, MOST_NOTED = (c_number(c_source("run.h"), name) for name in ("LATELY", "MOST_NOTED"))


class RunArguments(Structure):
    """One motion; see c/run.h."""

    _fields_ = [
        ("steps", c_int64),
        ("save_every", c_int64),
        ("first", c_int64),
        ("most", c_int64),
        ("t0", c_double),
        ("h", c_double),
        ("level", c_double),
        ("start", c_void_p),
        ("c", c_void_p),
        ("u", c_void_p),
        ("rows", c_void_p),
        ("carry", c_void_p),
        ("stats", c_void_p),
        ("scene", c_void_p),
        ("notes", c_void_p),
        ("rests", c_void_p),
        ("without_velocities", c_int64),
        ("heights", c_void_p),
        ("seen", c_void_p),
        ("end", c_double),
        ("alone", c_int64),
    ]


class PartsArguments(Structure):
    """One step from each of many states; see c/parts.c."""

    _fields_ = [
        ("count", c_int64),
        ("told", c_int64),
        ("used", c_int64),
        ("most", c_int64),
        ("start", c_void_p),
        ("t", c_void_p),
        ("h", c_void_p),
        ("c", c_void_p),
        ("u", c_void_p),
        ("opening", c_void_p),
        ("rows", c_void_p),
        ("good", c_void_p),
        ("scene", c_void_p),
    ]


class RunStats(Structure):
    """What a run tells of itself, before (q, p, v) of the node where it ended; see c/run.h."""

    _fields_ = [
        ("status", c_double),
        ("steps", c_double),
        ("iterations", c_double),
        ("most_iterations", c_double),
        ("residual", c_double),
        ("failed", c_double),
        ("contraction", c_double),
        ("noted", c_double),
    ]


class MembersArguments(Structure):
    """Many motions of one scene; see c/run.h."""

    _fields_ = [
        ("members", c_int64),
        ("steps", c_int64),
        ("save_every", c_int64),
        ("nodes", c_int64),
        ("apart", c_int64),
        ("t0", c_double),
        ("h", c_double),
        ("q0", c_void_p),
        ("p0", c_void_p),
        ("c", c_void_p),
        ("u", c_void_p),
        ("q", c_void_p),
        ("p", c_void_p),
        ("good", c_void_p),
    ]


_CODES = {c_int64: "q", c_double: "d", c_void_p: "P"}


def packing(layout: type[Structure]) -> struct.Struct:
    """A structure's fields as bytes: made in a third of the time of an instance, and safe where
    several threads call at once.
    """
    return struct.Struct("".join(_CODES[field[1]] for field in layout._fields_))  # type: ignore[index]
