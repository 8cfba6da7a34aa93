"""How all figures look: colours, names of axes, and how much of a long run is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.notation.names import latex_name, name_parts
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Okabe & Ito's colours, told apart by colour-blind readers and in grey print
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MOST_LINES = 7  # coordinates drawn one by one; more are drawn as the first and the last ones
MOST_NAMED_WITHIN = 4  # names of lines that a panel has room for; more stand beside it
LONGEST_NAME = 40  # characters of an expression beside its axis
MOST_POINTS = 20_000  # a line with more is thinned for drawing, keeping its last point


def label(name: str) -> str:
    """Mathematical notation for a symbol's name: theta_dot → θ with a dot, x1 → x with index 1."""
    return name if name_parts(name) is None else f"${latex_name(name)}$"


def named_expressions(expressions: Sequence[Any], system: System) -> list[tuple[str, Any]]:
    """(name of the axis, expression): names given in a dictionary, or what the expression reads
    like.
    """
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
    # @1 stands for a part
    return text if len(text) < LONGEST_NAME and "@" not in text else f"expression {number}"


def shown_indices(n: int) -> list[int]:
    """Which of n curves are drawn: all, or the first ones and the last."""
    return list(range(n)) if n <= MOST_LINES else [*range(MOST_LINES - 1), n - 1]


def how_many(title: str, n: int) -> str:
    """The title of a panel with n curves, which says it where not all of them are drawn."""
    shown = len(shown_indices(n))
    return title if shown == n else f"{title} ({shown} of {n})"


def handed_over(figure: Figure) -> Figure:
    """A figure for the caller: what Matplotlib cannot read as mathematics stands as it is; in a
    notebook its value shows it, so that pyplot must not again.
    """
    import matplotlib
    from matplotlib import pyplot as plt

    write_plainly(figure)
    if "inline" in matplotlib.get_backend():
        plt.close(figure)
    return figure


def write_plainly(figure: Figure) -> None:
    """Texts that are no mathematics for all their dollars are drawn letter by letter: names are
    the user's, and a figure must not end in what Matplotlib says of them.
    """
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if "$" in text.get_text() and not _is_mathematics(text.get_text()):
            text.set_parse_math(False)


@lru_cache(maxsize=1024)
def _is_mathematics(text: str) -> bool:
    from matplotlib.mathtext import MathTextParser

    try:
        MathTextParser("path").parse(text)
    except ValueError:  # what it says of other people's names
        return False
    return True


def thinned_indices(count: int, most: int = MOST_POINTS) -> np.ndarray:
    """Indices of at most so many of `count` points, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).astype(int))


def name_axes(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3)


def add_legend(axes: Axes) -> None:
    """Names of a panel's lines: within where there is most room, or beside it where they are
    many.
    """
    many = len(axes.get_legend_handles_labels()[1]) > MOST_NAMED_WITHIN
    where = dict(loc="upper left", bbox_to_anchor=(1.0, 1.0)) if many else dict(loc="best")
    axes.legend(fontsize="small", **where)
