"""What a scene may be made of: symbols, expressions of them, and where each may act."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from varint.errors import InputError, parsed_or_refused
from varint.scene.epigraph import refuse_largest

CONDITIONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)


def symbols(what: str, x: Any) -> ca.SX:
    """x as a column of distinct SX symbols."""
    if isinstance(x, ca.MX):
        raise InputError(
            f"{what} is an MX; varint takes SX symbols (coordinates, time, Parameters, ca.SX.sym)"
        )
    if not isinstance(x, ca.SX) or not x.is_valid_input():
        made = (
            "; a scene is System(q, v, L) with q, v = coordinates(...)"
            if what in ("q", "v")
            else ""
        )
        raise InputError(f"{what} must be SX symbols, got {x!r}{made}")
    x = ca.vec(x)
    if len({s.element_hash() for s in ca.symvar(x)}) < x.numel():
        raise InputError(f"{what} holds the same symbol twice: {x}")
    return x


def expression(what: str, x: Any, shape: tuple[int | None, int]) -> ca.SX:
    """x as a dense-shaped SX of the wanted shape (None: any number of rows)."""
    if isinstance(x, ca.MX):
        raise InputError(
            f"{what} is an MX expression; write it with SX symbols (coordinates, time, Parameters)"
        )
    x = parsed_or_refused(
        lambda: ca.SX(x), lambda: f"{what} must be a CasADi SX expression, got {type(x).__name__}"
    )
    rows, cols = shape
    if x.shape[1] != cols or (rows is not None and x.shape[0] != rows):
        wanted = f"({'any' if rows is None else rows}, {cols})"
        raise InputError(f"{what} has shape {x.shape}; it must have {wanted}")
    return x


def refuse_condition(what: str, x: ca.SX, instead: str) -> None:
    """Refuse a comparison, or what joins some, where an expression is wanted: it is 0 or 1."""
    if any(x.is_op(condition) for condition in CONDITIONS):
        raise InputError(f"{what} is a condition, 0 or 1, {instead}; got {x}")


def rows(what: str, x: Any) -> ca.SX:
    """x as a column of expressions none of which is a condition; none for None."""
    found = expression(what, ca.SX(0, 1) if x is None else x, (None, 1))
    for i in range(found.numel()):
        refuse_condition(f"row {i} of {what}", found[i], _IN_PLACE_OF_CONDITIONS[what])
    return found


def pfaffian(x: Any, v: ca.SX) -> ca.SX:
    """The matrix A of rows A(q, t) v = 0, (any, n); none for None."""
    if isinstance(x, ca.SX) and ca.depends_on(x, v):
        for entry in ca.vertsplit(ca.vec(x)):
            refuse_condition("nonholonomic", entry, _IN_PLACE_OF_CONDITIONS["nonholonomic"])
    if isinstance(x, ca.SX) and x.shape[1] != v.numel() and ca.depends_on(x, v):
        raise InputError(
            f"nonholonomic takes the matrix A of the rows A(q, t) v = 0, {v.numel()} columns wide, "
            f"got what depends on v, of shape {x.shape}; give nonholonomic=ca.jacobian(rows, v) of "
            "rows that are linear in v"
        )
    return expression("nonholonomic", ca.SX(0, v.numel()) if x is None else x, (None, v.numel()))


def _hashes(x: ca.SX) -> set[int]:
    return {s.element_hash() for s in ca.symvar(x)}


def check_symbols(
    q: ca.SX, v: ca.SX, t: ca.SX, control: ca.SX, c: ca.SX, parts: Mapping[str, ca.SX]
) -> None:
    """Every symbol is declared, has a name of its own, and acts where it may.

    `parts` are the expressions of the scene by the names that `_MAY_DEPEND` has for them.
    """
    declared = ca.vertcat(q, v, t, control, c)
    names = [x.name() for x in ca.vertsplit(declared)]
    twice = sorted({name for name in names if names.count(name) > 1})
    moving = {x.name() for x in ca.vertsplit(ca.vertcat(q, v, control, c))}
    if t.name() in moving:
        raise InputError(
            f"{t.name()!r} is the name of time, and of a coordinate, velocity, control or "
            "parameter too; give that another name, such as 'tau'"
        )
    if twice:
        raise InputError(f"the names {twice} are used for more than one symbol; give each its own")
    base = _hashes(ca.vertcat(q, t, c))
    more = {"the Lagrangian": _hashes(v), "the force": _hashes(v) | _hashes(control)}
    known = _hashes(declared)
    for what, expression in parts.items():
        used = {x.element_hash(): x.name() for x in ca.symvar(expression)}
        strange = sorted(name for key, name in used.items() if key not in known)
        refuse_largest(what, expression, declared)
        if strange:
            raise InputError(
                f"undeclared symbols {strange} in {what}; declare them: coordinates(...) for q and "
                "v, params={m: 1.0} or Parameters(...) for constants, t=time() for time, control= "
                "for controls"
            )
        may = base | more.get(what, set())
        wrong = sorted(name for key, name in used.items() if key not in may)
        if wrong:
            raise InputError(
                f"{what} may not depend on {wrong}; it is a function of {_MAY_DEPEND[what]}"
            )
    for i, row in enumerate(ca.vertsplit(parts["the constraint"])):
        if not (ca.depends_on(row, q) or row.is_zero()):
            raise InputError(
                f"row {i} of the constraint is {row}, which no coordinate changes; give an "
                "expression of q that the motion keeps at zero"
            )
    if not ca.depends_on(parts["the Lagrangian"], v):
        raise InputError(
            "the Lagrangian has no velocities: it must depend on "
            f"{[x.name() for x in ca.symvar(v)]}; use the v that coordinates(...) returned "
            "together with this q"
        )


_MAY_DEPEND = {
    "the Lagrangian": "q, v, t and the parameters; controls act through force=",
    "the force": "q, v, t, the controls and the parameters",
    "the constraint": "q, t and the parameters; constraints on velocities are nonholonomic=",
    "nonholonomic": "q, t and the parameters (the rows A of A(q) v = 0)",
    "the contact": "q, t and the parameters",
}

_IN_PLACE_OF_CONDITIONS = {
    "the constraint": "which no motion keeps at zero: give what is zero where it holds, as x - y "
    "for x == y",
    "the contact": "which is no distance: give the gap, positive off the contact and zero at it, "
    "as x - 0.5 for x >= 0.5",
    "nonholonomic": "where the rows A of A(q, t) v = 0 are wanted: give "
    "ca.jacobian(v[0] - v[1], v) for v[0] == v[1]",
}
