"""What is done for every link alike, built once for each motion and called link by link.

A call is one crossing into CasADi where the operations themselves are dozens; zeros and ones of
what it is called with are left out of the result as they are elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

import casadi as ca

from varint.multibody.data import Placement
from varint.multibody.tree import Link

SIZES = {"revolute": 1, "prismatic": 1, "translation": 3, "spherical": 4}
MATRICES, SCALARS = ("J", "H", "M", "inertia"), ("mass", "momentum", "armature", "share", "rate")
Operation = TypeVar("Operation", bound=Callable[..., Any])


def for_each_link(*given: type, gives: type) -> Callable[[Operation], Operation]:
    """Let an operation (link, q, *given) → gives of named tuples be built once for each motion.

    Parameters
    ----------
    *given, gives : type
        Named tuples of expressions, vectors (3,) but for `MATRICES` and `SCALARS`; `ca.SX` is a
        vector.
    """

    def remembered(operation: Operation) -> Operation:
        @cache
        def function(motion: str) -> ca.Function:
            place = Placement(ca.SX.sym("r", 3), ca.SX.sym("E", 3, 3))
            q = ca.SX.sym("q", SIZES[motion])
            taken = [_symbols(kind) for kind in given]
            found = operation(Link("", motion, 0, place, 0, SIZES[motion]), q, *taken)
            inputs = [*place, q, *(x for part in taken for x in _parts(part))]
            return ca.Function(
                operation.__name__.strip("_"), inputs, [ca.densify(x) for x in _parts(found)]
            )

        @wraps(operation)
        def called(link: Link, q: ca.SX, *taken: Any) -> Any:
            inputs = [*link.place, q, *(x for part in taken for x in _parts(part))]
            found = function(link.motion)(*inputs)
            return found if gives is ca.SX else gives(*found)

        return called  # type: ignore[return-value]

    return remembered


def _symbols(kind: Any) -> Any:
    if kind is ca.SX:
        return ca.SX.sym("x", 3)
    return kind(*(ca.SX.sym(name, *_shape(name)) for name in kind._fields))


def _shape(name: str) -> tuple[int, int]:
    return (3, 3) if name in MATRICES else (1, 1) if name in SCALARS else (3, 1)


def _parts(x: Any) -> tuple[ca.SX, ...]:
    return (x,) if isinstance(x, ca.SX) else tuple(x)
