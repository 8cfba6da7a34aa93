"""How far a motion leaves its constraints, in positions and in velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.diagnostics.runs import march, mark, scene
from varint.discrete.legendre import velocity_function
from varint.integration.problem import Start
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

CONSTRAINT, HIDDEN = 1e-12, 1e-10  # |g| and |G v|, relative to the sizes of q and v


@per_system
def surface_function(system: System) -> ca.Function:
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
    value = over_columns(surface_function(system), q, p, t[:, None], start.c)[0]
    g, hidden = np.abs(value[:, :m]).max(), np.abs(value[:, m:]).max()
    size = max(1.0, np.abs(q).max() ** 2)
    speed = max(1.0, np.abs(np.diff(q, axis=0)).max() / abs(h) * np.abs(q).max())
    good = g <= CONSTRAINT * size and hidden <= HIDDEN * speed
    return ConstraintDrift(start.name, h, steps, float(g), float(hidden), bool(good))
