"""Orbital elements along a motion of gravitating bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.orbits.bodies import bodies_of
from varint.orbits.files import save
from varint.orbits.kepler import TURN, KeplerElements, kepler_elements
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Elements:
    """Osculating elements of bodies along a motion; arrays (N + 1, B), angles in radians.

    Attributes
    ----------
    t : ndarray (N + 1,)
    names : tuple of str
        Of the bodies.
    mu : ndarray (B,)
        G times the masses that act in the two-body problem of each.
    a, e, inclination, node, pericentre, mean_anomaly : ndarray (N + 1, B)
        As in `KeplerElements`.
    centre : str
        What the orbits are about.
    """

    t: np.ndarray
    names: tuple[str, ...]
    mu: np.ndarray
    a: np.ndarray
    e: np.ndarray
    inclination: np.ndarray
    node: np.ndarray
    pericentre: np.ndarray
    mean_anomaly: np.ndarray
    centre: str

    def __repr__(self) -> str:
        ends = f"t = {self.t[0]:g} … {self.t[-1]:g}"
        return f"Elements({', '.join(self.names)} about {self.centre}: {len(self.t)} times, {ends})"

    @property
    def longitude_of_pericentre(self) -> np.ndarray:
        """ϖ = Ω + ω."""
        return np.mod(self.node + self.pericentre, TURN)

    @property
    def mean_longitude(self) -> np.ndarray:
        """λ = ϖ + M."""
        return np.mod(self.node + self.pericentre + self.mean_anomaly, TURN)

    @property
    def mean_motion(self) -> np.ndarray:
        """n = √(μ/|a|³)."""
        return np.sqrt(self.mu / np.abs(self.a) ** 3)

    @property
    def period(self) -> np.ndarray:
        """2π/n; not a number for hyperbolas."""
        return np.where(self.a > 0, TURN / self.mean_motion, np.nan)

    def of(self, body: str) -> KeplerElements:
        """The elements of one body, (N + 1,) each."""
        if body not in self.names:
            raise InputError(f"unknown body {body!r}; known: {list(self.names)}")
        i = self.names.index(body)
        fields = KeplerElements._fields
        return KeplerElements(*(getattr(self, name)[:, i] for name in fields))

    def plot(self) -> Figure:
        """Semi-major axes, eccentricities and inclinations over time."""
        from varint.drawing.element_figures import elements_figure

        panels = {"$a$": self.a, "$e$": self.e, "inclination": self.inclination}
        return elements_figure(self.t, self.names, panels, wide=("$a$",))

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def osculating_elements(
    motion: Trajectory,
    *,
    centre: str | None = None,
    masses: Any = None,
    G: Any = None,
    names: Sequence[str] | None = None,
) -> Elements:
    """Keplerian elements of every body about one of them, at every node: of the orbit with μ = G
    (m_centre + m) that it would go on with if the others were not there.

    Parameters
    ----------
    motion : Trajectory
        Of bodies whose coordinates are called x1, y1, z1, x2, …
    centre : str, optional
        Name of the body they go about, ``"1"`` of x1, … Default: the heaviest.
    masses : array (B,) or SX, optional
        Default: the scene's parameter ``m``.
    G : float or SX, optional
        Default: the scene's parameter ``G``.
    names : sequence of str, optional
        What to call the bodies, in the order of their coordinates.

    Returns
    -------
    Elements

    Raises
    ------
    InputError
        If bodies, masses or G are not known.

    References
    ----------
    Murray & Dermott, Solar System Dynamics, 1999, §§2.8–2.9.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.two_body(e=0.3)
    >>> motion = vi.simulate(model.system, vi.gauss(8), **model.start)
    >>> found = vi.orbits.osculating_elements(motion)
    >>> bool(abs(found.e - 0.3).max() < 1e-11)
    True
    """
    bodies = bodies_of(motion, masses, G)
    called = _called(names, bodies.names)
    index = int(np.argmax(bodies.masses))
    if centre is not None:
        known = list(dict.fromkeys([*bodies.names, *called]))
        if centre not in known:
            raise InputError(f"unknown centre {centre!r}; known: {known}")
        index = (called if centre in called else bodies.names).index(centre)
    others = [i for i in range(len(called)) if i != index]
    q, v = motion.q[:, bodies.places], motion.v[:, bodies.places]
    mu = bodies.G * (bodies.masses[index] + bodies.masses[others])
    found = kepler_elements(q[:, others] - q[:, [index]], v[:, others] - v[:, [index]], mu)
    return Elements(motion.t, tuple(called[i] for i in others), mu, *found, called[index])


def jacobi_elements(
    motion: Trajectory,
    *,
    order: Sequence[str] | None = None,
    masses: Any = None,
    G: Any = None,
    names: Sequence[str] | None = None,
) -> Elements:
    """Keplerian elements in Jacobi's coordinates: of every body about the centre of mass of all
    that are further in, with μ = G times the masses of all of these and its own.

    They vary less than those about the heaviest body, whose own motion the latter show.

    Parameters
    ----------
    motion : Trajectory
        As for `osculating_elements`.
    order : sequence of str, optional
        Names of the bodies from the inside out. Default: the heaviest, then by the distance from
        it at the first node.
    masses, G, names
        As for `osculating_elements`.

    Returns
    -------
    Elements

    Raises
    ------
    InputError
        As for `osculating_elements`; if `order` does not name every body once.

    References
    ----------
    Murray & Dermott, Solar System Dynamics, 1999, §9.4; Wisdom & Holman, Astronomical Journal 102
    (1991) 1528.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> model = vi.models.outer_solar_system()
    >>> motion = vi.simulate(
    ...     model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=300.0, steps=200
    ... )
    >>> about_sun = vi.orbits.osculating_elements(motion).of("3").a
    >>> about_all = vi.orbits.jacobi_elements(motion).of("3").a
    >>> bool(np.ptp(about_all) < np.ptp(about_sun) / 5)
    True
    """
    bodies = bodies_of(motion, masses, G)
    called = _called(names, bodies.names)
    q, v = motion.q[:, bodies.places], motion.v[:, bodies.places]
    if order is None:
        heaviest = int(np.argmax(bodies.masses))
        inwards = list(np.argsort(np.linalg.norm(q[0] - q[0, heaviest], axis=-1), kind="stable"))
    else:
        known = called if set(order) <= set(called) else bodies.names
        if sorted(order) != sorted(known):
            raise InputError(f"order must name every body once: {list(known)}; got {list(order)}")
        inwards = [known.index(body) for body in order]
    m = bodies.masses[inwards]
    inside = np.cumsum(m)
    if not inside[0] > 0:
        raise InputError("the innermost body has no mass: name another one first in order")

    def relative(x: np.ndarray) -> np.ndarray:
        x = x[:, inwards]
        centres = np.cumsum(m[:, None] * x, axis=1) / inside[:, None]
        return x[:, 1:] - centres[:, :-1]

    mu = bodies.G * inside[1:]
    found = kepler_elements(relative(q), relative(v), mu)
    outer = tuple(called[i] for i in inwards[1:])
    return Elements(motion.t, outer, mu, *found, "the centre of mass further in")


def _called(names: Any, known: tuple[str, ...]) -> tuple[str, ...]:
    if names is None:
        return known
    called = tuple(map(str, names))
    if len(called) != len(known) or len(set(called)) < len(called):
        raise InputError(
            f"names must be {len(known)} different ones, for the bodies {list(known)}; got "
            f"{list(called)}"
        )
    return called
