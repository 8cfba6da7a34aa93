"""SymPy, an optional extra, imported only when something is to be read or comes from there."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from varint.errors import VarintError


def sympy_module(what: str) -> Any:
    """SymPy for `what` asks for it.

    Raises
    ------
    VarintError
        If it is not installed.
    """
    if not is_there():
        raise VarintError(f"{what} needs the package sympy: pip install varint-mechanics[sympy]")
    import sympy

    return sympy


def is_there() -> bool:
    """Whether SymPy is installed; looking costs nothing."""
    return find_spec("sympy") is not None


def time_symbol() -> Any:
    """The symbol of time of `dynamicsymbols`."""
    from sympy.physics.vector import dynamicsymbols

    return dynamicsymbols._t
