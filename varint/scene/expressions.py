"""Expressions that users write about a system, in the symbols of that system."""

from __future__ import annotations

from typing import Any

import casadi as ca

from varint.errors import InputError, parsed_or_refused
from varint.scene.system import System


def in_own_symbols(expression: Any, system: System, what: str = "the expression") -> ca.SX:
    """The expression in the system's own symbols, matched by name; or the symbol of that name."""
    own = {
        x.name(): x
        for x in ca.vertsplit(ca.vertcat(system.q, system.v, system.t, system.control, system.c))
    }
    if isinstance(expression, str):
        if expression not in own:
            raise InputError(f"{what} is {expression!r}, no symbol's name; known: {sorted(own)}")
        return own[expression]
    if isinstance(expression, ca.MX):
        raise InputError(f"{what} is an MX; write it with the system's SX symbols")
    expression = parsed_or_refused(
        lambda: ca.SX(expression),
        lambda: f"{what} must be a CasADi SX expression, got {type(expression).__name__}",
    )
    used = ca.symvar(expression)
    unknown = sorted(x.name() for x in used if x.name() not in own)
    if unknown:
        raise InputError(f"unknown symbols {unknown} in {what}; known: {sorted(own)}")
    foreign = [x for x in used if not ca.is_equal(x, own[x.name()])]
    return ca.substitute(
        expression, ca.vertcat(*foreign), ca.vertcat(*(own[x.name()] for x in foreign))
    )
