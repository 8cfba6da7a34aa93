"""Sphinx extension: absolute values such as |q| in docstrings are not substitutions of
reStructuredText, and a colon in the first line of a property ends no type.
"""

from __future__ import annotations

import re

LITERAL = re.compile(r"(``.*?``|`[^`]+`)")

# napoleon reads "words: more" on a property's first line as a type: a character that it passes on
COLON = "\ue000"


def escaped(line: str) -> str:
    """The line with bars escaped, but for literals."""
    return "".join(
        part if part.startswith("`") else part.replace("|", r"\|") for part in LITERAL.split(line)
    )


def process(app, what, name, obj, options, lines: list[str]) -> None:
    if what == "property":
        lines[:1] = [line.replace(":", COLON) for line in lines[:1]]
    lines[:] = [
        line if line.lstrip().startswith((">>>", "...")) else escaped(line) for line in lines
    ]


def restore(app, what, name, obj, options, lines: list[str]) -> None:
    lines[:] = [line.replace(COLON, ":") for line in lines]


def setup(app):
    app.connect("autodoc-process-docstring", process, priority=100)  # before napoleon …
    app.connect("autodoc-process-docstring", restore, priority=900)  # … and after it
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
