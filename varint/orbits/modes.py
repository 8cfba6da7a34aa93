"""Small oscillations about an equilibrium: frequencies, shapes, stability in words."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.integration.simulate import simulate
from varint.notation.html import table
from varint.orbits.guess import guess_of
from varint.orbits.orbit import Orbit
from varint.orbits.oscillations import modes_at
from varint.orbits.periodic import Sought, orbit_near
from varint.orbits.phase import (
    energy_at,
    state_of,
)
from varint.orbits.rest import Equilibrium, require_restful, rest
from varint.orbits.resting import MODES, save_equilibria
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.inputs import finite_array, number, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

    from varint.drawing.sketch import Sketch

TINY = 1e-9  # entries of a shape that are printed as 0
FRAMES = 60  # of a period that is shown


@dataclass(frozen=True, eq=False, repr=False)
class NormalModes:
    """Motions δq = Re(u e^{st}) about an equilibrium.

    Attributes
    ----------
    equilibrium : Equilibrium
    exponents : ndarray of complex (k,)
        s, one of each pair ±s or s, s*: iω of oscillations, the slow ones first, real where it
        grows or decays. Neutral modes of symmetries are left out.
    shapes : ndarray of complex (k, n)
        u, the largest entry of each 1.
    signatures : tuple of int or None
        Sign of the energy of an oscillation (Krein), None where there is none.
    definite : bool
        Whether the energy is definite across the symmetries.
    neutral : int
        Directions of the phase space along which nothing drives, beyond those of the symmetries.
    damped : bool
        Whether forces act.
    """

    equilibrium: Equilibrium
    exponents: np.ndarray
    shapes: np.ndarray
    signatures: tuple[int | None, ...]
    definite: bool
    neutral: int
    damped: bool

    def __len__(self) -> int:
        return len(self.exponents)

    @property
    def system(self) -> System:
        """The scene."""
        return self.equilibrium.system

    @property
    def frequencies(self) -> np.ndarray:
        """Angular frequencies |Im s|, (k,); 0 where a mode does not oscillate."""
        return np.abs(self.exponents.imag)

    @property
    def periods(self) -> np.ndarray:
        """2π/ω, infinite where a mode does not oscillate."""
        with np.errstate(divide="ignore"):
            return 2 * np.pi / self.frequencies

    @property
    def growth(self) -> np.ndarray:
        """Rates Re s of growth, (k,)."""
        return self.exponents.real

    @property
    def verdict(self) -> str:
        """Stability in words."""
        worst = float(self.growth.max(initial=0.0))
        if worst > 0:
            return f"unstable: grows e-fold in {1 / worst:.6g}"
        if self.damped:
            calm = bool((self.growth < 0).all()) and not self.neutral
            return "asymptotically stable: every motion about it decays" if calm else "neutral"
        if self.neutral:
            return "neutral: to first order it may drift away"
        if not len(self):
            return "neutral: nothing moves about it but along the symmetries"
        if self.definite:
            return "stable: the energy is definite there (Lagrange–Dirichlet)"
        return "linearly stable: the energy is indefinite, beyond the linear motion all is open"

    def start(self, k: int = 0, amplitude: float = 1e-2) -> tuple[np.ndarray, np.ndarray]:
        """(q0, v0) of a mode with this displacement of the coordinate that moves most; a guess for
        `periodic`.
        """
        one = self.motion(k, amplitude, frames=2)
        return one.q[0], one.v[0]

    def orbit(self, k: int = 0, amplitude: float = 1e-3, rule: Rule | None = None) -> Orbit:
        """The periodic orbit of the full equations that goes over into a mode for small
        amplitudes, with the energy of the mode; the first of a family.
        """
        k = self._index(k)
        if not self.frequencies[k] or self.growth[k] or self.damped:
            raise InputError(f"mode {k} is no undamped oscillation: no periodic orbits begin there")
        q, v = self.start(k, amplitude)
        values = self.equilibrium.parameters
        x = state_of(self.system, q, v, 0.0, self.equilibrium.c)
        energy = energy_at(self.system, x, 0.0, self.equilibrium.c)
        long = float(self.periods[k])
        near = guess_of(self.system, (q, v), long, values, 0.0, None)
        return orbit_near(self.system, near, rule, Sought(long, energy))[0]

    def motion(self, k: int = 0, amplitude: float = 0.1, *, frames: int = FRAMES) -> Trajectory:
        """One period of a mode as a motion of the linear equations, with constraints put on their
        manifold; of a mode that does not oscillate, until it has grown e-fold.
        """
        which, size = self._index(k), number("amplitude", amplitude)
        s, shape = self.exponents[which], self.shapes[which]
        frames = positive_integer("frames", frames)
        long = 2 * np.pi / abs(s.imag) if s.imag else 1 / abs(s.real)
        t = np.linspace(0.0, long, frames + 1)
        wave = size * np.exp(s * t)
        at, c = self.equilibrium.q, self.equilibrium.c
        q = at + (wave[:, None] * shape).real
        v = (s * wave[:, None] * shape).real
        x = np.array([state_of(self.system, a, b, 0.0, c) for a, b in zip(q, v, strict=True)])
        n = len(at)
        first = simulate(
            self.system,
            q0=x[0, :n],
            p0=x[0, n:],
            h=long / frames,
            steps=1,
            params=self.equilibrium.parameters,
            progress=False,
        )
        none = None if first.active_set is None else np.zeros(len(t), dtype=int)
        u = np.empty((frames, 1, 0))
        every = np.arange(frames + 1)
        return replace(first, t=t, q=x[:, :n], p=x[:, n:], k=every, u=u, active_set=none)

    def _index(self, k: Any) -> int:
        if not isinstance(k, (int, np.integer)) or not -len(self) <= k < len(self):
            raise InputError(f"there are {len(self)} modes, 0 to {len(self) - 1}; got {k!r}")
        return int(k) % len(self)

    def save(self, path: Any) -> None:
        """Write the equilibrium with its scene to one ``.npz`` file, from which `varint.load` finds
        the modes again.
        """
        save_equilibria(path, MODES, (self.equilibrium,))

    def rows(self) -> list[tuple[str, str]]:
        """What is printed: name and value."""
        marks = {1: "energy +", -1: "energy −", 0: "energy ±", None: ""}
        rows = []
        for i, (s, u, sign) in enumerate(
            zip(self.exponents, self.shapes, self.signatures, strict=True)
        ):
            if s.imag:
                what = f"ω = {abs(s.imag):.10g}"
                what += f", rate {s.real:.6g}" if s.real else ""
            else:
                what = f"rate {s.real:.10g}"
            parts = zip(self.system.names, u, strict=True)
            shape = ", ".join(f"{name} {_complex(x)}" for name, x in parts)
            rows.append((f"mode {i}", f"{what}   ({shape})   {marks[sign]}".rstrip()))
        return rows

    def __repr__(self) -> str:
        return f"NormalModes({self.verdict})"

    def __str__(self) -> str:
        return "\n".join([self.verdict, *(f"  {a}  {b}" for a, b in self.rows())])

    def _repr_html_(self) -> str:
        return table(self.verdict, self.rows())

    def plot(self) -> Figure:
        """The shape of every mode, with its frequency."""
        from varint.drawing.orbit_figures import modes_figure

        return modes_figure(self.exponents, self.shapes, self.system.names)

    def animate(
        self,
        k: int = 0,
        path: Any = None,
        *,
        amplitude: float = 0.3,
        sketch: Sketch | None = None,
        speed: float = 1.0,
    ) -> FuncAnimation:
        """Film of one period of a mode; see `Trajectory.animate`."""
        return self.motion(k, amplitude).animate(path, sketch=sketch, speed=speed)


def _complex(x: complex) -> str:
    real, imaginary = (y if abs(y) > TINY else 0.0 for y in (x.real, x.imag))
    return f"{real:.5g}{imaginary:+.5g}i" if imaginary else f"{real:.5g}"


def normal_modes(
    system: System, at: Any = None, *, params: ParameterValues | None = None
) -> NormalModes:
    """Small oscillations about an equilibrium, M ẍ + C ẋ + K x = 0 with C = ∂²L/∂v∂q − its
    transpose, K = −∂²(L + λ·g)/∂q², on the tangents of the constraints.

    Gyroscopic terms, as in turning frames and magnetic fields, make the shapes complex; forces add
    their slopes. Neutral directions of symmetries, and what is conjugate to them, are divided out.

    Parameters
    ----------
    system : System
        Autonomous.
    at : Equilibrium or array (n,)
        From `equilibria`, or coordinates where the scene rests.
    params : dict, optional
        Parameter values that differ from the defaults.

    Returns
    -------
    NormalModes
        Prints its verdict and a table; `plot`, `animate`, and `start` as a guess for `periodic`.

    Raises
    ------
    InputError
        If the scene does not rest there.

    References
    ----------
    Goldstein, Classical Mechanics, chapter 6; Arnold, Mathematical Methods of Classical Mechanics,
    appendix 6; MacKay, in: Nonlinear Phenomena and Chaos, 1986 (signatures).

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.double_pendulum()
    >>> modes = vi.orbits.normal_modes(model.system, [0.0, 0.0])
    >>> g = float(modes.equilibrium.parameters["g"])
    >>> [round(float(x), 12) for x in modes.frequencies**2 / g]  # 2 ∓ √2
    [0.585786437627, 3.414213562373]
    """
    require_restful(system)
    if system.structure.nonholonomic:
        raise InputError("normal modes are those of scenes without non-holonomic rows")
    if isinstance(at, Equilibrium):
        if at.system is not system:
            raise InputError("the equilibrium is one of another system")
        where = at
    else:
        if at is None:
            raise InputError("give at=, an Equilibrium or coordinates where the scene rests")
        n = system.structure.n
        q = vector("at", finite_array("at", at), n, system.names)
        where = rest(system, q, parameter_values(system, params))
        if np.abs(where.q - q).max() > 1e-6 * max(np.abs(q).max(), 1.0):
            raise InputError(
                f"the scene does not rest at {q}, but at {where.q}: take equilibria(system, guess)"
            )
    return NormalModes(where, *modes_at(where), system.structure.forced)
