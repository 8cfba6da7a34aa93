"""Frequencies of a quasi-periodic signal, by Laskar's analysis of fundamental frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.orbits.files import save
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.scene.inputs import positive_integer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEWEST = 16  # samples
UNEVEN = 1e-6  # of the time between samples: more is no even grid
ROUND_OFF = 1e-14  # of the largest amplitude: lines below it are not looked for
PEAK_STEPS, JOINT_STEPS = 20, 12
WORTH = 0.01  # of what is left: corrections that take off less are the last
SETTLED = 1e-15  # of the frequencies' unit, the band 2π/dt


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Lines of a signal, z(t) ≈ Σ A_k e^{i (ν_k t + φ_k)}, or the real part of that for real
    signals.

    Attributes
    ----------
    frequencies : ndarray (m,)
        ν_k, radians per unit of time, the largest amplitude first; positive for real signals.
    amplitudes, phases : ndarray (m,)
        A_k > 0 and φ_k, the phase at t = 0.
    residual : float
        Root mean square of what is left, by the window.
    real : int
        1 where the signal was real.
    """

    frequencies: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    residual: float
    real: int

    def __repr__(self) -> str:
        shown = ", ".join(f"{x:.8g}" for x in self.frequencies[:3])
        return f"Frequencies({shown}{', …' if len(self.frequencies) > 3 else ''})"

    def at(self, t: Any) -> np.ndarray:
        """The sum of the lines at times (k,)."""
        times = np.asarray(t, dtype=float)
        turns = np.exp(1j * (np.multiply.outer(times, self.frequencies) + self.phases))
        found = turns @ self.amplitudes
        return found.real if self.real else found

    def plot(self) -> Figure:
        """The line spectrum."""
        from varint.drawing.chaos_figures import lines_figure

        return lines_figure(self.frequencies, self.amplitudes, self.residual)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def frequencies(motion: Trajectory, signal: Any, count: int = 5, *, window: int = 3) -> Frequencies:
    """Frequencies, amplitudes and phases of an expression along a motion; see `naff`.

    Parameters
    ----------
    motion : Trajectory
        With nodes at equal distances.
    signal : SX or (SX, SX)
        A real signal x, or x + i y of a pair such as (q, p), which tells the sign of a frequency.
    count : int
        Lines wanted.
    window : int
        As for `naff`.

    Returns
    -------
    Frequencies

    Raises
    ------
    InputError
        If the nodes have unequal distances, or the signal is no scalar.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> springs = vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - q[1] ** 2)
    >>> motion = vi.simulate(springs, vi.gauss(8), q0=[1, 1], v0=[0, 0], h=0.2, steps=2000)
    >>> found = vi.orbits.frequencies(motion, q[0] + 0.3 * q[1], count=2)
    >>> bool(np.allclose(found.frequencies, [1, np.sqrt(2)], atol=1e-12))
    True
    """
    values = signal_values(motion, signal)
    return naff(motion.t, values, count, window=window)


def signal_values(motion: Trajectory, signal: Any) -> np.ndarray:
    """A signal along a motion, complex for a pair."""
    require_trajectory(motion)
    pair = signal if isinstance(signal, (tuple, list)) else (signal,)
    if len(pair) not in (1, 2) or not all(isinstance(x, ca.SX) and x.numel() == 1 for x in pair):
        raise InputError(
            f"the signal must be one SX expression, or a pair (x, y) for x + i y, got {signal!r}"
        )
    values = [motion.value(x) for x in pair]
    return values[0] if len(values) == 1 else values[0] + 1j * values[1]


def naff(t: Any, z: Any, count: int = 5, *, window: int = 3) -> Frequencies:
    """Frequencies ν_k of z(t) = Σ a_k e^{iν_k t} + …, by Laskar's method.

    Each is where |∫ z(t) e^{−iνt} χ(t) dt| is largest, with the window χ ∝ (1 + cos(2πt/T))^p: its
    error falls like T^{−2p−2}, where a transform's is 2π/T. What has been found is taken off by
    least squares; in the end all frequencies and amplitudes are corrected together by the
    Gauss–Newton method in the same window, so that lines do not disturb each other: sums of `count`
    lines come out to round-off.

    Parameters
    ----------
    t : array (N,)
        Times at equal distances.
    z : array (N,)
        Real or complex values.
    count : int
        Lines wanted; fewer come where nothing is left.
    window : int
        p, 0 … 8. A higher one parts a line from far ones better and from near ones worse.

    Returns
    -------
    Frequencies

    Raises
    ------
    InputError
        If there are fewer than 16 samples, they are not finite, or their distances differ.

    References
    ----------
    Laskar, Icarus 88 (1990) 266; Laskar, Physica D 67 (1993) 257; the corrections together:
    Šidlichovský & Nesvorný, Celestial Mechanics 65 (1996) 137.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> t = np.arange(2000) * 0.1
    >>> found = vi.orbits.naff(t, np.cos(1.234567890123 * t) + 0.01 * np.sin(5.4 * t), 2)
    >>> bool(np.allclose(found.frequencies, [1.234567890123, 5.4], rtol=1e-13))
    True
    """
    times, values = _samples(t, z)
    wanted = positive_integer("count", count)
    p = positive_integer("window", window, 0)
    if p > 8:
        raise InputError(f"window must be 0 … 8, got {p}")
    real = not np.iscomplexobj(values)
    middle, dt = (times[0] + times[-1]) / 2, float(times[1] - times[0])
    tau = times - middle
    # (1 + cos)^p with mean one over the run
    weight = (1 + np.cos(2 * np.pi * tau / (len(tau) * dt))) ** p * 2.0**p / comb(2 * p, p)
    fit = _Fit(tau, values, weight, real)
    nu, largest = np.empty(0), 0.0
    coefficients, rest = np.empty(0), values
    for _ in range(wanted):
        one, size = _peak(tau, weight * rest, dt, real)
        if size <= ROUND_OFF * largest or size == 0:
            break
        largest = max(largest, size)
        nu = np.append(nu, one)
        coefficients, rest = fit.amplitudes(nu)
    nu, coefficients, rest = fit.together(nu, coefficients, rest, 2 * np.pi / dt)
    a = coefficients[0::2] + 1j * coefficients[1::2]
    if real:
        a, nu = np.where(nu < 0, a.conj(), a), np.abs(nu)
    order = np.argsort(-np.abs(a), kind="stable")
    a, nu = a[order], nu[order]
    phases = np.angle(a * np.exp(-1j * nu * middle))
    residual = float(np.sqrt((weight * np.abs(rest) ** 2).mean()))
    return Frequencies(nu, np.abs(a), phases, residual, int(real))


def _samples(t: Any, z: Any) -> tuple[np.ndarray, np.ndarray]:
    times = parsed_or_refused(
        lambda: np.asarray(t, dtype=float), lambda: f"t must be times (N,), got {t!r}"
    )
    values = parsed_or_refused(
        lambda: np.asarray(z) + 0.0, lambda: f"z must be numbers (N,), got {z!r}"
    )
    if times.ndim != 1 or values.shape != times.shape or len(times) < FEWEST:
        raise InputError(
            f"t and z must be as many times and values, at least {FEWEST}; got shapes "
            f"{times.shape} and {values.shape}"
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise InputError("t and z must be finite")
    steps = np.diff(times)
    if np.abs(steps - steps.mean()).max() > UNEVEN * abs(steps.mean()) or steps.mean() == 0:
        raise InputError(
            "the times must lie at equal distances; of a motion with variable steps take "
            "motion.at(np.linspace(t0, t1, N))"
        )
    return times, values


def _peak(tau: np.ndarray, z: np.ndarray, dt: float, real: bool) -> tuple[float, float]:
    """ν where |∫ z e^{−iνt}| is largest, and how large: from the transform by Newton's method."""
    size = 2 ** int(np.ceil(np.log2(2 * len(z))))
    bins = 2 * np.pi * np.fft.fftfreq(size, dt)
    height = np.abs(np.fft.fft(z, size))
    if real:
        height[bins < 0] = 0.0
    at = int(np.argmax(height))
    nu, width = float(bins[at]), 2 * np.pi / (size * abs(dt))
    low, high = nu - width, nu + width
    if real and at == 0:
        return 0.0, float(height[0] / len(z))
    for _ in range(PEAK_STEPS):
        turned = z * np.exp(-1j * nu * tau)
        f, f1, f2 = turned.sum(), (-1j * tau * turned).sum(), (-(tau**2) * turned).sum()
        slope = (f.conjugate() * f1).real
        bend = abs(f1) ** 2 + (f.conjugate() * f2).real
        low, high = (nu, high) if slope > 0 else (low, nu)
        new = nu - slope / bend if bend < 0 else (low + high) / 2
        new = new if low <= new <= high else (low + high) / 2
        if abs(new - nu) <= SETTLED * 2 * np.pi / abs(dt):
            break
        nu = new
    return nu, float(abs(f) / len(z))


def _least_squares(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Through the factors, so that dependent columns are met in a small matrix."""
    q, r = np.linalg.qr(columns)
    return np.linalg.lstsq(r, q.T @ wanted, rcond=None)[0]


class _Fit:
    """Least squares of lines in a window."""

    def __init__(self, tau: np.ndarray, values: np.ndarray, weight: np.ndarray, real: bool):
        self.tau, self.values, self.real = tau, values, real
        self.root = np.sqrt(weight)

    def _stacked(self, columns: np.ndarray) -> np.ndarray:
        """Complex numbers as real ones, in the window."""
        columns = columns * (self.root[:, None] if columns.ndim == 2 else self.root)
        return columns.real if self.real else np.concatenate([columns.real, columns.imag])

    def _basis(self, nu: np.ndarray) -> np.ndarray:
        turns = np.exp(1j * np.multiply.outer(self.tau, nu))
        return np.stack([turns, 1j * turns], axis=-1).reshape(len(self.tau), -1)

    def _left(self, basis: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        found = basis @ coefficients
        return self.values - (found.real if self.real else found)

    def amplitudes(self, nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Real and imaginary parts of the amplitudes in turn, and what they leave of the signal."""
        basis = self._basis(nu)
        found = _least_squares(self._stacked(basis), self._stacked(self.values))
        return found, self._left(basis, found)

    def together(
        self, nu: np.ndarray, coefficients: np.ndarray, rest: np.ndarray, unit: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequencies and amplitudes corrected together, as long as less is left."""
        if not len(nu):
            return nu, coefficients, rest
        best = float(np.linalg.norm(self._stacked(rest)))
        half = (self.tau[-1] - self.tau[0]) / 2
        for _ in range(JOINT_STEPS):
            basis = self._basis(nu)
            a = coefficients[0::2] + 1j * coefficients[1::2]
            turned = 1j * (self.tau / half)[:, None] * basis[:, 0::2] * a  # of ν in units 1/half
            moving = (nu != 0) | (not self.real)
            columns = self._stacked(np.hstack([basis, turned[:, moving]]))
            change = _least_squares(columns, self._stacked(rest))
            new = nu.copy()
            new[moving] += change[2 * len(nu) :] / half
            found, left = self.amplitudes(new)
            size = float(np.linalg.norm(self._stacked(left)))
            if not size < best:
                break
            done = np.abs(new - nu).max() <= SETTLED * unit or size > (1 - WORTH) * best
            nu, coefficients, rest, best = new, found, left, size
            if done:
                break
        return nu, coefficients, rest
