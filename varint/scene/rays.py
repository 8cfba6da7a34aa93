"""Coordinates of which only the ratio matters, as unit quaternions: rays.

L is unchanged by q → λ q, v → λ v of such a group. The length is then a motion of its own that
nothing pushes: its momentum q·p is kept by every rule, zero from the start, and what a step does
commutes with the scaling. So nothing has to hold the length, and unit vectors are as good a
reading of the motion as any: p → p/λ goes with q → λ q.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError

Rays = tuple[tuple[int, ...], ...]
SEED, LENGTH, AGREES = 21, 1.7, 1e-9  # of the check that lengths do not matter
UNIT = 4 * np.finfo(float).eps  # so near to one a length is one


def checked_rays(given: Sequence[Sequence[int]], system: Any) -> Rays:
    """The groups as tuples.

    Raises
    ------
    InputError
        If they are no groups of coordinates, or L changes with the length of one, or gives it no
        inertia.
    """
    rays = tuple(tuple(int(i) for i in group) for group in given)
    every, n = [i for group in rays for i in group], system.q.numel()
    if len(set(every)) < len(every) or not all(0 <= i < n for i in every) or () in rays:
        raise InputError(f"rays are groups of different coordinates 0 to {n - 1}, got {given}")
    if rays:
        lagrangian = ca.Function("L", [system.q, system.v, system.t, system.c], [system.lagrangian])
        random = np.random.default_rng(SEED)
        q, v, t = random.normal(size=n), random.normal(size=n), random.normal()
        before = float(lagrangian(q, v, t, system.default_vector))
        mass = None if system.kinetics else _inertia(system)(q, v, t, system.default_vector).full()
        for group in rays:
            scaled = [np.where(np.isin(np.arange(n), group), LENGTH * x, x) for x in (q, v)]
            after = float(lagrangian(*scaled, t, system.default_vector))
            if not abs(after - before) <= AGREES * (abs(before) + 1):
                raise InputError(
                    f"L changes with the length of the coordinates {list(group)}: write it in "
                    "q/|q|, or hold the length by a constraint and leave rays out"
                )
            along = np.where(np.isin(np.arange(n), group), q, 0.0)
            if mass is not None and not abs(along @ mass @ along) > AGREES * np.abs(mass).max() * (
                along @ along
            ):
                raise InputError(
                    f"L gives the length of the coordinates {list(group)} no inertia, so that "
                    "their velocities do not follow from momenta: add (q·v)²/(q·q)²/2, which is "
                    "zero where the length stays and changes nothing else"
                )
    return rays


def _inertia(system: Any) -> ca.Function:
    """(q, v, t, c) → ∂²L/∂v²."""
    symbols = [system.q, system.v, system.t, system.c]
    return ca.Function("M", symbols, [ca.hessian(system.lagrangian, system.v)[0]])


def with_unit_rays(rays: Rays, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same states (…, n) with unit vectors: (q, p) → (q/|q|, p |q|) in every group."""
    if not rays:
        return q, p
    q, p = np.array(q, dtype=float), np.array(p, dtype=float)
    for group in rays:
        at = list(group)
        length = np.linalg.norm(q[..., at], axis=-1, keepdims=True)
        length[abs(length - 1) <= UNIT] = 1.0
        q[..., at], p[..., at] = q[..., at] / length, p[..., at] * length
    return q, p


def make_nodes_unit(motion: Any) -> None:
    """Give a new motion, with fields system, q, p, unit vectors at its nodes."""
    q, p = with_unit_rays(motion.system.rays, motion.q, motion.p)
    motion.__dict__.update(q=q, p=p)


def start_on_rays(
    rays: Rays, q: np.ndarray, v: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """A start (n,) with unit vectors, and rates at right angles to them.

    Raises
    ------
    InputError
        If a group is zero: no direction is given.
    """
    if not rays:
        return q, v
    q, v = np.array(q, dtype=float), None if v is None else np.array(v, dtype=float)
    for group in rays:
        at = list(group)
        length = np.linalg.norm(q[at])
        if not length > 0:
            raise InputError(
                f"the coordinates {at} of q0 are all zero; as a quaternion they give no rotation, "
                "(1, 0, 0, 0) is none"
            )
        if abs(length - 1) > UNIT:
            q[at] /= length
        if v is not None:
            v[at] -= q[at] * (q[at] @ v[at])
    return q, v


def tangent_columns(rays: Rays, q: np.ndarray) -> np.ndarray:
    """A basis (n, n − number of rays) of what may change in a configuration.

    Every other coordinate by itself; of a unit quaternion the rotations about the body's axes by
    1 rad, δq = ½ q ∘ (0, δθ); of other rays an orthonormal basis across them.
    """
    columns = []
    first = {group[0]: group for group in rays}
    inside = {i for group in rays for i in group}
    for i in range(len(q)):
        if i in first:
            at = list(first[i])
            block = np.zeros((len(q), len(at) - 1))
            block[at] = _turns(q[at]) if len(at) == 4 else _across(q[at])
            columns.append(block)
        elif i not in inside:
            columns.append(np.eye(len(q))[:, [i]])
    return np.hstack([np.zeros((len(q), 0)), *columns])


def _turns(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) / 2


def _across(q: np.ndarray) -> np.ndarray:
    return np.linalg.svd(q[None])[2][1:].T
