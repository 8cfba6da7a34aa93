"""Families of periodic orbits by pseudo-arclength continuation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.notation.html import table
from varint.numerics.progress import progress_bar, told_beside
from varint.orbits.advance import FIRST, exactly, in_new_segments, next_point
from varint.orbits.bifurcations import Bifurcation
from varint.orbits.continuation import quantity
from varint.orbits.curve import Curve
from varint.orbits.drive import drive_of
from varint.orbits.ends import is_at_rest, is_back
from varint.orbits.orbit import Orbit
from varint.orbits.passages import Point, located, point_of
from varint.orbits.save import save_orbits, saved_orbit
from varint.scene.inputs import number, positive_integer
from varint.scene.system import parameter_entries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST = 0.15  # arclength of a step, in ranges of the orbit
MOST_STEPS = 30_000  # of an orbit: more mean a collision ahead, and seconds an orbit


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
        orbits.
        """
        from varint.drawing.orbit_figures import family_figure

        marks = [(one.kind, one.value, one.orbit.period) for one in self.bifurcations]
        curve = self.values if self.along != "period" else self.energies
        across = self.along if self.along != "period" else "energy"
        if self.along == "period":
            marks = [(one.kind, one.orbit.energy, one.orbit.period) for one in self.bifurcations]
        motions = [one.motion for one in self]
        return family_figure(curve, across, self.periods, self.stable, marks, motions)

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


def family(
    orbit: Orbit,
    along: str = "energy",
    *,
    to: float | None = None,
    increasing: bool = True,
    hold: str = "period",
    most: int = 100,
    step: float = FIRST,
    longest: float = LONGEST,
    bifurcations: bool = True,
    progress: bool | None = None,
) -> Family:
    """The family of an orbit by pseudo-arclength continuation: ⟨ẏ, y − y_k⟩ = Δs with y = (states,
    period, parameter).

    Energy and momenta are kept by unfolding, so the equations are regular at folds, too. Steps
    adapt to Newton's method and to the bends of the curve; folds, branch points, period doublings
    and collisions of multipliers are located on it.

    Parameters
    ----------
    orbit : Orbit
        From `periodic`, `Bifurcation.branch`, or a mode by `NormalModes.orbit`: small amplitudes
        make a family of nonlinear normal modes.
    along : str
        "energy" or "period" (the same curve), or a parameter, ``"mu"``, ``"mass[0]"``. Of a scene
        that is driven the period goes with the parameter, where that is the frequency or the
        period of the drive.
    to : float, optional
        Value at which it ends, with an orbit right there.
    increasing : bool
        Which way it sets out, where `to` does not say.
    hold : {"period", "energy"}
        What is held while a parameter is varied, in scenes that conserve their energy.
    most : int
        Orbits at most.
    step, longest : float
        First and longest arclength of a step, in ranges of the orbit.
    bifurcations : bool
        Whether to look for them.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for what takes longer than a second; elsewhere
        a line on standard error after two seconds, and again at most every ten.

    Returns
    -------
    Family

    Raises
    ------
    InputError
        If there is no such quantity, or the scene conserves no energy to vary.

    References
    ----------
    Keller, Lectures on Numerical Methods in Bifurcation Problems, 1987; Muñoz Almaraz et al.,
    Physica D 181 (2003) 1; Kerschen et al., Mechanical Systems and Signal Processing 23 (2009) 170
    (nonlinear normal modes).

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> duffing = vi.System(q, v, (v**2 - q**2 - q**4 / 2) / 2)
    >>> first = vi.orbits.normal_modes(duffing, [0.0]).orbit(0)
    >>> backbone = vi.orbits.family(first, to=0.75)  # amplitude 1
    >>> round(backbone[-1].period, 10)
    4.7680220291
    """
    if not isinstance(orbit, Orbit):
        raise InputError(f"family takes an Orbit, from periodic(), got {type(orbit).__name__}")
    most, curve = positive_integer("most", most, 2), _curve(orbit, along, hold)
    step, longest = number("step", step), number("longest", longest)
    if not 0 < step <= longest:
        raise InputError(f"step={step} must be positive and at most longest={longest}")
    value = quantity(orbit, curve)
    ahead = increasing if to is None else number("to", to) > value
    here = point_of(orbit, curve, None, 1.0 if ahead else -1.0)
    orbits, found, ended = [orbit], [], f"after {most} orbits"
    before: Point | None = None
    bar, told = progress_bar(most, "orbit", progress), told_beside("family of orbits", progress)
    with bar as move, told as say:
        while len(orbits) < most:
            if here.orbit.steps > MOST_STEPS:
                ended = f"where an orbit takes more than {MOST_STEPS} steps: near a collision"
                break
            made = next_point(here, before, step, curve)
            if made is None:
                ended = "where steps of any length fail: near a collision, or where orbits end"
                break
            following, length, step = made
            step = min(step, longest)
            reached = (
                to is not None
                and (quantity(following.orbit, curve) - to) * (quantity(here.orbit, curve) - to)
                <= 0
            )
            if reached:
                following, length = exactly(here, following, length, float(to), curve)  # type: ignore[arg-type]
                ended = f"at {along}={to:.10g}"
            if bifurcations:
                found += located(here, following, length, curve)
            orbits.append(following.orbit)
            move(1, lambda: f"{along}={quantity(orbits[-1], curve):.6g}")
            say(lambda: f"{len(orbits)} orbits, {along}={quantity(orbits[-1], curve):.6g}")
            if reached:
                break
            if is_back(orbits, following, length, curve):
                ended = "where it began: the family is closed"
                break
            if is_at_rest(orbits):
                ended = "where its orbits shrink to an equilibrium"
                break
            before, here = here, in_new_segments(following, curve)
    return Family(tuple(orbits), along, tuple(found), ended)


def _curve(orbit: Orbit, along: Any, hold: str) -> Curve:
    known = orbit.shooting.integrals.energy
    if along in ("energy", "period"):
        if not known:
            raise InputError(
                f"the scene does not conserve its energy: its orbits form no family along {along}; "
                "vary a parameter"
            )
        return Curve(along, None, None, 0.0)
    if hold not in ("period", "energy"):
        raise InputError(f"hold must be 'period' or 'energy', got {hold!r}")
    index = parameter_index(orbit, along)
    held = hold if known else None
    drive = 0 if orbit.shooting.autonomous else drive_of(orbit, along, index)
    value = orbit.period if hold == "period" else orbit.energy
    return Curve(along, index, held, value, drive)
