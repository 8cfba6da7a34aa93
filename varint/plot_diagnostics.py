"""Figures of diagnostics and momentum maps, in the style of `plot`. Matplotlib is imported only for a figure."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from varint.plot import COLOURS, MOST_POINTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from varint.diagnostics import Convergence, EnergySlope, MomentumMap, RoundOff, WorkPrecision

SMALLEST = 1e-18  # drawn on logarithmic axes for an exact zero
MARKERS = "osD^v<>P"


def momentum_maps_figure(maps: list[MomentumMap]) -> Figure:
    """Deviation of every conserved quantity from what it must be; for a single one also its values."""
    import matplotlib.pyplot as plt

    single = len(maps) == 1
    fig, axes = plt.subplots(1, 1 + single, figsize=(10 if single else 7, 3.8), layout="constrained", squeeze=False)
    error = axes[0, -1]
    for m, colour in zip(maps, cycle(COLOURS), strict=False):
        keep = np.unique(np.linspace(0, len(m.t) - 1, min(len(m.t), MOST_POINTS)).astype(int))
        so_far = np.maximum.accumulate(np.abs(m.error))[keep]
        error.semilogy(m.t[keep], np.maximum(so_far, SMALLEST), color=colour, lw=1.2, label=m.symmetry.name)
        if single:
            axes[0, 0].plot(m.t[keep], m.values[keep], color=colour, lw=1.2, label="actual")
            if m.expected is not None and not m.symmetry.conserved:
                axes[0, 0].plot(m.t[keep], m.expected[keep], color=COLOURS[-1], lw=1.0, ls="--", label="expected")
                axes[0, 0].legend(fontsize="small")
            _dress(axes[0, 0], "time $t$", "$J$", m.symmetry.name)
    _dress(
        error, "time $t$", "largest deviation so far / size of terms", f"Momentum maps, {maps[0].rule}" if maps else ""
    )
    if not single and maps:
        error.legend(fontsize="x-small", loc="center left", bbox_to_anchor=(1, 0.5))
    return fig


def convergence_figure(result: Convergence) -> Figure:
    """Errors over the step with the expected slope."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    h = np.abs(result.h)
    for name, error, order, colour, marker in (
        ("q", result.q_error, result.q_order, COLOURS[0], "o"),
        ("p", result.p_error, result.p_order, COLOURS[1], "s"),
    ):
        label = f"${name}$, order {order:.2f}"
        axes.loglog(h, np.maximum(error, SMALLEST), color=colour, marker=marker, ms=4, lw=1, label=label)
    middle = len(h) // 2
    at = np.flatnonzero(np.isfinite(result.q_error) & (result.q_error > 100 * result.floor))
    middle = int(at[len(at) // 2]) if len(at) else middle
    line = result.q_error[middle] * (h / h[middle]) ** result.expected
    low = np.nanmin(np.maximum(result.q_error, SMALLEST))
    axes.loglog(h[line >= low], line[line >= low], color=COLOURS[-1], ls=":", lw=1, label=f"slope {result.expected:g}")
    axes.axhline(result.floor, color="0.6", lw=0.8)
    axes.legend(fontsize="small")
    _dress(axes, "step $h$", "relative error at the end", result.method)
    return fig


def energy_figure(result: EnergySlope) -> Figure:
    """Energy error with the means of its windows, and the means alone."""
    import matplotlib.pyplot as plt

    fig, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    keep = np.unique(np.linspace(0, len(result.t) - 1, min(len(result.t), MOST_POINTS)).astype(int))
    start = result.energy[0]
    left.plot(result.t[keep], result.energy[keep] - start, color=COLOURS[5], lw=0.6)
    left.plot(result.centres, result.means - start, color=COLOURS[1], marker="o", ms=3, lw=1)
    right.plot(result.centres, result.means - start, color=COLOURS[1], marker="o", ms=3, lw=0)
    line = result.means.mean() - start + result.slope * (result.centres - result.centres.mean())
    right.plot(result.centres, line, color=COLOURS[-1], lw=1, label=f"slope {result.slope:.1e} ± {result.noise:.1e}")
    right.legend(fontsize="small")
    _dress(left, "time $t$", "$H - H_0$", f"Energy error, {result.method}")
    _dress(right, "time $t$", "$H - H_0$", "Windowed means")
    return fig


def round_off_figure(result: RoundOff) -> Figure:
    """Errors on return over the number of steps."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    axes.loglog(result.steps, np.maximum(result.state, SMALLEST), color=COLOURS[0], marker="o", ms=4, label="$q$, $p$")
    label = f"$H$, ∝ steps$^{{{result.exponent:.2f}}}$"
    axes.loglog(result.steps, np.maximum(result.energy, SMALLEST), color=COLOURS[1], marker="s", ms=4, label=label)
    guide = max(result.energy[0], SMALLEST) * np.sqrt(result.steps / result.steps[0])
    axes.loglog(result.steps, guide, color=COLOURS[-1], ls=":", lw=1, label="slope ½")
    axes.legend(fontsize="small")
    _dress(axes, "steps there and back", "relative error on return", f"Round-off, {result.method}")
    return fig


def work_precision_figure(result: WorkPrecision) -> Figure:
    """Run time over error, one line a method."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(6.5, 4.4), layout="constrained")
    for i, (name, colour, marker) in enumerate(zip(result.methods, cycle(COLOURS), cycle(MARKERS), strict=False)):
        error = np.maximum(result.error[i], SMALLEST)
        axes.loglog(error, result.seconds[i], color=colour, marker=marker, ms=4, lw=1, label=name)
    axes.invert_xaxis()
    axes.legend(fontsize="small")
    _dress(axes, "relative error at the end", "run time [s]", "Work and precision")
    return fig


def _dress(axes: Axes, x: str, y: str, title: str) -> None:
    from matplotlib.ticker import NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log" and np.ptp(np.log10(axis.get_view_interval())) > 1:
            axis.set_minor_formatter(NullFormatter())
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3)
