"""The start of a run: where it is defined, its momentum, and the manifold that it lies on."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.composed import steps_by_gauss
from varint.discrete.consistency import (
    check_configuration,
    check_velocity,
    independent_rows,
)
from varint.discrete.constraints import (
    ActiveSet,
    every_row_function,
    position_rows_function,
    tangent_function,
)
from varint.discrete.inertia import check_inertia
from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.numerics.arrays import call, finite
from varint.numerics.operations import constants_of
from varint.scene.inputs import vector
from varint.scene.memory import per_scene
from varint.scene.system import System

REMEMBERED = 1000  # parameter values whose mass matrix need not be looked at again
STEEPEST = 1e150  # of a gradient: its square must be a number, too


def check_rows(system: System, q: np.ndarray, t0: float, c: np.ndarray) -> None:
    """Constraints and contacts, and their gradients, have numbers at the start."""
    s = system.structure
    if not (s.constraints or s.nonholonomic or s.contacts):
        return
    if not are_defined(rows_at_start(system, q, t0, c)):
        raise InputError(
            f"the constraints, the gaps or their gradients are not finite at the start, q0={q}, "
            f"t0={t0:g}: a square root or logarithm of a negative number, a division by zero; move "
            "the start or write them in another form"
        )


def rows_at_start(system: System, q: np.ndarray, t0: float, c: np.ndarray) -> np.ndarray:
    """What makes the constraints and contacts of a start, one below the other: first g and gaps,
    then their slopes, what rows of velocities are at rest, and the gradients of these.
    """
    return call(_rows_at_rest(system), q, np.array((t0,)), c)[0]


def are_defined(rows: np.ndarray) -> bool:
    """Whether `rows_at_start` are numbers that may be squared."""
    return bool((np.abs(rows) < STEEPEST).all())


@per_scene
def _rows_at_rest(system: System) -> ca.Function:
    """(q, t, c) → `rows_at_start`."""
    s = system
    parts = position_rows_function(s)(s.q, s.t, s.c)
    parts += every_row_function(s)(s.q, ca.DM.zeros(s.q.shape), s.t, s.c)
    rows = ca.densify(ca.vertcat(*(ca.vec(x) for x in parts)))
    return ca.Function("rows_at_rest", [s.q, s.t, s.c], [rows])


def put_on_manifold(
    system: System, q: np.ndarray, v: np.ndarray | None, p: np.ndarray, t0: float, c: np.ndarray
) -> tuple[np.ndarray, ActiveSet]:
    """The momentum without its round-off across the constraints, and the rows that are solved."""
    at = np.zeros(len(q)) if v is None else v.ravel()
    active_set = ActiveSet(independent_rows(system, q, at, t0, c))
    check_configuration(system, active_set, q, None if v is None else at, t0, c)
    tangent = tangent_function(active_set.scene(system))
    along, change = call(tangent, q, p, np.array([t0]), c)
    if not (np.isfinite(along).all() and np.isfinite(change).all()):
        raise InputError(
            f"no velocity along the constraints belongs to the momentum at the start, q0={q}, "
            f"t0={t0:g}: the mass matrix is singular along them, or the Lagrangian is no quadratic "
            "function of the velocities and too curved; start elsewhere"
        )
    check_velocity(system, q, along if v is None else at, t0, c)
    if v is None and np.abs(change).max() > 1e-9 * np.abs(p).max(initial=0.0):
        raise InputError(
            "p0 is not the momentum of a motion along the constraints: it is off by "
            f"{np.abs(change).max():.1e}; give v0 instead, or p0 = ∂L/∂v of a v0 with G v0 + ∂g/∂t "
            "= 0"
        )
    return p + change, active_set


@per_scene
def start_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → p, ∂L/∂q + F, L and M at the start, one below the other."""
    s = system
    value, momentum, gradient, force = point_function(s)(s.q, s.v, s.control, s.t, s.c)
    values = ca.vertcat(momentum, gradient + force, value, ca.vec(s.mass_matrix))
    return ca.Function("start_values", [s.q, s.v, s.control, s.t, s.c], [ca.densify(values)])


def start_momentum_of(
    system: System, q: np.ndarray, v0: Any, p0: Any, t0: float, c: np.ndarray, u: np.ndarray
) -> np.ndarray:
    n, names, structure = system.structure.n, system.names, system.structure
    if v0 is not None and p0 is not None:
        raise InputError("give v0 or p0, not both: p0 = ∂L/∂v(q0, v0)")
    if not structure.degenerate and v0 is None and p0 is None:
        raise InputError("give v0 (start velocities) or p0 (start momenta)")
    v = np.zeros(n) if v0 is None else vector("v0", v0, n, names)
    t = np.array((t0,))
    values = call(start_function(system), q, v, u, t, c)[0]
    p = values[:n]
    if not finite(values):
        _refuse_lost_symbols(system)
        what = (
            "the Lagrangian"
            if np.isfinite(values[: 2 * n]).all()
            else "the Lagrangian's derivatives"
        )
        raise InputError(
            f"{what} {'is' if what == 'the Lagrangian' else 'are'} not finite at the start, "
            f"q0={q}, t0={t0:g}: a collision, a square root or logarithm of a negative number, or "
            "a parameter value; move the start or change the parameters"
        )
    if structure.degenerate:
        speed = _first_order_start(system, q, p, t, c)
        _say_what_is_taken(system, ("v0", v0, speed), ("p0", p0, p))
    elif not (structure.constraints or structure.nonholonomic):
        check_mass(system, values[2 * n + 1 :], c)
    return p if p0 is None or structure.degenerate else vector("p0", p0, n, names)


def _say_what_is_taken(system: System, *starts: tuple[str, Any, np.ndarray]) -> None:
    """What a start of a degenerate scene is, where something else is given, (what, given, taken),
    or its steps are no usual ones.
    """
    size, names = system.structure.n, system.names
    others = [
        what
        for what, given, taken in starts
        if given is not None and not np.allclose(vector(what, given, size, names), taken)
    ]
    usual = steps_by_gauss(system)
    if usual and not others:
        return
    warnings.warn(
        "the Lagrangian is degenerate (∂²L/∂v² = 0): the start momentum is p0 = ∂L/∂v(q0)"
        + "".join(f", {what} plays no part" for what in others)
        + ("" if usual else "; steps of midpoint() are used without the usual guarantees"),
        stacklevel=5,
    )


def _refuse_lost_symbols(system: System) -> None:
    """Python's own functions make NaN of a symbol, without a word."""
    for what, x in (("Lagrangian", system.lagrangian), ("force", system.force)):
        if np.isnan(constants_of(x)).any():
            raise InputError(
                f"the {what} holds what is no number: math.cos(q), float(q) and the like lose the "
                "symbol; take ca.cos(q). A constant such as 0 / 0 is none either"
            )


def _first_order_start(
    system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Velocities of a degenerate scene; refuses one whose equations determine none."""
    s = system.structure
    v = call(velocity_function(system), q, p, t, c)[0]
    if s.constraints or s.nonholonomic or finite(v):
        return v
    odd = ", as for every odd number of coordinates" if s.n % 2 else ""
    raise InputError(
        "the Lagrangian is degenerate (∂²L/∂v² = 0), and its equations of first order determine no "
        f"velocities at the start: ∂p_i/∂q_j − ∂p_j/∂q_i, p = ∂L/∂v, is singular there{odd}; give "
        "every coordinate a partner or a kinetic energy, or another start"
    )


@per_scene
def regular_at(system: System) -> set[bytes]:
    """Parameter values for which a constant mass matrix has been found regular."""
    return set()


def check_mass(system: System, mass: np.ndarray, c: np.ndarray) -> None:
    """`check_inertia`, once for each parameter values where the mass matrix is constant."""
    known, key = regular_at(system), c.tobytes()
    if key not in known:
        check_inertia(system, mass.reshape(system.structure.n, -1))
        if system.structure.constant_mass and len(known) < REMEMBERED:
            known.add(key)
