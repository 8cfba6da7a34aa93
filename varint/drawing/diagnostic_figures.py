"""Figures of diagnostics and momentum maps, in the style of `plot`. Matplotlib is imported only
for a figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from varint.drawing.style import COLOURS, MOST_POINTS, handed_over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SMALLEST = 1e-18  # drawn on logarithmic axes for an exact zero
MARKERS = "osD^v<>P"


def momentum_maps_figure(
    rule: str,
    curves: Sequence[tuple[str, np.ndarray, np.ndarray]],
    values: tuple[np.ndarray, np.ndarray | None] | None = None,
) -> Figure:
    """Deviation of every conserved quantity from what it must be; for a single one also its values.

    Parameters
    ----------
    rule : str
        For the title.
    curves : sequence of (name, times (N + 1,), deviations (N + 1,))
    values : (actual (N + 1,), expected (N + 1,) or None), optional
        Of the only quantity.
    """
    import matplotlib.pyplot as plt

    single = values is not None
    fig, axes = plt.subplots(
        1, 1 + single, figsize=(10 if single else 7, 3.8), layout="constrained", squeeze=False
    )
    error = axes[0, -1]
    for (name, t, deviation), colour in zip(curves, cycle(COLOURS), strict=False):
        keep = np.unique(np.linspace(0, len(t) - 1, min(len(t), MOST_POINTS)).astype(int))
        so_far = np.maximum.accumulate(np.abs(deviation))[keep]
        error.semilogy(t[keep], np.maximum(so_far, SMALLEST), color=colour, lw=1.2, label=name)
        if values is not None:
            actual, expected = values
            axes[0, 0].plot(t[keep], actual[keep], color=colour, lw=1.2, label="actual")
            if expected is not None:
                axes[0, 0].plot(
                    t[keep], expected[keep], color=COLOURS[-1], lw=1.0, ls="--", label="expected"
                )
                axes[0, 0].legend(fontsize="small")
            _dress(axes[0, 0], "time $t$", "$J$", name)
    title = f"Momentum maps, {rule}" if curves else ""
    _dress(error, "time $t$", "largest deviation so far / size of terms", title)
    if not single and curves:
        error.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1, 0.5))
    return handed_over(fig)


def convergence_figure(
    method: str,
    h: np.ndarray,
    errors: Mapping[str, tuple[np.ndarray, float]],
    expected: float,
    floor: float,
) -> Figure:
    """Errors over the step with the expected slope."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    h = np.abs(h)
    for (name, (error, order)), colour, marker in zip(
        errors.items(), COLOURS, MARKERS, strict=False
    ):
        label = f"${name}$, order {order:.2f}"
        axes.loglog(
            h, np.maximum(error, SMALLEST), color=colour, marker=marker, ms=4, lw=1, label=label
        )
    middle = len(h) // 2
    first, _ = next(iter(errors.values()))
    at = np.flatnonzero(np.isfinite(first) & (first > 100 * floor))
    middle = int(at[len(at) // 2]) if len(at) else middle
    line = first[middle] * (h / h[middle]) ** expected
    low = np.nanmin(np.maximum(first, SMALLEST))
    axes.loglog(
        h[line >= low],
        line[line >= low],
        color=COLOURS[-1],
        ls=":",
        lw=1,
        label=f"slope {expected:g}",
    )
    axes.axhline(floor, color="0.6", lw=0.8)
    axes.legend(fontsize="small")
    _dress(axes, "step $h$", "relative error at the end", method)
    return handed_over(fig)


def energy_figure(
    method: str,
    curve: tuple[np.ndarray, np.ndarray],
    windows: tuple[np.ndarray, np.ndarray],
    slope: float,
    noise: float,
) -> Figure:
    """Energy error with the means of its windows, and the means alone."""
    import matplotlib.pyplot as plt

    fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    (t, energy), (centres, means) = curve, windows
    keep = np.unique(np.linspace(0, len(t) - 1, min(len(t), MOST_POINTS)).astype(int))
    start = energy[0]
    left.plot(t[keep], energy[keep] - start, color=COLOURS[5], lw=0.6)
    left.plot(centres, means - start, color=COLOURS[1], marker="o", ms=3, lw=1)
    right.plot(centres, means - start, color=COLOURS[1], marker="o", ms=3, lw=0)
    line = means.mean() - start + slope * (centres - centres.mean())
    right.plot(centres, line, color=COLOURS[-1], lw=1, label=f"slope {slope:.1e} ± {noise:.1e}")
    right.legend(fontsize="small")
    _dress(left, "time $t$", "$H - H_0$", f"Energy error, {method}")
    _dress(right, "time $t$", "$H - H_0$", "Windowed means")
    return handed_over(fig)


def round_off_figure(
    method: str, steps: np.ndarray, state: np.ndarray, energy: np.ndarray, exponent: float
) -> Figure:
    """Errors on return over the number of steps."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    axes.loglog(
        steps, np.maximum(state, SMALLEST), color=COLOURS[0], marker="o", ms=4, label="$q$, $p$"
    )
    label = f"$H$, ∝ steps$^{{{exponent:.2f}}}$"
    axes.loglog(
        steps, np.maximum(energy, SMALLEST), color=COLOURS[1], marker="s", ms=4, label=label
    )
    guide = max(energy[0], SMALLEST) * np.sqrt(steps / steps[0])
    axes.loglog(steps, guide, color=COLOURS[-1], ls=":", lw=1, label="slope ½")
    axes.legend(fontsize="small")
    _dress(axes, "steps there and back", "relative error on return", f"Round-off, {method}")
    return handed_over(fig)


def work_precision_figure(methods: Sequence[str], error: np.ndarray, seconds: np.ndarray) -> Figure:
    """Run time over error, one line a method."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(6.5, 4.4), layout="constrained")
    for i, (name, colour, marker) in enumerate(
        zip(methods, cycle(COLOURS), cycle(MARKERS), strict=False)
    ):
        axes.loglog(
            np.maximum(error[i], SMALLEST),
            seconds[i],
            color=colour,
            marker=marker,
            ms=4,
            lw=1,
            label=name,
        )
    axes.invert_xaxis()
    axes.legend(fontsize="small")
    _dress(axes, "relative error at the end", "run time [s]", "Work and precision")
    return handed_over(fig)


def _dress(axes: Axes, x: str, y: str, title: str) -> None:
    from matplotlib.ticker import NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log" and np.ptp(np.log10(axis.get_view_interval())) > 1:
            axis.set_minor_formatter(NullFormatter())
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3)
