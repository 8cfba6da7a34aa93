"""Scenes from SymPy: Lagrangians in `dynamicsymbols`, and the methods of its mechanics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from varint.errors import InputError, parsed_or_refused
from varint.notation.extra import sympy_module, time_symbol
from varint.notation.from_sympy import casadi_of
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates, time
from varint.typeset.sympy_methods import Given, given_of_method


def from_sympy(
    lagrangian: Any,
    coordinates: Any = None,
    *,
    parameters: Mapping[Any, Any] | None = None,
    constraints: Any = None,
    forces: Any = None,
    controls: Any = None,
) -> System:
    """A scene whose Lagrangian L(q, q̇, t) was written in SymPy; names stay as they are.

    Needs SymPy: ``pip install varint-mechanics[sympy]``.

    Parameters
    ----------
    lagrangian : sympy.Expr, or LagrangesMethod or KanesMethod of sympy.physics.mechanics
        L in coordinates that are functions of time, ``dynamicsymbols("theta")``, their first
        derivatives, ``dynamicsymbols._t`` and symbols; or an object of Lagrange's or Kane's method,
        which brings coordinates, constraints and forces with it. Of Kane's it is the bodies' T − V
        with the generalised speeds written in q̇; its loads are forces, gravity among them: what is
        to count as energy stands in the bodies' ``potential_energy``.
    coordinates : sequence of functions of time
        The generalised coordinates, in the order that they are to have.
    parameters : dict, optional
        Default values of constants by symbol or name; an array is a parameter whose elements are
        called ``m_0, m_1, …``.
    constraints : sequence of sympy.Expr, optional
        What is zero: functions of q and t, or linear in the velocities (non-holonomic).
    forces : sequence of sympy.Expr, optional
        Generalised forces, one a coordinate.
    controls : sequence of functions of time or symbols, optional
        What acts through the forces and is to be chosen.

    Returns
    -------
    System

    Raises
    ------
    VarintError
        If SymPy is not installed.
    InputError
        If an expression holds a function that CasADi has not, or a symbol that nobody declared;
        all of them are named.

    Examples
    --------
    >>> import sympy
    >>> from sympy.physics.mechanics import dynamicsymbols
    >>> import varint as vi
    >>> theta, (m, ell, g) = dynamicsymbols("theta"), sympy.symbols("m ell g")
    >>> L = m * ell**2 * theta.diff() ** 2 / 2 + m * g * ell * sympy.cos(theta)
    >>> pendulum = vi.from_sympy(L, [theta], parameters={m: 1.0, ell: 2.0, g: 9.81})
    >>> vi.simulate(pendulum, q0=0.1, v0=0, h=0.1, steps=10).energy.std() < 1e-6
    np.True_
    """
    sp = sympy_module("from_sympy()")
    given = _given(sp, lagrangian, coordinates, constraints, forces)
    t = time_symbol()
    names = [_function_name(sp, x, t) for x in given.coordinates]
    q, v = _coordinates(names)
    clock = time()
    u = [(x, ca.SX.sym(_control_name(sp, x, t))) for x in _listed("controls", controls)]
    values = Parameters(**_defaults(sp, parameters))
    table: dict[Any, ca.SX] = {t: clock}
    for x, place, speed in zip(given.coordinates, ca.vertsplit(q), ca.vertsplit(v), strict=True):
        table |= {x: place, x.diff(t): speed}
    table |= dict(u)
    constants = {x.name(): x for y in values._symbols.values() for x in ca.vertsplit(ca.vec(y))}
    every = [given.lagrangian, *given.constraints, *given.forces]
    for symbol in sorted({x for e in every for x in e.free_symbols}, key=str):
        if symbol not in table and symbol.name in constants:
            table[symbol] = constants[symbol.name]
    held = [casadi_of("a constraint", e, table) for e in given.constraints]
    rolling = [e for e in held if ca.depends_on(e, v)]
    return System(
        q,
        v,
        casadi_of("the Lagrangian", given.lagrangian, table),
        constraint=_column([e for e in held if not ca.depends_on(e, v)]),
        nonholonomic=_rows(rolling, v),
        force=_column([casadi_of("a force", e, table) for e in given.forces]),
        control=_column([x for _, x in u]),
        params=values if values._defaults else None,
        t=clock,
    )


def _given(sp: Any, lagrangian: Any, coordinates: Any, constraints: Any, forces: Any) -> Given:
    """The parts of the scene, from the arguments or from an object of a method."""
    if found := given_of_method(lagrangian):
        if coordinates is not None or constraints is not None or forces is not None:
            raise InputError(
                f"an object of {type(lagrangian).__name__} has coordinates, constraints and forces "
                "of its own; give only parameters= and controls= beside it"
            )
        return found
    expression = _expression(sp, "the Lagrangian", lagrangian)
    path = _listed("coordinates", coordinates)
    if not path:
        raise InputError('coordinates must list functions of time, as dynamicsymbols("theta")')
    acting = [_expression(sp, "a force", e) for e in _listed("forces", forces)]
    if acting and len(acting) != len(path):
        raise InputError(
            f"there are {len(acting)} forces for {len(path)} coordinates; give one for each, 0 "
            "where none acts"
        )
    zero = [_expression(sp, "a constraint", e) for e in _listed("constraints", constraints)]
    return Given(expression, path, zero, acting)


def _expression(sp: Any, what: str, e: Any) -> Any:
    if isinstance(e, ca.SX):
        raise InputError(f"{what} is a CasADi expression; hand it to System")
    found = parsed_or_refused(
        lambda: sp.sympify(e, strict=True),
        lambda: f"{what} must be a SymPy expression, got {type(e).__name__}",
    )
    if not isinstance(found, sp.Expr) or found.is_Matrix:
        raise InputError(f"{what} must be a scalar SymPy expression, got {type(e).__name__}")
    return found


def _listed(what: str, items: Any) -> list[Any]:
    if items is None:
        return []
    if isinstance(items, str):
        raise InputError(f"{what} must be a list of SymPy expressions, got {items!r}")
    return parsed_or_refused(
        lambda: list(items),
        lambda: f"{what} must be a list of SymPy expressions, got {type(items).__name__}",
    )


def _function_name(sp: Any, x: Any, t: Any) -> str:
    if not isinstance(x, sp.core.function.AppliedUndef) or x.args != (t,):
        raise InputError(f'a coordinate is a function of time, dynamicsymbols("theta"), got {x!r}')
    return x.func.__name__


def _control_name(sp: Any, x: Any, t: Any) -> str:
    return x.name if isinstance(x, sp.Symbol) else _function_name(sp, x, t)


def _coordinates(names: Sequence[str]) -> tuple[ca.SX, ca.SX]:
    return coordinates(*names)


def _defaults(sp: Any, parameters: Any) -> dict[str, Any]:
    """Default values by name."""
    if parameters is None:
        return {}
    if not isinstance(parameters, Mapping):
        raise InputError(
            f"parameters must be a dictionary such as {{m: 1.0}}, got {type(parameters).__name__}"
        )
    found: dict[str, Any] = {}
    for key, value in parameters.items():
        if not isinstance(key, (str, sp.Symbol)):
            raise InputError(f"parameters has the key {key!r}; keys are symbols or names")
        name = key if isinstance(key, str) else key.name
        if name in found:
            raise InputError(f"parameters has two values for {name!r}; give one")
        found[name] = value
    return found


def _column(entries: Sequence[ca.SX]) -> ca.SX | None:
    return ca.vertcat(*entries) if entries else None


def _rows(velocities: Sequence[ca.SX], v: ca.SX) -> ca.SX | None:
    """The rows A of A(q) v = 0."""
    if not velocities:
        return None
    held = ca.vertcat(*velocities)
    rows = ca.jacobian(held, v)
    rest = ca.substitute(held, v, ca.SX.zeros(v.shape))
    if ca.depends_on(rows, v) or not ca.simplify(rest).is_zero():
        raise InputError(
            "constraints on velocities must be linear in them, A(q) v = 0; others are not supported"
        )
    return rows
