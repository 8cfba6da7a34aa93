"""The figure of `work_precision.json`: of every tool the cheapest settings for each error, one
panel a scene.

`python benchmarks/tools/fronts.py [scene ...]` draws it anew from the stored numbers.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from varint.drawing.style import COLOURS

RESULT = Path(__file__).parents[1] / "results" / "work_precision.json"
MARKERS = "osD^vPX<>*"
# have a colour of their own
FIRST = (
    "varint",
    "heyoka",
    "compiled DOP853",
    "REBOUND IAS15",
    "SciPy DOP853",
)
COLUMNS = 3
FLOOR = 1e-16  # an error of zero has no place on a logarithmic axis


def read(path: Path = RESULT) -> dict[str, Any]:
    """What the benchmark stored."""
    return json.loads(path.read_text(encoding="utf-8"))


def front(settings: list[dict[str, Any]]) -> np.ndarray:
    """(error, ms) of the settings that no other beats in both, by falling time."""
    points, best = [], np.inf
    for row in sorted(settings, key=lambda row: (row["error"], row["seconds"])):
        if row["seconds"] < best:
            points.append((max(row["error"], FLOOR), 1e3 * row["seconds"]))
            best = row["seconds"]
    return np.array(points).reshape(-1, 2)


def figure(result: dict[str, Any], names: list[str] | None = None) -> Figure:
    """Time over error; varint thick, in the colour and with the marker that a tool has in all
    panels.
    """
    scenes = {name: result["scenes"][name] for name in names or result["scenes"]}
    tools = {row["tool"] for scene in result["scenes"].values() for row in scene["all"]}
    order = [*(tool for tool in FIRST if tool in tools), *sorted(tools - set(FIRST))]
    style = {
        tool: {
            "color": COLOURS[i % len(COLOURS)],
            "marker": MARKERS[i % len(MARKERS)],
            "ls": "-" if i < len(COLOURS) else ":",
        }
        for i, tool in enumerate(order)
    }
    columns = min(COLUMNS, len(scenes))
    lines = -(-len(scenes) // columns)
    fig, grid = plt.subplots(
        lines,
        columns,
        figsize=(3.7 * columns, 3.1 * lines + 0.5),
        squeeze=False,
        layout="constrained",
    )
    for axes, (name, scene) in zip(grid.flat, scenes.items(), strict=False):
        for tool in reversed(order):
            found = front([row for row in scene["all"] if row["tool"] == tool])
            if len(found):
                axes.loglog(
                    *found.T, **style[tool], ms=3.5, lw=2.2 if tool == "varint" else 1.0, label=tool
                )
        axes.set(
            title=name, xlim=(1e-14, 1), xlabel="error of q at the end", ylabel="run time in ms"
        )
        axes.grid(alpha=0.3)
    for axes in grid.flat[len(scenes) :]:
        axes.axis("off")
    handles = {h.get_label(): h for axes in grid.flat for h in axes.get_legend_handles_labels()[0]}
    named = [tool for tool in order if tool in handles]
    fig.legend(
        [handles[tool] for tool in named], named, loc="outside upper center", ncols=4, frameon=False
    )
    return fig


if __name__ == "__main__" and RESULT.exists():
    figure(read(), sys.argv[1:]).savefig(RESULT.with_suffix(".png"), dpi=110)
