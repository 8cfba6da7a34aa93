"""The symbols of a scene in SymPy: plain ones to calculate with, functions of time to hand out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from varint.errors import InputError, VarintError
from varint.notation.extra import is_there, sympy_module, time_symbol
from varint.notation.styles import LATEX
from varint.notation.tidy import tidied
from varint.notation.to_sympy import lengths, sympy_of
from varint.notation.writer import write
from varint.numerics.operations import operations_of

READABLE = 300  # operations of a Lagrangian that is shown without being asked for


class Letters(NamedTuple):
    """Symbols of SymPy, all real, by what they stand for.

    Attributes
    ----------
    t : sympy.Symbol
        Time.
    q, v, a, u, c : tuple of sympy.Symbol
        Coordinates, velocities, accelerations, controls, parameters.
    functions : dict
        What each is to the outside: coordinates as functions of time (``dynamicsymbols``),
        velocities and accelerations as their derivatives, parameters without assumptions.
    order : tuple of str
        Names as they come in sums and products: parameters, time, coordinates, controls.
    """

    t: Any
    q: tuple[Any, ...]
    v: tuple[Any, ...]
    a: tuple[Any, ...]
    u: tuple[Any, ...]
    c: tuple[Any, ...]
    functions: dict[Any, Any]
    order: tuple[str, ...]

    @property
    def moving(self) -> tuple[Any, ...]:
        """What is not constant and no velocity."""
        return (*self.q, self.t, *self.u)


def letters_of(system: Any) -> Letters:
    """The letters of a scene.

    Raises
    ------
    VarintError
        If SymPy is not installed.
    InputError
        If something has the name t, which is that of time in SymPy, and is not time.
    """
    sp = sympy_module("typesetting")
    t = time_symbol()
    names = {x: _names(getattr(system, x)) for x in ("q", "v", "control", "c")}
    if any("t" in found for found in names.values()):
        raise InputError("'t' is the name of time in SymPy; give what is called so another name")
    made = {x: tuple(sp.Symbol(name, real=True) for name in names[x]) for x in names}
    time = sp.Dummy("t", real=True)
    accelerations = tuple(sp.Dummy(f"{name}_ddot", real=True) for name in names["q"])
    path = [sp.Function(name)(t) for name in names["q"]]
    functions = {time: t} | dict(zip(made["q"], path, strict=True))
    functions |= {v: x.diff(t) for v, x in zip(made["v"], path, strict=True)}
    functions |= {a: x.diff(t, 2) for a, x in zip(accelerations, path, strict=True)}
    functions |= {u: sp.Function(u.name)(t) for u in made["control"]}
    functions |= {c: sp.Symbol(c.name) for c in made["c"]}
    return Letters(
        time,
        made["q"],
        made["v"],
        accelerations,
        made["control"],
        made["c"],
        functions,
        (*names["c"], "t", *names["q"], *names["control"]),
    )


def in_letters(system: Any, letters: Letters, expressions: Sequence[ca.SX]) -> list[list[Any]]:
    """Expressions of a scene in its letters, each a list of entries column by column."""
    s = system
    symbols = [(letters.t,), letters.q, letters.v, letters.u, letters.c]
    return sympy_of([s.t, s.q, s.v, s.control, s.c], symbols, expressions)


def length_of(system: Any, expression: ca.SX) -> int:
    """Operations of an expression of a scene when it is written out."""
    s = system
    inputs = [s.q, s.v, s.t, s.control, s.c]
    return lengths(operations_of(ca.Function("length", inputs, [expression], {"cse": True})))[0]


def lagrangian_latex(system: Any) -> str | None:
    """The Lagrangian for notebooks; None where SymPy is not installed, or it is too long to be
    read or cannot be written in SymPy: then they show the plain text.
    """
    if not is_there():
        return None
    try:
        if length_of(system, system.lagrangian) > READABLE:
            return None
        letters = letters_of(system)
        [[lagrangian]] = in_letters(system, letters, [system.lagrangian])
    except VarintError:
        return None
    shown = tidied(lagrangian, letters.v, letters.moving).xreplace(letters.functions)
    return rf"$\displaystyle L = {write(shown, LATEX, letters.order)}$"


def _names(symbols: ca.SX) -> list[str]:
    return [symbols[i].name() for i in range(symbols.numel())]
