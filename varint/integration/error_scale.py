"""What the error of a motion is measured by, coordinate by coordinate."""

from __future__ import annotations

import re
from random import Random
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.start import start_function
from varint.numerics.arrays import call
from varint.numerics.places import normal_numbers
from varint.results.trajectory import Trajectory
from varint.scene.inputs import finite_array
from varint.scene.system import System, per_system

RESTS = 1e-12  # of where it is: what moves by less stays there but for round-off
RADIAN = 1.0  # scale of an angle that turns by more
HARDLY = 1e-3  # of the largest, compared by inertia: what a coordinate that hardly moves counts
PLACES = 8  # at which a shift by 2π is tried
SAME = 1e-9  # relative: the Lagrangian does not notice a shift


def error_scales(system: System, motion: Trajectory, given: Any = None) -> np.ndarray:
    """Scales (n,) by which errors of the coordinates are divided.

    A coordinate is measured by its own range during the motion; the coordinates of a body (x1, y1
    and z1, told by their names) by the range of the body; an angle, which the scene does not
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
    ranges = np.ptp(motion.q, axis=0)
    ranges[ranges <= RESTS * np.abs(motion.q).max(axis=0)] = 0.0
    scales = ranges.copy()
    for members in _bodies(system.names):
        scales[members] = np.sqrt((ranges[members] ** 2).sum())
    turns = np.array(angles(system), dtype=bool)
    scales[turns] = np.minimum(scales[turns], RADIAN)
    u, t = np.zeros(system.structure.controls), motion.t[:1]
    v = np.nan_to_num(motion[:1].v[0])
    mass = np.abs(
        np.diag(call(start_function(system), motion.q[0], v, u, t, motion.c)[1].reshape(n, n))
    )
    mass = np.where(mass > 0, mass, mass.max(initial=0.0) or 1.0)
    least = HARDLY * np.sqrt((mass * scales**2).max() / mass)
    scales = np.maximum(scales, least)
    return np.where(scales > 0, scales, np.maximum(np.abs(motion.q[0]), 1.0))


def _bodies(names: tuple[str, ...]) -> list[list[int]]:
    """Indices of the coordinates of each body, told by names such as x1, y1, z1."""
    found: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        match = re.fullmatch(r"[xyz]_?(\w*)", name)
        if match:
            found.setdefault(match[1], []).append(i)
    return [members for members in found.values() if len(members) > 1]


@per_system
def angles(system: System) -> tuple[bool, ...]:
    """Which coordinates are angles: L, forces and constraints change with them, not by 2π."""
    s = system
    parts = ca.vertcat(s.lagrangian, s.force, s.constraint, s.contact, ca.vec(s.nonholonomic))
    f = ca.Function("parts", [s.q, s.v, s.control, s.t, s.c], [ca.densify(parts)])
    random = Random(6)
    n = s.structure.n
    found = []
    for i in range(n):
        if not ca.depends_on(parts, s.q[i]):
            found.append(False)
            continue
        shift = 2 * np.pi * np.eye(n)[i]
        same = True
        for _ in range(PLACES):
            q, v = normal_numbers(random, n), normal_numbers(random, n)
            u = normal_numbers(random, s.structure.controls)
            before, after = (
                np.array(f(x, v, u, 0.3, s.default_vector)).ravel() for x in (q, q + shift)
            )
            finite = np.isfinite(before) & np.isfinite(after)
            size = np.abs(before[finite]).max(initial=0.0)
            same &= bool((np.abs(after - before)[finite] <= SAME * size).all() and finite.any())
        found.append(same)
    return tuple(found)
