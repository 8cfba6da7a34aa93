"""Sphinx extension: absolute values such as |q| in docstrings are not substitutions of reStructuredText."""

from __future__ import annotations

import re

LITERAL = re.compile(r"(``.*?``|`[^`]+`)")


def escaped(line: str) -> str:
    """The line with bars escaped, but for literals."""
    return "".join(part if part.startswith("`") else part.replace("|", r"\|") for part in LITERAL.split(line))


def process(app, what, name, obj, options, lines: list[str]) -> None:
    lines[:] = [line if line.lstrip().startswith((">>>", "...")) else escaped(line) for line in lines]


def setup(app):
    app.connect("autodoc-process-docstring", process, priority=100)  # before napoleon
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
