"""From what the user wrote to a well-posed initial value problem, or a clear refusal."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.arrays import call, finite, is_definite
from varint.discrete import point_function
from varint.errors import InputError
from varint.grid import MOST_STEPS, affordable
from varint.parameters import number, whole
from varint.rules import Rule
from varint.stepping.run import Task
from varint.system import System, parameter_values, per_system

if TYPE_CHECKING:
    from varint.manifold import Phase

WHOLE = 1e-9  # relative: duration/h this close to a whole number is one
REMEMBERED = 1000  # parameter values whose mass matrix need not be looked at again
STEEPEST = 1e150  # of a gradient: its square must be a number, too
LEVEL = 1e-3  # of the wanted error: what iterations may leave in a step
SINGULAR = 1e-13  # smallest eigenvalue of the mass matrix scaled to a unit diagonal


def initial_task(
    system: System,
    rule: Rule,
    *,
    q0: Any,
    v0: Any,
    p0: Any,
    h: float | None,
    steps: int | None,
    duration: float | None,
    t0: float,
    u: Any,
    params: Mapping[str, Any] | None,
    save_every: int,
    level: float = 0.0,
) -> Task:
    """Checked and completed input of one run."""
    n = system.structure.n
    step, count = time_grid(h, steps, duration)
    save_every = whole("save_every", save_every)
    t0 = number("t0", t0)
    c = parameter_values(system, params)
    q = vector("q0", q0, n, system.names)
    p = _momentum(system, q, v0, p0, t0, c)
    phase = None
    _check_rows(system, q, t0, c)
    if system.structure.contacts:
        from varint.consistency import check_gaps

        check_gaps(system, q, t0, c)
    if system.structure.constraints or system.structure.nonholonomic:
        p, phase = _on_manifold(system, q, None if v0 is None else np.array(v0, dtype=float), p, t0, c)
    u = controls(system, rule, u, count)
    return Task(q, p, t0, step, count, save_every, u, c, len(rule.nodes), phase, level=level)


@per_system
def held_function(system: System) -> ca.Function:
    """(q, t, c) → constraints and gaps."""
    s = system
    return ca.Function("held", [s.q, s.t, s.c], [ca.densify(ca.vertcat(s.constraint, s.contact))])


def _check_rows(system: System, q: np.ndarray, t0: float, c: np.ndarray) -> None:
    """Constraints and contacts, and their gradients, have numbers at the start."""
    s = system.structure
    if not (s.constraints or s.nonholonomic or s.contacts):
        return
    from varint.manifold import every_row_function

    rows = [*call(every_row_function(system), q, np.zeros(s.n), np.array([t0]), c)]
    rows += call(held_function(system), q, np.array([t0]), c)
    if not all((np.abs(x) < STEEPEST).all() for x in rows):
        raise InputError(
            f"the constraints, the gaps or their gradients are not finite at the start, q0={q}, t0={t0:g}: a square "
            "root or logarithm of a negative number, a division by zero; move the start or write them in another form"
        )


def _on_manifold(
    system: System, q: np.ndarray, v: np.ndarray | None, p: np.ndarray, t0: float, c: np.ndarray
) -> tuple[np.ndarray, Phase]:
    """The momentum without its round-off across the constraints, and the rows that are solved."""
    from varint.consistency import check_start, independent_rows
    from varint.manifold import Phase, tangent_function

    t = np.array([t0])
    phase = Phase(independent_rows(system, q, np.zeros(len(q)) if v is None else v.ravel(), t0, c))
    tangent = tangent_function(phase.scene(system))
    along, change = call(tangent, q, p, t, c)
    if not (np.isfinite(along).all() and np.isfinite(change).all()):
        raise InputError(
            f"no velocity along the constraints belongs to the momentum at the start, q0={q}, t0={t0:g}: the mass "
            "matrix is singular along them, or the Lagrangian is no quadratic function of the velocities and too "
            "curved; start elsewhere"
        )
    check_start(system, phase, q, along if v is None else v.ravel(), t0, c, "v0")
    if v is None and np.abs(change).max() > 1e-9 * np.abs(p).max(initial=0.0):
        raise InputError(
            f"p0 is not the momentum of a motion along the constraints: it is off by {np.abs(change).max():.1e}; "
            "give v0 instead, or p0 = ∂L/∂v of a v0 with G v0 + ∂g/∂t = 0"
        )
    return p + change, phase


def time_grid(h: float | None, steps: int | None, duration: float | None) -> tuple[float, int]:
    """Step size and number of steps from two of h, steps, duration."""
    if (h is None) + (steps is None) + (duration is None) != 1:
        given = [name for name, x in (("h", h), ("steps", steps), ("duration", duration)) if x is not None]
        raise InputError(f"give two of h, steps, duration; got {given or 'none of them'}")
    steps = None if steps is None else whole("steps", steps)
    _refuse_too_many(steps or 0)
    for name, x in (("h", h), ("duration", duration)):
        if x is not None and number(name, x) == 0:
            raise InputError(f"{name} must not be zero")
    if steps is not None:
        return (float(h) if h is not None else float(duration) / int(steps)), int(steps)  # type: ignore[arg-type]
    ratio = float(duration) / float(h)  # type: ignore[arg-type]
    if ratio < 0:
        raise InputError(f"h={h} and duration={duration} have different signs; a backward run takes both negative")
    _refuse_too_many(ratio)
    count = max(round(ratio), 1)
    if abs(ratio - count) > WHOLE * count:
        up = max(math.ceil(ratio), 1)
        raise InputError(
            f"duration={duration} is {ratio:.6g} steps of h={h}, not a whole number; "
            f"give steps={up} with duration={duration} (h={float(duration) / up:.6g})"  # type: ignore[arg-type]
        )
    return float(duration) / count, count  # type: ignore[arg-type]


def _refuse_too_many(steps: float) -> None:
    if steps > MOST_STEPS:
        raise InputError(f"steps={steps:.6g} is more than any run can take; at most {MOST_STEPS:.0g}")


def vector(what: str, x: Any, n: int, names: tuple[str, ...]) -> np.ndarray:
    """x as n finite numbers."""
    try:
        value = np.array(x, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{what} must be {n} numbers, one for each of {list(names)}, got {x!r}") from None
    if value.ndim == 0 and n == 1:
        value = value.reshape(1)
    if value.shape != (n,):
        raise InputError(f"{what} has shape {value.shape}; it must be ({n},), one number for each of {list(names)}")
    if not finite(value):
        bad = [names[i] for i in np.flatnonzero(~np.isfinite(value))]
        raise InputError(f"{what} is not finite in {bad}: {value}")
    return value


@per_system
def start_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → (p, M, ∂L/∂q + F, L) at the start."""
    s = system
    value, momentum, gradient, force = point_function(s)(s.q, s.v, s.control, s.t, s.c)
    outputs = [ca.densify(x) for x in (momentum, s.mass_matrix, gradient + force, value)]
    return ca.Function("start_values", [s.q, s.v, s.control, s.t, s.c], outputs)


def _momentum(system: System, q: np.ndarray, v0: Any, p0: Any, t0: float, c: np.ndarray) -> np.ndarray:
    n, names, structure = system.structure.n, system.names, system.structure
    if v0 is not None and p0 is not None:
        raise InputError("give v0 or p0, not both: p0 = ∂L/∂v(q0, v0)")
    if structure.degenerate:
        warnings.warn(
            "the Lagrangian is degenerate (∂²L/∂v² = 0): the start momentum is p0 = ∂L/∂v(q0), v0 plays no part, "
            "and midpoint() is used without the usual guarantees",
            stacklevel=4,
        )
    elif v0 is None and p0 is None:
        raise InputError("give v0 (start velocities) or p0 (start momenta)")
    v = np.zeros(n) if v0 is None else vector("v0", v0, n, names)
    u, t = np.zeros(structure.controls), np.array((t0,))
    p, mass, push, value = call(start_function(system), q, v, u, t, c)
    if not finite(p, mass, push, value):
        what = "the Lagrangian" if np.isfinite(p).all() and np.isfinite(push).all() else "the Lagrangian's derivatives"
        raise InputError(
            f"{what} {'is' if what == 'the Lagrangian' else 'are'} not finite at the start, q0={q}, t0={t0:g}: a "
            "collision, a square root or logarithm of a negative number, or a parameter value; move the start or "
            "change the parameters"
        )
    if not (structure.degenerate or structure.constraints or structure.nonholonomic):
        _check_mass(system, mass.reshape(n, n), c)
    return p if p0 is None or structure.degenerate else vector("p0", p0, n, names)


@per_system
def _regular_at(system: System) -> set[bytes]:
    """Parameter values for which a constant mass matrix has been found regular."""
    return set()


def _check_mass(system: System, mass: np.ndarray, c: np.ndarray) -> None:
    constant, known = system.structure.constant_mass, _regular_at(system)
    key = c.tobytes() if constant else b""
    if key in known or is_definite(mass):
        if constant and len(known) < REMEMBERED:
            known.add(key)
        return
    names = system.names
    size = np.sqrt(np.abs(np.diag(mass)))
    scaled = mass / np.outer(np.where(size > 0, size, 1), np.where(size > 0, size, 1))
    values, vectors = np.linalg.eigh(scaled)
    smallest = np.argmin(np.abs(values))
    if abs(values[smallest]) > SINGULAR:
        return
    part = np.abs(vectors[:, smallest])
    weak = [name for name, x in zip(names, part, strict=True) if x > 0.1 * part.max()]
    raise InputError(
        f"the mass matrix ∂²L/∂v² is singular at the start: the Lagrangian gives no inertia to (a combination of) "
        f"{weak}; use other coordinates or another start"
    )


def controls(system: System, rule: Rule, u: Any, steps: int) -> np.ndarray:
    """Controls of every step, (steps, r, k) with r = 1 where they are constant on a step."""
    k = system.structure.controls
    if not k:
        if u is not None:
            raise InputError("u was given, but the system has no control; declare it with System(..., control=...)")
        return np.empty((steps, 1, 0))
    r, names = len(rule.nodes), list(system.control_names)
    wanted = f"({steps}, {k}), ({steps}, {r}, {k}) or ({k},)"
    if u is None:
        raise InputError(f"the system has the controls {names}; give u with shape {wanted}")
    try:
        value = np.array(u, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"u must be numbers of shape {wanted}, got {type(u).__name__}") from None
    if value.ndim == 0 and k == 1:
        value = value.reshape(1)
    if value.ndim == 1 and k == 1 and value.shape == (steps,) and steps > 1:
        value = value[:, None]
    if value.shape == (k,):
        affordable(f"u of {steps} steps", steps * k, "let the control be a force or a parameter of the scene")
        value = np.broadcast_to(value, (steps, k))
    if value.shape == (steps, k):
        value = value[:, None, :]
    allowed = {(steps, 1, k), (steps, r, k)} if rule.points else {(steps, 1, k)}
    if value.shape not in allowed:
        hint = "" if rule.points else f"; {rule} takes one value a step"
        raise InputError(f"u has shape {value.shape}; it must have {wanted}{hint}")
    if not np.isfinite(value).all():
        raise InputError("u is not finite everywhere")
    return np.ascontiguousarray(value)
