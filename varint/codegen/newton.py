"""Newton's method on the equations of one step in a compiled loop: implicit rules, constraints,
linear scenes.

The equations are those of the interpreted steppers, as C. Where many scenes differ the loop does
too: few unknowns are solved for in closed form, many in a band ordered once; a linear scene is
factorised once for the whole run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.codegen.arguments import c_source, c_tables
from varint.codegen.band import Band, band
from varint.codegen.cache import AS_WRITTEN
from varint.codegen.continuation import FORCED_HISTORY, HISTORY, continuation_tables, force_table
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.mechanics import velocity
from varint.codegen.opening import opening_values
from varint.codegen.routines import Routine, routines
from varint.codegen.solution import Functions, Solution, solution_of
from varint.codegen.source import Source, c_head, compiled, emitted_together, source_of
from varint.discrete.composed import base_of, shares
from varint.discrete.constrained_equations import constrained_equations, size_expressions
from varint.discrete.constraints import hidden_functions as tangent_parts
from varint.discrete.equations import Equations, implicit_equations
from varint.discrete.kick_drift import kick_function
from varint.discrete.legendre import (
    HALVINGS,
    first_order_expressions,
    first_order_velocity,
    legendre_expressions,
)
from varint.discrete.row_independence import FOLDED, VANISHED, folds, pivot_and_lengths
from varint.discrete.scales import SMALLEST, UNKNOWN
from varint.discrete.shake_equations import eliminates_path, shake_equations
from varint.discrete.shake_equations import hidden_functions as multiplier_parts
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.numerics.limits import LEGENDRE_ITERATIONS, STEP_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.system import System

OWN = ("C",)  # numbers that scenes of a size may have differently
NO_BAND = Band(np.zeros(0, dtype=int), 0, 0, np.zeros(0, dtype=int), 0)


@kernel_per_system
def newton_kernel(system: System, rule: Rule) -> Kernel:
    """The compiled loop of Newton's method for any rule with control points; with constraints, for
    scenes whose momentum is linear in the velocities.

    Parameters
    ----------
    system : System
        Without contacts.
    rule : Rule
        With control points (not a bare composition).

    Returns
    -------
    Kernel

    Raises
    ------
    NotCompilable
        If the scene has contacts, or constraints and a momentum that is not linear in the
        velocities, or it is too large.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    return compiled(newton_source(system, rule))


@kernel_per_system
def newton_source(system: System, rule: Rule) -> Source:
    """The C source of `newton_kernel`."""
    x = newton_scheme(system, rule)
    heads = {"LANES": 1, **x.counts, **x.limits}
    data, closed, parts = c_tables(x.places | x.tables), x.counts["CLOSED"], x.counts["PARTS"]
    functions = newton_routines(system, rule)
    sizes = {name: number for name, number in heads.items() if name not in OWN}
    loop = map(c_source, ("newton_apart.h", "newton.c", "parts.c"))
    return source_of(
        x.about,
        system,
        len(rule.nodes),
        emitted_together(functions, x.constants.numel(), closed > 0, parts > 1),
        heads,
        data + c_source("newton_table.h"),
        "newton_functions.c",
        opening=x.opening,
        rows=x.rows,
        contraction=AS_WRITTEN,
        straight=not closed,
        apart=c_head(sizes, data) + "".join(loop),
    )


@kernel_per_system
def newton_routines(system: System, rule: Rule) -> dict[str, Routine]:
    """The scheme's functions, arranged once for both gears."""
    x = newton_scheme(system, rule)
    return routines(x.constants, x.functions)


@dataclass(frozen=True, eq=False)
class Scheme:
    """What the loop of c/newton.c needs of a scene and a rule, as C or as data.

    Attributes
    ----------
    constants : SX
        What does not change in a step: parameters, h, typical sizes.
    functions : dict
        Expressions by the names that c/newton.c calls them.
    counts, limits : dict
        Numbers by the names in c/newton.c.
    places, tables : dict of array
        The same for arrays of whole and other numbers.
    opening : callable
        See `Kernel`.
    """

    about: str
    constants: ca.SX
    functions: Functions
    counts: dict[str, int]
    limits: dict[str, float]
    places: dict[str, np.ndarray]
    tables: dict[str, np.ndarray]
    opening: Callable[..., np.ndarray]

    @property
    def rows(self) -> int:
        """Constraint rows whose folds are noted."""
        return self.counts["WATCHED"] * self.counts["VELOCITY_ROWS"]


@kernel_per_system
def newton_scheme(system: System, rule: Rule) -> Scheme:
    """What Newton's method needs of a scene and a rule, or of the steps that a composition has;
    raises NotCompilable.
    """
    s, base = system.structure, base_of(system, rule)
    parts, given = shares(system, rule) if base else [(1.0, 0.0)], len(rule.nodes)
    rule = base or rule
    held = bool(s.constraints or s.nonholonomic)
    if s.contacts or not rule.points or (held and not s.quadratic_kinetic):
        raise NotCompilable(
            "the compiled Newton method needs a rule with control points, and a scene without "
            "contacts, with constraints quadratic in "
            'velocities; use backend="interpreted"'
        )
    eliminates = held and eliminates_path(system, rule)
    if eliminates:
        e = shake_equations(system)
    else:
        e = constrained_equations(system, rule) if held else implicit_equations(system, rule)
    solve = solution_of(system, rule, e, held)
    functions = solve.functions
    projection = _projection(system, e, eliminates) if held else None
    if projection:
        functions |= projection.functions
    if not projection or not projection.speed:
        functions |= _velocities(system)
    if folds(system):
        pivot, lengths = pivot_and_lengths(system)
        functions["independence"] = [system.q, system.t], [pivot]
        functions["lengths"] = [system.q, system.t], [lengths**2]
    if eliminates:
        functions["kick"] = (
            [e.q, e.t, system.control],
            [kick_function(system)(e.q, system.control, e.t, e.c)],
        )
    forced = s.constant_mass and s.separable and not (held or solve.map)
    about = f"Newton's method, {e.y.numel()} unknowns" + (
        " in closed form"
        if solve.closed
        else f" in a band of {solve.band.below} and {solve.band.above} diagonals"
    )
    if solve.linear:
        about = about.replace("Newton's method", "one linear solve a step, factorised once")
    if solve.map:
        about = "one constant linear map a step"
    # steps of different sizes are not continued over several of them
    history = 1 if base else _history(rule, forced)
    return Scheme(
        about,
        ca.vertcat(e.c, e.h, e.scale, e.sizes),
        functions,
        _counts(system, rule, e, solve, projection, eliminates, forced)
        | {"HISTORY": history, "PARTS": len(parts), "GIVEN": given},
        {
            "LAST_CORRECTION": solve.last_correction,
            "RESIDUAL_LIMIT": RESIDUAL_LIMIT,
            "SMALLEST": SMALLEST,
            "UNKNOWN": UNKNOWN,
            "FOLDED": FOLDED,
            "VANISHED": VANISHED,
        },
        _places(solve, projection) | solve.nodes.places,
        _tables(rule, forced, history)
        | solve.nodes.tables
        | {"SHARES": np.array(parts)[:, 0], "BEGUN": np.append(np.array(parts)[:, 1], 1.0)},
        opening_values(system),
    )


def _velocities(system: System) -> Functions:
    """How the velocities follow from q and p: in closed form, or by Newton's method."""
    s, p = system.structure, ca.SX.sym("p", system.q.numel())
    if s.degenerate:
        known = first_order_velocity(system)
    else:
        known = velocity(system, p) if s.quadratic_kinetic else None
    if known is not None:
        return {"speed": ([system.q, p, system.t], [known])}
    return {
        "legendre": first_order_expressions(system)
        if s.degenerate
        else legendre_expressions(system)
    }


@dataclass(frozen=True, eq=False)
class _Projection:
    """How the momentum is projected; `speed`: the velocity comes with it."""

    functions: Functions
    band: Band
    speed: bool


def _projection(system: System, e: Equations, eliminates: bool) -> _Projection:
    s, n = system, system.structure.n
    p = ca.SX.sym("p", n)
    parts, pull = multiplier_parts(s) if eliminates else tangent_parts(s)
    matrix, right, size = parts(s.q, p, s.t, s.c)
    order = band(matrix.sparsity())
    x = ca.SX.sym("x", right.numel())
    sized = size_expressions(s)(s.q, s.t, e.h, s.c, e.scale)
    functions: Functions = {
        "hidden": (
            [s.q, p, s.t],
            [right[order.order.tolist()], matrix.nz[:], size[order.order.tolist()]],
        ),
        "sized": ([s.q, s.t], [sized]),
    }
    if eliminates:
        functions["pulled"] = [x, s.q, p, s.t], [pull(s.q, s.t, s.c, x)]
    else:
        functions["pulled"] = [x, s.q, p, s.t], [-pull(s.q, s.t, s.c, x[n:])]
        functions["speed"] = [x, s.q, s.t], [x[:n]]
    return _Projection(functions, order, not eliminates)


def _counts(
    system: System,
    rule: Rule,
    e: Equations,
    solve: Solution,
    projection: _Projection | None,
    eliminates: bool,
    forced: bool,
) -> dict[str, int]:
    s, degree, held = system.structure, rule.degree, projection is not None
    size = 0 if solve.closed else solve.band.size
    with_map = size + 2 * s.n * (2 * s.n + solve.band.order.size + 1) if solve.map else size
    order = projection.band if projection else NO_BAND
    hidden_size = order.size if projection else 0
    counts = {
        "N": s.n,
        "NU": s.controls,
        "NODES": len(rule.nodes),
        "Y": e.y.numel(),
        "C": e.c.numel(),
        "SIZES": e.sizes.numel(),
        "DEGREE": degree,
        "PATH": 0 if eliminates else s.n,
        "MULTIPLIERS": s.constraints,
        "ROWS": s.nonholonomic,
        "CLOSED": int(solve.closed),
        "LINEAR": int(solve.linear),
        "FROZEN": int(solve.frozen),
        "MAP": int(solve.map),
        "STEADY": int(solve.steady),
        "FORCED": int(forced),
        "JUDGED": solve.judged or e.y.numel(),
        "KICKED": int(eliminates),
        "HELD": int(held),
        "WATCHED": int(folds(system)),
        "VELOCITY_ROWS": s.constraints + s.nonholonomic,
        "BELOW": solve.band.below,
        "REACH": solve.band.reach,
        "BAND_SIZE": size,
        "NONZEROS": len(solve.band.places),
        "H": len(order.order),
        "HIDDEN_BELOW": order.below,
        "HIDDEN_REACH": order.reach,
        "HIDDEN_NONZEROS": len(order.places),
        "HIDDEN_SPEED": int(bool(projection and projection.speed)),
        "HIDDEN_SIZE": hidden_size,
        "MATRIX_SIZE": max(with_map, hidden_size),
        "MOST_ITERATIONS": STEP_ITERATIONS,
        "LEGENDRE_ITERATIONS": LEGENDRE_ITERATIONS,
        "HALVINGS": HALVINGS,
        "INVERTED": int("legendre" in solve.functions),
    }
    return counts | solve.nodes.counts


def _places(solve: Solution, projection: _Projection | None) -> dict[str, np.ndarray]:
    order = projection.band if projection else NO_BAND
    places = {"PERM": solve.band.order, "AT": solve.band.places}
    return places | {"HIDDEN_PERM": order.order, "HIDDEN_PLACES": order.places}


def _history(rule: Rule, forced: bool) -> int:
    return (FORCED_HISTORY if forced else HISTORY).get(rule.degree, 1)


def _tables(rule: Rule, forced: bool, history: int) -> dict[str, np.ndarray]:
    tables = {"POINTS": np.array(rule.points[1:]), **continuation_tables(rule, history)}
    return tables | {"AHEAD_FORCES": force_table(rule, history) if forced else np.zeros(1)}
