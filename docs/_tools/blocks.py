"""Python blocks of Markdown pages, and how they run: in order, one namespace a page, so what is
printed is true.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import tempfile
import warnings
from base64 import b64decode
from dataclasses import dataclass
from typing import Any

FENCE = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
MARKED = re.compile(r"^```\{code-block\} python\n:class: (\w+)\n\n?(.*?)^```$", re.M | re.S)
FIGURE = re.compile(r"^# figure: (.+)$", re.M)
FILM = re.compile(r"^# film: (.+)$", re.M)
ANSWER = re.compile(r"^# answer\n.*?^# end of answer\n", re.M | re.S)
ANSWER_MARKS = re.compile(r"^# (?:end of )?answer\n", re.M)
EMBEDDED = re.compile(r'src="data:image/gif;base64,([^"]+)"')
DPI = 110


@dataclass(frozen=True)
class Outcome:
    """What a block printed, the figures it left open as PNG, for light and for dark pages, each
    with its description, the LaTeX of its value where that has one, as a notebook shows it, and
    the film that its value is as GIF.
    """

    text: str
    figures: tuple[tuple[str, bytes, bytes], ...]
    formula: str = ""
    films: tuple[tuple[str, bytes], ...] = ()


def python_blocks(markdown: str) -> list[str]:
    """The code of all Python blocks of a page."""
    return FENCE.findall(markdown)


def marked_blocks(markdown: str) -> list[tuple[str, str]]:
    """(class, code) of the Python blocks that do not run with their page."""
    return MARKED.findall(markdown)


def outcome(code: str, namespace: dict, where: str, *, draw: bool = True) -> Outcome:
    """Run one block, in an empty folder that it may write to.

    A line ``# figure: words`` describes a figure for those who do not see it, and captions it;
    ``# film: words`` does so for an animation that is the block's value.
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    printed = io.StringIO()
    before = os.getcwd()
    folder = namespace.setdefault("__folder__", tempfile.mkdtemp())
    os.chdir(folder)
    try:
        with plt.rc_context(namespace.get("__style__")):  # a page's style is its own
            with contextlib.redirect_stdout(printed), warnings.catch_warnings():
                warnings.simplefilter("error")
                value = run(code, namespace, where)
            namespace["__style__"] = {"axes.prop_cycle": plt.rcParams["axes.prop_cycle"]}
            films = []
            if isinstance(value, FuncAnimation):
                films.append(gif(value) if draw else b"")
                plt.close(value._fig)
            pictures = [
                light_and_dark(plt.figure(number)) if draw else (b"", b"")
                for number in plt.get_fignums()
            ]
    finally:
        plt.close("all")
        os.chdir(before)
    words, titles = FIGURE.findall(code), FILM.findall(code)
    for kind, found, said in (("figure", pictures, words), ("film", films, titles)):
        if len(said) != len(found):
            raise ValueError(
                f"{where}: {len(found)} {kind}s but {len(said)} lines '# {kind}: …' to describe "
                "them"
            )
    formula = value._repr_latex_() if hasattr(value, "_repr_latex_") else None
    figures = tuple((w, *png) for w, png in zip(words, pictures, strict=True))
    shown = tuple(zip(titles, films, strict=True))
    return Outcome(printed.getvalue(), figures, (formula or "").strip("$ "), shown)


def light_and_dark(figure: Any) -> tuple[bytes, bytes]:
    """A figure as PNG on white, and with its greys turned round on the colour of dark pages."""
    from dark import darken, few_colours

    light, dark = io.BytesIO(), io.BytesIO()
    figure.savefig(light, dpi=DPI, format="png")
    darken(figure)
    figure.savefig(dark, dpi=DPI, format="png")
    return few_colours(light.getvalue()), few_colours(dark.getvalue())


def gif(film: Any) -> bytes:
    """A film as a notebook shows it."""
    found = EMBEDDED.search(film._repr_html_())
    if found is None:
        raise ValueError("the film has no picture to show")
    return b64decode(found[1])


def run(code: str, namespace: dict, where: str) -> Any:
    """The value of the block's last line, where that is an expression."""
    tree = ast.parse(code, where)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, where, "exec"), namespace)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), where, "eval"), namespace)
