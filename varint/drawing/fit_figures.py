"""Figures of fits: what was measured, what was fitted, and what is left between them."""

from __future__ import annotations

from collections.abc import Sequence
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
