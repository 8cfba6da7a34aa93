"""A figure that follows a solver: the last path and its controls, cost and violation so far."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.figures import draw_controls
from varint.drawing.style import COLOURS, label, name_axes, shown_indices, write_plainly
from varint.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST = 1e-16  # of a violation in a logarithmic plot


def live_plot(figure: Figure | None = None) -> Callable[[int, float, float, Any], None]:
    """A ``callback=`` for `optimal_control` and `optimal_phases` that draws every iterate.

    Parameters
    ----------
    figure : matplotlib Figure, optional
        Where to draw. Default: a new one, in a window of its own where there can be one.

    Returns
    -------
    callable
        (iteration, cost, violation, path) → None.

    Raises
    ------
    InputError
        If `figure` is none.

    Examples
    --------
    >>> import casadi as ca
    >>> import matplotlib.pyplot as plt
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> figure = plt.figure()
    >>> move = vi.optimal_control(
    ...     cart, vi.gauss(2), duration=1, steps=5, cost=force**2,
    ...     q0=0, v0=0, end=dict(q=[1], v=[0]), callback=vi.live_plot(figure))
    >>> [axes.get_title() for axes in figure.axes[:3]]
    ['Path', 'Controls', 'Iteration 1']
    >>> plt.close(figure)
    """
    if figure is None:
        import matplotlib.pyplot as plt

        figure = plt.figure(figsize=(12, 3.6), layout="constrained")
    elif not hasattr(figure, "subplots"):
        raise InputError(f"live_plot takes a matplotlib Figure, got {type(figure).__name__}")
    elif figure.get_layout_engine() is None:
        figure.set_layout_engine("constrained")  # or names of axes stand in the next one
    shown, costs, violations = figure, list[float](), list[float]()

    def draw(iteration: int, cost: float, violation: float, path: Any) -> None:
        if iteration == 0:
            costs.clear()
            violations.clear()
        costs.append(cost)
        violations.append(max(violation, LEAST))
        shown.clear()
        top, controls, way = shown.subplots(1, 3)
        for motion in path if isinstance(path, list) else [path]:
            for colour, i in zip(COLOURS, shown_indices(motion.q.shape[1]), strict=False):
                name = label(motion.system.names[i])
                top.plot(motion.t, motion.q[:, i], color=colour, label=name, lw=1.2)
            if motion.u.size:
                draw_controls(controls, motion, np.arange(len(motion)))
        name_axes(top, "time $t$", "coordinates $q$", "Path")
        controls.set_title("Controls")
        way.plot(costs, color=COLOURS[0], label="cost")
        name_axes(way, "iteration", "cost", f"Iteration {iteration}")
        beside = way.twinx()
        beside.semilogy(violations, color=COLOURS[1])
        beside.set_ylabel("violation", color=COLOURS[1])
        write_plainly(shown)
        _show(shown)

    return draw


def _show(figure: Figure) -> None:
    """Now, where there is a window."""
    if getattr(figure.canvas, "required_interactive_framework", None):
        figure.show()
    figure.canvas.draw_idle()
    figure.canvas.flush_events()
