"""Sphinx extension: formulas by the MathJax that came with pip, so that pages are complete without
a network, and of it what these pages need, two thirds of the whole.

The package's own extension does not say that it may run in parallel; this one uses its files.
"""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes
from sphinx.transforms import SphinxTransform
from sphinx.util.fileutil import copy_asset

PARTS = (
    "startup.js",
    "core.js",
    "input/tex-base.js",
    "input/tex/extensions/ams.js",
    "input/tex/extensions/boldsymbol.js",
    "output/chtml.js",
    "output/chtml/fonts/tex.js",
    "output/chtml/fonts/woff-v2",
    "a11y/assistive-mml.js",
)
CONFIG = {
    "loader": {
        "load": [
            "core",
            "input/tex-base",
            "[tex]/ams",
            "[tex]/boldsymbol",
            "output/chtml",
            "a11y/assistive-mml",
        ]
    },
    "tex": {"packages": {"[+]": ["ams", "boldsymbol"]}},
}

GAP = re.compile(r"\\qquad(?![a-zA-Z])")
OPENING, CLOSING = (
    re.compile(r"\\(?:begin|left)\b|(?<!\\)\{"),
    re.compile(r"\\(?:end|right)\b|(?<!\\)\}"),
)


def pieces(latex: str) -> list[str]:
    """The parts of a displayed formula between wide spaces that stand in no group."""
    found, start = [], 0
    for gap in GAP.finditer(latex):
        before = latex[start : gap.start()]
        if len(OPENING.findall(before)) == len(CLOSING.findall(before)):
            found.append(before)
            start = gap.end()
    return [part.strip() for part in [*found, latex[start:]] if part.strip()]


class Apart(SphinxTransform):
    """Divides displayed formulas at their wide spaces."""

    default_priority = 240

    def apply(self, **_: object) -> None:
        for whole in list(self.document.findall(nodes.math_block)):
            parts = pieces(whole.astext())
            if len(parts) > 1 and not whole.get("label"):
                row = nodes.container(classes=["formulas"])
                for part in parts:
                    one = nodes.math_block(part, part, classes=whole["classes"])
                    one["number"] = one["label"] = None
                    row += one
                whole.replace_self(row)


def configure(app, config) -> None:
    config.mathjax_path, config.mathjax3_config = f"mathjax/{PARTS[0]}", CONFIG


def copy(app, error) -> None:
    found = find_spec("sphinx-mathjax-offline")
    if error is None and found is not None and found.origin is not None:
        source = Path(found.origin).parent / "static" / "mathjax"
        target = Path(app.outdir) / "_static" / "mathjax"
        for part in PARTS:
            place = target / part
            copy_asset(source / part, place if (source / part).is_dir() else place.parent)


def setup(app):
    app.add_transform(Apart)
    app.connect("config-inited", configure)
    app.connect("build-finished", copy)
    return {"version": "2", "parallel_read_safe": True, "parallel_write_safe": True}
