"""Frequency maps: the fundamental frequencies of many motions, how they drift, and resonances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import gcd
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.ensembles.result import Ensemble
from varint.errors import InputError
from varint.numerics.progress import progress_bar
from varint.orbits.files import save
from varint.orbits.frequency import Frequencies, naff, signal_values
from varint.results.trajectory import Trajectory
from varint.scene.inputs import finite_array, number, positive_integer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HIGHEST_ORDER = 12  # Σ|k_i| of the resonances that are looked for unasked
NEAR = 1e-4  # |k·ν| of |k| |ν|: so near is locked, or all but
LEAST = 1e-16
LINES = 3  # of each signal: the strongest may be its mean


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """Fundamental frequencies of many motions.

    Attributes
    ----------
    first, second : ndarray (K, d)
        Frequencies in both halves of the time, a column each signal.
    """

    first: np.ndarray
    second: np.ndarray

    @property
    def frequencies(self) -> np.ndarray:
        """The mean of both halves, (K, d)."""
        return (self.first + self.second) / 2

    @property
    def diffusion(self) -> np.ndarray:
        """log₁₀ |ν′ − ν|/|ν| of the halves, (K,): −10 and less on tori, above −4 in chaos."""
        moved = np.linalg.norm(self.second - self.first, axis=1)
        return np.log10(np.maximum(moved / np.linalg.norm(self.frequencies, axis=1), LEAST))

    def resonances(self, order: int = HIGHEST_ORDER, near: float = NEAR) -> list[str]:
        """The resonance of each motion in words, empty where there is none."""
        return [
            "" if k is None else resonance_name(k)
            for k in (resonance(row, order, near) for row in self.frequencies)
        ]

    def __repr__(self) -> str:
        return f"FrequencyMap({len(self.first)} motions, {self.first.shape[1]} frequencies)"

    def plot(self, order: int = HIGHEST_ORDER, near: float = NEAR) -> Figure:
        """The first two frequencies, coloured by their diffusion, with the resonances met."""
        from varint.drawing.chaos_figures import frequency_map_figure

        if self.first.shape[1] < 2:
            raise InputError("a map is drawn of two frequencies and more; this one has one")
        met = [resonance(row[:2], order, near) for row in self.frequencies]
        counted = {k: met.count(k) for k in met if k is not None}
        strongest = sorted(counted, key=lambda k: -counted[k])
        return frequency_map_figure(self.frequencies, self.diffusion, strongest)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


def frequency_map(
    motions: Ensemble | Sequence[Trajectory],
    signals: Sequence[Any],
    *,
    window: int = 3,
    progress: bool | None = None,
) -> FrequencyMap:
    """Fundamental frequencies ν of many motions, and their change from one half of the time to the
    other: regular motions keep them, chaotic ones diffuse.

    Parameters
    ----------
    motions : Ensemble or sequence of Trajectory
        With nodes at equal distances.
    signals : sequence of SX or (SX, SX)
        One signal a degree of freedom, as for `frequencies`; its strongest line that is not its
        mean counts.
    window : int
        As for `naff`.
    progress : bool, optional
        As for `simulate`, over the motions.

    Returns
    -------
    FrequencyMap

    Raises
    ------
    InputError
        As for `frequencies`.

    References
    ----------
    Laskar, Physica D 67 (1993) 257.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> springs = vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - 2 * q[1] ** 2)
    >>> runs = vi.ensemble(
    ...     springs, vi.gauss(8), q0=[[1, 0.5], [0.3, 1]], v0=[0, 0], h=0.2, steps=1000
    ... )
    >>> vi.orbits.frequency_map(runs, [q[0], q[1]]).resonances()
    ['ν₁ : ν₂ = 1 : 2', 'ν₁ : ν₂ = 1 : 2']
    """
    if isinstance(motions, Trajectory):
        raise InputError("a frequency map is of many motions; frequencies(motion, …) is of one")
    if not isinstance(signals, (list, tuple)) or not len(signals):
        raise InputError(f"signals must be a list of expressions or pairs, got {signals!r}")
    halves: list[list[list[float]]] = [[], []]
    with progress_bar(len(motions), "motion", progress) as move:
        for motion in motions:
            values = [signal_values(motion, signal) for signal in signals]
            count = len(motion.t) // 2
            for half, part in zip(halves, (slice(0, count), slice(count, 2 * count)), strict=True):
                t = motion.t[part]
                half.append([_leading(naff(t, x[part], LINES, window=window), t) for x in values])
            move(1, lambda: "")
    return FrequencyMap(np.array(halves[0]), np.array(halves[1]))


def _leading(found: Frequencies, t: np.ndarray) -> float:
    """The strongest line that turns at all in the time."""
    slowest = 2 * np.pi / abs(t[-1] - t[0])
    turning = found.frequencies[np.abs(found.frequencies) > slowest]
    return float(turning[0]) if len(turning) else 0.0


def resonance(
    frequencies: Any, order: int = HIGHEST_ORDER, near: float = NEAR
) -> tuple[int, ...] | None:
    """Whole numbers k with k · ν = 0: those of least order Σ|k_i| with |k · ν| ≤ near |k| |ν|.

    Parameters
    ----------
    frequencies : array (d,)
        ν.
    order : int
        Highest Σ|k_i| tried.
    near : float
        How near to zero is near.

    Returns
    -------
    tuple of int, or None

    Examples
    --------
    >>> from varint import orbits
    >>> orbits.resonance([1.0, 2.00001]), orbits.resonance([1.0, 2**0.5])
    ((2, -1), None)
    """
    nu, most = finite_array("frequencies", frequencies).ravel(), positive_integer("order", order)
    reach = number("near", near) * float(np.linalg.norm(nu))
    if len(nu) > 6:
        raise InputError(f"resonances of at most 6 frequencies are looked for, got {len(nu)}")
    found: list[tuple[int, float, tuple[int, ...]]] = []
    for k in product(range(-most, most + 1), repeat=len(nu)):
        size = sum(map(abs, k))
        if not 0 < size <= most or next(x for x in k if x) < 0 or gcd(*k) > 1:
            continue
        off = abs(float(np.dot(k, nu)))
        if off <= reach * float(np.linalg.norm(k)):
            found.append((size, off, k))
    return min(found)[2] if found else None


def resonance_name(k: Sequence[int]) -> str:
    """A resonance in words: ν₁ : ν₂ = 2 : 1, or Σ k_i ν_i = 0.

    Examples
    --------
    >>> from varint import orbits
    >>> orbits.resonance_name((1, -2)), orbits.resonance_name((1, -2, 3))
    ('ν₁ : ν₂ = 2 : 1', 'ν₁ − 2 ν₂ + 3 ν₃ = 0')
    """
    letters = [f"ν{chr(0x2081 + i)}" for i in range(len(k))]
    met = [(x, letter) for x, letter in zip(k, letters, strict=True) if x]
    if len(met) == 2 and met[0][0] * met[1][0] < 0:
        (a, first), (b, second) = met
        return f"{first} : {second} = {abs(b)} : {abs(a)}"
    text = " ".join(
        f"{'−' if x < 0 else '+'} {'' if abs(x) == 1 else f'{abs(x)} '}{letter}"
        for x, letter in met
    )
    return f"{text.removeprefix('+ ')} = 0"
