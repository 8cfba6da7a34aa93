"""A periodic orbit: what was found, how well, and what is made of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.integration.simulate import simulate
from varint.notation.html import table
from varint.orbits.multipliers import Floquet, multipliers_of
from varint.orbits.phase import Units, energy_at, velocity_at
from varint.orbits.save import save_orbits, saved_orbit
from varint.orbits.shooting import Iterate, Linear, Shooting, linearise, runs
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System, parameters_by_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Orbit:
    """A periodic orbit of the discrete motion, x(T) = x(0).

    Attributes
    ----------
    shooting : Shooting
        Scene, rule, segments and steps of a period.
    at : Iterate
        States (q, p) at the beginnings of the segments, period, parameter values.
    units : Units
        What coordinates and momenta are measured by.
    residual : float
        What is left of x(T) − x(0), in ranges of the coordinates.
    error_estimate : float
        How far the orbit would move if the steps were half as long, in the same units.
    period_error : float
        The same of the period.
    iterations : int
        Newton steps.
    """

    shooting: Shooting
    at: Iterate
    units: Units
    residual: float
    error_estimate: float
    period_error: float
    iterations: int

    @property
    def system(self) -> System:
        """The scene."""
        return self.shooting.system

    @property
    def rule(self) -> Rule:
        """The rule of its steps."""
        return self.shooting.rule

    @property
    def steps(self) -> int:
        """Steps of a period."""
        return self.shooting.steps

    @property
    def period(self) -> float:
        """T."""
        return float(self.at.period)

    @property
    def h(self) -> float:
        """Size of a step; the mean one where they differ."""
        return self.period / self.steps

    @property
    def t0(self) -> float:
        """Time of the start."""
        return self.shooting.t0

    @property
    def q0(self) -> np.ndarray:
        """Coordinates at the start, (n,)."""
        return self.at.x[0, : len(self.shooting.shift)]

    @property
    def p0(self) -> np.ndarray:
        """Momenta at the start, (n,)."""
        return self.at.x[0, len(self.shooting.shift) :]

    @property
    def v0(self) -> np.ndarray:
        """Velocities at the start, (n,)."""
        return velocity_at(self.system, self.at.x[0], self.t0, self.at.c)

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Parameter values by name."""
        return parameters_by_name(self.system, self.at.c)

    @property
    def integrals(self) -> dict[str, float]:
        """What the scene conserves, by name, and its values."""
        there = self.shooting.integrals
        if not there.names:
            return {}
        values = there.at(self.at.x[0], self.at.c)
        return {name: float(x) for name, x in zip(there.names, values, strict=True)}

    @cached_property
    def energy(self) -> float:
        """Energy at the start."""
        return energy_at(self.system, self.at.x[0], self.t0, self.at.c)

    @cached_property
    def motion(self) -> Trajectory:
        """One period, with every step."""
        n = len(self.shooting.shift)
        step = float(self.period * self.shooting.sizes[0])
        given: dict[str, Any] = dict(h=step, t0=self.t0, params=self.parameters)
        first = simulate(
            self.system,
            self.rule,
            q0=self.q0,
            p0=self.p0,
            steps=self.shooting.each,
            progress=False,
            **given,
        )
        if self.shooting.segments == 1:
            return first
        pieces = runs(self.shooting, self.at)
        x = np.concatenate([pieces[0].x[:1], *(piece.x[1:] for piece in pieces)])
        k = np.arange(len(x))
        s = self.shooting
        sizes = self.period * np.repeat(s.sizes, s.each)
        inside = s.beginnings[:, None] + s.sizes[:, None] * np.arange(s.each)
        t = self.t0 + self.period * np.append(inside.ravel(), 1.0)
        none = None if first.active_set is None else np.zeros(len(x), dtype=int)
        u = np.empty((self.steps, 1, 0))
        made = replace(first, t=t, q=x[:, :n], p=x[:, n:], k=k, u=u, active_set=none)
        if self.shooting.parts is None:
            return replace(made, t=self.t0 + self.h * k)
        return replace(made, h=self.h, sizes=sizes)

    @cached_property
    def linear(self) -> Linear:
        """Tangent maps of the segments, by the run's own steps."""
        return linearise(self.shooting, self.at, runs(self.shooting, self.at), self.units, None)

    @cached_property
    def floquet(self) -> Floquet:
        """Multipliers and stability."""
        names = self.shooting.integrals.names
        return multipliers_of(self.linear, names, self.system.structure)

    @property
    def monodromy(self) -> np.ndarray:
        """Φ = ∂(q, p)(T)/∂(q, p)(0), (2n, 2n); with constraints on their tangents, zero across."""
        frame = self.linear.frames[0]
        return frame.into @ self.linear.monodromy @ frame.onto

    def rows(self) -> list[tuple[str, str]]:
        """What is printed: name and value."""
        rows = [("period", f"{self.period:.15g} ± {self.period_error:.1e}")]
        rows += [(name, f"{x:.15g}") for name, x in self.integrals.items()]
        rows += [
            ("steps", f"{self.steps} by {self.rule}, {_segments(self.shooting)}"),
            ("x(T) − x(0)", f"{self.residual:.1e} of its ranges"),
            ("error estimate", f"{self.error_estimate:.1e} of its ranges"),
        ]
        return rows

    def __repr__(self) -> str:
        return f"Orbit(period={self.period:.10g}, error_estimate={self.error_estimate:.1e})"

    def __str__(self) -> str:
        rows = self.rows()
        wide = max(len(name) for name, _ in rows)
        return "\n".join(["periodic orbit", *(f"  {a:<{wide}}  {b}" for a, b in rows)])

    def _repr_html_(self) -> str:
        return table("periodic orbit", self.rows())

    def plot(self) -> Figure:
        """The orbit in its coordinates, and its multipliers with the unit circle."""
        from varint.drawing.orbit_figures import orbit_figure

        of = self.floquet
        return orbit_figure(self.motion, of.multipliers, of.signatures)

    def save(self, path: Any) -> None:
        """Write it to one compressed ``.npz`` file without pickle; `varint.load` reads it."""
        save_orbits(path, "orbit", [saved_orbit(self)])


def _segments(shooting: Shooting) -> str:
    """How a period is parted, in words."""
    if shooting.parts is None:
        return f"{shooting.segments} segments"
    ratio = float(shooting.parts.max() / shooting.parts.min())
    return f"{shooting.segments} segments, the longest {ratio:.4g} times the shortest"
