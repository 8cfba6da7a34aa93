"""Where a motion begins: numbers, or expressions of parameters such as the elements of an orbit."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call
from varint.scene.inputs import vector
from varint.scene.system import System


def begin_function(system: System, q0: Any, v0: Any, unknown: Any) -> ca.Function:
    """c → (q0, v0) and its derivatives by c."""
    n, parts = system.structure.n, []
    for name, value in (("q0", q0), ("v0", v0)):
        if not isinstance(value, ca.SX):
            parts.append(ca.SX(vector(name, value, n, system.names).tolist()))
            continue
        if name in unknown:
            raise InputError(f"{name} is an expression of parameters: leave it out of unknown")
        if value.numel() != n:
            raise InputError(f"{name} must be {n} expressions, got {value.shape}")
        parts.append(ca.densify(ca.vec(value)))
    start, c = ca.vertcat(*parts), system.c
    known = {x.element_hash() for x in ca.vertsplit(c)}
    if strange := [x.name() for x in ca.symvar(start) if x.element_hash() not in known]:
        raise InputError(
            f"q0 and v0 depend on {strange}; they may depend on the scene's parameters only"
        )
    slope = ca.densify(ca.jacobian(start, c))
    return ca.Function("begin", [c], [ca.densify(start), slope], {"cse": True})


def begun(begin: ca.Function, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q0, v0) and its derivatives (2n, C)."""
    start, slope = call(begin, c)
    return start, slope.reshape(len(c), len(start)).T
