"""What users give for masses, places and constants: numbers, or expressions of parameters."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import Placement
from varint.multibody.rotations import rotation_of
from varint.scene.inputs import finite_array, number

SYMMETRIC = 1e-9  # of an inertia, relative to its size


def scalar(what: str, given: Any) -> Any:
    """A finite float, or an SX scalar."""
    if isinstance(given, ca.SX):
        if given.numel() != 1:
            raise InputError(f"{what} is an expression of shape {given.shape}; it must be a scalar")
        return given
    return number(what, given)


def not_negative(what: str, given: Any) -> Any:
    """A scalar that, where it is a number, is at least zero."""
    value = scalar(what, given)
    if not isinstance(value, ca.SX) and value < 0:
        raise InputError(f"{what} must not be negative, got {given!r}")
    return value


def point(what: str, given: Any) -> Any:
    """Three finite numbers as an array (3,), or an SX (3,); a list may mix numbers and SX."""
    if isinstance(given, (list, tuple)) and any(isinstance(x, ca.SX) for x in given):
        given = ca.vertcat(*given)
    if isinstance(given, ca.SX):
        if given.numel() != 3:
            raise InputError(f"{what} is an expression of shape {given.shape}; it must be (3,)")
        return ca.vec(given)
    value = finite_array(what, given)
    if value.shape != (3,):
        raise InputError(f"{what} must be three numbers, got {given!r}")
    return value


def placement(what: str, position: Any, rotation: Any = None) -> Placement:
    """A placement from a position and a rotation, or from a `Placement` itself."""
    if isinstance(position, Placement):
        if rotation is not None:
            raise InputError(f"{what} is a Placement already; leave the rotation out")
        position, rotation = position
    return Placement(point(what, position), rotation_of(f"the rotation of {what}", rotation))


def placed(position: Any = (0.0, 0.0, 0.0), rotation: Any = None) -> Placement:
    """Where a frame stands: a position (3,) and a rotation, as matrix (3, 3) or unit quaternion
    (w, x, y, z).
    """
    return placement("the place", position, rotation)


def inertia_matrix(what: str, given: Any) -> Any:
    """An inertia (3, 3) from a number (a ball), three principal moments, or the matrix.

    Raises
    ------
    InputError
        If it is not symmetric or has a negative moment.
    """
    if isinstance(given, (list, tuple)) and any(isinstance(x, ca.SX) for x in given):
        given = ca.vertcat(*given)
    if isinstance(given, ca.SX):
        if given.numel() == 1:
            return given * ca.SX.eye(3)
        if given.shape == (3, 1):
            return ca.diag(given)
        if given.shape == (3, 3):
            return ca.densify(given)
        raise InputError(f"{what} is an expression of shape {given.shape}; it must be (3, 3)")
    value = finite_array(what, given)
    if value.shape in ((), (3,)):
        value = np.diag(np.broadcast_to(value, 3))
    if value.shape != (3, 3):
        raise InputError(
            f"{what} has shape {value.shape}; give a number, three principal moments or a matrix "
            "(3, 3)"
        )
    size = abs(value).max()
    if abs(value - value.T).max() > SYMMETRIC * size:
        raise InputError(f"{what} is not symmetric: {value.tolist()}")
    if np.linalg.eigvalsh(value).min() < -SYMMETRIC * size:
        raise InputError(
            f"{what} has a negative principal moment: {np.linalg.eigvalsh(value).tolist()}"
        )
    return (value + value.T) / 2


def excess_moment(inertia: Any) -> float:
    """How far the largest principal moment lies above the sum of the others, relative to it; zero
    or less of what a body may have, and of expressions.

    One moment alone, (0, 0, I), says what a body has that turns about one axis: the others are not
    told.
    """
    if isinstance(inertia, ca.SX):
        return 0.0
    least, middle, largest = np.linalg.eigvalsh(inertia)
    alone = middle <= SYMMETRIC * largest
    return 0.0 if alone else float((largest - least - middle) / largest)


def product(a: Any, b: Any) -> Any:
    """a @ b of arrays, or of expressions."""
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.mtimes(ca.SX(a), ca.SX(b))
    return a @ b


def cross(a: Any, b: Any) -> Any:
    """a × b of arrays (3,), or of expressions."""
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.cross(ca.SX(a), ca.SX(b))
    return np.cross(a, b)


def plus(a: Any, b: Any) -> Any:
    """a + b of arrays, or of expressions."""
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return ca.SX(a) + ca.SX(b)
    return a + b


def compose(outer: Placement, inner: Placement) -> Placement:
    """Where a frame stands that stands at `inner` in the frame at `outer`."""
    return Placement(
        plus(outer.position, product(outer.rotation, inner.position)),
        product(outer.rotation, inner.rotation),
    )


def inverse(place: Placement) -> Placement:
    """Where the outer frame stands in the inner one."""
    back = place.rotation.T
    return Placement(-product(back, place.position), back)
