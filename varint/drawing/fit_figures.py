"""Figures of fits: what was measured, what was fitted, and what is left between them."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.drawing.style import COLOURS, handed_over, named_expressions, thinned_indices
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Fitted(NamedTuple):
    """A measurement with the motion fitted to it: times and values (M,), (M, o), residuals in units
    of σ, NaN where a value is missing.
    """

    motion: Trajectory
    expression: Any
    t: np.ndarray
    values: np.ndarray
    residuals: np.ndarray


def fit_figure(fitted: Sequence[Fitted]) -> Figure:
    """Measured values over the fitted motion, a column a measurement; residuals in σ beneath."""
    import matplotlib.pyplot as plt

    fig, rows = plt.subplots(
        2,
        len(fitted),
        figsize=(1.0 + 5.0 * len(fitted), 5.0),
        sharex="col",
        squeeze=False,
        height_ratios=(2, 1),
        layout="constrained",
    )
    for (above, below), part in zip(rows.T, fitted, strict=True):
        keep = thinned_indices(len(part.motion))
        curves = part.motion.value(part.expression)[keep].reshape(len(keep), -1)
        [(name, _)] = named_expressions([part.expression], part.motion.system)
        for i, colour in zip(range(curves.shape[1]), COLOURS * curves.shape[1], strict=False):
            above.plot(part.motion.t[keep], curves[:, i], color=colour, lw=1.2, label="fitted")
            marks = dict(color=colour, ls="", marker=".", ms=4)
            above.plot(part.t, part.values[:, i], label="measured", **marks)
            below.plot(part.t, part.residuals[:, i], **marks)
        for level in (-2, 0, 2):
            below.axhline(level, color="0.6", lw=0.8, ls="-" if level == 0 else ":")
        above.set_ylabel(name)
        below.set_ylabel(r"residual / $\sigma$")
        below.set_xlabel("time $t$")
        above.grid(alpha=0.3)
        below.grid(alpha=0.3)
    rows[0, 0].legend(fontsize="small", loc="best")
    return handed_over(fig)


def profile_figure(
    name: str,
    level: float,
    values: np.ndarray,
    chi_squared: np.ndarray,
    estimate: float,
    interval: tuple[float, float],
    linear: tuple[float, float],
) -> Figure:
    """χ² above its minimum against one unknown, with the interval where it stays below the level's,
    and the parabola of the linearised problem.
    """
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    threshold = NormalDist().inv_cdf((1 + level) / 2) ** 2
    x = np.linspace(values[0], values[-1], 200)
    half = (linear[1] - linear[0]) / 2
    if half > 0:
        parabola = threshold * ((x - estimate) / half) ** 2
        axes.plot(x, parabola, color="0.6", ls="--", lw=1.0, label="linearised")
    colour = COLOURS[0]
    axes.plot(values, chi_squared, color=colour, marker=".", ms=4, lw=1.2, label="profile")
    axes.axhline(threshold, color="0.6", lw=0.8, ls=":")
    for end in interval:
        if np.isfinite(end):
            axes.axvline(end, color=colour, lw=0.8, ls=":")
    axes.set_ylim(0, 2 * threshold)
    axes.set_xlabel(name)
    axes.set_ylabel(r"$\chi^2 - \chi^2_{\min}$")
    axes.set_title(f"{100 * level:g} %: {interval[0]:.5g} … {interval[1]:.5g}", fontsize="medium")
    axes.legend(fontsize="small")
    return handed_over(fig)
