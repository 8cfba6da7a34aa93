"""Geometric structure of one method on one scene: symplectic, reversible, on the constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.diagnostics.runs import Scene, march, mark, scene
from varint.discrete.legendre import velocity_function
from varint.errors import InputError, parsed_or_refused
from varint.integration.problem import Start
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.inputs import number, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, per_system

SYMPLECTIC = 1e-12  # of ‖AᵀJA − J‖ for balanced A; exact derivatives leave some 1e-15
CONSTRAINT, HIDDEN = 1e-12, 1e-10  # |g| and |G v|, relative to the sizes of q and v
EPS = np.finfo(float).eps
MARGIN = 100.0  # round-off of one step, in units of eps, that a reversible method may leave
PROBE = 1e-7  # relative perturbation that shows how fast errors grow


@dataclass(frozen=True, eq=False)
class SymplecticDefect:
    """‖AᵀJA − J‖ with A = ∂(q1, p1)/∂(q0, p0), at states along a run.

    Attributes
    ----------
    method : str
    h : float
    values : ndarray
        One a state.
    passed : bool or None
        None where forces or non-holonomic constraints make the flow itself not symplectic, and with
        contacts.
    """

    method: str
    h: float
    values: np.ndarray
    passed: bool | None

    @property
    def worst(self) -> float:
        return float(self.values.max(initial=0.0))

    def __str__(self) -> str:
        if not self.values.size:
            return f"{mark(None)} symplectic: contacts have no step that could be differentiated"
        what = "symplectic" if self.worst <= SYMPLECTIC else "not symplectic"
        what += ": forces or non-holonomic constraints" if self.passed is None else ""
        return f"{mark(self.passed)} {what}: ‖AᵀJA − J‖ = {self.worst:.1e} (limit {SYMPLECTIC:g})"


def symplectic_defect(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    states: int = 5,
    apart: int = 7,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> SymplecticDefect:
    """How far one step is from symplectic, AᵀJA = J with A = ∂(q1, p1)/∂(q0, p0) by exact
    derivatives.

    Parameters
    ----------
    system : System
    method : Rule or Function, optional
        A rule, or a step function with the signature of `step_function`. Default: the scene's own
        rule.
    q0, v0, p0, h, params, t0, u
        As in `simulate`; u is constant.
    states, apart : int
        Measure at so many states of a run, so many steps apart.

    Returns
    -------
    SymplecticDefect
        With A scaled symplectically to momenta and positions of like size. With constraints the
        two-form is taken on vectors tangent to g = 0, G v = 0.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> vi.diagnostics.symplectic_defect(pendulum, vi.gauss(2), q0=1.0, v0=0.0, h=0.1).passed
    True
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    states, apart = positive_integer("states", states), positive_integer("apart", apart)
    if system.structure.contacts:
        return SymplecticDefect(start.name, h, np.empty(0), None)
    q, p, t = march(start, h, max(states - 1, 1) * apart)
    values = np.array(
        [_defect(start, q[i], p[i], t[i], h) for i in range(0, len(q), apart)][:states]
    )
    good, free = (
        bool((values <= SYMPLECTIC).all()),
        system.structure.forced or system.structure.nonholonomic,
    )
    return SymplecticDefect(start.name, h, values, None if free and not good else good)


def _defect(start: Scene, q: np.ndarray, p: np.ndarray, t: float, h: float) -> float:
    n = len(q)
    where = (
        f"the step from q={q}, p={p} at t={t:g} has no finite derivative: take a smaller h or "
        "other parameters"
    )
    blocks = parsed_or_refused(
        lambda: _slopes(start.step)(q, p, start.controls, start.c, t, h), lambda: where
    )
    a = np.array(ca.blockcat([blocks[:2], blocks[2:]]))
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    size = np.sqrt(np.maximum(np.abs(q).max(), EPS) / np.maximum(np.abs(p).max(), EPS))
    scale = np.concatenate([np.full(n, size), np.full(n, 1 / size)])
    with np.errstate(all="ignore"):
        a = a * scale / scale[:, None]
    if not np.isfinite(a).all():
        raise InputError(where)
    tangent = np.eye(2 * n)
    if start.system.structure.constraints:
        slope = np.array(_surface(start.system)(q, p, t, start.c)[1]) * scale
        _, values, vectors = np.linalg.svd(slope)
        tangent = vectors[int((values > 1e-10 * values[0]).sum()) :].T
    a = a @ tangent
    stretch = max(1.0, float(np.linalg.norm(a, 2)))  # divided by first: its square may overflow
    a, tangent = a / stretch, tangent / stretch
    return float(np.linalg.norm(a.T @ j @ a - tangent.T @ j @ tangent, 2))


def _slopes(step: ca.Function) -> ca.Function:
    """(q0, p0, u, c, t, h) → ∂q1/∂q0, ∂q1/∂p0, ∂p1/∂q0, ∂p1/∂p0."""
    inputs = [ca.MX.sym(step.name_in(i), step.numel_in(i)) for i in range(6)]
    q, p, u, c, t, h = inputs
    q1, p1, *_ = step.call([q, p, ca.reshape(u, *step.size_in(2)), c, t, h])
    outputs = [ca.densify(ca.jacobian(y, x)) for y in (q1, p1) for x in (q, p)]
    return ca.Function("slopes", inputs, outputs)


@per_system
def _surface(system: System) -> ca.Function:
    """(q, p, t, c) → (g, G v + ∂g/∂t) and their Jacobian with respect to (q, p)."""
    s = system
    hidden = ca.jtimes(s.constraint, s.q, s.v) + ca.jacobian(s.constraint, s.t)
    both = ca.Function("both", [s.q, s.v, s.t, s.c], [s.constraint, hidden])
    x, c, t = ca.MX.sym("x", 2 * s.structure.n), ca.MX.sym("c", s.c.numel()), ca.MX.sym("t")
    q, p = ca.vertsplit(x, s.structure.n)
    value = ca.vertcat(*both(q, velocity_function(s)(q, p, t, c), t, c))
    f = ca.Function("surface", [x, t, c], [value, ca.densify(ca.jacobian(value, x))])
    q, p = ca.MX.sym("q", s.structure.n), ca.MX.sym("p", s.structure.n)
    return ca.Function("surface", [q, p, t, c], f(ca.vertcat(q, p), t, c))


@dataclass(frozen=True, eq=False)
class ReversibilityDefect:
    """Distance from the start after a run there and back.

    Attributes
    ----------
    method : str
    h : float
    steps : int
    error : float
        Largest of the relative errors of q and p.
    limit : float
        Round-off times growth.
    growth : float
        Amplification of a small perturbation over the run.
    flipped : bool
        Whether velocities were flipped; otherwise h was (Lagrangians that are not even in v, or
        depend on t).
    passed : bool or None
    """

    method: str
    h: float
    steps: int
    error: float
    limit: float
    growth: float
    flipped: bool
    passed: bool | None

    def __str__(self) -> str:
        how = "flipping v" if self.flipped else "flipping h"
        what = "reversible" if self.passed else "not reversible"
        what += ": impacts lose energy" if self.passed is None else ""
        return (
            f"{mark(self.passed)} {what}: {self.error:.1e} after {self.steps} steps there and "
            f"back, {how} (limit {self.limit:.1e}: round-off × growth {self.growth:.1e})"
        )


def reversibility_defect(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    steps: int = 100,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> ReversibilityDefect:
    """N steps, flip v, N steps: ρ Φ ρ Φ = id with ρ(q, p) = (q, −p), to round-off times growth.

    Where L is not even in v or depends on time the way back takes −h: a self-adjoint method has
    Φ_{−h} Φ_h = id.

    Parameters
    ----------
    system, method, q0, v0, p0, h, params, t0, u
        As in `symplectic_defect`.
    steps : int

    Returns
    -------
    ReversibilityDefect
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    flip = is_even(system)
    h, steps = number("h", h), positive_integer("steps", steps)
    q, p, t = march(start, h, steps)
    back_q, back_p = _back(start, q[-1], p[-1], t[-1], h, steps, flip)
    size = np.abs(q).max(), np.abs(p).max()
    error = max(_relative(back_q - start.q, size[0]), _relative(back_p - start.p, size[1]))
    nudge = PROBE * np.where(np.abs(start.q) > 0, start.q, size[0])
    near_q, near_p, _ = (
        (q, p, t) if start.is_held else march(start, h, steps, start.q + nudge, start.p)
    )
    apart = max(_relative(near_q[-1] - q[-1], size[0]), _relative(near_p[-1] - p[-1], size[1]))
    growth = max(1.0, apart / PROBE)
    limit = MARGIN * EPS * steps * growth
    good = None if start.dissipates else bool(error <= limit)
    return ReversibilityDefect(start.name, h, steps, error, limit, growth, flip, good)


def is_even(system: System) -> bool:
    """Whether flipping v runs time backwards: no forces, L free of t and even in v at random
    points.
    """
    s = system.structure
    if not s.autonomous or s.forced:
        return False
    at = ca.Function(
        "odd",
        [system.q, system.v, system.c],
        [system.lagrangian, ca.substitute(system.lagrangian, system.v, -system.v)],
    )
    rng = np.random.default_rng(0)
    q, v = rng.uniform(0.1, 1.0, (2, s.n, 20))
    c = np.tile(system.default_vector[:, None], (1, 20))
    one, other = (np.array(x) for x in at(q, 0.1 * v, c))
    good = np.isfinite(one) & np.isfinite(other)
    return bool(np.allclose(one[good], other[good], rtol=1e-12, atol=1e-14))


def _back(
    start: Scene, q, p, t: float, h: float, steps: int, flip: bool
) -> tuple[np.ndarray, np.ndarray]:
    if flip:
        back_q, back_p, _ = march(start, h, steps, q, -p, start.t)
        return back_q[-1], -back_p[-1]
    back_q, back_p, _ = march(start, -h, steps, q, p, t)
    return back_q[-1], back_p[-1]


def _relative(error: np.ndarray, size: float) -> float:
    return float(np.abs(error).max() / max(size, EPS))


@dataclass(frozen=True, eq=False)
class ConstraintDrift:
    """Largest violation of g = 0 and G v = 0 over a run.

    Attributes
    ----------
    method : str
    h : float
    steps : int
    position, velocity : float
        max |g| and max |G v + ∂g/∂t|.
    passed : bool or None
        None where the scene has no constraints.
    """

    method: str
    h: float
    steps: int
    position: float
    velocity: float
    passed: bool | None

    def __str__(self) -> str:
        if self.passed is None:
            return f"{mark(None)} no constraints"
        sizes = f"|g| ≤ {self.position:.1e}, |G v| ≤ {self.velocity:.1e}"
        return f"{mark(self.passed)} constraints: {sizes} in {self.steps} steps"


def constraint_drift(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    steps: int = 1000,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> ConstraintDrift:
    """Largest |g| and |G v + ∂g/∂t| at the nodes of a run.

    Parameters
    ----------
    system, method, q0, v0, p0, h, params, t0, u
        As in `symplectic_defect`.
    steps : int

    Returns
    -------
    ConstraintDrift
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    m = system.structure.constraints
    if not m:
        return ConstraintDrift(start.name, h, steps, 0.0, 0.0, None)
    q, p, t = march(start, h, steps)
    value = over_columns(_surface(system), q, p, t[:, None], start.c)[0]
    g, hidden = np.abs(value[:, :m]).max(), np.abs(value[:, m:]).max()
    size = max(1.0, np.abs(q).max() ** 2)
    speed = max(1.0, np.abs(np.diff(q, axis=0)).max() / abs(h) * np.abs(q).max())
    good = g <= CONSTRAINT * size and hidden <= HIDDEN * speed
    return ConstraintDrift(start.name, h, steps, float(g), float(hidden), bool(good))
