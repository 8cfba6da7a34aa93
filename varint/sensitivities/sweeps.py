"""Tangents carried forwards and adjoints carried backwards over a piece of a run, by compiled loops
or by CasADi's own.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from varint.errors import InputError
from varint.integration.backend import BACKENDS
from varint.rules.rule import Rule
from varint.scene.system import System, per_system
from varint.sensitivities.linear_steps import operations
from varint.sensitivities.pieces import Piece
from varint.sensitivities.steps_at_once import (
    Directions,
    Pulled,
    Sweeper,
    backwards_interpreted,
    failure,
    forwards_interpreted,
)

if TYPE_CHECKING:
    from varint.codegen.sweep import SweepKernel

INSTRUCTION = 8e-9  # seconds of CasADi's virtual machine for an operation
CALL = 5e-5  # seconds of it for a step besides
STARTING, STATEMENT = 0.25, 1e-4  # seconds to compile loops, and for a statement of them
NOT_REGULAR = 2  # enum Sweep of c/sweep.h


def sweeper(
    system: System, rule: Rule, steps: int, backend: str, density: str | None = None
) -> Sweeper:
    """Compiled loops where the run is long enough to repay the compiler, or where asked for.

    Raises
    ------
    InputError
        If there is no such backend.
    NotCompilable, CompileError
        If ``"compiled"`` is asked for and impossible.
    """
    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; known: {list(BACKENDS)}")
    if backend == "compiled" or (backend == "auto" and _repays(system, rule, steps)):
        from varint.codegen.cache import CompileError
        from varint.codegen.graph import NotCompilable

        try:
            return Sweeper(system, rule, density, _kernels(system, rule, density))
        except (CompileError, NotCompilable) as error:
            if backend == "compiled":
                raise
            if isinstance(error, CompileError):
                warnings.warn(f"{str(error).splitlines()[0]}; slower until then", stacklevel=4)
    return Sweeper(system, rule, density)


@per_system
def _kernels(system: System, rule: Rule, density: str | None) -> tuple[SweepKernel, ...]:
    """Where stages are iterated the factors of a step's equations are not built at once: only a
    stiff scene needs them.
    """
    from varint.codegen.sweep import sweep_kernel
    from varint.codegen.sweep_gauss import has_stage_sweep, stage_sweep_kernel

    if has_stage_sweep(system, rule):
        return (stage_sweep_kernel(system, rule, density),)
    return (sweep_kernel(system, rule, density),)


def _repays(system: System, rule: Rule, steps: int) -> bool:
    """Whether the steps take CasADi longer than the compiler needs for their loops."""
    turn, statements = operations(system, rule)
    return steps * (CALL + INSTRUCTION * turn) > STARTING + STATEMENT * statements


def forwards(
    by: Sweeper, piece: Piece, c: np.ndarray, directions: Directions, tangent: np.ndarray
) -> np.ndarray:
    """∂x at every node of the piece, (S + 1, 2n, m), from that at its first, (2n, m).

    Raises
    ------
    ConvergenceError
        If a step's equations cannot be solved again or have no regular derivative.
    """
    if not by.kernels:
        return forwards_interpreted(by, piece, c, directions, tangent)
    out = np.empty((len(piece.x), *tangent.shape))
    _compiled(by, "tangents", piece, c, directions, dict(tangent=tangent, out=out), every=1)
    return out


def carried(
    by: Sweeper, piece: Piece, c: np.ndarray, directions: Directions, tangent: np.ndarray
) -> np.ndarray:
    """∂x at the last node of the piece alone, (2n, m)."""
    if not by.kernels:
        return forwards_interpreted(by, piece, c, directions, tangent)[-1]
    return _compiled(by, "tangents", piece, c, directions, dict(tangent=tangent))["tangent"]


def backwards(
    by: Sweeper,
    piece: Piece,
    c: np.ndarray,
    adjoint: np.ndarray,
    seeds: np.ndarray | None,
    nodes: int,
) -> tuple[np.ndarray, Pulled]:
    """The adjoint (2n,) carried from the piece's last node to its first, and what it pulls back.

    `seeds` (S, 2n) is what the node at which each step begins adds to the adjoint; `nodes` are the
    control values a step.
    """
    if not by.kernels:
        return backwards_interpreted(by, piece, c, adjoint, seeds, nodes)
    directions = Directions(np.zeros((len(c) + 2, 1)), -1, nodes)
    arrays = dict(
        tangent=adjoint,
        out=np.zeros((len(piece.t), nodes, piece.u.shape[2])),
        loss=np.zeros(1),
        outer=directions.outer,
    )
    found = _compiled(by, "adjoints", piece, c, directions, arrays, seeds=seeds)
    pulled = Pulled(found["outer"][:, 0], found["out"], float(found["loss"][0]))
    return found["tangent"], pulled


def _compiled(
    by: Sweeper,
    loop: str,
    piece: Piece,
    c: np.ndarray,
    directions: Directions,
    arrays: dict[str, np.ndarray],
    *,
    every: int = 0,
    seeds: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """What a loop makes of copies of the arrays; where the stages' iteration fails, the loop that
    factorises.
    """
    smooth = not piece.u.shape[2] and bool((piece.h == piece.h[0]).all())
    kernels, status = list(by.kernels), 0
    while kernels:
        given = {name: x if name == "out" and every else x.copy() for name, x in arrays.items()}
        given = dict(outer=np.ascontiguousarray(directions.outer)) | given
        failed = np.zeros(1)
        status = getattr(kernels.pop(0), loop)(
            dict(
                steps=len(piece.t),
                first=piece.first,
                columns=directions.outer.shape[1],
                every=every,
                outer_moves=int(directions.outer.any()),
                control_column=directions.controls,
                control_nodes=directions.nodes,
                smooth=int(smooth),
                x=piece.x,
                v=piece.v,
                t=piece.t,
                h=piece.h,
                c=np.ascontiguousarray(c),
                u=np.ascontiguousarray(piece.u),
                seeds=None if seeds is None else np.ascontiguousarray(seeds),
                failed=failed,
                **given,
            )
        )
        if not status:
            return given
        if not kernels and (other := _by_factors(by)) is not None:
            kernels = [other]
            by = Sweeper(by.system, by.rule, by.density, (other,))
    step, what = int(failed[0]), "regular" if status == NOT_REGULAR else "solved"
    raise failure(piece.first + step, float(piece.t[step]), what)


def _by_factors(by: Sweeper) -> SweepKernel | None:
    """The loop that factorises the equations of a step, if it is not the one that failed."""
    from varint.codegen.sweep import sweep_kernel

    kernel = sweep_kernel(by.system, by.rule, by.density)
    return None if kernel in by.kernels else kernel
