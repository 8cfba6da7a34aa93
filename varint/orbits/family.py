"""Families of periodic orbits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.notation.html import table
from varint.orbits.bifurcations import Bifurcation
from varint.orbits.orbit import Orbit
from varint.orbits.save import save_orbits, saved_orbit
from varint.scene.system import parameter_entries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAME_PERIOD = 1e-9  # of it: not drawn


@dataclass(frozen=True, eq=False, repr=False)
class Family:
    """A curve of periodic orbits; iterate, or pick one by number.

    Attributes
    ----------
    orbits : tuple of Orbit
    along : str
        "energy", "period" or the parameter that was varied.
    bifurcations : tuple of Bifurcation
        What was met, in order.
    ended : str
        Why it ends where it does.
    """

    orbits: tuple[Orbit, ...]
    along: str
    bifurcations: tuple[Bifurcation, ...]
    ended: str

    def __len__(self) -> int:
        return len(self.orbits)

    def __iter__(self) -> Iterator[Orbit]:
        return iter(self.orbits)

    def __getitem__(self, which: int) -> Orbit:
        return self.orbits[which]

    @cached_property
    def periods(self) -> np.ndarray:
        """Period of every orbit."""
        return np.array([one.period for one in self])

    @cached_property
    def energies(self) -> np.ndarray:
        """Energy of every orbit."""
        return np.array([one.energy for one in self])

    @cached_property
    def values(self) -> np.ndarray:
        """Energy, period or parameter along which the family goes."""
        if self.along in ("energy", "period"):
            return self.energies if self.along == "energy" else self.periods
        return self.parameter(self.along)

    def parameter(self, name: str) -> np.ndarray:
        """A parameter of every orbit, by its name (``"mass[1]"`` for an entry of a vector)."""
        index = parameter_index(self.orbits[0], name)
        return np.array([one.at.c[index] for one in self])

    @cached_property
    def stable(self) -> np.ndarray:
        """Whether every orbit is linearly stable."""
        return np.array([one.floquet.stable for one in self])

    @cached_property
    def indices(self) -> np.ndarray:
        """Stability indices ν = (μ + 1/μ)/2 of every orbit, (k, pairs), the largest first."""
        return np.array([one.floquet.indices for one in self])

    def rows(self) -> list[tuple[str, str]]:
        """What is printed: name and value."""
        low, high = self.values.min(), self.values.max()
        rows = [
            ("orbits", f"{len(self)}, {int(self.stable.sum())} of them stable"),
            (self.along, f"{low:.8g} … {high:.8g}"),
            ("period", f"{self.periods.min():.8g} … {self.periods.max():.8g}"),
            ("ends", self.ended),
        ]
        rows += [
            (one.kind, f"{self.along} {one.value:.10g}, period {one.orbit.period:.10g}")
            for one in self.bifurcations
        ]
        return rows

    def __repr__(self) -> str:
        return f"Family({len(self)} orbits along {self.along}: {self.ended})"

    def __str__(self) -> str:
        rows = self.rows()
        wide = max(len(name) for name, _ in rows)
        return "\n".join(["family of periodic orbits", *(f"  {a:<{wide}}  {b}" for a, b in rows)])

    def _repr_html_(self) -> str:
        return table("family of periodic orbits", self.rows())

    def plot(self) -> Figure:
        """Period against energy (or parameter) with stability and what was met, and some of the
        orbits; where the period is the same all along, energy or, of a driven scene, width.
        """
        from varint.drawing.orbit_figures import family_figure

        across = self.along if self.along != "period" else "energy"
        up = "period"
        if np.ptp(self.periods) <= SAME_PERIOD * self.periods.max():
            up = "energy" if self.orbits[0].shooting.integrals.energy else "width"
        met = [one.orbit for one in self.bifurcations]
        curve, heights = (self._measured(self.orbits, name) for name in (across, up))
        at = (self._measured(met, name) for name in (across, up))
        marks = list(zip([one.kind for one in self.bifurcations], *at, strict=True))
        motions = [one.motion for one in self]
        return family_figure((across, curve), (up, heights), self.stable, marks, motions)

    def _measured(self, orbits: Sequence[Orbit], name: str) -> np.ndarray:
        """Energy, period, largest range or a parameter of each."""
        if name == "width":
            return np.array([float(one.units.length.max()) for one in orbits])
        if name in ("energy", "period"):
            return np.array([getattr(one, name) for one in orbits])
        index = parameter_index(self.orbits[0], name)
        return np.array([one.at.c[index] for one in orbits])

    def save(self, path: Any) -> None:
        """Write all orbits, and what was met, to one compressed ``.npz`` file without pickle;
        `varint.load` reads it.
        """
        words = {"along": self.along, "ended": self.ended}
        save_orbits(path, "family", [saved_orbit(one) for one in self], words, self.bifurcations)


def parameter_index(orbit: Orbit, name: str) -> int:
    """Place of a parameter among ``system.c``."""
    entries = parameter_entries(orbit.system)
    if name not in entries:
        raise InputError(f"along={name!r} is neither 'energy' nor 'period' nor one of {entries}")
    return entries.index(name)
