"""Rotations: matrices from angles, axes and unit quaternions, and back to angles for plots."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.inputs import finite_array

# entries of a rotation that round-off alone keeps from 0, 1 or −1: cos of what is written as π/2
ROUND_OFF = 4e-16
ORTHOGONAL = 1e-6  # of a given rotation matrix or unit quaternion; files carry as few digits


def axis_rotation(axis: Any, angle: Any) -> Any:
    """Matrix (3, 3) of the rotation by an angle (rad) about an axis (Rodrigues).

    Numbers give an array, an SX angle an SX with the zeros left out.

    Examples
    --------
    >>> import numpy as np
    >>> import varint.multibody as mb
    >>> mb.axis_rotation([0, 0, 1], np.pi / 2) @ [1, 0, 0]
    array([0., 1., 0.])
    """
    n = unit("axis", axis)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    if isinstance(angle, ca.SX):
        along = np.outer(n, n)
        return (
            ca.cos(angle) * ca.sparsify(ca.SX(tidied(np.eye(3) - along)))
            + ca.sin(angle) * ca.sparsify(ca.SX(cross))
            + ca.sparsify(ca.SX(along))
        )
    x = float(angle)
    return tidied(np.eye(3) + np.sin(x) * cross + 2 * np.sin(x / 2) ** 2 * cross @ cross)


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Matrix (3, 3) of the fixed-axis angles (rad) of URDF, ``R_z(yaw) R_y(pitch) R_x(roll)``."""
    x, y, z = np.eye(3)
    return tidied(axis_rotation(z, yaw) @ axis_rotation(y, pitch) @ axis_rotation(x, roll))


def quaternion_matrix(q: Any) -> Any:
    """Matrix (3, 3) of a unit quaternion (w, x, y, z), body to space.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> mb.quaternion_matrix([0, 1, 0, 0]).diagonal()
    array([ 1., -1., -1.])
    """
    if isinstance(q, ca.SX):
        w, x, y, z = ca.vertsplit(q)
        return ca.blockcat(_quaternion_rows(w, x, y, z))
    value = finite_array("the quaternion", q)
    if value.shape != (4,) or abs(value @ value - 1) > ORTHOGONAL:
        raise InputError(f"a rotation's quaternion is four numbers (w, x, y, z) of norm 1, got {q}")
    return tidied(np.array(_quaternion_rows(*value / np.linalg.norm(value))))


def ray_matrix(q: ca.SX) -> ca.SX:
    """Matrix (3, 3) of the rotation that a quaternion of any length but zero stands for."""
    w, x, y, z = ca.vertsplit(q)
    return ca.blockcat(_quaternion_rows(w, x, y, z, 2 / ca.sumsqr(q)))


def _quaternion_rows(w: Any, x: Any, y: Any, z: Any, two: Any = 2) -> list[list[Any]]:
    return [
        [1 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), 1 - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), 1 - two * (x * x + y * y)],
    ]


def matrix_quaternion(rotation: Any) -> np.ndarray:
    """The unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix (Shepperd 1978).

    Examples
    --------
    >>> import varint.multibody as mb
    >>> mb.matrix_quaternion(mb.quaternion_matrix([0.6, 0, 0.8, 0]))
    array([0.6, 0. , 0.8, 0. ])
    """
    r = rotation_of("the rotation", rotation)
    trace = np.trace(r)
    squares = np.array([trace, *(2 * np.diag(r) - trace)]) + 1  # 4 w², 4 x², 4 y², 4 z²
    largest = int(squares.argmax())
    products = np.array(
        [
            [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], squares[1], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], squares[2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[3]],
        ]
    )
    q = products[largest] / np.linalg.norm(products[largest])
    return -q if q[0] < 0 else q


def quaternion_rate(q: Any, omega: Any) -> np.ndarray:
    """q̇ = ½ q (0, ω) (4,) of a unit quaternion for an angular velocity along the body's axes."""
    (w, x, y, z), (a, b, c) = q, omega
    return (
        np.array(
            [
                -x * a - y * b - z * c,
                w * a + y * c - z * b,
                w * b + z * a - x * c,
                w * c + x * b - y * a,
            ]
        )
        / 2
    )


def rotation_of(what: str, given: Any) -> Any:
    """A rotation matrix (3, 3) from None, a matrix, or a unit quaternion (w, x, y, z)."""
    if given is None:
        return np.eye(3)
    if isinstance(given, ca.SX):
        if given.shape == (4, 1):
            return quaternion_matrix(given)
        if given.shape == (3, 3):
            return given
        raise InputError(f"{what} is an expression of shape {given.shape}; it must be (3, 3)")
    value = finite_array(what, given)
    if value.shape == (4,):
        return quaternion_matrix(value)
    if value.shape != (3, 3):
        raise InputError(
            f"{what} has shape {value.shape}; give a rotation matrix (3, 3) or a unit quaternion "
            "(w, x, y, z)"
        )
    if abs(value @ value.T - np.eye(3)).max() > ORTHOGONAL or np.linalg.det(value) < 0:
        raise InputError(f"{what} is no rotation matrix (orthogonal, determinant 1): {given}")
    return tidied(value)


def unit(what: str, given: Any) -> np.ndarray:
    """A direction (3,) of length one."""
    value = finite_array(what, given)
    size = np.linalg.norm(value)
    if value.shape != (3,) or size == 0:
        raise InputError(f"{what} must be three numbers that are not all zero, got {given!r}")
    return tidied(value / size)


def frame_along(axis: np.ndarray) -> np.ndarray:
    """A rotation matrix whose third column is the unit vector `axis`, the identity where it may."""
    z = np.asarray(axis, dtype=float)
    # the cyclic permutations keep the zeros of an axis along x or y
    cyclic = (np.eye(3), np.roll(np.eye(3), 1, axis=0), np.roll(np.eye(3), 2, axis=0))
    for matrix in cyclic:
        if np.array_equal(matrix[:, 2], z):
            return matrix
        if np.array_equal(matrix[:, 2], -z):
            return matrix @ np.diag([1.0, -1.0, -1.0])
    x = np.cross(np.eye(3)[abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return tidied(np.column_stack([x, np.cross(z, x), z]))


def tidied(matrix: np.ndarray) -> np.ndarray:
    """The same with 0, 1 and −1 in place of what round-off alone keeps from them."""
    nearest = np.round(matrix)
    return np.where(abs(matrix - nearest) <= ROUND_OFF, nearest, matrix) + 0.0


def euler_angles(rotation: Any, order: str = "zyx") -> np.ndarray:
    """Angles (…, 3) in rad of turns about moving axes, ``R = R_a(α) R_b(β) R_c(γ)``, for plots.

    Parameters
    ----------
    rotation : array (…, 3, 3) or (…, 4)
        Rotation matrices, or unit quaternions (w, x, y, z).
    order : str, optional
        Three letters out of x, y, z, neighbours different: "zyx" yaw, pitch and roll; "zxz" the
        Euler angles of the books.

    Returns
    -------
    array (…, 3)
        The second within ±π/2, or within [0, π] where the first and third axis are the same; at
        its ends, where the others turn about one axis, the third is zero.

    Raises
    ------
    InputError
        If the order names no three axes.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> turned = mb.roll_pitch_yaw(0.1, 0.2, 0.3)
    >>> mb.euler_angles(turned).round(12)
    array([0.3, 0.2, 0.1])
    """
    letters = "xyz"
    known = isinstance(order, str) and len(order) == 3 and set(order) <= set(letters)
    if not known or order[0] == order[1] or order[1] == order[2]:
        raise InputError(f'order must be three axes such as "zyx" or "zxz", got {order!r}')
    r = np.asarray(rotation, dtype=float)
    if r.shape[-1:] == (4,):
        w, x, y, z = np.moveaxis(r / np.linalg.norm(r, axis=-1, keepdims=True), -1, 0)
        r = np.moveaxis(np.array(_quaternion_rows(w, x, y, z)), (0, 1), (-2, -1))
    if r.shape[-2:] != (3, 3):
        raise InputError(f"rotations have shape (…, 3, 3) or (…, 4), got {r.shape}")
    i, j, k = (letters.index(x) for x in order)
    odd = 1 if (j - i) % 3 == 1 else -1
    if i == k:
        k = 3 - i - j
        second = np.arctan2(np.hypot(r[..., i, j], r[..., i, k]), r[..., i, i])
        level = np.sin(second) < EDGE
        first = np.arctan2(r[..., j, i], -odd * r[..., k, i])
        third = np.arctan2(r[..., i, j], odd * r[..., i, k])
    else:
        second = np.arctan2(odd * r[..., i, k], np.hypot(r[..., i, i], r[..., i, j]))
        level = np.cos(second) < EDGE
        first = np.arctan2(-odd * r[..., j, k], r[..., k, k])
        third = np.arctan2(-odd * r[..., i, j], r[..., i, i])
    alone = np.arctan2(odd * r[..., k, j], r[..., j, j])
    return np.stack([np.where(level, alone, first), second, np.where(level, 0.0, third)], axis=-1)


EDGE = 1e-12  # sine of the angle from the singular attitudes below which two angles are one
