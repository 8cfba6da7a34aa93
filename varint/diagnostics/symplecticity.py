"""How far a step is from symplectic, on the constraints' tangent space where there are any."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.diagnostics.constraints import surface_function
from varint.diagnostics.runs import EPS, Scene, march, mark, scene
from varint.errors import InputError, parsed_or_refused
from varint.integration.problem import Start
from varint.rules.rule import Rule
from varint.scene.inputs import positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

SYMPLECTIC = 1e-12  # of ‖AᵀJA − J‖ for balanced A; exact derivatives leave some 1e-15


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
        slope = np.array(surface_function(start.system)(q, p, t, start.c)[1]) * scale
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
