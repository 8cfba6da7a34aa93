"""Lyapunov exponents of a motion, all of them or the largest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.orbits.carried import Stretch, scene_to_vary, stretches
from varint.orbits.files import save
from varint.orbits.tangent_space import random_frame, tangent_space
from varint.results.trajectory import Trajectory
from varint.scene.inputs import positive_integer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# of the logarithms of stretching between two decompositions: of a matrix with this condition the
# smallest diagonal entry keeps thirteen digits
APART = 6.0
BATCHES = 16  # of a run, whose means tell the statistical error


@dataclass(frozen=True, eq=False)
class LyapunovSpectrum:
    """Lyapunov exponents of a motion.

    Attributes
    ----------
    t : ndarray (K,)
        Times at which the frame was made orthonormal.
    history : ndarray (K, m)
        The exponents that the run until then has: they go to their limits like 1/t.
    errors : ndarray (m,)
        Statistical errors, from the means of 16 parts of the run; in ordered motions, where parts
        are alike, the exponents themselves are what ln(t)/t has left.
    pairing : float
        Largest |λ_i + λ_{2d+1−i}|, 0 to round-off where the flow is symplectic; not a number where
        not all exponents were asked for.
    """

    t: np.ndarray
    history: np.ndarray
    errors: np.ndarray
    pairing: float

    @property
    def exponents(self) -> np.ndarray:
        """λ₁ ≥ λ₂ ≥ … (m,), per unit of time."""
        return self.history[-1]

    @property
    def sum(self) -> float:
        """Σ λ_i: 0, or the mean divergence of the flow, where all were asked for."""
        return float(self.exponents.sum())

    def __repr__(self) -> str:
        shown = ", ".join(
            f"{x:.4g} ± {e:.1g}" for x, e in zip(self.exponents, self.errors, strict=True)
        )
        return f"LyapunovSpectrum({shown})"

    def plot(self) -> Figure:
        """The exponents of the run until each time."""
        from varint.drawing.chaos_figures import spectrum_figure

        return spectrum_figure(self.t, self.history)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def lyapunov_spectrum(
    motion: Trajectory, count: int | None = None, *, seed: int = 0, progress: bool | None = None
) -> LyapunovSpectrum:
    """Lyapunov exponents, λ_i = lim 1/T ln R_ii of the tangent map Φ = Q R.

    Displacements are carried by the derivatives of the run's own steps and made orthonormal
    whenever they have come apart. Where the flow is symplectic and all exponents are asked for,
    they come in pairs ±λ to round-off, at any finite time: the frame is a unitary one, [[Re U, −Im
    U], [Im U, Re U]], and stays one, for the factors of a symplectic matrix are unitary and
    triangular symplectic (Iwasawa's decomposition) if columns are ordered q₁ … q_d, p_d … p₁. With
    constraints the exponents are the 2d of the motions on them.

    Parameters
    ----------
    motion : Trajectory
        From `simulate` with h or steps. What was left out (`save_every`) is computed once more.
    count : int, optional
        Only so many of the largest. Default: all, 2n without constraints.
    seed : int
        Of the frame at the start.
    progress : bool, optional
        As for `simulate`.

    Returns
    -------
    LyapunovSpectrum

    Raises
    ------
    InputError
        If the run has impacts, variable steps of a time scale, or non-holonomic constraints.
    ConvergenceError
        If a step has no regular derivative.

    References
    ----------
    Benettin, Galgani, Giorgilli & Strelcyn, Meccanica 15 (1980) 9; the decomposition: Helgason,
    Differential Geometry, Lie Groups, and Symmetric Spaces, 1978, VI.3.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.henon_heiles(q0=(0.0, -0.25), total=1 / 8)
    >>> chaotic = vi.simulate(
    ...     model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.3, steps=4000
    ... )
    >>> found = vi.orbits.lyapunov_spectrum(chaotic)
    >>> bool(0.02 < found.exponents[0] < 0.08), found.pairing < 1e-12
    (True, True)
    """
    space = tangent_space(motion, scene_to_vary(motion))
    out, _ = space.maps(np.concatenate([motion.q[0], motion.p[0]]), float(motion.t[0]))
    size = out.shape[1]
    wanted = size if count is None else positive_integer("count", count)
    if wanted > size:
        raise InputError(f"count={wanted} is more than the {size} exponents that the scene has")
    if size == 0:
        raise InputError("the constraints leave nothing that could move")
    order = np.append(np.arange(size // 2), np.arange(size)[: size // 2 - 1 : -1])
    times, logs = [float(motion.t[0])], [np.zeros(wanted)]

    def renew(s: Stretch) -> tuple[np.ndarray, float]:
        out, back = space.maps(s.end, float(s.t[-1]))
        frame, stretched = np.linalg.qr((back @ s.tangents[-1])[order])
        diagonal = np.diag(stretched)
        grown = np.log(np.abs(diagonal))
        times.append(float(s.t[-1]))
        logs.append(grown)
        tangents = out[:, order] @ (frame * np.sign(diagonal))
        return tangents, float(np.ptp(grown) if wanted > 1 else abs(grown[0]))

    frame = random_frame(size // 2, seed)[np.ix_(order, order)][:, :wanted]
    for _ in stretches(motion, out[:, order] @ frame, renew, APART, progress):
        continue
    t = np.array(times)
    elapsed, total = np.abs(t[1:] - t[0]), np.cumsum(logs, axis=0)
    rank = np.argsort(-total[-1], kind="stable")
    history = total[1:, rank] / elapsed[:, None]
    pairs = history[-1] + history[-1][::-1] if wanted == size else np.array([np.nan])
    return LyapunovSpectrum(
        t[1:], history, _errors(np.append(0.0, elapsed), total[:, rank]), float(np.abs(pairs).max())
    )


def _errors(t: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Standard errors of mean rates from those of equal parts of the run."""
    edges = np.linspace(0, t[-1], BATCHES + 1)
    at = np.array([np.interp(edges, t, column) for column in total.T])
    return np.diff(at, axis=1).std(axis=1, ddof=1) / np.diff(edges).mean() / np.sqrt(BATCHES)
