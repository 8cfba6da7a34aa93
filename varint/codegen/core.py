"""Gauss rules with nothing compiled for the scene: the loop of c/gauss.c, built once, and the
scene's operations as data.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from ctypes import CDLL, c_char_p, c_int, c_int64, c_void_p
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.cache import AS_WRITTEN, library, vector_length
from varint.codegen.gauss import Scheme, gauss_scheme
from varint.codegen.graph import NotCompilable, kernel_per_system, operations
from varint.codegen.kernel import FEW_ROOTS, Kernel
from varint.codegen.tableau import tableau_arrays
from varint.codegen.tape import Tape, tape_of
from varint.numerics.progress import notice
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_COORDINATES, MOST_CONTROLS, MOST_TAKEN = 64, 16, 512  # MOST_N, … of c/scene.h
ALIGNED = 64  # bytes
_LEVELS = {8: "x86_64_v4", 4: "x86_64_v3", 2: "plain"}  # as setup.py calls them


@kernel_per_system
def gauss_on_tape(system: System, rule: Rule) -> Kernel:
    """The kernel that `gauss_kernel` compiles, with nothing compiled for the scene: the same
    numbers in two to four times the time.

    Raises
    ------
    NotCompilable
        If the scene has no such kernel, or is too large for it.
    CompileError
        If the loop is not there and cannot be compiled.
    """
    scheme = gauss_scheme(system, len(rule.nodes))
    n, controls = system.q.numel(), system.control.numel()
    taken = len(scheme.functions["kick"].graph.outputs[-1]) if "kick" in scheme.functions else 0
    if scheme.geometry or n > MOST_COORDINATES or controls > MOST_CONTROLS or taken > MOST_TAKEN:
        raise NotCompilable("the scene is too large for a tape; use backend='compiled'")
    loop = loop_for(scheme.lanes, scheme.vectors, scheme.form)
    block = scene_block(scheme, n, controls)
    address = _start(block)
    return Kernel(
        scheme.about,
        n,
        controls,
        scheme.stages,
        next(operations(f.graph, f.last)[0] for f in scheme.functions.values()),
        loop.run,
        loop.parts,
        loop.carry_size(address),
        scene=address,
        block=block,
    )


class Loop(NamedTuple):
    """The entries of the loop: `run`, `parts` and the size of what it carries on."""

    run: Callable[[bytes], int]
    parts: Callable[[bytes], int]
    carry_size: Callable[[int], int]


@lru_cache(maxsize=32)
def loop_for(lanes: int, vectors: int, form: int) -> Loop:
    """The loop for vectors of so many lanes, so many of them for the stages of a coordinate: built
    when the package was installed, else compiled now and kept.

    Raises
    ------
    CompileError
        If it is not there and there is no compiler.
    """
    level, built = _LEVELS[vector_length()], _built()
    ending = f"{level}_{lanes}_{vectors}_{form}"
    if built is None or not hasattr(built, f"run_{ending}"):
        defines = {"LEVEL": level, "LANES": lanes, "VECTORS": vectors, "FORM": form}
        text = "".join(f"#define {key} {value}\n" for key, value in defines.items())
        with notice("compiling the loop of Gauss rules (once; it is kept)"):
            built = library(text + c_source("core.c"), AS_WRITTEN)
    run, parts, size = (
        getattr(built, f"{name}_{ending}") for name in ("run", "parts", "carry_size")
    )
    for entry in (run, parts):
        entry.argtypes, entry.restype = [c_char_p], c_int
    size.argtypes, size.restype = [c_void_p], c_int64
    return Loop(run, parts, size)


@cache
def _built() -> CDLL | None:
    """What setup.py has built, where there was a compiler."""
    for path in Path(__file__).parent.glob("_core.*"):
        with suppress(OSError):  # made for another machine
            return CDLL(str(path))
    return None


def scene_block(scheme: Scheme, n: int, controls: int) -> np.ndarray:
    """The structure Scene of c/scene.h with all that it points to, in one block of bytes."""
    functions = scheme.functions
    many = sum(operations(*f)[1] for f in functions.values()) > FEW_ROOTS
    tapes = [tape_of(f.graph, f.last, many) for f in functions.values()]
    if scheme.form == 2:  # the right-hand side is one function
        tapes.insert(1, EMPTY)
    tables = list(tableau_arrays(scheme.stages, scheme.lanes, scheme.diagonals).values())
    needs = [np.array(x, np.int8) for x in scheme.needs.values()]
    head = struct.Struct("6q3P" + "5q5P" * len(tapes))
    arrays = [*needs, *tables, *(array for tape in tapes for array in _arrays(tape))]
    places, end = [], _up(head.size) + _up(8 * len(tables))
    for array in arrays:
        places.append(end)
        end += _up(array.nbytes)
    block = np.zeros(end + ALIGNED, np.uint8)
    base = _start(block)
    shift = base - block.ctypes.data
    for place, array in zip(places, arrays, strict=True):
        block[shift + place : shift + place + array.nbytes] = np.frombuffer(
            array.tobytes(), np.uint8
        )
    addresses = [base + place for place in places]
    listed = base + _up(head.size)
    tables_at = np.array(addresses[len(needs) : len(needs) + len(tables)], np.uint64)
    block[shift + _up(head.size) :][: tables_at.nbytes] = np.frombuffer(
        tables_at.tobytes(), np.uint8
    )
    rest = iter(addresses[len(needs) + len(tables) :])
    fields = [n, controls, scheme.stages, scheme.diagonals, scheme.on_velocity, scheme.ahead]
    fields += [*addresses[: len(needs)], listed]
    for tape in tapes:
        fields += [tape.uniforms, tape.numbers, tape.registers, len(tape.inputs), len(tape.outputs)]
        fields += [next(rest) for _ in _arrays(tape)]
    block[shift : shift + head.size] = np.frombuffer(head.pack(*map(int, fields)), np.uint8)
    return block


EMPTY = Tape(
    0,
    0,
    0,
    np.zeros((1, 6), np.uint16),
    np.zeros((1, 6), np.uint16),
    np.zeros(1),
    np.zeros((0, 3), np.uint16),
    np.zeros((0, 3), np.uint16),
)


def _arrays(tape: Tape) -> tuple[np.ndarray, ...]:
    return tape.once, tape.often, tape.constants, tape.inputs, tape.outputs


def _start(block: np.ndarray) -> int:
    """Address of the first aligned byte."""
    return _up(block.ctypes.data)


def _up(size: int) -> int:
    return -(-size // ALIGNED) * ALIGNED
