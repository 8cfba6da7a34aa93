"""Many members of one separable scene in a compiled loop, one in each lane of a vector."""

from __future__ import annotations

import struct
from collections.abc import Callable
from ctypes import c_char_p, c_int
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from varint.compiled.cache import library
from varint.compiled.emit import emit
from varint.compiled.graph import NotCompilable
from varint.compiled.mechanics import force, velocity
from varint.rules import Rule
from varint.system import System, per_system

LANES = 8  # also on machines with shorter vectors: the compiler takes two or four of them
MOST_OPERATIONS = 20_000
_ARGUMENTS = struct.Struct("4q2d6P")


@dataclass(frozen=True, eq=False)
class MembersKernel:
    """A compiled loop over members: `entry` takes the packed arguments of members.c."""

    n: int
    entry: Callable[[bytes], int]


@per_system
def members_kernel(system: System, rule: Rule) -> MembersKernel:
    """The compiled composition of a separable scene for members that differ in start and parameters.

    Raises
    ------
    NotCompilable
        If the scene is not separable with constant mass, has controls, or the rule has no kicks.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    s = system.structure
    if not s.explicit or not rule.kicks or s.controls:
        raise NotCompilable(
            "members are compiled together for compositions of separable scenes with constant mass and without "
            'controls; use backend="interpreted"'
        )
    p, none = ca.SX.sym("p", s.n), ca.SX(0, 1)
    expressions = {
        "rhs": ([system.q, system.t, system.c, none], force(system)),
        "velocity": ([system.q, p, system.t, system.c, none], velocity(system, p)),
    }
    source = f"#define LANES {LANES}\n#define N {s.n}\n#define NC {system.c.numel()}\n#define KICKS {len(rule.kicks)}\n"
    folder = Path(__file__).parent
    source += (folder / "lanes.h").read_text()
    times = [sum(rule.drifts[:k]) for k in range(len(rule.kicks))]
    for name, values in (("KICK", rule.kicks), ("DRIFT", rule.drifts), ("NODE", times)):
        source += f"static const double {name}[] = {{{', '.join(float(x).hex() for x in values)}}};\n"
    for name, (inputs, output) in expressions.items():
        f = ca.Function(name, inputs, [ca.cse(ca.densify(output))])
        if f.n_instructions() > MOST_OPERATIONS:
            raise NotCompilable(f"{name} has {f.n_instructions()} operations, more than {MOST_OPERATIONS}")
        source += emit(name, f).source
    compiled = library(source + (folder / "members.c").read_text())
    entry = compiled.run
    entry.argtypes, entry.restype = [c_char_p], c_int
    return MembersKernel(s.n, entry)


def run_members(
    kernel: MembersKernel, q0: np.ndarray, p0: np.ndarray, c: np.ndarray, *, t0: float, h: float, steps: int,
    save_every: int, nodes: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Motions of all members: q and p (members, nodes, n), and how many nodes of each are finite.

    Rows behind a member's good ones are zero and no data.
    """
    count = len(q0)
    q0, p0, c = (np.ascontiguousarray(x, dtype=float) for x in (q0, p0, c))
    q, p = np.zeros((count, nodes, kernel.n)), np.zeros((count, nodes, kernel.n))
    q[:, 0], p[:, 0] = q0, p0
    good = np.empty(count, dtype=np.int64)
    places = (x.ctypes.data for x in (q0, p0, c, q, p, good))
    kernel.entry(_ARGUMENTS.pack(count, steps, save_every, nodes, t0, h, *places))
    return q, p, good
