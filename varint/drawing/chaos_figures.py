"""Figures of chaos and order: indicators, exponents, sections, frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from varint.drawing.style import COLOURS, handed_over, name_axes, thinned_indices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALLEST = 1e-16  # an index below it is drawn there
MOST_NAMED = 12  # resonances, frequencies: more names would cover each other


def megno_figure(
    t: np.ndarray, values: np.ndarray, means: np.ndarray, log_lengths: np.ndarray
) -> Figure:
    """Y and ⟨Y⟩ beside the 2 of ordered motion, and the length of the displacement."""
    import matplotlib.pyplot as plt

    fig, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), layout="constrained")
    keep = thinned_indices(len(t))
    left.plot(t[keep], values[keep], color=COLOURS[5], lw=0.8, label="$Y$")
    left.plot(t[keep], means[keep], color=COLOURS[0], lw=1.6, label=r"$\langle Y\rangle$")
    left.axhline(2.0, color=COLOURS[6], ls="--", lw=1, label="ordered: 2")
    left.legend(fontsize="small")
    name_axes(left, "time $t$", "", "MEGNO")
    right.plot(t[keep], log_lengths[keep], color=COLOURS[1], lw=1)
    name_axes(right, "time $t$", r"$\ln\,|\delta|/|\delta_0|$", "a small displacement")
    return handed_over(fig)


def alignment_figure(t: np.ndarray, values: np.ndarray, name: str) -> Figure:
    """An alignment index over time, both logarithmic."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
    later = np.flatnonzero(t > t[0])
    keep = later[thinned_indices(len(later))]
    axes.loglog(t[keep] - t[0], np.maximum(values[keep], SMALLEST), color=COLOURS[0], lw=1)
    name, _, count = name.partition("_")
    name_axes(axes, "time $t$", "", name + (f"$_{count}$" if count else ""))
    return handed_over(fig)


def spectrum_figure(t: np.ndarray, history: np.ndarray) -> Figure:
    """Exponents of the run until each time: positive and negative ones on linear axes, their sizes
    on logarithmic ones.
    """
    import matplotlib.pyplot as plt

    fig, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), layout="constrained")
    keep = thinned_indices(len(t))
    for i, column in enumerate(history.T):
        colour = COLOURS[i % len(COLOURS)]
        left.plot(t[keep], column[keep], color=colour, lw=1.2, label=rf"$\lambda_{{{i + 1}}}$")
        style = "-" if column[-1] > 0 else "--"
        right.loglog(t[keep], np.maximum(np.abs(column[keep]), SMALLEST), style, color=colour, lw=1)
    if history.shape[1] <= len(COLOURS):
        left.legend(fontsize="small", ncols=2)
    name_axes(left, "time $t$", r"$\lambda_i$", "Lyapunov exponents")
    name_axes(right, "time $t$", r"$|\lambda_i|$", "negative ones dashed")
    return handed_over(fig)


def section_figure(
    groups: Sequence[np.ndarray],
    names: tuple[str, str],
    title: str,
    boundary: tuple[np.ndarray, np.ndarray, np.ndarray] | None,
) -> Figure:
    """Points (N, 2) of each motion in a colour of its own; boundary: a grid a, b and the energy
    left there for the direction that is not shown, whose zero encloses what can be reached.
    """
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.4, 5.0), layout="constrained")
    total = sum(len(points) for points in groups)
    size = float(np.clip(20_000 / max(total, 1), 1.0, 3.0))  # points, of each dot
    for i, points in enumerate(groups):
        axes.plot(*points.T, ".", ms=size, mew=0, color=COLOURS[i % 6])
    if boundary is not None:
        axes.contour(*boundary, levels=[0.0], colors="0.4", linewidths=1)
    name_axes(axes, *names, title)
    return handed_over(fig)


def lines_figure(frequencies: np.ndarray, sizes: np.ndarray, error: float) -> Figure:
    """A line spectrum: the amplitude at each frequency, and the part of the signal left over."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
    axes.vlines(frequencies, max(sizes.min() / 10, SMALLEST), sizes, color=COLOURS[0], lw=1.5)
    axes.plot(frequencies, sizes, "o", ms=4, color=COLOURS[0])
    axes.axhline(max(error, SMALLEST), color=COLOURS[1], ls="--", lw=1, label="left over (rms)")
    axes.set_yscale("log")
    axes.legend(fontsize="small")
    name_axes(axes, r"angular frequency $\nu$", "amplitude", f"{len(frequencies)} frequencies")
    return handed_over(fig)


def frequency_map_figure(
    frequencies: np.ndarray, diffusion: np.ndarray, resonances: Sequence[tuple[int, ...]]
) -> Figure:
    """The first two frequencies of each motion, coloured by their diffusion; lines of resonances k
    · ν = 0.
    """
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(6.2, 4.8), layout="constrained")
    x, y = frequencies[:, 0], frequencies[:, 1]
    shown = axes.scatter(x, y, c=diffusion, s=9, cmap="viridis", lw=0)
    fig.colorbar(shown, label=r"diffusion $\log_{10}|\Delta\nu|/|\nu|$")
    spread = [np.ptp(a) or max(abs(a).max(), 1.0) for a in (x, y)]
    limits = [(a.min() - 0.08 * s, a.max() + 0.08 * s) for a, s in zip((x, y), spread, strict=True)]
    axes.set(xlim=limits[0], ylim=limits[1])
    for a, b in (k for k in resonances[:MOST_NAMED] if k[0] * k[1] < 0):  # ν₂ = −a/b ν₁
        axes.axline((0.0, 0.0), slope=-a / b, color="0.6", lw=0.8, zorder=0)
        at = min(limits[0][1], -b / a * limits[1][1])  # where the line leaves
        if at > limits[0][0] and -a / b * at > limits[1][0]:
            axes.annotate(
                f"{abs(b)}:{abs(a)}",
                (at, -a / b * at),
                xytext=(-4, -10),
                textcoords="offset points",
                ha="right",
                fontsize="small",
                color="0.4",
            )
    name_axes(axes, r"$\nu_1$", r"$\nu_2$", f"frequencies of {len(x)} motions")
    return handed_over(fig)
