"""Results as values of a notebook's cell: a short table and a small picture."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.curves import curve_of, marks_of
from varint.drawing.ensemble_figures import draw_spread
from varint.drawing.figures import draw_controls, draw_coordinates
from varint.drawing.style import (
    COLOURS,
    label,
    name_axes,
    shown_indices,
    thinned_indices,
    write_plainly,
)
from varint.notation.html import table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from varint.results.trajectory import Trajectory

FEW = 400  # points of a line in a small picture
PANEL = (3.4, 2.2)  # inches
DPI = 110
Draw = Callable[["Axes"], None]


def picture(words: str, panels: Sequence[Draw]) -> str:
    """Panels side by side as an ``<img>`` that needs no file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL[0] * len(panels), PANEL[1]), dpi=DPI, layout="tight")
    for axes, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        draw(axes)
    write_plainly(figure)
    png = io.BytesIO()
    figure.savefig(png, format="png")
    data = b64encode(png.getvalue()).decode()
    return f'<img alt="{words}" src="data:image/png;base64,{data}">'


def trajectory_html(motion: Trajectory) -> str:
    """What a motion is, in a few lines, and its coordinates and controls over time."""
    keep = thinned_indices(len(motion), FEW)
    few = motion[keep]
    rows = [
        ("nodes", f"{len(motion)}, t = {motion.t[0]:.6g} … {motion.t[-1]:.6g}"),
        ("rule", f"{motion.rule}, order {motion.rule.order}, h = {motion.h:.6g}"),
        *(
            (name, f"{motion.q[0, i]:.6g} … {motion.q[-1, i]:.6g}")
            for i, name in _some_names(motion.system.names)
        ),
        ("energy", f"{few.energy[0]:.9g}, changes by {np.ptp(few.energy):.1e}"),
    ]
    kinds = [event.kind for event in motion.events]
    rows += [(f"events: {kind}", str(kinds.count(kind))) for kind in dict.fromkeys(kinds)]
    if hasattr(motion.solution, "total_cost"):
        rows += solution_rows(motion.solution)
    curve = curve_of(motion)
    points = thinned_indices(len(curve), 2 * FEW)
    marks = marks_of(motion, curve.t[points])
    panels: list[Draw] = [lambda axes: draw_coordinates(axes, curve, points, marks)]
    if motion.system.structure.controls:
        panels.append(lambda axes: draw_controls(axes, motion, keep))
    return table("Trajectory", rows, picture("Coordinates over time.", panels))


def solution_rows(solution: Any) -> list[tuple[str, str]]:
    """How an optimal control ended."""
    return [
        ("cost", f"{solution.cost:.9g}"),
        ("status", f"{solution.status} after {solution.iterations} iterations"),
        ("constraint violation", f"{solution.violation:.1e}"),
    ]


def solution_html(solution: Any) -> str:
    """How an optimal control ended, and its controls over the fraction of the duration."""
    at = np.linspace(0, 1, FEW)
    values = solution.u(at)

    def draw(axes: Axes) -> None:
        for colour, i in zip(COLOURS, shown_indices(values.shape[1]), strict=False):
            axes.plot(at, values[:, i], color=colour, lw=1.2)
        name_axes(axes, "fraction of the duration", "controls $u$", "Controls")

    rows = [*solution_rows(solution), ("steps", str(len(solution.mesh) - 1))]
    panels = [draw] if values.shape[1] else []
    return table("Optimal control", rows, picture("Controls over time.", panels) if panels else "")


def ensemble_html(
    names: Sequence[str], t: np.ndarray, levels: np.ndarray, rows: Sequence[tuple[str, str]]
) -> str:
    """What an ensemble is, and the spread of its first coordinates over time.

    Parameters
    ----------
    names : sequence of str
        Of the coordinates that are drawn.
    t : ndarray (N + 1,)
    levels : ndarray (k, 5, N + 1)
        Their quantiles from the lowest up.
    rows : sequence of (str, str)
    """
    keep = thinned_indices(len(t), FEW)

    def panel(i: int) -> Draw:
        def draw(axes: Axes) -> None:
            draw_spread(axes, t[keep], levels[i][:, keep], COLOURS[i])
            name_axes(axes, "time $t$", label(names[i]), "Median, 50 %, 90 %")

        return draw

    panels = [panel(i) for i in range(len(names))]
    return table("Ensemble", rows, picture("Spread over time.", panels) if panels else "")


def _some_names(names: Sequence[str]) -> list[tuple[int, str]]:
    return [(i, names[i]) for i in shown_indices(len(names))]
