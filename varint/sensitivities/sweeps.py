"""Tangents carried forwards and adjoints carried backwards over a piece of a run, by loops in C or
by CasADi's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.codegen.graph import NotCompilable
from varint.errors import ConvergenceError
from varint.sensitivities.loops import by_factors
from varint.sensitivities.pieces import Piece
from varint.sensitivities.steps_at_once import (
    NO_NUMBERS,
    NOT_REGULAR,
    NOT_SOLVED,
    Directions,
    Pulled,
    Sweeper,
    backwards_interpreted,
    failure,
    forwards_interpreted,
)

WHY = (NOT_SOLVED, NOT_REGULAR, NO_NUMBERS)  # enum Sweep of c/sweep.h, from 1 on


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
    try:
        _compiled(by, "tangents", piece, c, directions, dict(tangent=tangent, out=out), every=1)
    except NotCompilable:
        return forwards_interpreted(by, piece, c, directions, tangent)
    return out


def carried(
    by: Sweeper, piece: Piece, c: np.ndarray, directions: Directions, tangent: np.ndarray
) -> np.ndarray:
    """∂x at the last node of the piece alone, (2n, m)."""
    if not by.kernels:
        return forwards_interpreted(by, piece, c, directions, tangent)[-1]
    try:
        return _compiled(by, "tangents", piece, c, directions, dict(tangent=tangent))["tangent"]
    except NotCompilable:
        return forwards_interpreted(by, piece, c, directions, tangent)[-1]


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
    try:
        found = _compiled(by, "adjoints", piece, c, directions, arrays, seeds=seeds)
    except NotCompilable:
        return backwards_interpreted(by, piece, c, adjoint, seeds, nodes)
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
    factorises; raises NotCompilable where its equations are too large for C.
    """
    kernels, status = list(by.kernels), 0
    while kernels:
        given = {name: x if name == "out" and every else x.copy() for name, x in arrays.items()}
        failed = np.zeros(1)
        loops = kernels.pop(0)
        told = arguments(piece, c, directions, seeds, failed) | dict(every=every) | given
        status = getattr(loops, loop)(told)
        if not status:
            return given
        if not kernels and (other := by_factors(by)) is not None:
            kernels = [other]
            by = replace(by, kernels=(other,))
    raise failed_step(piece, failed, status)


def arguments(
    piece: Piece,
    c: np.ndarray,
    directions: Directions,
    seeds: np.ndarray | None,
    failed: np.ndarray,
) -> dict:
    """What every loop over a piece is told, by the names in c/sweep.h."""
    x, v = (y if y.strides[1] == y.itemsize else y.copy() for y in (piece.x, piece.v))
    return dict(
        steps=len(piece.t),
        first=piece.first,
        columns=directions.outer.shape[1],
        outer=np.ascontiguousarray(directions.outer),
        outer_moves=int(directions.outer.any()),
        control_column=directions.controls,
        control_nodes=directions.nodes,
        smooth=int(not piece.u.shape[2] and bool((piece.h == piece.h[0]).all())),
        x=x,
        v=v,
        x_apart=x.strides[0] // x.itemsize,
        v_apart=v.strides[0] // v.itemsize,
        t=piece.t,
        h=piece.h,
        c=np.ascontiguousarray(c),
        u=np.ascontiguousarray(piece.u),
        seeds=None if seeds is None else np.ascontiguousarray(seeds),
        failed=failed,
    )


def failed_step(piece: Piece, failed: np.ndarray, status: int) -> ConvergenceError:
    """The error of the step at which a loop gave up."""
    if status > len(WHY):
        raise MemoryError("no memory for the derivatives of a run")
    step = int(failed[0])
    return failure(piece.first + step, float(piece.t[step]), WHY[status - 1])
