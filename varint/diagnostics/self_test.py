"""Everything at once on the user's own scene, with a verdict for each property."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from varint.diagnostics.accuracy import LEVELS, Convergence, convergence
from varint.diagnostics.constraints import ConstraintDrift, constraint_drift
from varint.diagnostics.long_runs import EnergySlope, RoundOff, energy_slope, round_off
from varint.diagnostics.momentum import DRIFT, Conserved
from varint.diagnostics.reversibility import ReversibilityDefect, reversibility_defect
from varint.diagnostics.runs import mark
from varint.diagnostics.symplecticity import SymplecticDefect, symplectic_defect
from varint.integration.problem import Start
from varint.integration.simulate import simulate
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

CONVERGENCE_STEPS = 64  # of size h: the duration of the convergence test


@dataclass(frozen=True, eq=False)
class SelfTest:
    """Results of all diagnostics on one scene; a table of verdicts in print.

    Attributes
    ----------
    method : str
    convergence, symplectic, reversibility, energy, round_off, constraints
        The single results.
    conserved : Conserved or None
        Momentum maps; None for step functions.
    """

    method: str
    convergence: Convergence
    symplectic: SymplecticDefect
    reversibility: ReversibilityDefect
    energy: EnergySlope
    round_off: RoundOff
    constraints: ConstraintDrift
    conserved: Conserved | None

    @property
    def momenta(self) -> bool | None:
        """Whether all that the rule keeps exactly drifts less than 1e-11, forces and reactions
        taken into account.
        """
        if self.conserved is None:
            return None
        kept = [m for m in self.conserved if m.expected is not None and m.exact]
        return all(m.drift <= DRIFT for m in kept) if kept else None

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return all(x.passed is not False for x in _single(self)) and self.momenta is not False

    def __str__(self) -> str:
        lines = [
            f"{self.method}: {'all hold' if self.passed else 'NOT all hold'}",
            *(str(x) for x in _single(self)),
        ]
        if self.conserved is not None:
            count = len(self.conserved)
            lines.append(
                f"{mark(self.momenta)} momentum maps of {count} symmetries, each as theory says:"
            )
            lines += [f"    {m}" for m in self.conserved]
        return "\n".join(lines)


def _single(test: SelfTest) -> tuple[Any, ...]:
    """The single results, in the order in which they are told."""
    return (
        test.convergence,
        test.symplectic,
        test.reversibility,
        test.energy,
        test.round_off,
        test.constraints,
    )


def self_test(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    steps: int = 2000,
    order: float | None = None,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> SelfTest:
    """All diagnostics on the user's scene: order, structure, energy, round-off, constraints,
    momentum maps.

    Parameters
    ----------
    system, method, q0, v0, p0, h, params, t0, u
        As in `symplectic_defect`.
    steps : int
        Of the long runs.
    order : float, optional
        Expected order of a step function.

    Returns
    -------
    SelfTest
        ``print`` it; ``.passed``; the single results are its attributes.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> vi.diagnostics.self_test(pendulum, vi.gauss(2), q0=1.0, v0=0.0, h=0.1, steps=500).passed
    True
    """
    start: dict[str, Any] = Start(q0, v0, p0, t0, params, u)._asdict()
    conserved = None
    if not isinstance(method, ca.Function):
        motion = simulate(system, method, h=h, steps=steps, progress=False, **start)
        method, conserved = motion.rule, motion.conserved()
    return SelfTest(
        method=str(method) if isinstance(method, Rule) else method.name(),
        convergence=convergence(
            system, method, duration=CONVERGENCE_STEPS * h, steps=LEVELS, order=order, **start
        ),
        symplectic=symplectic_defect(system, method, h=h, **start),
        reversibility=reversibility_defect(
            system, method, h=h, steps=max(steps // 20, 10), **start
        ),
        energy=energy_slope(system, method, h=h, steps=steps, **start),
        round_off=round_off(system, method, h=h, steps=steps, **start),
        constraints=constraint_drift(system, method, h=h, steps=steps, **start),
        conserved=conserved,
    )
