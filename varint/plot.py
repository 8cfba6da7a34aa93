"""Figures of trajectories. Matplotlib is imported here and in `animate`, and only when a figure is wanted."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from varint.ensembles.result import Ensemble
    from varint.system import System
    from varint.trajectory import Trajectory

# Okabe & Ito's colours, told apart by colour-blind readers and in grey print
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MOST_LINES = 7  # coordinates drawn one by one; more are drawn as the first and the last ones
MOST_EVENTS = 40  # marked; bounces that pile up would paint the figure grey
EVENT_STYLES = ("--", ":", "-.", (0, (1, 3)))
LONGEST_NAME = 40  # characters of an expression beside its axis
MOST_POINTS = 20_000  # a line with more is thinned for drawing, keeping its last point
GREEK = {
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu", "xi",
    "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega",
}  # fmt: skip


def trajectory_figure(motion: Trajectory, *expressions: Any) -> Figure:
    """Coordinates, phase portrait, energy; multipliers, momenta, controls where there are; or the given expressions.

    Parameters
    ----------
    motion : Trajectory
    *expressions : SX or dict of str to SX
        Drawn over time instead, one panel each; a dictionary names the axes.

    Returns
    -------
    matplotlib.figure.Figure
    """
    return _expressions(motion, expressions) if expressions else _overview(motion)


def ensemble_figure(motions: Ensemble, *expressions: Any) -> Figure:
    """Median, quartiles and the middle 90 % of the completed members over time, one panel an expression.

    Parameters
    ----------
    motions : Ensemble
    *expressions : SX or dict of str to SX
        Scalars, named by a dictionary; default: the first coordinates.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt

    shown = _named(expressions or [motions.system.q[i] for i in _shown(motions.system.structure.n)], motions.system)
    fig, rows = plt.subplots(
        len(shown), 1, figsize=(7, 1.2 + 2.2 * len(shown)), sharex=True, squeeze=False, layout="constrained"
    )
    keep = _thinned(len(motions.t))
    for axes, (name, expression), colour in zip(rows[:, 0], shown, COLOURS * len(shown), strict=False):
        low, quarter, median, three_quarters, high = motions.quantiles(expression, (0.05, 0.25, 0.5, 0.75, 0.95))
        t = motions.t[keep]
        axes.fill_between(t, low[keep], high[keep], color=colour, alpha=0.15, lw=0, label="90 %")
        axes.fill_between(t, quarter[keep], three_quarters[keep], color=colour, alpha=0.3, lw=0, label="50 %")
        axes.plot(t, median[keep], color=colour, lw=1.4, label="median")
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    rows[0, 0].legend(fontsize="small", loc="best")
    rows[-1, 0].set_xlabel("time $t$")
    fig.suptitle(f"{len(motions.completed)} members, {motions.rule}, h = {motions.h:.4g}", fontsize="medium")
    return fig


def label(name: str) -> str:
    """Mathematical notation for a symbol's name: theta_dot → θ with a dot, x1 → x with index 1."""
    dotted = name.endswith("_dot")
    match = re.fullmatch(r"([A-Za-z]+?)_?(\d+)?", name.removesuffix("_dot"))
    if match is None:
        return name
    base, index = match.groups()
    symbol = f"\\{base}" if base.lower() in GREEK else base if len(base) == 1 else f"\\mathrm{{{base}}}"
    symbol = f"\\dot{{{symbol}}}" if dotted else symbol
    return f"${symbol}_{{{index}}}$" if index else f"${symbol}$"


def _overview(motion: Trajectory) -> Figure:
    """Coordinates, phase portrait and energy; below them what else the scene has: multipliers, momenta, controls."""
    import matplotlib.pyplot as plt

    structure = motion.system.structure
    extra = [
        draw
        for draw, present in (
            (_draw_multipliers, np.any(motion.multipliers)),
            (_draw_momenta, _conserved_momenta(motion)),
            (_draw_controls, structure.controls),
        )
        if present
    ]
    rows, columns = (2 if extra else 1), (2 if len(extra) == 1 else 3)
    fig, grid = plt.subplots(rows, columns, figsize=(4 * columns, 3.5 * rows + 0.1), layout="constrained")
    top, phase, error, *others = grid.ravel()
    shown = _shown(structure.n)
    names = [label(motion.system.names[i]) for i in shown]
    keep = _thinned(len(motion))
    for colour, i, name in zip(COLOURS, shown, names, strict=False):
        top.plot(motion.t[keep], motion.q[keep, i], color=colour, label=name, lw=1.2)
        phase.plot(motion.q[keep, i], motion.p[keep, i], color=colour, label=name, lw=0.9)
    _name_axes(top, "time $t$", names[0] if len(names) == 1 else "coordinates $q$", "Coordinates")
    _name_axes(phase, "$q$", r"momentum $p = \partial L/\partial v$", "Phase portrait")
    if len(names) > 1:
        top.legend(fontsize="small", loc="best")
    _draw_energy(error, motion, keep)
    for axes, draw in zip(others, extra, strict=False):
        draw(axes, motion, keep)
    for axes in others[len(extra) :]:
        axes.remove()
    for axes in fig.axes:
        if axes is not phase:
            _mark_events(axes, motion, named=axes is top)
    fig.suptitle(f"{motion.rule}, h = {motion.h:.4g}", fontsize="medium")
    return fig


def _mark_events(axes: Axes, motion: Trajectory, named: bool) -> None:
    """A line at each event, one style a kind; where there are very many, at the first ones."""
    kinds = list(dict.fromkeys(event.kind for event in motion.events))
    named_before = set()
    for event in motion.events[:MOST_EVENTS]:
        first = event.kind not in named_before
        named_before.add(event.kind)
        style = EVENT_STYLES[kinds.index(event.kind) % len(EVENT_STYLES)]
        axes.axvline(event.time, color="0.35", lw=0.8, ls=style, label=event.kind if first else None, zorder=0)
    if named and kinds:
        axes.legend(fontsize="small", loc="best")


def _draw_multipliers(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    count = motion.multipliers.shape[1]
    shown = _shown(count)
    for colour, i in zip(COLOURS, shown, strict=False):
        axes.plot(motion.t[keep], motion.multipliers[keep, i], color=colour, lw=1.2, label=f"$\\lambda_{{{i + 1}}}$")
    _name_axes(axes, "time $t$", r"$\lambda$", "Multipliers")
    if count > 1:
        axes.legend(fontsize="small", loc="best")


def _conserved_momenta(motion: Trajectory) -> list[int]:
    """Cyclic coordinates whose momentum nothing changes."""
    s = motion.system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.forced
    return [] if held else list(s.cyclic)


def _draw_momenta(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    cyclic = _conserved_momenta(motion)
    for colour, i in zip(COLOURS, cyclic, strict=False):
        name = label(motion.system.names[i]).strip("$")
        change = motion.p[keep, i] - motion.p[0, i]
        axes.plot(motion.t[keep], change, color=colour, lw=0.9, label=f"$p_{{{name}}}$ = {motion.p[0, i]:.6g}")
    _name_axes(axes, "time $t$", "$p - p_0$", "Momenta of cyclic coordinates")
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)
    axes.legend(fontsize="small", loc="best")


def _draw_controls(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    names = [label(name) for name in motion.system.control_names]
    shown = _shown(len(names))
    steps, r, _ = motion.u.shape
    inside = r > 1 and len(motion) == steps + 1  # several values a step, and every step is there: a curve, no stairs
    for colour, i in zip(COLOURS, shown, strict=False):
        if inside:
            within = motion.t[:-1, None] + np.diff(motion.t)[:, None] * np.array(motion.rule.nodes, dtype=float)
            few = _thinned(within.size)
            axes.plot(within.ravel()[few], motion.u[:, :, i].ravel()[few], color=colour, lw=1.2, label=names[i])
        else:
            values = motion.value(motion.system.control[i])
            axes.plot(motion.t[keep], values[keep], color=colour, lw=1.2, label=names[i], drawstyle="steps-post")
    _name_axes(axes, "time $t$", names[0] if len(names) == 1 else "controls $u$", "Controls")
    if len(names) > 1:
        axes.legend(fontsize="small", loc="best")


def _draw_energy(axes: Axes, motion: Trajectory, keep: np.ndarray) -> None:
    structure = motion.system.structure
    lost = max((abs(event.energy_after - event.energy_before) for event in motion.events), default=0.0)
    kept = structure.autonomous and not structure.forced and lost <= 1e-9 * np.abs(motion.energy).max()
    if not kept:  # it changes, and how is what one wants to see
        axes.plot(motion.t[keep], motion.energy[keep], color=COLOURS[1], lw=1.2)
        _name_axes(axes, "time $t$", "energy $H$", "Energy")
        return
    change = motion.energy - motion.energy[0]
    size = abs(motion.energy[0])
    relative = size > 1e-9 * np.abs(motion.energy).max() and size > 0
    axes.plot(motion.t[keep], change[keep] / size if relative else change[keep], color=COLOURS[1], lw=0.9)
    _name_axes(axes, "time $t$", r"$(H - H_0)/|H_0|$" if relative else r"$H - H_0$", "Energy error")
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)


def _expressions(motion: Trajectory, expressions: tuple) -> Figure:
    import matplotlib.pyplot as plt

    shown = _named(expressions, motion.system)
    count = len(shown)
    fig, rows = plt.subplots(count, 1, figsize=(7, 1.2 + 2.2 * count), sharex=True, squeeze=False, layout="constrained")
    keep = _thinned(len(motion))
    for axes, (name, expression) in zip(rows[:, 0], shown, strict=True):
        values = motion.value(expression).reshape(len(motion), -1)
        for colour, column in zip(COLOURS, values[keep].T, strict=False):
            axes.plot(motion.t[keep], column, color=colour, lw=1.2)
        _mark_events(axes, motion, named=axes is rows[0, 0])
        axes.set_ylabel(name)
        axes.grid(alpha=0.3)
    rows[-1, 0].set_xlabel("time $t$")
    return fig


def _named(expressions: Sequence[Any], system: System) -> list[tuple[str, Any]]:
    """(name of the axis, expression): names given in a dictionary, or what the expression reads like."""
    named: list[tuple[str, Any]] = []
    for entry in expressions:
        named += entry.items() if isinstance(entry, dict) else [("", entry)]
    return [(name or _reads_like(x, k, system), x) for k, (name, x) in enumerate(named, start=1)]


def _reads_like(expression: Any, number: int, system: System) -> str:
    """A symbol's notation, H, the expression if it is short, or its number."""
    text = str(expression)
    if text == str(system.energy):
        return "energy $H$"
    if text.isidentifier():
        return label(text)
    return text if len(text) < LONGEST_NAME and "@" not in text else f"expression {number}"  # @1 stands for a part


def _shown(n: int) -> list[int]:
    return list(range(n)) if n <= MOST_LINES else [*range(MOST_LINES - 1), n - 1]


def _thinned(count: int) -> np.ndarray:
    if count <= MOST_POINTS:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, MOST_POINTS).astype(int))


def _name_axes(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3)
