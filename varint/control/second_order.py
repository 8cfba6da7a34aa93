"""Is a stationary control a minimum? The reduced Hessian: second derivatives of the Lagrangian
along all changes d that active conditions allow.

dᵀ H d > 0 for all d ≠ 0 with A d = 0 makes it a strict local minimum (the second-order sufficient
conditions: Nocedal & Wright, Numerical Optimization, Theorem 12.6); a d with dᵀ H d = 0 is a flat
direction, along which the solution is not determined to second order, one with dᵀ H d < 0 leads to
a cheaper motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from varint.control.neighbourhood import kkt_system
from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription, control_points, control_samples
from varint.nlp.kkt import KktSystem
from varint.nlp.solver import SolverResult
from varint.scene.system import parameter_entries

# of the cost's own size: curvatures below this are round-off of a flat direction
FLAT = 1e-7
DOUBLINGS = 60  # of FLAT: more than the range of numbers that a curvature can have
ITERATIONS = 12  # of inverse iteration: the kind and the place of a direction, not its digits
SHOWN = 0.1  # of the largest change: quantities that change by less are not named
STRICT, FLAT_DIRECTION, SADDLE, CORNER = (
    "strict minimum",
    "flat direction",
    "saddle point",
    "determined by its active bounds",
)


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """The second-order check of an optimal control.

    Attributes
    ----------
    kind : str
        ``"strict minimum"``, ``"flat direction"``, ``"saddle point"``, or ``"determined by its
        active bounds"`` where those leave nothing to vary.
    curvature : float
        Least second derivative of the cost per mean square change of controls (and of free starts,
        durations, parameters), in units of the problem's own scales; 0 where nothing varies.
    names : tuple of str
        What changes along the direction of least curvature, the strongest first, with the times
        where it does.
    direction : ndarray or None
        That direction among all unknowns.
    """

    kind: str
    curvature: float
    names: tuple[str, ...]
    direction: np.ndarray | None

    def __str__(self) -> str:
        if self.kind == CORNER:
            return f"{self.kind}: nothing can vary"
        along = ", ".join(self.names)
        if self.kind == STRICT:
            return f"{self.kind}; least curvature {self.curvature:.2g}, along {along}"
        if self.kind == SADDLE:
            return f"{self.kind}, no minimum: curvature {self.curvature:.2g} along {along}"
        return f"{self.kind}: to second order the cost does not change along {along}"


def second_order(
    problem: ControlProblem, part: PhaseTranscription, outcome: SolverResult
) -> SecondOrder:
    """Strict minimum, flat or saddle, with the direction of least curvature in words of a phase."""
    kkt = kkt_system(problem, outcome)
    if not len(kkt.free):
        return SecondOrder(CORNER, 0.0, (), None)
    shift = FLAT * _order(kkt, outcome)
    factors, kind = kkt.factors(-shift), STRICT
    if not kkt.is_convex(factors):
        factors = kkt.factors(shift)
        kind = FLAT_DIRECTION if kkt.is_convex(factors) else SADDLE
    for _ in range(DOUBLINGS):
        if kkt.is_convex(factors) or kind != SADDLE:
            break
        shift *= 4
        factors = kkt.factors(shift)
    curvature, direction = kkt.least_curvature(factors, ITERATIONS)
    if kind == STRICT and not np.isfinite(curvature):
        return SecondOrder(CORNER, 0.0, (), None)
    return SecondOrder(kind, curvature, _names(part, outcome, direction / kkt.scales.x), direction)


def _order(kkt: KktSystem, outcome: SolverResult) -> float:
    """The size of the cost's curvature, or of the cost itself where that is larger."""
    diagonal = np.abs(np.array(kkt.hessian.nonzeros()))
    rows, columns = (np.array(x, dtype=int) for x in kkt.hessian.sparsity().get_triplet())
    on = (rows == columns) & ~kkt.unknowns.active[rows]
    return max(float(np.sum(diagonal[on] * kkt.scales.x[rows[on]] ** 2)), abs(outcome.cost), 1e-300)


def _names(part: PhaseTranscription, outcome: SolverResult, change: np.ndarray) -> tuple[str, ...]:
    """What changes along a direction, the strongest first, and when."""
    phase, slots, system = part.phase, part.slots, part.phase.system
    t0, duration = part.shared_values(outcome.x, outcome.nlp.p)[:2]
    begin, size = phase.mesh[:-1, None], np.diff(phase.mesh)[:, None]
    nodes, points = (
        t0 + duration * (begin + size * x)
        for x in (phase.control_places, np.array(phase.rule.points))
    )
    q, u = control_points(change, part), control_samples(change, part)
    along = [(name, nodes, u[..., i]) for i, name in enumerate(system.control_names)]
    along += [(name, points, q[..., i]) for i, name in enumerate(system.names)]
    shared = ("t0", "duration", *parameter_entries(system))
    once = [(shared[i], change[slots.shared[i]]) for i in np.flatnonzero(slots.shared >= 0)]
    sizes = {name: float(np.abs(x).max(initial=0.0)) for name, _, x in along}
    sizes |= {name: float(np.abs(x)) for name, x in once}
    seen = [name for name in sizes if sizes[name] > SHOWN * max(sizes.values())]
    when = {name: at[np.abs(x) > SHOWN * np.abs(x).max()] for name, at, x in along if name in seen}
    words = {name: f" ({at.min():.4g} … {at.max():.4g})" for name, at in when.items()}
    return tuple(name + words.get(name, "") for name in sorted(seen, key=lambda x: -sizes[x]))
