"""Random points of a scene at which its expressions are defined.

An identity between expressions that are analytic holds everywhere if it holds at random points: the chance that a
false one vanishes at a random point is zero. Points where an expression is not finite are drawn anew.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.errors import InputError
from varint.system import System

MOST_ROUNDS = 60  # of drawing points until enough of them are usable


@dataclass(frozen=True, eq=False)
class Points:
    """Points (q, v, a, u, t, c) of a scene, one a row."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    t: np.ndarray
    c: np.ndarray

    def __len__(self) -> int:
        return len(self.q)

    @property
    def columns(self) -> list[np.ndarray]:
        return [getattr(self, f.name) for f in fields(self)]

    def __getitem__(self, index) -> Points:
        return Points(*(x[index] for x in self.columns))


@dataclass(frozen=True, eq=False)
class Region:
    """Where points are drawn: parameter values (None: every run of the generator draws its own) and a centre of q."""

    system: System
    c: np.ndarray | None = None
    near: np.ndarray | None = None


def at_points(system: System, name: str, outputs: list[ca.SX], a: ca.SX | None = None) -> ca.Function:
    """Function (q, v, a, u, t, c) → outputs with dense ends, for `over_columns`."""
    s = system
    a = ca.SX.sym("a", s.q.numel()) if a is None else a
    dense = [ca.densify(x) for x in outputs]
    return ca.Function(name, [s.q, s.v, a, s.control, s.t, s.c], dense, {"cse": True})


def draw(region: Region, count: int, rng: np.random.Generator) -> Points:
    """Points over several scales: positions and velocities small and large, half of them with positive q and t only."""
    s = region.system
    n = s.structure.n
    positive = rng.random((count, 1)) < 0.5
    if region.near is None:
        q = 10 ** rng.uniform(-0.7, 0.5, (count, 1)) * rng.uniform(-1, 1, (count, n))
        q = np.where(positive, np.abs(q), q)
    else:
        q = region.near + 10 ** rng.uniform(-2, -0.3, (count, 1)) * rng.uniform(-1, 1, (count, n))
    v = 10 ** rng.uniform(-1.5, 0.5, (count, 1)) * rng.uniform(-1, 1, (count, n))
    t = rng.uniform(-2, 2, (count, 1))
    c = random_parameters(s, rng, count) if region.c is None else np.tile(region.c, (count, 1))
    a, u = rng.uniform(-1, 1, (count, n)), rng.uniform(-1, 1, (count, s.structure.controls))
    return Points(q, v, a, u, np.where(positive, np.abs(t), t), c)


def random_parameters(system: System, rng: np.random.Generator, count: int) -> np.ndarray:
    """Parameter values near their defaults, with their signs, no two in a simple ratio; (count, number of them)."""
    default = np.tile(system.default_vector, (count, 1))
    factor = rng.uniform(0.6, 1.6, default.shape)
    return np.where(default == 0, factor, default * factor)


def sampled(region: Region, function: ca.Function, count: int, rng: np.random.Generator):
    """`count` points where `function` is finite, and its outputs there.

    Raises
    ------
    InputError
        If such points are not found.
    """
    parts: list[tuple[Points, list[np.ndarray]]] = []
    found = 0
    for _ in range(MOST_ROUNDS):
        points = draw(region, max(count, 8), rng)
        values = over_columns(function, *points.columns)
        good = np.all([np.isfinite(x).all(axis=1) for x in values], axis=0)
        if good.any():
            parts.append((points[good], [x[good] for x in values]))
            found += int(good.sum())
        if found >= count:
            break
    else:
        raise InputError(
            f"the scene's derivatives are finite at {found} of {MOST_ROUNDS * max(count, 8)} random points only; "
            "give near=q, coordinates around which they are defined"
        )
    points = Points(*(np.concatenate(x)[:count] for x in zip(*(p.columns for p, _ in parts), strict=True)))
    return points, [np.concatenate(x)[:count] for x in zip(*(v for _, v in parts), strict=True)]
