"""Gauss rules without a compiler: the loop of c/gauss.c, built once, on a scene's operations as data."""

from __future__ import annotations

import struct
from ctypes import CDLL, c_char_p, c_int, c_int64, c_void_p
from functools import lru_cache

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.cache import AS_WRITTEN, library
from varint.codegen.gauss import Scheme, gauss_scheme
from varint.codegen.graph import NotCompilable, kernel_per_system, operations
from varint.codegen.kernel import FEW_ROOTS, Kernel
from varint.codegen.tableau import gauss_tableau, tableau_arrays
from varint.codegen.tape import Tape, tape_of
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_COORDINATES, MOST_CONTROLS, MOST_TAKEN = 64, 16, 512  # MOST_N, … of c/scene.h
ALIGNED = 64  # bytes


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
    loop, block = core(scheme.lanes, scheme.vectors, scheme.form), scene_block(scheme, n, controls)
    address = _start(block)
    return Kernel(
        f"{scheme.about}, on a tape",
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


@lru_cache(maxsize=32)
def core(lanes: int, vectors: int, form: int) -> CDLL:
    """The loop for vectors of so many lanes, so many of them for the stages of a coordinate."""
    source = f"#define LANES {lanes}\n#define VECTORS {vectors}\n#define FORM {form}\n"
    source += "".join(
        f"#define {name} (scene->tables[{k}])\n" for k, name in enumerate(gauss_tableau(2))
    )
    source += "".join(
        map(c_source, ("lanes.h", "run.h", "tape.h", "scene.h", "gauss.c", "parts.c"))
    )
    loop = library(source, AS_WRITTEN)
    for entry in (loop.run, loop.parts):
        entry.argtypes, entry.restype = [c_char_p], c_int
    loop.carry_size.argtypes, loop.carry_size.restype = [c_void_p], c_int64
    return loop


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
