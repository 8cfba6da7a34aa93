"""C structures with all that they point to, in one block of memory."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from varint.codegen.tape import Tape

ALIGNED = 64  # bytes: every array begins at a multiple of it
Member = int | float | np.ndarray | Sequence[np.ndarray] | Tape


def block_of(members: Sequence[Member]) -> np.ndarray:
    """The bytes of a structure: whole numbers of 64 bits, numbers, pointers to arrays, a pointer
    to pointers to arrays, and tapes as in c/tape.h.

    The structure begins at `start_of` the block.
    """
    layout, values, pointed = "", list[int | float](), list[tuple[int, np.ndarray]]()
    listed: list[tuple[int, Sequence[np.ndarray]]] = []

    def add(code: str, value: int | float) -> None:
        nonlocal layout
        layout += code
        values.append(value)

    def point(array: np.ndarray) -> None:
        pointed.append((len(values), array))
        add("P", 0)

    for member in members:
        if isinstance(member, Tape):
            for count in (member.uniforms, member.numbers, member.registers):
                add("q", count)
            add("q", len(member.inputs))
            add("q", len(member.outputs))
            for array in (
                member.once,
                member.often,
                member.constants,
                member.inputs,
                member.outputs,
            ):
                point(array)
        elif isinstance(member, np.ndarray):
            point(member)
        elif isinstance(member, (int, np.integer)):
            add("q", int(member))
        elif isinstance(member, float):
            add("d", member)
        else:
            listed.append((len(values), member))
            add("P", 0)
    head = struct.Struct(layout)
    arrays = [array for _, array in pointed] + [array for _, many in listed for array in many]
    pointers = sum(8 * len(many) for _, many in listed)
    ends = np.cumsum([_up(head.size + pointers), *(_up(x.nbytes) for x in arrays)])
    block = np.zeros(int(ends[-1]) + ALIGNED, np.uint8)
    base = start_of(block)
    room = block[base - block.ctypes.data :]
    for place, array in zip(ends, arrays, strict=False):
        room[place : place + array.nbytes] = np.frombuffer(array.tobytes(), np.uint8)
    addresses = iter((base + ends[:-1]).tolist())
    for k, _ in pointed:
        values[k] = next(addresses)
    at = head.size
    for k, many in listed:
        values[k] = base + at
        table = np.array([next(addresses) for _ in many], np.uint64)
        room[at : at + table.nbytes] = np.frombuffer(table.tobytes(), np.uint8)
        at += table.nbytes
    room[: head.size] = np.frombuffer(head.pack(*values), np.uint8)
    return block


def start_of(block: np.ndarray) -> int:
    """Address of the structure in a block."""
    return _up(block.ctypes.data)


def _up(size: int) -> int:
    return -(-size // ALIGNED) * ALIGNED
