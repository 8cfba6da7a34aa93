"""How far a motion of a given energy can come in a section."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

GRID = 121  # points of a side
WIDER, WIDENINGS = 1.25, 4  # until what is reached lies within, or is taken to have no end
CORRECTIONS = 20
NOTHING = 1e-6  # of the most that is left: so little is a saddle, through which nothing comes


def energy_left(
    system: System,
    surface: ca.SX,
    shown: int,
    energy: float,
    q: np.ndarray,
    points: np.ndarray,
    c: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """A grid of (q_j, p_j) around points of a section of two coordinates, (A,) and (B,), and E −
    min_{p_i} H there, (B, A).

    The coordinate i is what the surface makes of it. Nothing is returned where H is not convex in
    p_i, or the surface has no zero there.
    """
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    half = np.maximum(np.ptp(points, axis=0) / 2, 1e-3 * (1 + np.abs(middle)))
    other = float(np.median(q[:, 1 - shown]))
    found: tuple[np.ndarray, ...] = ()
    for _ in range(WIDENINGS):
        half = WIDER * half
        a, b = (np.linspace(m - h, m + h, GRID) for m, h in zip(middle, half, strict=True))
        left = _left(system, surface, shown, energy, (a, b), other, c)
        if left is None:
            return ()
        near = [
            np.clip(np.rint((points[:, j] - x[0]) / (x[1] - x[0])).astype(int), 0, GRID - 1)
            for j, x in enumerate((a, b))
        ]
        inside = _connected(left > NOTHING * left.max(), near[1], near[0])
        found = a, b, np.where(inside, left, -np.abs(left))
        if not (inside[[0, -1]].any() or inside[:, [0, -1]].any()):
            break
    return found


def _connected(allowed: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What of the grid is joined to the places of the points."""
    found = np.zeros_like(allowed)
    found[rows, columns] = True
    found &= allowed
    while True:
        wider = found.copy()
        wider[1:] |= found[:-1]
        wider[:-1] |= found[1:]
        wider[:, 1:] |= found[:, :-1]
        wider[:, :-1] |= found[:, 1:]
        wider &= allowed
        if (wider == found).all():
            return found
        found = wider


def _left(
    system: System,
    surface: ca.SX,
    shown: int,
    energy: float,
    grid: tuple[np.ndarray, np.ndarray],
    other: float,
    c: np.ndarray,
) -> np.ndarray | None:
    s, i = system, 1 - shown
    of_surface = ca.Function(
        "surface",
        [s.q, s.c],
        [ca.densify(surface), ca.densify(ca.jacobian(surface, s.q[i]))],
    )
    a, b = grid
    column = np.empty((len(a), 2))
    column[:, shown], column[:, i] = a, other
    for _ in range(CORRECTIONS):
        value, slope = (x[:, 0] for x in over_columns(of_surface, column, c))
        change = value / np.where(slope == 0, np.nan, slope)
        column[:, i] -= change
        if not np.isfinite(change).all():
            return None
        if (np.abs(change) <= 1e-14 * (1 + np.abs(column[:, i]))).all():
            break
    else:
        return None
    q = np.tile(column, (len(b), 1))
    p = np.zeros_like(q)
    p[:, shown] = np.repeat(b, len(a))
    t = np.zeros((len(q), 1))
    for _ in range(CORRECTIONS):
        value, slope, bend = (x[:, 0] for x in over_columns(_along(s, i), q, p, t, c))
        if not (bend > 0).all():
            return None
        p[:, i] -= slope / bend
        if (np.abs(slope) <= 1e-10 * bend * (1 + np.abs(p[:, i]))).all():
            break
    value = over_columns(_along(s, i), q, p, t, c)[0]
    return energy - value.reshape(len(b), len(a))


@per_system
def _along(system: System, which: int) -> ca.Function:
    """(q, p, t, c) → H, ∂H/∂p_i, ∂²H/∂p_i²."""
    s = system
    value = ca.Function("energy", [s.q, s.v, s.t, s.c], [s.energy], {"cse": True})
    sizes = (s.structure.n, s.structure.n, 1, s.c.numel())
    q, p, t, c = (ca.MX.sym(name, size) for name, size in zip("qptc", sizes, strict=True))
    h = value(q, velocity_function(s)(q, p, t, c), t, c)
    slope = ca.jacobian(h, p)[which]
    out = [ca.densify(x) for x in (h, slope, ca.jacobian(slope, p)[which])]
    return ca.Function("along_momentum", [q, p, t, c], out)
