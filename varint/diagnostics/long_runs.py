"""What only many steps show: the slope of the energy, and how round-off grows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.diagnostics.reversibility import is_even
from varint.diagnostics.runs import EPS, Scene, march, mark, scene
from varint.integration.problem import Start
from varint.rules.rule import Rule
from varint.scene.inputs import number, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# standard errors of a slope: chaotic motions reach 9, RK4 and Euler have hundreds and more
SIGNIFICANT = 15.0
NEGLIGIBLE = 1e-3  # of the oscillation, over the whole run: what windows leave of it
PARTS = 4  # windows that fit into the run side by side: long ones average oscillations out
ROUND_OFF = 30.0  # eps × √steps: a drift below it is round-off


@dataclass(frozen=True, eq=False)
class EnergySlope:
    """Slope of windowed means of the energy.

    Attributes
    ----------
    method : str
    h : float
    t, energy : ndarray (N + 1,)
    centres, means : ndarray (windows,)
        Times and weighted means of the windows.
    slope, noise : float
        Slope of the means over time and its standard error.
    floor : float
        Slope that round-off alone may cause.
    passed : bool or None
        None where the scene does not conserve energy.
    """

    method: str
    h: float
    t: np.ndarray
    energy: np.ndarray
    centres: np.ndarray
    means: np.ndarray
    slope: float
    noise: float
    floor: float
    passed: bool | None

    @property
    def oscillation(self) -> float:
        """Largest energy error."""
        return float(np.abs(self.energy - self.energy[0]).max())

    def __str__(self) -> str:
        if self.passed is None:
            return (
                f"{mark(None)} energy is not conserved by this scene (forces, impacts, or L "
                "depends on time)"
            )
        what = "no drift of energy" if self.passed else "energy drifts"
        return (
            f"{mark(self.passed)} {what}: slope {self.slope:.1e} ± {self.noise:.1e} (round-off "
            f"{self.floor:.1e}), oscillation {self.oscillation:.1e} over {len(self.t) - 1} steps"
        )

    def plot(self) -> Figure:
        """Energy error over time with its windowed means."""
        from varint.drawing.diagnostic_figures import energy_figure

        return energy_figure(
            self.method, (self.t, self.energy), (self.centres, self.means), self.slope, self.noise
        )


def energy_slope(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    steps: int = 10_000,
    windows: int = 20,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> EnergySlope:
    """Slope of windowed means of H over a run, against its own noise.

    The windows, a quarter of the run long and overlapping, are weighted by a bump ∝ exp(−1/(x(1 −
    x))), which averages oscillations out far better than a box.

    Parameters
    ----------
    system, method, q0, v0, p0, h, params, t0, u
        As in `symplectic_defect`.
    steps, windows : int

    Returns
    -------
    EnergySlope
        Passed if the slope is within its noise, or negligible against the oscillation, or what
        round-off alone does.
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    h, steps, windows = (
        number("h", h),
        positive_integer("steps", steps),
        positive_integer("windows", windows, least=3),
    )
    q, p, t = march(start, h, steps)
    energy = start.energy(q, p, t)
    centres, means = window_means(t, energy, windows)
    x, y = centres - centres.mean(), means - means.mean()
    slope = float(x @ y / (x @ x))
    overlap = max(windows / PARTS, 1.0)
    noise = float(np.sqrt(((y - slope * x) ** 2).sum() * overlap / (windows - 2) / (x @ x)))
    size = np.abs(energy).max() + (np.abs(p) * np.abs(np.gradient(q, t, axis=0))).sum(axis=1).max()
    floor = ROUND_OFF * EPS * np.sqrt(steps) * size / abs(t[-1] - t[0])
    around = np.ptp(energy - slope * (t - t[0]))
    least = max(SIGNIFICANT * noise, NEGLIGIBLE * around / abs(t[-1] - t[0]), floor)
    good = bool(np.isfinite(slope) and abs(slope) <= least)
    passed = (
        None
        if system.structure.forced or not system.structure.autonomous or start.dissipates
        else good
    )
    return EnergySlope(start.name, h, t, energy, centres, means, slope, noise, float(floor), passed)


def window_means(t: np.ndarray, values: np.ndarray, windows: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres and bump-weighted means of overlapping windows, a quarter of the run long each."""
    length = max(len(t) // PARTS, 2)
    x = (np.arange(length) + 0.5) / length
    weight = np.exp(-1 / (x * (1 - x)))
    weight /= weight.sum()
    starts = np.linspace(0, len(t) - length, windows).astype(int)
    first = values[0]
    means = np.array([(values[i : i + length] - first) @ weight for i in starts]) + first
    return np.array([t[i : i + length] @ weight for i in starts]), means


@dataclass(frozen=True, eq=False)
class RoundOff:
    """Growth of round-off: error of runs there and back against their length.

    Attributes
    ----------
    method : str
    h : float
    steps : ndarray (k,)
    state, energy : ndarray (k,)
        Root mean squares, over several starts, of the relative errors of (q, p) and of H on return.
    exponent : float
        e of the growth law of the energy error, ∝ steps**e: ½ random walk, 1 steady; more is
        systematic.
    passed : bool or None
        None where impacts lose energy.
    """

    method: str
    h: float
    steps: np.ndarray
    state: np.ndarray
    energy: np.ndarray
    exponent: float
    passed: bool | None

    def __str__(self) -> str:
        if self.passed is None:
            return f"{mark(None)} round-off: impacts lose energy, no run leads back"
        what = "round-off" if self.passed else "errors beyond round-off"
        return (
            f"{mark(self.passed)} {what}: energy error {self.energy[-1]:.1e} after "
            f"{self.steps[-1]} steps there and back, ∝ steps^{self.exponent:.2f}; state "
            f"{self.state[-1]:.1e}"
        )

    def plot(self) -> Figure:
        """Errors on return over the number of steps."""
        from varint.drawing.diagnostic_figures import round_off_figure

        return round_off_figure(self.method, self.steps, self.state, self.energy, self.exponent)


# eps: energy error that a hundred steps there and back may leave, times √steps/10
FIRST_LEVEL = 30.0
STEEPEST = 1.25  # exponent of the growth law: 1 and the scatter of its fit
STARTS = 6
NUDGE = 1e-3


def round_off(
    system: System,
    method: Rule | ca.Function | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float,
    steps: int = 3000,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> RoundOff:
    """Growth law of round-off: error of N steps there and back, which a reversible method leaves to
    round-off alone.

    Parameters
    ----------
    system, method, q0, v0, p0, h, params, t0, u
        As in `symplectic_defect`.
    steps : int
        Longest run.

    Returns
    -------
    RoundOff
        Passed if the energy error grows no faster than steps^1.25 and starts at the level of
        round-off (Hairer, Lubich & Wanner, VIII.5).
    """
    start = scene(system, method, Start(q0, v0, p0, t0, params, u))
    h, steps = number("h", h), positive_integer("steps", steps)
    if start.dissipates:
        nothing = np.full(1, np.nan)
        return RoundOff(start.name, h, np.array([steps]), nothing, nothing, float("nan"), None)
    levels = np.unique(np.geomspace(max(steps // 100, 10), steps, 6).astype(int))
    rng, flip = np.random.default_rng(1), is_even(system)
    state, energy = np.zeros((STARTS, len(levels))), np.zeros((STARTS, len(levels)))
    starts = 1 if start.is_held else STARTS
    for i in range(starts):
        factor = 1 + NUDGE * rng.uniform(-1, 1, len(start.q)) * (i > 0)
        state[i], energy[i] = _there_and_back(start, h, levels, start.q * factor, flip)
    mean_state, mean_energy = (np.sqrt((x[:starts] ** 2).mean(axis=0)) for x in (state, energy))
    seen = np.maximum(mean_energy, EPS / 10)
    exponent = float(np.polyfit(np.log(levels), np.log(seen), 1)[0]) if len(levels) > 1 else 0.0
    level = FIRST_LEVEL * EPS * np.sqrt(levels[0] / 10)
    good = bool(
        np.isfinite(seen).all() and seen[0] <= level and (exponent <= STEEPEST or seen[-1] <= level)
    )
    return RoundOff(start.name, h, levels, mean_state, mean_energy, exponent, good)


def _there_and_back(start: Scene, h: float, levels: np.ndarray, q0: np.ndarray, flip: bool):
    q, p, t = march(start, h, int(levels[-1]), q0, start.p)
    size_q, size_p = np.abs(q).max(), np.abs(p).max()
    size = (np.abs(p) * np.abs(np.gradient(q, t, axis=0))).sum(axis=1).max()
    state, ends = [], []
    for k in levels:
        back_q, back_p, _ = march(
            start,
            h if flip else -h,
            int(k),
            q[k],
            -p[k] if flip else p[k],
            start.t if flip else t[k],
        )
        end = back_q[-1], (-back_p[-1] if flip else back_p[-1])
        ends.append(end)
        state.append(
            max(
                np.abs(end[0] - q0).max() / max(size_q, EPS),
                np.abs(end[1] - start.p).max() / max(size_p, EPS),
            )
        )
    at = np.array([q0, *(x for x, _ in ends)]), np.array([start.p, *(x for _, x in ends)])
    h_values = start.energy(*at, np.full(len(ends) + 1, start.t))
    return np.array(state), np.abs(h_values[1:] - h_values[0]) / max(
        size, np.abs(h_values).max(), EPS
    )
