"""Random points of a scene at which its expressions are defined.

An identity between expressions that are analytic holds everywhere if it holds at random points: the
chance that a false one vanishes at a random point is zero. Points where an expression is not finite
are drawn anew.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.scene.system import System

SHARE_OF_PLACES = 0.7  # of the coordinates of lively points
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
    """Where points are drawn: parameter values (None: every run of the generator draws its own)
    and a centre of q.
    """

    system: System
    c: np.ndarray | None = None
    near: np.ndarray | None = None


def at_points(
    system: System, name: str, outputs: list[ca.SX], a: ca.SX | None = None
) -> ca.Function:
    """Function (q, v, a, u, t, c) → outputs with dense ends, for `over_columns`."""
    s = system
    a = ca.SX.sym("a", s.q.numel()) if a is None else a
    dense = [ca.densify(x) for x in outputs]
    return ca.Function(name, [s.q, s.v, a, s.control, s.t, s.c], dense, {"cse": True})


def draw(region: Region, count: int, rng: np.random.Generator) -> Points:
    """Points over several scales: positions and velocities small and large, half of them with
    positive q and t only.
    """
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


def lively_points(region: Region, count: int, rng: np.random.Generator) -> Points:
    """Points where the scene's expressions live: coordinates near its own constants, their roots
    and its parameters, of either sign; some of them as drawn elsewhere. Not all need be usable.
    """
    points = draw(region, count, rng)
    size = np.abs(np.concatenate([_constants(region.system), region.system.default_vector]))
    size = np.unique(size[(size > 0) & np.isfinite(size)])
    if not len(size):
        return points
    size = np.unique(np.concatenate([size, np.sqrt(size), 1 / size]))
    places = rng.choice(size, points.q.shape) * rng.choice([-1.0, 1.0], points.q.shape)
    places *= 1 + 10 ** rng.uniform(-3, -0.5, points.q.shape) * rng.uniform(-1, 1, points.q.shape)
    here = rng.random(points.q.shape) < SHARE_OF_PLACES
    return replace(points, q=np.where(here, places, points.q))


def _constants(system: System) -> np.ndarray:
    """Numbers that stand in the scene's expressions."""
    s = system
    outputs = [s.lagrangian, s.constraint, s.nonholonomic, s.contact, s.force]
    function = at_points(s, "expressions", outputs)
    numbers = {
        function.instruction_constant(k)
        for k in range(function.n_instructions())
        if function.instruction_id(k) == ca.OP_CONST
    }
    return np.array(sorted(numbers), dtype=float)


def join_points(first: Points, second: Points) -> Points:
    """All points of both."""
    pairs = zip(first.columns, second.columns, strict=True)
    return Points(*(np.concatenate(pair) for pair in pairs))


def random_parameters(system: System, rng: np.random.Generator, count: int) -> np.ndarray:
    """Parameter values near their defaults, with their signs, no two in a simple ratio; (count,
    number of them).
    """
    default = np.tile(system.default_vector, (count, 1))
    factor = rng.uniform(0.6, 1.6, default.shape)
    return np.where(default == 0, factor, default * factor)


def sample(region: Region, function: ca.Function, count: int, rng: np.random.Generator):
    """`count` points where `function` is finite, and its outputs there.

    Raises
    ------
    InputError
        If such points are not found.
    """
    parts: list[tuple[Points, list[np.ndarray]]] = []
    found = 0
    for k in range(MOST_ROUNDS):
        draw_points = draw if k < MOST_ROUNDS // 2 else lively_points
        points = draw_points(region, max(count, 8), rng)
        values = over_columns(function, *points.columns)
        good = np.all([np.isfinite(x).all(axis=1) for x in values], axis=0)
        if good.any():
            parts.append((points[good], [x[good] for x in values]))
            found += int(good.sum())
        if found >= count:
            break
    else:
        raise InputError(
            f"the scene's derivatives are finite at {found} of {MOST_ROUNDS * max(count, 8)} "
            "random points only; give near=q, coordinates around which they are defined"
        )
    points = Points(
        *(np.concatenate(x)[:count] for x in zip(*(p.columns for p, _ in parts), strict=True))
    )
    return points, [np.concatenate(x)[:count] for x in zip(*(v for _, v in parts), strict=True)]
