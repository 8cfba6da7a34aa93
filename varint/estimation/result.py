"""What a fit found: estimates with their spread, residuals, and what stays open."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.estimation.measurement import Measurement
from varint.estimation.profile import Profile, profile
from varint.estimation.search import Minimum
from varint.estimation.step_error import moved_in_words
from varint.results.trajectory import Trajectory
from varint.scene.parameters import values_by_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FAR = 3.0  # σ: independent errors have half of the residuals below 0.7 of them
ROUNDED = 1e-12  # of χ² by its degrees of freedom: what is left is round-off, not noise


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters and start values estimated from measurements.

    Attributes
    ----------
    names : tuple of str
        Of everything estimated, entry by entry.
    estimates : ndarray (k,)
        In the same order.
    covariance : ndarray (k, k)
        By the linearised problem, (JᵀJ)⁻¹ along the equations of motion; infinite where the data
        tell nothing.
    params : dict of ndarray
        All parameters of the scene, the estimated ones put in.
    q0, v0 : tuple of ndarray (n,)
        Start of every experiment.
    trajectories : tuple of Trajectory
        The motions fitted, one an experiment.
    data : tuple of tuple of Measurement
        What they were fitted to.
    residuals : tuple of tuple of ndarray
        (ψ − y)/σ of every measurement, in the shape of its values; NaN where none was.
    unidentifiable : tuple of str
        What the data leave open, a sentence each.
    chi_squared : float
        Σ ((ψ − y)/σ)².
    freedom : int
        Values measured less what was estimated from them.
    converged : bool
    steps : int
        Gauss–Newton steps.
    at_bounds : tuple of str
        What bounds hold.
    step_shift : ndarray (k,)
        How far half the step would move the estimates, to first order: what the step's own error
        does to them. More than a tenth of a standard deviation comes with a warning.
    jitter_sigma : tuple of tuple of float
        Standard deviation of every estimated noise level, which stands in `data`; NaN where the
        level was given, infinite where it came out as zero.
    origin : Minimum
        The solver's own numbers, from which profiles start.
    """

    names: tuple[str, ...]
    estimates: np.ndarray
    covariance: np.ndarray
    params: dict[str, np.ndarray]
    q0: tuple[np.ndarray, ...]
    v0: tuple[np.ndarray, ...]
    trajectories: tuple[Trajectory, ...]
    data: tuple[tuple[Measurement, ...], ...]
    residuals: tuple[tuple[np.ndarray, ...], ...]
    unidentifiable: tuple[str, ...]
    chi_squared: float
    freedom: int
    converged: bool
    steps: int
    at_bounds: tuple[str, ...]
    step_shift: np.ndarray
    jitter_sigma: tuple[tuple[float, ...], ...]
    origin: Minimum

    def __repr__(self) -> str:
        parts = [
            f"{name}={x:.6g}±{s:.2g}"
            for name, x, s in zip(self.names, self.estimates, self.sigma, strict=True)
        ]
        return f"Fit({', '.join(parts)})"

    @cached_property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the estimates, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def correlation(self) -> np.ndarray:
        """Correlation of the estimates, (k, k); NaN where the data tell nothing of one."""
        with np.errstate(invalid="ignore"):
            found = self.covariance / np.outer(self.sigma, self.sigma)
        found[~np.isfinite(np.outer(self.sigma, self.sigma))] = np.nan
        return found

    def interval(self, level: float = 0.95) -> np.ndarray:
        """Confidence intervals by the linearised problem, estimate ± z σ, rows (lower, upper).

        Parameters
        ----------
        level : float
            Between 0 and 1.

        Returns
        -------
        ndarray (k, 2)

        Raises
        ------
        InputError
            If the level is none.
        """
        wide = NormalDist().inv_cdf((1 + _level(level)) / 2) * self.sigma
        return np.column_stack([self.estimates - wide, self.estimates + wide])

    def profile(self, name: Any, level: float = 0.95) -> Profile:
        """Profile likelihood of one unknown: min χ² over all others, value after value of it.

        Where the linearised interval is doubtful (few data, an estimate that is not good to a
        fraction of itself, valleys that bend) this one is to be trusted.

        Parameters
        ----------
        name : str or SX
            One of `names`, or the parameter's symbol.
        level : float
            Of the interval, between 0 and 1.

        Returns
        -------
        Profile
            ``interval``, ``values``, ``chi_squared``, ``plot()``.

        Raises
        ------
        InputError
            If the name is none of these, or the data tell nothing of it.
        SolverError
            If another minimum fits the data better.

        Notes
        -----
        Venzon & Moolgavkar, Applied Statistics 37 (1988) 87; Raue et al., Bioinformatics 25 (2009)
        1923.

        Examples
        --------
        >>> import numpy as np
        >>> import varint as vi
        >>> q, v = vi.coordinates("x")
        >>> c = vi.Parameters(k=1.0)
        >>> spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
        >>> t = np.linspace(0, 3, 7)
        >>> seen = vi.Measurement(q, t, np.cos(2 * t), sigma=0.1)
        >>> found = vi.fit(spring, vi.gauss(4), data=seen, unknown="k", h=0.1, q0=1, v0=0)
        >>> found.profile("k")
        Profile(k=4, 95 %: 3.75958 … 4.26151)
        """
        wanted = next(iter(values_by_name([(name, None)])))
        if wanted not in self.names:
            raise InputError(f"profile takes one of {list(self.names)}, got {wanted!r}")
        i = self.names.index(wanted)
        if not np.isfinite(self.sigma[i]):
            raise InputError(f"{wanted} has no profile: the data tell nothing of it")
        return profile(self.origin, i, float(self.sigma[i]), _level(level))

    @cached_property
    def whiteness(self) -> tuple[tuple[float, ...], ...]:
        """√M times the correlation of neighbouring residuals of every measurement: beyond ±2 they
        are not independent, so something is missing in the scene or in the noise.
        """
        return tuple(
            tuple(_neighbours(m.t, r) for m, r in zip(data, parts, strict=True))
            for data, parts in zip(self.data, self.residuals, strict=True)
        )

    @property
    def misfit(self) -> str:
        """That the data are not met, in words, where half of the residuals are far beyond σ."""
        every = np.concatenate([r.ravel() for parts in self.residuals for r in parts])
        middle = float(np.nanmedian(np.abs(every))) if np.isfinite(every).any() else 0.0
        if middle <= FAR or self.freedom <= 0:
            return ""
        held = f"the bounds of {', '.join(self.at_bounds)} in its way, " if self.at_bounds else ""
        return (
            f"the data are not met: half of the residuals are beyond {middle:.2g} σ; the minimum "
            "may be a wrong one (try other guesses, more segments, huber=1.5 against outliers), "
            f"{held}the scene may lack something, or sigma is too small"
        )

    @property
    def step_error(self) -> str:
        """What the step's own error does to the estimates, in words, where it shows."""
        return moved_in_words(self.names, self.step_shift, self.sigma)

    def report(self) -> None:
        """Print estimates with intervals, the size and independence of the residuals, whether the
        data are met, what the step's own error does where it shows, what bounds hold and what the
        data leave open.
        """
        print(self.summary)

    @property
    def summary(self) -> str:
        """What `report` prints."""
        how = "converged" if self.converged else "did NOT converge"
        lines = [f"{how} after {self.steps} Gauss–Newton steps"]
        wide = max((len(name) for name in self.names), default=0)
        rows = zip(self.names, self.estimates, self.sigma, self.interval(), strict=True)
        for name, x, s, (low, high) in rows:
            spread = f"± {s:.2g}   95 %: {low:.6g} … {high:.6g}" if np.isfinite(s) else "not told"
            lines.append(f"  {name:<{wide}}  {x:.8g}  {spread}")
        ratio = self.chi_squared / self.freedom if self.freedom > 0 else float("nan")
        lines.append(
            f"χ² = {self.chi_squared:.4g} for {self.freedom} degrees of freedom: {ratio:.3g}"
        )
        for e, parts in enumerate(self.whiteness):
            for m, white in zip(self.data[e], parts, strict=True):
                if ratio < ROUNDED:
                    continue
                what = "white" if abs(white) <= 2 else "NOT white: neighbours go together"
                lines.append(f"residuals of {m.expression}: {what} ({white:+.1f})")
        for data, spreads in zip(self.data, self.jitter_sigma, strict=True):
            lines += [
                f"noise of {m.expression}: {m.level:.6g} ± {s:.2g}"
                for m, s in zip(data, spreads, strict=True)
                if not np.isnan(s)
            ]
        lines += [sentence for sentence in (self.misfit, self.step_error) if sentence]
        lines += [f"at a bound: {name}" for name in self.at_bounds]
        lines += [f"open: {sentence}" for sentence in self.unidentifiable]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Figure of what was measured and what was fitted, with the residuals beneath."""
        from varint.drawing.fit_figures import Fitted, fit_figure

        rows = zip(self.trajectories, self.data, self.residuals, strict=True)
        return fit_figure(
            [
                Fitted(motion, m.expression, m.t, m.values, r)
                for motion, data, parts in rows
                for m, r in zip(data, parts, strict=True)
            ]
        )


def _level(level: Any) -> float:
    if not (isinstance(level, (int, float)) and 0 < level < 1):
        raise InputError(f"level must be a number between 0 and 1, got {level!r}")
    return float(level)


def _neighbours(t: np.ndarray, r: np.ndarray) -> float:
    in_order = r[np.argsort(t, kind="stable")]
    good = [column[np.isfinite(column)] for column in in_order.T]
    products = sum(float(x[1:] @ x[:-1]) for x in good)
    squares = sum(float(x @ x) for x in good)
    count = sum(max(len(x) - 1, 0) for x in good)
    return products / squares * np.sqrt(count) if squares > 0 else 0.0
