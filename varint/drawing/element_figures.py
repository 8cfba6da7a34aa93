"""Figures of orbital elements over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from varint.drawing.style import COLOURS, handed_over, thinned_indices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLES = ("-", "--")  # a second round of colours
FAR = 8.0  # ratio of the largest to the smallest that is drawn on a logarithmic axis


def elements_figure(
    t: np.ndarray, names: Sequence[str], panels: Mapping[str, np.ndarray], wide: Sequence[str]
) -> Figure:
    """One panel an element (N + 1, B), one line a body; those in `wide` may be of any size."""
    import matplotlib.pyplot as plt

    fig, rows = plt.subplots(
        len(panels), 1, figsize=(8, 1 + 2.1 * len(panels)), sharex=True, layout="constrained"
    )
    keep = thinned_indices(len(t))
    for axes, (title, values) in zip(np.atleast_1d(rows), panels.items(), strict=True):
        for i, name in enumerate(names):
            style = STYLES[i // len(COLOURS) % len(STYLES)]
            axes.plot(
                t[keep],
                values[keep, i],
                style,
                color=COLOURS[i % len(COLOURS)],
                lw=0.8,
                label=name,
            )
        middle = np.median(values, axis=0)
        if title in wide and values.min() > 0 and middle.max() > FAR * middle.min():
            axes.set_yscale("log")
        axes.set_ylabel(title)
        axes.grid(alpha=0.3)
    np.atleast_1d(rows)[-1].set_xlabel("time $t$")
    fig.legend(*np.atleast_1d(rows)[0].get_legend_handles_labels(), loc="outside right upper")
    return handed_over(fig)
