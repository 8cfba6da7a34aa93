"""How far a motion back ends from where it began, beside what round-off grows to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.diagnostics.runs import EPS, Scene, march, mark, scene
from varint.integration.problem import Start
from varint.rules.rule import Rule
from varint.scene.inputs import number, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

MARGIN = 100.0  # round-off of one step, in units of eps, that a reversible method may leave
PROBE = 1e-7  # relative perturbation that shows how fast errors grow


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
