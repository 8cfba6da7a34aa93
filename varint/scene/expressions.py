"""Expressions that users write about a system, in the symbols of that system."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from varint.errors import InputError, parsed_or_refused
from varint.scene.memory import per_system
from varint.scene.system import System


def in_own_symbols(expression: Any, system: System, what: str = "the expression") -> ca.SX:
    """The expression in the system's own symbols, matched by name; or the symbol of that name."""
    own = _own_symbols(system)
    if isinstance(expression, str):
        if expression not in own:
            raise InputError(f"{what} is {expression!r}, no symbol's name; known: {sorted(own)}")
        return own[expression]
    if isinstance(expression, ca.MX):
        raise InputError(f"{what} is an MX; write it with the system's SX symbols")
    if not isinstance(expression, ca.SX):
        expression = parsed_or_refused(
            lambda: ca.SX(expression),
            lambda: f"{what} must be a CasADi SX expression, got {type(expression).__name__}",
        )
    same = _own_hashes(system)
    foreign = [x for x in ca.symvar(expression) if x.element_hash() not in same]
    if not foreign:
        return expression
    unknown = sorted(x.name() for x in foreign if x.name() not in own)
    if unknown:
        raise InputError(f"unknown symbols {unknown} in {what}; known: {sorted(own)}")
    return ca.substitute(
        expression, ca.vertcat(*foreign), ca.vertcat(*(own[x.name()] for x in foreign))
    )


@per_system
def _own_symbols(system: System) -> dict[str, ca.SX]:
    """By name: q, v, t, the controls and the parameters."""
    s = system
    return {x.name(): x for x in ca.vertsplit(ca.vertcat(s.q, s.v, s.t, s.control, s.c))}


@per_system
def _own_hashes(system: System) -> set[int]:
    """What tells those symbols from others of the same names."""
    return {x.element_hash() for x in _own_symbols(system).values()}


class Written(NamedTuple):
    """What an expression says: which one it is, its operation, and what that is of, as deep as it
    was looked at.
    """

    node: int
    operation: int
    of: tuple[Written, ...]


def as_written(x: ca.SX, deep: int) -> Written:
    """What a scalar expression says, as long as it is kept."""
    of = [as_written(x.dep(i), deep - 1) for i in range(x.n_dep())] if deep else []
    return Written(x.element_hash(), x.op(), tuple(of))


def is_written_so(x: ca.SX, known: Written) -> bool:
    """Whether a scalar expression says the same, written anew; in a fifth of the time of CasADi's
    comparison.
    """
    if x.element_hash() == known.node:
        return True
    if not known.of or x.op() != known.operation:
        return False
    return all(is_written_so(x.dep(i), part) for i, part in enumerate(known.of))


def values_of(system: System, expression: Any) -> ca.Function:
    """(q, v, t, u, c) → an expression of the system's symbols, matched by name."""
    s, own = system, ca.densify(in_own_symbols(expression, system))
    return ca.Function("value", [s.q, s.v, s.t, s.control, s.c], [own], {"cse": True})
