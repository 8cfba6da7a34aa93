"""From what the user wrote to a well-posed initial value problem, or a clear refusal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.errors import InputError
from varint.integration.start import check_rows, put_on_manifold, start_momentum_of
from varint.numerics.limits import FIXED_POINT_ITERATIONS, MOST_STEPS, check_memory
from varint.rules.rule import Rule
from varint.scene.inputs import control_values, number, positive_integer, shown, vector
from varint.scene.parameters import ParameterValues
from varint.scene.rays import start_on_rays
from varint.scene.restitution import restitution_at
from varint.scene.system import System, parameter_values

if TYPE_CHECKING:
    from varint.discrete.constraints import ActiveSet

WHOLE = 1e-9  # relative: duration/h this close to a whole number is one
LEVEL = 1e-3  # of the accuracy that iterations are to serve: what they may leave in a step


class Start(NamedTuple):
    """What a user gives of a run's start; see `varint.simulate`."""

    q0: Any
    v0: Any = None
    p0: Any = None
    t0: Any = 0.0
    params: ParameterValues | None = None
    u: Any = None


Grid = tuple[Any, Any, Any]  # h, steps and duration as a user gives them


class RunOptions(NamedTuple):
    """What a user asks of a run besides its start; see `varint.simulate`."""

    h: Any = None
    steps: Any = None
    duration: Any = None
    tol: float | None = None
    scale: Any = None
    iteration_tol: float | None = None
    save_every: Any = 1
    until: Any = None
    events: Any = None
    progress: bool | None = None
    backend: str = "auto"
    checkpoint: Any = None
    on_failure: str = "raise"


def initial_value_problem(
    system: System, rule: Rule, start: Start, options: RunOptions
) -> InitialValueProblem:
    """Checked and completed input of one run."""
    _, v0, p0, _, _, u = start
    n = system.structure.n
    step, count = time_grid(options.h, options.steps, options.duration)
    save_every = positive_integer("save_every", options.save_every)
    t0 = number("t0", start.t0)
    c = parameter_values(system, start.params)
    q = vector("q0", start.q0, n, system.names)
    if system.rays:
        v0 = None if v0 is None else vector("v0", v0, n, system.names)
        q, v0 = start_on_rays(system.rays, q, v0)
    u = controls(system, rule, u, count)
    p = start_momentum_of(system, q, v0, p0, t0, c, u[0, 0])
    active_set = None
    check_rows(system, q, t0, c)
    if system.structure.contacts:
        from varint.discrete.consistency import check_gaps

        check_gaps(system, q, t0, c)
        restitution_at(system, c)
    if system.structure.constraints or system.structure.nonholonomic:
        p, active_set = put_on_manifold(
            system, q, None if v0 is None else np.array(v0, dtype=float), p, t0, c
        )
    level = 0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol
    return InitialValueProblem(
        q, p, t0, step, count, save_every, u, c, len(rule.nodes), active_set, level=level
    )


def time_grid(h: float | None, steps: int | None, duration: float | None) -> tuple[float, int]:
    """Step size and number of steps from two of h, steps, duration."""
    plain = duration is None and type(h) is float and type(steps) is int
    if plain and 0 < steps <= MOST_STEPS and h - h == 0 != h:  # type: ignore[operator]
        return h, steps  # type: ignore[return-value]
    if (h is None) + (steps is None) + (duration is None) != 1:
        given = [
            name
            for name, x in (("h", h), ("steps", steps), ("duration", duration))
            if x is not None
        ]
        raise InputError(
            f"give two of h, steps, duration; got {given or 'none of them'} (simulate and "
            "ensemble take duration alone as well, and choose the steps)"
        )
    steps = None if steps is None else positive_integer("steps", steps)
    _refuse_too_many(steps or 0)
    for name, x in (("h", h), ("duration", duration)):
        if x is not None and number(name, x) == 0:
            raise InputError(f"{name} must not be zero")
    if steps is not None:
        return (float(h) if h is not None else float(duration) / int(steps)), int(steps)  # type: ignore[arg-type]
    ratio = float(duration) / float(h)  # type: ignore[arg-type]
    if ratio < 0:
        raise InputError(
            f"h={h} and duration={duration} have different signs; a backward run takes both "
            "negative"
        )
    _refuse_too_many(ratio)
    count = max(round(ratio), 1)
    if abs(ratio - count) > WHOLE * count:
        up = max(math.ceil(ratio), 1)
        raise InputError(
            f"duration={duration} is {ratio:.6g} steps of h={h}, not a whole number; give "
            f"steps={up} with duration={duration} (h={float(duration) / up:.6g})"  # type: ignore[arg-type]
        )
    return float(duration) / count, count  # type: ignore[arg-type]


def _refuse_too_many(steps: float) -> None:
    if steps > MOST_STEPS:
        raise InputError(
            f"steps={steps:.6g} is more than any run can take; at most {MOST_STEPS:.0g}"
        )


def check_tolerance(name: str, x: Any) -> None:
    """Refuse what is no relative error."""
    if not (isinstance(x, (float, int)) and 0 < x < 1):
        raise InputError(f"{name} must be a relative error between 0 and 1, got {shown(x)}")


def check_on_failure(on_failure: Any) -> None:
    """Refuse what is no way to go on after a step that fails."""
    if on_failure not in ("raise", "subdivide"):
        raise InputError(f"on_failure must be 'raise' or 'subdivide', got {on_failure!r}")


def controls(system: System, rule: Rule, u: Any, steps: int) -> np.ndarray:
    """Controls of every step, (steps, r, k) with r = 1 where they are constant on a step."""
    k = system.structure.controls
    if not k:
        if u is not None:
            raise InputError(
                "u was given, but the system has no control; declare it with System(..., "
                "control=...)"
            )
        return np.empty((steps, 1, 0))
    r, names = len(rule.nodes), list(system.control_names)
    wanted = f"({steps}, {k}), ({steps}, {r}, {k}) or ({k},)"
    if u is None:
        raise InputError(f"the system has the controls {names}; give u with shape {wanted}")
    value = control_values(u, f" of shape {wanted}")
    if value.ndim == 0 and k == 1:
        value = value.reshape(1)
    if value.ndim == 1 and k == 1 and value.shape == (steps,) and steps > 1:
        value = value[:, None]
    if value.shape == (k,):
        check_memory(
            f"u of {steps} steps",
            steps * k,
            "let the control be a force or a parameter of the scene",
        )
        value = value[None].repeat(steps, axis=0)
    if value.shape == (steps, k):
        value = value[:, None, :]
    allowed = {(steps, 1, k), (steps, r, k)} if rule.points else {(steps, 1, k)}
    if value.shape not in allowed:
        hint = "" if rule.points else f"; {rule} takes one value a step"
        raise InputError(f"u has shape {value.shape}; it must have {wanted}{hint}")
    return np.ascontiguousarray(value)


class InitialValueProblem(NamedTuple):
    """What the time loop needs: start, grid, controls (steps, r or 1, k) at the `nodes`,
    parameters; what holds.
    """

    q0: np.ndarray
    p0: np.ndarray
    t0: float
    h: float
    steps: int
    save_every: int
    u: np.ndarray
    c: np.ndarray
    nodes: int
    active_set: ActiveSet | None = None
    first: int = 0
    # relative error of a step's unknowns where a compiled iteration may stop; 0: round-off
    level: float = 0.0
    most: int = FIXED_POINT_ITERATIONS  # of a step, by a compiled loop
    # whether another method takes over where the loop's iteration fails; a trial had better fail
    rescued: bool = True
    ahead: int = 0  # steps of other runs that are likely to follow, which the same loop would take

    def controls(self, k: int, count: int) -> np.ndarray:
        """Controls of `count` steps from step k on, at every node."""
        u = self.u[k : k + count]
        if not u.size:
            return np.empty((len(u), self.nodes, 0))
        return np.ascontiguousarray(np.broadcast_to(u, (len(u), self.nodes, u.shape[2])))
