"""Figures of trajectories. Matplotlib is imported here and in `animate`, and only when a figure
is wanted.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.curves import curve_of, marks_of
from varint.drawing.style import (
    COLOURS,
    add_legend,
    handed_over,
    how_many,
    label,
    name_axes,
    named_expressions,
    shown_indices,
    thinned_indices,
)
from varint.errors import InputError
from varint.results.records import leans

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from varint.results.trajectory import Trajectory

MOST_EVENTS = 40  # marked; bounces that pile up would paint the figure grey
ARROWS = (0.07, 0.4, 0.8)  # where along a phase portrait its direction is shown
ARROW = dict(
    arrowstyle="-|>,head_width=0.3,head_length=0.7", lw=0, mutation_scale=14, shrinkA=0, shrinkB=0
)
EVENT_STYLES = ("--", ":", "-.", (0, (1, 3)))


def trajectory_figure(motion: Trajectory, *expressions: Any) -> Figure:
    """Coordinates, phase portrait, energy; multipliers, momenta, controls where there are; or the
    given expressions.

    Parameters
    ----------
    motion : Trajectory
    *expressions : SX, str or dict of str to these
        Drawn over time instead, one panel each; a dictionary names the axes.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if any(isinstance(x, Mapping) and not x for x in expressions):
        raise InputError("a dictionary names what is drawn, and this one is empty")
    return _expressions(motion, expressions) if expressions else _overview(motion)


def _overview(motion: Trajectory) -> Figure:
    """Coordinates, phase portrait and energy; below them what else the scene has: multipliers,
    momenta, controls.
    """
    import matplotlib.pyplot as plt

    structure, curve = motion.system.structure, curve_of(motion)
    extra = [
        (draw, of)
        for draw, of, present in (
            (_draw_multipliers, curve, not leans(motion) and np.any(motion.multipliers)),
            (_draw_momenta, motion, _conserved_momenta(motion)),
            (draw_controls, motion, structure.controls),
        )
        if present
    ]
    rows, columns = (2 if extra else 1), (2 if len(extra) == 1 else 3)
    fig, grid = plt.subplots(
        rows, columns, figsize=(4 * columns, 3.5 * rows + 0.1), layout="constrained"
    )
    top, phase, error, *others = grid.ravel()
    shown = shown_indices(structure.n)
    names = [label(motion.system.names[i]) for i in shown]
    points = thinned_indices(len(curve))
    marks = marks_of(motion, curve.t[points])
    draw_coordinates(top, curve, points, marks)
    for colour, i, name in zip(COLOURS, shown, names, strict=False):
        q, p = curve.q[points, i], curve.p[points, i]
        phase.plot(q, p, color=colour, label=name, lw=0.9, **marks)
        _draw_direction(phase, q, p, colour)
    name_axes(
        phase,
        "$q$",
        r"momentum $p = \partial L/\partial v$",
        how_many("Phase portrait", structure.n),
    )
    _draw_energy(error, motion, curve)
    for axes, (draw, of) in zip(others, extra, strict=False):
        draw(axes, of, thinned_indices(len(of)))
    for axes in others[len(extra) :]:
        axes.remove()
    for axes in fig.axes:
        if axes is not phase:
            _mark_events(axes, motion, named=axes is top)
    fig.suptitle(f"{motion.rule}, h = {motion.h:.4g}", fontsize="medium")
    return handed_over(fig)


def _draw_direction(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str) -> None:
    """Arrows along a curve, in the sense in which it is run through."""
    count = len(x) - 1
    for k in {int(share * count) for share in ARROWS if count > 1}:
        if x[k] != x[k + 1] or y[k] != y[k + 1]:
            axes.annotate(
                "",
                xy=(x[k + 1], y[k + 1]),
                xytext=(x[k], y[k]),
                arrowprops=ARROW | {"color": colour},
            )


def draw_coordinates(
    axes: Axes, motion: Trajectory, keep: np.ndarray, marks: Mapping[str, Any] | None = None
) -> None:
    """Coordinates over time, with marks of `marks_of`."""
    shown = shown_indices(motion.system.structure.n)
    names = [label(motion.system.names[i]) for i in shown]
    for colour, i, name in zip(COLOURS, shown, names, strict=False):
        x = motion.q[keep, i]
        axes.plot(motion.t[keep], x, color=colour, label=name, lw=1.2, **(marks or {}))
    name_axes(
        axes,
        "time $t$",
        names[0] if len(names) == 1 else "coordinates $q$",
        how_many("Coordinates", motion.system.structure.n),
    )
    if len(names) > 1:
        add_legend(axes)


def _mark_events(axes: Axes, motion: Trajectory, named: bool) -> None:
    """A line at each event, one style a kind; where there are very many, at the first ones."""
    kinds = list(dict.fromkeys(event.kind for event in motion.events))
    named_before = set()
    for event in motion.events[:MOST_EVENTS]:
        first = event.kind not in named_before
        named_before.add(event.kind)
        style = EVENT_STYLES[kinds.index(event.kind) % len(EVENT_STYLES)]
        axes.axvline(
            event.time,
            color="0.35",
            lw=0.8,
            ls=style,
            label=event.kind if first else None,
            zorder=0,
        )
    if named and kinds:
        add_legend(axes)


def _draw_multipliers(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    count = motion.multipliers.shape[1]
    shown = shown_indices(count)
    for colour, i in zip(COLOURS, shown, strict=False):
        axes.plot(
            motion.t[keep],
            motion.multipliers[keep, i],
            color=colour,
            lw=1.2,
            label=f"$\\lambda_{{{i + 1}}}$",
        )
    name_axes(axes, "time $t$", r"$\lambda$", how_many("Multipliers", count))
    if count > 1:
        add_legend(axes)


def _conserved_momenta(motion: Trajectory) -> list[int]:
    """Cyclic coordinates whose momentum nothing changes."""
    s = motion.system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.forced
    return [] if held else list(s.cyclic)


def _draw_momenta(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    every = _conserved_momenta(motion)
    cyclic = [every[k] for k in shown_indices(len(every))]
    for colour, i in zip(COLOURS, cyclic, strict=False):
        name = label(motion.system.names[i]).strip("$")
        change = motion.p[keep, i] - motion.p[0, i]
        axes.plot(
            motion.t[keep],
            change,
            color=colour,
            lw=0.9,
            label=f"$p_{{{name}}}$ = {motion.p[0, i]:.6g}",
        )
    name_axes(axes, "time $t$", "$p - p_0$", how_many("Momenta of cyclic coordinates", len(every)))
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)
    add_legend(axes)


def draw_controls(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    """Controls at their nodes, or as stairs where they are constant on a step."""
    names = [label(name) for name in motion.system.control_names]
    shown = shown_indices(len(names))
    steps, r, _ = motion.u.shape
    # several values a step, and every step is there: a curve, no stairs
    inside = r > 1 and len(motion) == steps + 1
    for colour, i in zip(COLOURS, shown, strict=False):
        if inside:
            within = motion.t[:-1, None] + np.diff(motion.t)[:, None] * np.array(
                motion.rule.nodes, dtype=float
            )
            few = thinned_indices(within.size)
            axes.plot(
                within.ravel()[few],
                motion.u[:, :, i].ravel()[few],
                color=colour,
                lw=1.2,
                label=names[i],
            )
        else:
            values = motion.value(motion.system.control[i])
            axes.plot(
                motion.t[keep],
                values[keep],
                color=colour,
                lw=1.2,
                label=names[i],
                drawstyle="steps-post",
            )
    name_axes(
        axes,
        "time $t$",
        names[0] if len(names) == 1 else "controls $u$",
        how_many("Controls", len(names)),
    )
    if len(names) > 1:
        add_legend(axes)


def _draw_energy(axes: Axes, motion: Trajectory, curve: Trajectory) -> None:
    keep = thinned_indices(len(motion))
    structure = motion.system.structure
    lost = max(
        (abs(event.energy_after - event.energy_before) for event in motion.events), default=0.0
    )
    kept = (
        structure.autonomous and not structure.forced and lost <= 1e-9 * np.abs(motion.energy).max()
    )
    if not kept:  # it changes, and how is what one wants to see
        points = thinned_indices(len(curve))
        axes.plot(curve.t[points], curve.energy[points], color=COLOURS[1], lw=1.2)
        name_axes(axes, "time $t$", "energy $H$", "Energy")
        return
    change = motion.energy - motion.energy[0]
    size = abs(motion.energy[0])
    relative = size > 1e-9 * np.abs(motion.energy).max() and size > 0
    axes.plot(
        motion.t[keep], change[keep] / size if relative else change[keep], color=COLOURS[1], lw=0.9
    )
    name_axes(axes, "time $t$", r"$(H - H_0)/|H_0|$" if relative else r"$H - H_0$", "Energy error")
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)


def _expressions(motion: Trajectory, expressions: tuple) -> Figure:
    import matplotlib.pyplot as plt

    shown = named_expressions(expressions, motion.system)
    count = len(shown)
    fig, rows = plt.subplots(
        count, 1, figsize=(7, 1.2 + 2.2 * count), sharex=True, squeeze=False, layout="constrained"
    )
    curve = curve_of(motion)
    keep = thinned_indices(len(curve))
    marks = marks_of(motion, curve.t[keep])
    for axes, (name, expression) in zip(rows[:, 0], shown, strict=True):
        values = curve.value(expression).reshape(len(curve), -1)
        for colour, column in zip(cycle(COLOURS), values[keep].T, strict=False):
            axes.plot(curve.t[keep], column, color=colour, lw=1.2, **marks)
        _mark_events(axes, motion, named=axes is rows[0, 0])
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    rows[-1, 0].set_xlabel("time $t$")
    return handed_over(fig)
