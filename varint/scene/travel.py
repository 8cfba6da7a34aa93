"""How expressions go to another process, and what cannot go there says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import casadi as ca

from varint.errors import InputError


@dataclass(frozen=True, eq=False)
class _Travelling:
    """Stands for an expression in a pickle, out of which the expression itself comes."""

    expression: ca.SX

    def __reduce__(self) -> tuple[Callable[[str], ca.SX], tuple[str]]:
        return _expression_of, (self.expression.serialize(),)


def _expression_of(text: str) -> ca.SX:
    return ca.SX.deserialize(text)


def travelling(x: Any) -> Any:
    """What a pickle holds of a value: an expression comes out of it with symbols of the same
    names.
    """
    return _Travelling(x) if isinstance(x, ca.SX) else x


def as_fields(record: Any) -> tuple[Any, ...]:
    """All fields of a record in order, for its pickle."""
    return tuple(travelling(getattr(record, f.name)) for f in fields(record))


def itself(record: Any, memo: Any = None) -> Any:
    """The copy of what never changes."""
    return record


def stays(what: str) -> Callable[[Any], Any]:
    """`__reduce__` of what holds a solver that is built: it cannot be pickled."""

    def refuse(record: Any) -> Any:
        raise InputError(
            f"{what} holds a solver that is built, which cannot be pickled: build it anew where "
            "it is needed, or send the motions that it returns"
        )

    return refuse
