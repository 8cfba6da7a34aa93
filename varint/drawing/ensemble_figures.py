"""Figures of many motions. Matplotlib is imported only when a figure is wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.style import (
    COLOURS,
    handed_over,
    how_many,
    named_expressions,
    shown_indices,
    thinned_indices,
)
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_spread(axes: Axes, t: np.ndarray, levels: np.ndarray, colour: str) -> None:
    """Median, quartiles and the middle 90 % over time: levels (5, N + 1) from the lowest up."""
    low, quarter, median, three_quarters, high = levels
    axes.fill_between(t, low, high, color=colour, alpha=0.15, lw=0, label="90 %")
    axes.fill_between(t, quarter, three_quarters, color=colour, alpha=0.3, lw=0, label="50 %")
    axes.plot(t, median, color=colour, lw=1.4, label="median")


def ensemble_figure(
    system: System,
    t: np.ndarray,
    quantiles: Callable[[Any, Sequence[float]], np.ndarray],
    title: str,
    *expressions: Any,
) -> Figure:
    """Median, quartiles and the middle 90 % of many motions over time, one panel an expression.

    Parameters
    ----------
    system : System
        Names the expressions.
    t : ndarray (N + 1,)
    quantiles : callable
        (expression, levels) → values at these levels of its distribution, (levels, N + 1).
    title : str
    *expressions : SX or dict of str to SX
        Scalars, named by a dictionary; default: the first coordinates.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt

    shown = named_expressions(
        expressions or [system.q[i] for i in shown_indices(system.structure.n)], system
    )
    fig, rows = plt.subplots(
        len(shown),
        1,
        figsize=(7, 1.2 + 2.2 * len(shown)),
        sharex=True,
        squeeze=False,
        layout="constrained",
    )
    keep = thinned_indices(len(t))
    for axes, (name, expression), colour in zip(
        rows[:, 0], shown, COLOURS * len(shown), strict=False
    ):
        draw_spread(
            axes, t[keep], quantiles(expression, (0.05, 0.25, 0.5, 0.75, 0.95))[:, keep], colour
        )
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    rows[0, 0].legend(fontsize="small", loc="best")
    rows[-1, 0].set_xlabel("time $t$")
    title = title if expressions else how_many(title, system.structure.n)
    fig.suptitle(title, fontsize="medium")
    return handed_over(fig)
