"""What a mechanics course derives from a Lagrangian, to be read: the equations of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from varint.errors import InputError
from varint.notation.extra import sympy_module
from varint.notation.names import latex_text, plain_name
from varint.notation.tidy import tidied
from varint.scene.letters import READABLE, Letters, in_letters, length_of, letters_of
from varint.scene.memory import per_system
from varint.scene.system import System, require_system
from varint.symmetry.noether import symmetries
from varint.symmetry.symmetry import Symmetry
from varint.typeset.formula import Conserved, Equation, Quantity
from varint.typeset.lagrange import Mechanics, euler_lagrange
from varint.typeset.legendre import (
    effective_potential,
    hamiltonian,
    inverse_entries,
    quadratic,
)


class Equations(NamedTuple):
    """The equations of a scene; prints them all, and shows them typeset in notebooks.

    Attributes
    ----------
    lagrangian : Quantity
        L, tidied.
    euler_lagrange : tuple of Equation
        d/dt ∂L/∂v − ∂L/∂q = Σ λ ∂g/∂q + F, one a coordinate; constant factors of a whole equation
        are divided out.
    constraints : tuple of Equation
        Holonomic ones, then non-holonomic ones, then gaps of contacts that are not negative, in the
        order of the multipliers λ.
    forces : tuple of Quantity
        Generalised forces F; empty where there are none.
    momenta : tuple of Quantity
        p = ∂L/∂v.
    energy : Quantity
        E = v·p − L.
    hamiltonian : Quantity or None
        H(q, p, t); None where the mass matrix depends on velocities or is singular. Where it
        couples more than three coordinates its inverse stands there by letters W_ij (`notes` says
        so).
    cyclic : tuple of Conserved
        Coordinates that L does not depend on, with their momenta, and what else changes these.
    effective_potential : Quantity or None
        V_eff of what is left when all cyclic coordinates with conserved momenta are eliminated.
    conserved : tuple of Conserved
        What the symmetries that `symmetries` finds conserve.
    notes : tuple of str
        What is missing, and why.
    """

    lagrangian: Quantity
    euler_lagrange: tuple[Equation, ...]
    constraints: tuple[Equation, ...]
    forces: tuple[Quantity, ...]
    momenta: tuple[Quantity, ...]
    energy: Quantity
    hamiltonian: Quantity | None
    cyclic: tuple[Conserved, ...]
    effective_potential: Quantity | None
    conserved: tuple[Conserved, ...]
    notes: tuple[str, ...]

    @property
    def sections(self) -> list[tuple[str, list[Any]]]:
        """(heading, formulas) of everything that the scene has, in reading order."""
        reduced = [f"{plain_name(x.name)}" for x in self.cyclic if not x.broken_by]
        every: list[tuple[str, Sequence[Any]]] = [
            ("Lagrangian", [self.lagrangian]),
            ("Euler–Lagrange equations", self.euler_lagrange),
            ("Constraints", self.constraints),
            ("Generalised forces", self.forces),
            ("Momenta", self.momenta),
            ("Cyclic coordinates", self.cyclic),
            ("Energy", [self.energy]),
            ("Hamiltonian", [self.hamiltonian]),
            (f"Effective potential without {', '.join(reduced)}", [self.effective_potential]),
            ("Conserved quantities", [x for x in self.conserved if not x.broken_by]),
            ("Symmetries of L alone", [x for x in self.conserved if x.broken_by]),
        ]
        shown = [(heading, [x for x in some if x is not None]) for heading, some in every]
        return [(heading, some) for heading, some in shown if some]

    def latex(self) -> str:
        """All of it as one LaTeX environment ``aligned``, without dollar signs."""
        rows = []
        for heading, formulas in self.sections:
            rows.append(f"&{latex_text(heading, 'textbf')}")
            rows += [
                rf"&\quad {x.latex_in_words() if isinstance(x, Conserved) else x.latex()}"
                for x in formulas
            ]
        return r"\begin{aligned} " + r" \\ ".join(rows) + r" \end{aligned}"

    def sympy(self) -> dict[str, list[Any]]:
        """SymPy's expressions and relations under the headings of the text, in `dynamicsymbols`."""
        return {heading: [x.sympy() for x in formulas] for heading, formulas in self.sections}

    def _repr_latex_(self) -> str:
        return f"$$ {self.latex()} $$"

    def __str__(self) -> str:
        lines = []
        for heading, formulas in self.sections:
            lines += [heading, *(f"  {x}" for x in formulas)]
        return "\n".join([*lines, *self.notes])

    def __repr__(self) -> str:
        return str(self)


def equations(system: System) -> Equations:
    """What a mechanics course derives from the Lagrangian: d/dt ∂L/∂v − ∂L/∂q = Gᵀλ + F, momenta,
    energy, Hamiltonian, cyclic coordinates, conserved quantities, effective potential.

    Needs SymPy: ``pip install varint-mechanics[sympy]``.

    Parameters
    ----------
    system : System

    Returns
    -------
    Equations
        Prints as text with Greek letters and dots and shows itself typeset in notebooks. Every part
        has ``.latex()`` and ``.sympy()``, a SymPy expression or relation in ``dynamicsymbols``.

    Raises
    ------
    VarintError
        If SymPy is not installed.
    InputError
        If the scene has more operations than anybody reads, one that SymPy has not, or something
        else than time has the name ``t``.

    Notes
    -----
    Constants are taken for the exact numbers that they stand for (0.5 is ½, 3.14159… is π);
    velocities, accelerations and momenta stand apart, and their coefficients are shortened by
    bounded work, so that some may be longer than in a book.

    ``system.equations`` is the same.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> c = vi.Parameters(m=1.0, ell=1.0, g=9.81)
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(
    ...     q, v, c.m * c.ell**2 * v**2 / 2 + c.m * c.g * c.ell * ca.cos(q), params=c)
    >>> vi.equations(pendulum).euler_lagrange[0]
    θ̈ + (g/ℓ) sin(θ) = 0
    >>> pendulum.equations.sympy()["Momenta"]
    [ell**2*m*Derivative(theta(t), t)]
    """
    require_system(system)
    return _equations(system)


@per_system
def _equations(system: System) -> Equations:
    sp = sympy_module("equations()")
    x, s = letters_of(system), system.structure
    m = _mechanics(system, x)  # refuses what is too long before anything is searched for
    count = s.constraints + s.nonholonomic + s.contacts
    multipliers = _fresh(sp, x, [f"lambda_{i + 1}" for i in range(count)])
    p = _fresh(sp, x, [f"p_{name}" for name in system.names])
    order = tuple(y.name for y in (*p, *multipliers)) + x.order
    time = x.functions[x.t]
    moving = x.functions | {y: sp.Function(y.name)(time) for y in (*p, *multipliers)}
    constants = x.functions | {y: sp.Symbol(y.name) for y in p}

    def quantity(name: str, e: Any, table: dict[Any, Any] = moving) -> Quantity:
        return Quantity(name, e.xreplace(table), order)

    momenta, energy, acting = m.momenta, m.energy, m.acting
    named = [quantity(y.name, e) for y, e in zip(p, momenta, strict=True)]
    known = {energy: "E"} | dict(zip(momenta, (y.name for y in p), strict=True))
    cyclic = [i for i, q in enumerate(x.q) if not m.lagrangian.has(q)]
    total, reduced = _reduced(m, p, [i for i in cyclic if not acting[i]])
    found, notes = _symmetries(system)
    if total is None:
        notes.insert(0, _no_hamiltonian(m))
    elif coupled := _coupled(m, total):
        notes.insert(0, coupled)
    pairs = zip(system.names, euler_lagrange(m, multipliers), strict=True)
    return Equations(
        lagrangian=quantity("L", m.lagrangian),
        euler_lagrange=tuple(
            Equation(name, left.xreplace(moving), right.xreplace(moving), order)
            for name, (left, right) in pairs
        ),
        constraints=_constraints(m, moving, order),
        forces=tuple(
            quantity(f"F_{name}", e)
            for name, e in zip(system.names, m.force, strict=True)
            if s.forced
        ),
        momenta=tuple(named),
        energy=quantity("E", energy),
        hamiltonian=None if total is None else quantity("H", total),
        cyclic=tuple(Conserved(system.names[i], named[i], acting[i]) for i in cyclic),
        effective_potential=None if reduced is None else quantity("V_eff", reduced, constants),
        conserved=tuple(
            Conserved(y.name, quantity(known.get(e, "J"), e), y.broken_by)
            for y, e in zip(found, _noether(system, x, found, momenta, energy), strict=True)
        ),
        notes=tuple(notes),
    )


def _mechanics(system: System, x: Letters) -> Mechanics:
    """What the scene is made of, in its letters."""
    n, s = system.structure.n, system
    parts = [s.lagrangian, s.force, s.constraint, s.nonholonomic, s.contact]
    [lagrangian], force, constraint, rows, contact = in_letters(system, x, parts)
    count = system.structure.nonholonomic
    return Mechanics(
        x,
        tidied(lagrangian, x.v, x.moving),
        [tidied(y, (*x.u, *x.v), x.moving) for y in force],
        [tidied(y, (), x.moving) for y in constraint],
        # CasADi's matrices lie column by column
        [[rows[j * count + i] for j in range(n)] for i in range(count)],
        [tidied(y, (), x.moving) for y in contact],
    )


def _reduced(m: Mechanics, p: Sequence[Any], free: Sequence[int]) -> tuple[Any, Any]:
    """Hamiltonian, and effective potential without the coordinates `free`; None where there is
    none.
    """
    parts = quadratic(m)
    if parts is None:
        return None, None
    potential = None
    if free and len(free) < len(p):
        potential = effective_potential(m, parts, p, free)
        if potential is not None and not potential.has(*m.letters.q):
            potential = None  # a constant tells nothing
    return hamiltonian(m, parts, p), potential


def _noether(
    system: System, x: Letters, found: Sequence[Symmetry], momenta: Sequence[Any], energy: Any
) -> list[Any]:
    """J = p·ξ + τ H − K of each symmetry, of momenta and energy that are tidied already."""
    parts = [ca.vertcat(y.xi, y.tau, y.gauge) for y in found]
    whole = [
        sum((a * b for a, b in zip(momenta, xi, strict=True)), tau * energy - gauge)
        for *xi, tau, gauge in (in_letters(system, x, parts) if parts else [])
    ]
    return [tidied(e, x.v, x.moving) for e in whole]


def _fresh(sp: Any, x: Letters, names: Sequence[str]) -> list[Any]:
    """Symbols of names that the scene does not use."""
    while set(names) & set(x.order):
        names = [f"{name}_new" for name in names]
    return [sp.Symbol(name, real=True) for name in names]


def _symmetries(system: System) -> tuple[list[Symmetry], list[str]]:
    """The symmetries, or why they were not found."""
    try:
        table = symmetries(system)
    except InputError as error:
        return [], [f"symmetries were not searched for: {error}"]
    short = [x for x in table if length_of(system, ca.vertcat(x.xi, x.tau, x.gauge)) <= READABLE]
    notes = [f"{x.name}: too long to be written down" for x in table if x not in short]
    return short, [*notes, *([table.note] if table.note else [])]


def _no_hamiltonian(m: Mechanics) -> str:
    why = (
        "the Lagrangian is not quadratic in the velocities"
        if quadratic(m) is None
        else "its mass matrix is singular"
    )
    return f"no Hamiltonian is written down: {why}"


def _coupled(m: Mechanics, total: Any) -> str:
    """What stands in the Hamiltonian for the inverse of a mass matrix that couples many."""
    letters = inverse_entries(m, range(len(m.letters.q)))
    used = sorted({i for pair, y in letters.items() if total.has(y) for i in pair})
    if not used:
        return ""
    name = str(letters[used[0], used[0]]).split("_")[0]
    rows = ", ".join(str(m.letters.q[i]) for i in used)
    return (
        f"{name} in the Hamiltonian is the inverse of the mass matrix of {rows}, whose rows are "
        "the coefficients of the velocities in their momenta; its entries are functions of them"
    )


def _constraints(
    m: Mechanics, functions: dict[Any, Any], order: tuple[str, ...]
) -> tuple[Equation, ...]:
    x = m.letters
    rolling = [sum(a * v for a, v in zip(row, x.v, strict=True)) for row in m.nonholonomic]
    equalities = [*m.constraint, *(tidied(y, x.v, x.moving) for y in rolling)]
    every = [(y, "Equality") for y in equalities] + [(y, "GreaterThan") for y in m.contact]
    return tuple(
        Equation(f"lambda_{i + 1}", y.xreplace(functions), y * 0, order, relation)
        for i, (y, relation) in enumerate(every)
    )
