"""A few steps and the energies of their nodes in one call of c/few_steps_core.c."""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import few_steps_entry, rows_entry
from varint.codegen.kernel import Kernel, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_ASKED = struct.Struct("11P4q3d")  # FewSteps


class Entries(NamedTuple):
    """Addresses of a loop and of the energy (q, p, t) → H, |p·v| of its scene, and what lies
    there.
    """

    n: int
    carry: int
    scene: int
    run: int
    rows: int
    energy: int
    held: tuple


def entries_of(kernel: Kernel, energy: RowFunction) -> Entries:
    """Where they are.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (kernel.entry, rows_entry())
    run, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    heads = kernel.n, kernel.carry_size, kernel.scene
    return Entries(*heads, run, rows, energy.at, (kernel, energy))


class FewSteps(NamedTuple):
    """Nodes, work, the largest change of the energy and the largest energy."""

    k: np.ndarray
    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    iterations: float
    residual: float
    change: float
    largest: float


def few_steps(
    entries: Entries, start: int, c: int, *, t0: float, h: float, steps: int, level: float
) -> FewSteps | None:
    """The motion with every node, from q and p at the address `start` with parameters at `c`; None
    where a step cannot be solved.
    """
    n, nodes = entries.n, steps + 1
    q, p = np.empty((nodes, n)), np.empty((nodes, n))
    t, k, told = np.empty(nodes), np.empty(nodes, np.int64), np.empty(4)
    status = few_steps_entry()(
        _ASKED.pack(
            entries.run,
            entries.scene,
            entries.rows,
            entries.energy,
            start,
            c,
            new_address(q),
            new_address(p),
            new_address(t),
            new_address(told),
            new_address(k),
            n,
            entries.carry,
            steps,
            FIXED_POINT_ITERATIONS,
            t0,
            h,
            level,
        )
    )
    return FewSteps(k, t, q, p, *told.tolist()) if status == DONE else None
