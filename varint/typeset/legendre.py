"""Hamiltonian and Routhian of a scene in SymPy, where L is quadratic in the velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from varint.notation.extra import sympy_module
from varint.notation.tidy import opened, shortest, slope, tidied
from varint.typeset.lagrange import Mechanics

# coordinates that the mass matrix couples and whose inverse is written out; of more, its entries
# are letters
LARGEST = 3


class Quadratic(NamedTuple):
    """L = ½ vᵀ M v + b·v − U."""

    mass: Any
    linear: list[Any]
    potential: Any


def quadratic(m: Mechanics) -> Quadratic | None:
    """The parts of a Lagrangian that is quadratic in the velocities; None where it is not."""
    sp = sympy_module("quadratic()")
    x = m.letters
    slopes = [slope(m.lagrangian, v) for v in x.v]
    mass = sp.Matrix([[shortest(slope(p, v), x.moving) for v in x.v] for p in slopes])
    if mass.has(*x.v):
        return None
    still = dict.fromkeys(x.v, 0)
    return Quadratic(mass, [p.subs(still) for p in slopes], -m.lagrangian.subs(still))


def hamiltonian(m: Mechanics, parts: Quadratic, p: Sequence[Any]) -> Any | None:
    """H = ½ (p − b)ᵀ M⁻¹ (p − b) + U, tidied, with `inverse_entries` where M couples many; None
    where M is singular.
    """
    kinetic = _kinetic(m, parts, p, list(range(len(p))))
    if kinetic is None:
        return None
    return tidied(kinetic + parts.potential, p, m.letters.moving)


def inverse_entries(m: Mechanics, which: Sequence[int]) -> dict[tuple[int, int], Any]:
    """Letters W_ij for the entries of the inverse of the mass matrix of these coordinates, which
    are functions of q; W is symmetric.
    """
    sp, x = sympy_module("inverse_entries()"), m.letters
    taken = {str(y).split("_")[0] for y in (*x.functions, *x.functions.values())}
    letter = next(y for y in ("W", "Upsilon", "Xi") if y not in taken)
    count = len(x.q)
    comma = "," if count > 9 else ""
    return {
        (i, j): sp.Symbol(f"{letter}_{min(i, j) + 1}{comma}{max(i, j) + 1}", real=True)
        for i in which
        for j in which
    }


def effective_potential(
    m: Mechanics, parts: Quadratic, p: Sequence[Any], cyclic: Sequence[int]
) -> Any | None:
    """V_eff = U + ½ (p − b)ᵀ M_cc⁻¹ (p − b) of the cyclic coordinates c, tidied: minus Routh's
    function where the other coordinates rest.
    """
    kinetic = _kinetic(m, parts, p, cyclic)
    if kinetic is None:
        return None
    return tidied(kinetic + parts.potential, p, m.letters.moving)


def _is_singular(block: Any) -> bool:
    """Is the matrix singular where its letters have some values? Looked at in numbers."""
    random = np.random.default_rng(0)
    values = {y: random.uniform(0.5, 1.5) for y in sorted(block.free_symbols, key=str)}
    found = np.array(block.xreplace(values).evalf().tolist(), dtype=float)
    return bool(np.linalg.matrix_rank(found) < len(found))


def _kinetic(m: Mechanics, parts: Quadratic, p: Sequence[Any], which: Sequence[int]) -> Any | None:
    """½ (p − b)ᵀ M⁻¹ (p − b) of some coordinates, group by group of those that M couples."""
    sp, moving = sympy_module("_kinetic()"), m.letters.moving
    mass = parts.mass.extract(list(which), list(which))
    shifted = [p[i] - parts.linear[i] for i in which]
    total = sp.Integer(0)
    for group in mass.connected_components():
        block = mass.extract(group, group)
        if len(group) > LARGEST:
            if _is_singular(block):
                return None
            own = [which[a] for a in group]
            letters = inverse_entries(m, own)
            for a, i in zip(group, own, strict=True):
                for b, j in zip(group, own, strict=True):
                    total += sp.Rational(1, 2) * letters[i, j] * shifted[a] * shifted[b]
            continue
        size = shortest(opened(block.det(method="berkowitz")), moving)
        if size == 0:
            return None
        adjugate = block.adjugate()
        for a, i in enumerate(group):
            for b, j in enumerate(group):
                part = shortest(opened(adjugate[a, b]), moving) / size
                total += sp.Rational(1, 2) * shortest(part, moving) * shifted[i] * shifted[j]
    return total
