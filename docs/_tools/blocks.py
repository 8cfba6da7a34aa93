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
from dataclasses import dataclass
from typing import Any

FENCE = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
MARKED = re.compile(r"^```\{code-block\} python\n:class: (\w+)\n\n?(.*?)^```$", re.M | re.S)
FIGURE = re.compile(r"^# figure: (.+)$", re.M)
DPI = 110


@dataclass(frozen=True)
class Outcome:
    """What a block printed, the figures it left open as PNG, each with its description, and the
    LaTeX of its value where that has one, as a notebook shows it.
    """

    text: str
    figures: tuple[tuple[str, bytes], ...]
    formula: str = ""


def python_blocks(markdown: str) -> list[str]:
    """The code of all Python blocks of a page."""
    return FENCE.findall(markdown)


def marked_blocks(markdown: str) -> list[tuple[str, str]]:
    """(class, code) of the Python blocks that do not run with their page."""
    return MARKED.findall(markdown)


def outcome(code: str, namespace: dict, where: str, *, draw: bool = True) -> Outcome:
    """Run one block, in an empty folder that it may write to.

    A line ``# figure: words`` describes a figure for those who do not see it, and captions it.
    """
    import matplotlib.pyplot as plt

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
            pictures = []
            for number in plt.get_fignums():
                png = io.BytesIO()
                if draw:
                    plt.figure(number).savefig(png, dpi=DPI, format="png")
                pictures.append(png.getvalue())
    finally:
        plt.close("all")
        os.chdir(before)
    words = FIGURE.findall(code)
    if len(words) != len(pictures):
        raise ValueError(
            f"{where}: {len(pictures)} figures but {len(words)} lines '# figure: …' to describe "
            "them"
        )
    formula = value._repr_latex_() if hasattr(value, "_repr_latex_") else None
    figures = tuple(zip(words, pictures, strict=True))
    return Outcome(printed.getvalue(), figures, (formula or "").strip("$ "))


def run(code: str, namespace: dict, where: str) -> Any:
    """The value of the block's last line, where that is an expression."""
    tree = ast.parse(code, where)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, where, "exec"), namespace)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), where, "eval"), namespace)
