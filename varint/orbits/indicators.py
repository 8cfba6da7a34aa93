"""Indicators of chaos from small displacements of a motion: MEGNO, SALI and GALI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.orbits.carried import Stretch, scene_to_vary, stretches
from varint.orbits.files import save
from varint.orbits.tangent_space import TangentSpace, random_frame, tangent_space
from varint.results.trajectory import Trajectory
from varint.scene.inputs import positive_integer, vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# of the logarithm of a displacement in a stretch: one solver finds it beside the motion, whose
# residuals must stay of like sizes
GROWTH = 20.0
SEEN = 1e-15  # angles between displacements that are told from none
ORDERED = 0.5  # of MEGNO's mean from 2: what finite times leave of regular motions


@dataclass(frozen=True, eq=False)
class Megno:
    """The mean exponential growth of nearby orbits along a motion.

    Attributes
    ----------
    t : ndarray (N + 1,)
        The kept nodes' times.
    values : ndarray (N + 1,)
        Y(t) = 2/t ∫ (δ'/δ) s ds.
    means : ndarray (N + 1,)
        ⟨Y⟩(t) = 1/t ∫ Y ds: to 2 for quasi-periodic motion, to 0 at a stable periodic orbit of an
        isochronous scene, and like λ t/2 in chaos.
    log_lengths : ndarray (N + 1,)
        ln |δ(t)|/|δ(0)|.
    """

    t: np.ndarray
    values: np.ndarray
    means: np.ndarray
    log_lengths: np.ndarray

    @property
    def value(self) -> float:
        """⟨Y⟩ at the end."""
        return float(self.means[-1])

    @property
    def exponent(self) -> float:
        """Largest Lyapunov exponent, ln(|δ(T)|/|δ(0)|)/T, of the whole run."""
        return float(self.log_lengths[-1] / abs(self.t[-1] - self.t[0]))

    def __repr__(self) -> str:
        what = "chaotic" if self.value > 2 + ORDERED else "ordered"
        return f"Megno(⟨Y⟩ = {self.value:.4g} at t = {self.t[-1]:g}: {what})"

    def plot(self) -> Figure:
        """Y, its mean and the length of the displacement over time."""
        from varint.drawing.chaos_figures import megno_figure

        return megno_figure(self.t, self.values, self.means, self.log_lengths)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def megno(
    motion: Trajectory, *, displacement: Any = None, seed: int = 0, progress: bool | None = None
) -> Megno:
    """Whether a motion is ordered or chaotic: MEGNO, Y(T) = 2/T ∫₀ᵀ (δ'/δ) t dt, of a small
    displacement δ.

    The displacement is carried by the tangent map of the run's own steps, so that it is exact for
    the discrete motion; the integral is Σ t ln(δ_k/δ_{k−1}) with t in the middle of the steps. It
    takes two to three times as long as the run has taken.

    Parameters
    ----------
    motion : Trajectory
        From `simulate` with h or steps. What was left out (`save_every`) is computed once more; the
        result has the motion's own nodes.
    displacement : array (2n,), optional
        (δq, δp) at the start, of any length. Default: a random one.
    seed : int
        Of the random one.
    progress : bool, optional
        As for `simulate`.

    Returns
    -------
    Megno

    Raises
    ------
    InputError
        If the run has impacts, variable steps of a time scale, or no Lagrangian flow.
    ConvergenceError
        If a step has no regular derivative.

    References
    ----------
    Cincotta & Simó, Astronomy and Astrophysics Supplement 147 (2000) 205; of maps: Cincotta,
    Giordano & Simó, Physica D 182 (2003) 151.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.henon_heiles(total=1 / 12)
    >>> start = dict(q0=model.q0, v0=model.v0)
    >>> ordered = vi.simulate(model.system, vi.gauss(6), **start, h=0.3, steps=3000)
    >>> vi.orbits.megno(ordered)
    Megno(⟨Y⟩ = 1.542 at t = 900: ordered)
    """
    space = tangent_space(motion, scene_to_vary(motion))
    start = _displacements(motion, space, displacement, 1, seed)

    def renew(s: Stretch) -> tuple[np.ndarray, float]:
        size = float(space.lengths(s.tangents[-1])[0])
        return s.tangents[-1] / size, float(np.log(size))

    keep = _Kept(motion)
    t0, log0, y0, mean0 = float(motion.t[0]), 0.0, 0.0, 0.0
    for s in stretches(motion, start, renew, GROWTH, progress):
        t = s.t - t0
        logs = log0 + np.log(space.lengths(s.tangents)[:, 0])
        steps, middle = np.diff(t), (t[1:] + t[:-1]) / 2
        integral = y0 + np.append(0.0, np.cumsum(middle * np.diff(logs)))  # t Y/2
        with np.errstate(invalid="ignore", divide="ignore"):
            y = np.where(t == 0, 0.0, 2 * integral / t)
            total = mean0 + np.append(0.0, np.cumsum(steps * (y[1:] + y[:-1]) / 2))
            mean = np.where(t == 0, 0.0, total / t)
        keep.add(s.k, y, mean, logs)
        log0, y0, mean0 = float(logs[-1]), float(integral[-1]), float(total[-1])
    return Megno(motion.t, *keep.rows)


@dataclass(frozen=True, eq=False)
class Alignment:
    """How displacements of a motion fall into one direction, or one plane.

    Attributes
    ----------
    t : ndarray (N + 1,)
        The kept nodes' times.
    values : ndarray (N + 1,)
        The index; 0 where it is below what numbers tell.
    count : int
        Displacements that it is made of.
    name : str
    """

    t: np.ndarray
    values: np.ndarray
    count: int
    name: str

    @property
    def value(self) -> float:
        """The index at the end."""
        return float(self.values[-1])

    def __repr__(self) -> str:
        return f"{self.name}({self.value:.3g} at t = {self.t[-1]:g})"

    def plot(self) -> Figure:
        """The index over time, both logarithmic."""
        from varint.drawing.chaos_figures import alignment_figure

        return alignment_figure(self.t, self.values, self.name)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def sali(motion: Trajectory, *, seed: int = 0, progress: bool | None = None) -> Alignment:
    """The smaller alignment index of two displacements of unit length, min(|a + b|, |a − b|).

    It stays of the order of one for ordered motions of two and more degrees of freedom, and falls
    like e^{−(λ₁ − λ₂) t} to round-off in chaos.

    Parameters
    ----------
    motion : Trajectory
        As for `megno`.
    seed : int
        Of the two displacements, random and orthogonal.
    progress : bool, optional
        As for `simulate`.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError, ConvergenceError
        As for `megno`.

    References
    ----------
    Skokos, Journal of Physics A 34 (2001) 10029.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.henon_heiles(q0=(0.0, -0.25), total=1 / 8)
    >>> chaotic = vi.simulate(
    ...     model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.3, steps=4000
    ... )
    >>> vi.orbits.sali(chaotic).value < 1e-12
    True
    """
    return _alignment(motion, 2, seed, progress, "SALI", _smaller)


def gali(
    motion: Trajectory, count: int = 3, *, seed: int = 0, progress: bool | None = None
) -> Alignment:
    """The generalised alignment index of so many displacements: the volume |a ∧ b ∧ …| of unit
    vectors.

    On a torus of d frequencies it stays of one order up to count = d and falls as a power of time
    beyond, t^{−(count − d)} and, past d of the 2n directions, t^{−2(count − n)} for d = n; in chaos
    it falls exponentially, with Σ (λ₁ − λ_i).

    Parameters
    ----------
    motion : Trajectory
        As for `megno`.
    count : int
        Displacements, 2 … 2n.
    seed : int
        Of the displacements, random and orthogonal.
    progress : bool, optional
        As for `simulate`.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError, ConvergenceError
        As for `megno`.

    References
    ----------
    Skokos, Bountis & Antonopoulos, Physica D 231 (2007) 30.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.henon_heiles(total=1 / 12)
    >>> ordered = vi.simulate(
    ...     model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.3, steps=3000
    ... )
    >>> vi.orbits.gali(ordered, 2).value > 0.01 > 1e-4 > vi.orbits.gali(ordered, 4).value
    True
    """
    return _alignment(motion, positive_integer("count", count, 2), seed, progress, "GALI", _volume)


def _smaller(units: np.ndarray) -> np.ndarray:
    a, b = units[..., 0], units[..., 1]
    return np.minimum(np.linalg.norm(a + b, axis=-1), np.linalg.norm(a - b, axis=-1))


def _volume(units: np.ndarray) -> np.ndarray:
    return np.prod(np.linalg.svd(units, compute_uv=False), axis=-1)


def _alignment(
    motion: Trajectory, count: int, seed: int, progress: bool | None, name: str, index: Any
) -> Alignment:
    space = tangent_space(motion, scene_to_vary(motion))
    start = _displacements(motion, space, None, count, seed)
    units = np.concatenate([1 / space.sizes, space.sizes])[:, None]

    def renew(s: Stretch) -> tuple[np.ndarray, float]:
        sizes = space.lengths(s.tangents[-1])
        return s.tangents[-1] / sizes, float(np.log(sizes).max())

    keep = _Kept(motion)
    for s in stretches(motion, start, renew, GROWTH, progress):
        scaled = units * s.tangents
        found = index(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))
        keep.add(s.k, np.where(found > SEEN, found, 0.0))
    return Alignment(motion.t, keep.rows[0], count, name if name == "SALI" else f"{name}_{count}")


class _Kept:
    """Rows of numbers at the motion's own nodes, gathered stretch by stretch."""

    def __init__(self, motion: Trajectory):
        self.k, self.rows = motion.k, np.zeros((3, len(motion)))

    def add(self, k: np.ndarray, *rows: np.ndarray) -> None:
        first, last = np.searchsorted(self.k, [k[0], k[-1]], side="left")
        last += last < len(self.k) and self.k[last] == k[-1]
        at = self.k[first:last] - k[0]
        for row, values in zip(self.rows, rows, strict=False):
            row[first:last] = values[at]


def _displacements(
    motion: Trajectory, space: TangentSpace, given: Any, count: int, seed: int
) -> np.ndarray:
    """Displacements (2n, count) of length one at the first node."""
    x, n = np.concatenate([motion.q[0], motion.p[0]]), motion.q.shape[1]
    out, back = space.maps(x, float(motion.t[0]))
    if given is None:
        most = out.shape[1]
        if count > most:
            raise InputError(
                f"count={count} displacements are more than the {most} dimensions that the scene "
                "moves in"
            )
        frame = random_frame(most // 2, seed)
        return _of_one_length(space, out @ frame[:, :count])
    names = tuple(f"{letter}{name}" for letter in ("δ", "δp_") for name in motion.system.names)
    moved = vector("displacement", given, 2 * n, names)
    if not moved.any():
        raise InputError("the displacement must not be zero in all of (δq, δp)")
    kept = out @ (back @ moved)
    far = space.lengths((kept - moved)[:, None])[0] / space.lengths(moved[:, None])[0]
    if far > 1e-6:
        raise InputError(
            f"the displacement leaves the constraints by {far:.1e} of its length: "
            "(δq, δp) must keep to them and to what they say of momenta"
        )
    return _of_one_length(space, kept[:, None])


def _of_one_length(space: TangentSpace, tangents: np.ndarray) -> np.ndarray:
    return tangents / space.lengths(tangents)
