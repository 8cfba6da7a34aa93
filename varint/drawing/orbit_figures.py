"""Figures of periodic orbits, their multipliers and families, and of normal modes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from varint.drawing.curves import curve_of
from varint.drawing.style import COLOURS, handed_over, label, name_axes, thinned_indices
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SHOWN = 12  # orbits of a family that are drawn
NARROW = 0.3  # of the wider side: a flat orbit is not drawn true to scale
MARKS = {"fold": "s", "branch": "D", "period": "o", "collision": "X"}
MEASURES = {"energy": "energy $H$", "period": "period $T$", "width": "largest range"}
FAR = 3.0  # multipliers further out are shown on a logarithmic scale, if at all


def multipliers_figure(multipliers: np.ndarray, signatures: Sequence[int | None]) -> Figure:
    """Multipliers and the unit circle."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(4.6, 4.4), layout="constrained")
    _multipliers(axes, multipliers, signatures)
    return handed_over(fig)


def orbit_figure(
    motion: Trajectory, multipliers: np.ndarray, signatures: Sequence[int | None]
) -> Figure:
    """An orbit in its coordinates, and its multipliers."""
    import matplotlib.pyplot as plt

    pairs = _planes(motion)
    fig, axes = plt.subplots(
        1, len(pairs) + 1, figsize=(4.4 * (len(pairs) + 1), 4.2), layout="constrained"
    )
    for one, (i, j) in zip(axes, pairs, strict=False):
        _curve(one, motion, i, j, COLOURS[0])
        name_axes(one, *_names(motion, i, j), "orbit")
    _multipliers(axes[-1], multipliers, signatures)
    return handed_over(fig)


def family_figure(
    across: tuple[str, np.ndarray],
    up: tuple[str, np.ndarray],
    stable: np.ndarray,
    marks: Sequence[tuple[str, float, float]],
    motions: Sequence[Trajectory],
) -> Figure:
    """One measure of a family over another, stable parts drawn through; some orbits beside."""
    import matplotlib.pyplot as plt

    pairs = _planes(motions[-1])[:2]
    fig, axes = plt.subplots(
        1, len(pairs) + 1, figsize=(4.6 * (len(pairs) + 1), 4.2), layout="constrained"
    )
    first = axes[0]
    values, heights = across[1], up[1]
    for k, (a, b) in enumerate(pairwise(range(len(values)))):
        solid = bool(stable[a] and stable[b])
        first.plot(values[[a, b]], heights[[a, b]], "-" if solid else ":", color=COLOURS[0], lw=1.5)
        if k == 0:
            first.plot([], [], "-", color=COLOURS[0], label="stable")
            first.plot([], [], ":", color=COLOURS[0], label="unstable")
    seen: set[str] = set()
    for kind, x, y in marks:
        mark = next((m for name, m in MARKS.items() if kind.startswith(name)), "*")
        first.plot(x, y, mark, color=COLOURS[1], ms=6, label=None if kind in seen else kind, ls="")
        seen.add(kind)
    names = [MEASURES.get(name) or label(name) for name, _ in (across, up)]
    name_axes(first, names[0], names[1], "family")
    first.legend(fontsize="small")
    chosen = thinned_indices(len(motions), MOST_SHOWN)
    shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, len(chosen)))
    for one, (i, j) in zip(axes[1:], pairs, strict=True):
        for k, shade in zip(chosen, shades, strict=True):
            _curve(one, motions[k], i, j, shade)
        name_axes(one, *_names(motions[-1], i, j), "its orbits")
    return handed_over(fig)


def modes_figure(exponents: np.ndarray, shapes: np.ndarray, names: Sequence[str]) -> Figure:
    """The entries of every mode's shape, real and imaginary parts."""
    import matplotlib.pyplot as plt

    count = max(len(shapes), 1)
    fig, rows = plt.subplots(
        1, count, figsize=(1.0 + 2.6 * count, 3.2), sharey=True, squeeze=False, layout="constrained"
    )
    places, turning = np.arange(len(names)), np.abs(shapes.imag).max(initial=0.0) > 0
    side, wide = (0.2, 0.4) if turning else (0.0, 0.6)
    for axes, s, shape in zip(rows[0], exponents, shapes, strict=False):
        axes.bar(places - side, shape.real, wide, color=COLOURS[0], label="real part")
        if turning:
            axes.bar(places + side, shape.imag, wide, color=COLOURS[1], label="imaginary part")
        axes.set_xticks(places, [label(name) for name in names])
        axes.axhline(0, color="0.5", lw=0.8)
        what = rf"$\omega$ = {abs(s.imag):.5g}" if s.imag else f"rate {s.real:.5g}"
        axes.set_title(what)
        axes.grid(alpha=0.3, axis="y")
    rows[0, 0].set_ylabel("displacement")
    if turning:
        rows[0, 0].legend(fontsize="small")
    return handed_over(fig)


def _planes(motion: Trajectory) -> list[tuple[int, int]]:
    """Pairs of coordinates that are drawn; (0, −1) is a coordinate with its velocity."""
    n = motion.q.shape[1]
    if n == 1:
        return [(0, -1)]
    return [(0, 1), (0, 2)] if n == 3 else [(0, 1)]


def _names(motion: Trajectory, i: int, j: int) -> tuple[str, str]:
    names = motion.system.names
    return label(names[i]), label(names[j] if j >= 0 else f"{names[i]}_dot")


def _curve(axes: Axes, motion: Trajectory, i: int, j: int, colour) -> None:
    names, motion = motion.system.names, curve_of(motion)
    if j > 0 and names[0] == "x1" and "y1" in names:  # many bodies in the plane
        for k, name in enumerate(names):
            if name.startswith("x") and (other := f"y{name[1:]}") in names:
                axes.plot(motion.q[:, k], motion.q[:, names.index(other)], color=colour, lw=1.2)
        axes.set_aspect("equal", adjustable="datalim")
        return
    x, y = motion.q[:, i], motion.v[:, i] if j < 0 else motion.q[:, j]
    axes.plot(x, y, color=colour, lw=1.2)
    wide = sorted((float(np.ptp(x)), float(np.ptp(y))))
    places = {"x", "y", "z"}
    if j >= 0 and wide[0] > NARROW * wide[1] and {names[i], names[j]} <= places:
        axes.set_aspect("equal", adjustable="datalim")


def _multipliers(axes: Axes, multipliers: np.ndarray, signatures: Sequence[int | None]) -> None:
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color="0.6", lw=0.8)
    near = np.abs(multipliers) <= FAR
    looks = {1: ("o", "Krein +"), -1: ("v", "Krein −"), 0: ("X", "Krein ±"), None: ("s", "")}
    for sign, (mark, text) in looks.items():
        some = np.array([x == sign for x in signatures], dtype=bool) & near
        if some.any():
            axes.plot(
                multipliers[some].real,
                multipliers[some].imag,
                mark,
                color=COLOURS[1] if sign is None else COLOURS[0],
                label=text or "no signature",
            )
    far = multipliers[~near]
    title = "multipliers"
    if len(far):
        title += f" ({len(far)} further out, to {np.abs(far).max():.3g})"
    name_axes(axes, "real part", "imaginary part", title)
    axes.set_aspect("equal")
    if near.any():
        axes.legend(fontsize="small", loc="upper right")
