"""Many members of one scene in a compiled loop, one in each lane of a vector."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_char_p, c_int

import casadi as ca
import numpy as np

from varint.codegen.arguments import MembersArguments, c_source, packing
from varint.codegen.cache import library
from varint.codegen.emit import emit
from varint.codegen.gauss import gauss_form
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.mechanics import acceleration, force, velocity
from varint.codegen.tableau import gauss_tableau
from varint.numerics.limits import FIXED_POINT_ITERATIONS
from varint.numerics.progress import notice
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.system import System

LANES = 8  # also on machines with shorter vectors: the compiler takes two or four of them
MOST_OPERATIONS = 20_000
MOST_UNKNOWNS = 400  # of all stages: a step's vectors are to stay in the cache
PILOT = 100  # steps after which a member's iteration must have shown that it contracts
POOR = 30  # iterations a step beyond which Newton's method is cheaper
_ARGUMENTS = packing(MembersArguments)
Expressions = dict[str, tuple[list[ca.SX], list[ca.SX]]]


@kernel_per_system
def members_kernel(system: System, rule: Rule) -> Callable[[bytes], int]:
    """The compiled loop for members of a scene that differ in start, parameters and controls.

    Compositions of separable scenes with constant mass are explicit; Gauss rules iterate all
    members of a vector until the last of them has settled.

    Raises
    ------
    NotCompilable
        If the scene or the rule is of another kind.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    if rule.kicks and system.structure.explicit:
        return _build(system, len(rule.kicks), *_explicit(system, rule))
    by_stages = rule == gauss(min(len(rule.nodes), MOST_STAGES)) and gauss_form(system)
    if by_stages and system.structure.quadratic_kinetic:
        return _build(system, len(rule.nodes), *_gauss(system, len(rule.nodes)))
    raise NotCompilable(
        "members are compiled together for compositions of separable scenes with constant mass, "
        "and for Gauss rules "
        "of regular scenes without constraints and contacts, quadratic in velocities; use "
        'backend="interpreted"'
    )


def _explicit(system: System, rule: Rule) -> tuple[Expressions, str, str]:
    q, t, u, p = system.q, system.t, system.control, ca.SX.sym("p", system.q.numel())
    times = [sum(rule.drifts[:k]) for k in range(len(rule.kicks))]
    data = f"#define KICKS {len(rule.kicks)}\n"
    for name, values in (("KICK", rule.kicks), ("DRIFT", rule.drifts), ("NODE", times)):
        data += f"static const double {name}[] = {{{_numbers(values)}}};\n"
    return (
        {"rhs": ([q, t, u], [force(system)]), "velocity": ([q, p, t], [velocity(system, p)])},
        data,
        "members.c",
    )


def _gauss(system: System, stages: int) -> tuple[Expressions, str, str]:
    form, (q, v, t, u) = gauss_form(system), (system.q, system.v, system.t, system.control)
    p = ca.SX.sym("p", q.numel())
    speed = velocity(system, p)
    if 2 * q.numel() * stages > MOST_UNKNOWNS:
        raise NotCompilable(
            f"{q.numel()} coordinates at {stages} stages are too many for members in lanes"
        )
    if form == 2:
        right = ([q, v, t, u], [acceleration(system)])
    else:
        right = ([q, p, t, u], [speed, ca.substitute(force(system), v, speed)])
    heads = dict(STAGES=stages, FORM=form, MOST=FIXED_POINT_ITERATIONS, PILOT=PILOT, POOR=POOR)
    heads["ON_VELOCITY"] = int(form == 2 and system.structure.force_on_velocity)
    data = "".join(f"#define {key} {value}\n" for key, value in heads.items())
    for name, table in gauss_tableau(stages).items():
        if len(table) == 1:
            data += f"static const double {name}[STAGES] = {{{_numbers(table[0])}}};\n"
        else:
            rows = ", ".join(f"{{{_numbers(row)}}}" for row in table)
            data += (
                f"static const double {name}[STAGES][STAGES] __attribute__((unused)) = "
                f"{{{rows}}};\n"
            )
    at_nodes = {"velocity": ([q, p, t], [speed]), "momentum": ([q, v, t], [system.momentum])}
    return {"rhs": right, **at_nodes}, data, "members_gauss.c"


def _numbers(values) -> str:
    return ", ".join(float(x).hex() for x in values)


def _build(
    system: System, nodes: int, expressions: Expressions, data: str, loop: str
) -> Callable[[bytes], int]:
    """Compile the loop around the scene's functions; parameters are inputs, for they differ from
    lane to lane.
    """
    heads = dict(LANES=LANES, N=system.q.numel(), NC=system.c.numel(), NU=system.control.numel())
    source = "".join(f"#define {key} {value}\n" for key, value in heads.items())
    source += "".join(map(c_source, ("lanes.h", "run.h"))) + data
    for name, (inputs, outputs) in expressions.items():
        f = ca.Function(
            name, [*inputs, system.c, ca.SX(0, 1)], ca.cse([ca.densify(x) for x in outputs])
        )
        if (
            f.n_instructions() * (nodes if loop == "members_gauss.c" and name == "rhs" else 1)
            > MOST_OPERATIONS
        ):
            raise NotCompilable(
                f"{name} has {f.n_instructions()} operations, too many for members in lanes"
            )
        source += emit(name, f).source
    with notice("compiling the loop over members (once; it is kept)"):
        entry = library(source + c_source("members.h") + c_source(loop)).run
    entry.argtypes, entry.restype = [c_char_p], c_int
    return entry


def run_members(
    entry: Callable[[bytes], int],
    q0: np.ndarray,
    p0: np.ndarray,
    c: np.ndarray,
    u: np.ndarray,
    *,
    t0: float,
    h: float,
    steps: int,
    save_every: int,
    nodes: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motions of all members: q and p (members, nodes, n), and how many nodes of each are solved.

    Controls u are (members or 1, steps, nodes of the rule, k). Rows behind a member's good ones are
    zero and no data.
    """
    count, n = q0.shape
    q0, p0, c, u = (np.ascontiguousarray(x, dtype=float) for x in (q0, p0, c, u))
    q, p = np.zeros((count, nodes, n)), np.zeros((count, nodes, n))
    q[:, 0], p[:, 0] = q0, p0
    good = np.empty(count, dtype=np.int64)
    places = (x.ctypes.data for x in (q0, p0, c, u, q, p, good))
    apart = u[0].size if len(u) > 1 else 0
    entry(_ARGUMENTS.pack(count, steps, save_every, nodes, apart, t0, h, *places))
    return q, p, good
