"""What the error of a motion is measured by, coordinate by coordinate."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from random import Random
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call, over_columns
from varint.numerics.places import normal_numbers
from varint.results.trajectory import Trajectory
from varint.scene.inputs import finite_array
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

RESTS = 1e-12  # of where it is: what moves by less stays there but for round-off
RADIAN = 1.0  # scale of an angle that turns by more
HARDLY = 1e-3  # of the largest, compared by inertia: what a coordinate that hardly moves counts
PLACES = 8  # at which a shift by 2π is tried
TURN = 2 * math.pi
SAME = 1e-9  # relative: the Lagrangian does not notice a shift
OTHER = 1e-3  # of what a shift by one changes
ROUNDED = 1e-14  # relative: what is no change


def error_scales(system: System, motion: Trajectory, given: Any = None) -> np.ndarray:
    """Scales (n,) by which errors of the coordinates are divided.

    A coordinate is measured by its own range during the motion; the coordinates of a body (x1, y1
    and z1, or base_x, base_y and base_z, told by their names) by the range of the body; a
    quaternion's four numbers by that of the quaternion; an angle, which the scene does not
    notice when it grows by 2π, by a radian if it turns by more. A coordinate that hardly moves is
    measured by 1e-3 of what the others would move with its inertia, and where nothing moves but by
    round-off, by how far it is from zero, or by one.

    Parameters
    ----------
    system : System
    motion : Trajectory
        Any run of it that is right to a digit.
    given : float or array (n,), optional
        Scales of the user's own.

    Raises
    ------
    InputError
        If the given scales are not positive numbers, one or n.
    """
    n = system.structure.n
    if given is not None:
        scales = finite_array("scale", given)
        if scales.shape not in ((), (1,), (n,)) or not (scales > 0).all():
            raise InputError(
                f"scale must be a positive number or one for each of {list(system.names)}, "
                f"got {given!r}"
            )
        return np.broadcast_to(scales.ravel(), (n,)).copy()
    return _own_scales(system, motion, _still(system, motion))


def _own_scales(system: System, motion: Trajectory, still: np.ndarray) -> np.ndarray:
    v = _first_velocity(system, motion)
    return scales_of_nodes(system, motion.q, v, motion.t[:1], motion.c, still)


def careful_scales(system: System, motion: Trajectory, given: Any = None) -> np.ndarray:
    """`error_scales`, none of its own larger than the largest coordinate: for rules of low order,
    whose estimates are hardly larger than the errors. A swing to both sides of zero has twice the
    range.
    """
    if given is not None:
        return error_scales(system, motion, given)
    q, still = motion.q, _still(system, motion)
    moves = np.where(np.abs(q) > still, q, 0.0) if still.any() else q
    return below_largest(_own_scales(system, motion, still), moves)


def below_largest(scales: np.ndarray, q: np.ndarray) -> np.ndarray:
    """None larger than the largest coordinate, where there is one."""
    largest = float(np.abs(q).max())
    return np.minimum(scales, largest) if largest > 0 else scales


def scales_of_nodes(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    t: np.ndarray,
    c: np.ndarray,
    still: np.ndarray | float = 0.0,
) -> np.ndarray:
    """`error_scales` of the nodes q (N, n), where the motion begins at t (1,) with v (n,), and
    ranges up to `still` are round-off.
    """
    each = np.ascontiguousarray(q.T)  # ten times as fast as along the columns
    high, low = each.max(axis=1).tolist(), each.min(axis=1).tolist()
    stays = np.broadcast_to(still, len(high)).tolist()
    ranges = [
        top - bottom if not top - bottom <= max(RESTS * max(abs(top), abs(bottom)), least) else 0.0
        for top, bottom, least in zip(high, low, stays, strict=True)
    ]
    sizes = list(ranges)
    for members in [*bodies(system.names), *system.rays]:
        size = math.sqrt(sum([ranges[i] * ranges[i] for i in members]))
        for i in members:
            sizes[i] = size
    sizes = [min(x, RADIAN) if turns else x for x, turns in zip(sizes, angles(system), strict=True)]
    mass = [1.0]
    if len(sizes) > 1:
        mass = np.abs(call(_inertia_function(system), q[0], v, t, c)[0]).tolist()
    some = max([x for x in mass if x > 0], default=1.0)
    mass = [x if x > 0 else some for x in mass]
    moved = max([x * (size * size) for x, size in zip(mass, sizes, strict=True)])
    for i, x in enumerate(mass):
        least = HARDLY * math.sqrt(moved / x)
        sizes[i] = max(sizes[i], least) or max(abs(float(q[0, i])), 1.0)
    return np.array(sizes)


def _first_velocity(system: System, motion: Trajectory) -> np.ndarray:
    """v (n,) at the start, where a mass may depend on it."""
    if system.structure.quadratic_kinetic:
        return np.zeros(system.structure.n)
    return np.nan_to_num(motion[:1].v[0])


def _still(system: System, motion: Trajectory) -> np.ndarray:
    """Ranges (n,) of what rests where constraints or contacts hold it, which may be at zero: by the
    last digits of how far forces at the start would move it in a step, were it free.
    """
    if not (system.structure.contacts or system.structure.constraints):
        return np.zeros(system.structure.n)
    v = _first_velocity(system, motion)
    u = motion.u[0, 0] if len(motion.u) else np.zeros(system.structure.controls)
    mass, force = call(_pull_function(system), motion.q[0], v, u, motion.t[:1], motion.c)
    free = np.isfinite(force) & (mass > 0)
    fall = np.divide(np.abs(force), mass, out=np.zeros(len(mass)), where=free)
    return RESTS * motion.h**2 * fall


@per_scene
def _pull_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → diagonal of M, ∂L/∂q + F."""
    s = system
    values = [ca.densify(x) for x in (ca.diag(s.mass_matrix), s.generalised_force)]
    return ca.Function("pull", [s.q, s.v, s.control, s.t, s.c], values, {"cse": True})


@per_scene
def _inertia_function(system: System) -> ca.Function:
    """(q, v, t, c) → diagonal of M."""
    s = system
    diagonal = ca.densify(ca.diag(s.mass_matrix))
    return ca.Function("inertia", [s.q, s.v, s.t, s.c], [diagonal], {"cse": True})


@lru_cache(maxsize=256)
def bodies(names: tuple[str, ...]) -> list[list[int]]:
    """Indices of the coordinates of each body, told by names such as x1, y1, z1, or base_x."""
    found: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        match = re.fullmatch(r"[xyz]_?(\w*)|(\w+)_[xyz]", name)
        if match:
            found.setdefault(match[1] or match[2] or "", []).append(i)
    return [members for members in found.values() if len(members) > 1]


@per_system
def angles(system: System) -> tuple[bool, ...]:
    """Which coordinates are angles: L, forces, constraints and gaps change with them, not by 2π."""
    s = system
    parts = ca.vertcat(s.lagrangian, s.force, s.constraint, ca.vec(s.nonholonomic), s.contact)
    f = ca.Function("parts", [s.q, s.v, s.control, s.t, s.c], [ca.densify(parts)])
    random, n = Random(6), s.structure.n
    left = np.flatnonzero(ca.which_depends(parts, s.q, 1, False))
    for _ in range(PLACES):
        q, v, u = (normal_numbers(random, size) for size in (n, n, s.structure.controls))
        each = np.eye(n)[left]
        some = np.vstack([q, q + TURN * each, q + each])
        same = (np.broadcast_to(x, (len(some), x.size)) for x in (v, u, np.array([0.3])))
        values = over_columns(f, some, *same, s.default_vector)[0]
        before, turned, shifted = np.split(values, [1, 1 + len(left)])
        both = zip(turned, shifted, strict=True)
        left = left[[_same(before[0], x, y, s.structure.contacts) for x, y in both]]
    return tuple(i in left for i in range(n))


def _same(before: np.ndarray, turned: np.ndarray, shifted: np.ndarray, gaps: int) -> bool:
    """Whether finite values are the same after a turn, there are some, and they are no more so than
    after any other shift: far and light bodies hardly change what there is besides. Gaps, the last
    ones, each by itself: one may be a distance and the next one its square.
    """
    finite = np.isfinite(before) & np.isfinite(turned) & np.isfinite(shifted)
    count = len(before)
    for part in np.split(np.arange(count), range(count - gaps, count)):
        some = part[finite[part]]
        if len(some):
            size = np.abs(before[some]).max()
            change, other = (np.abs(x[some] - before[some]).max() for x in (turned, shifted))
            if not change <= min(SAME * size, max(OTHER * other, ROUNDED * size)):
                return False
    return bool(finite.any())
