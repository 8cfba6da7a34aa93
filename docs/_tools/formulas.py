"""Sphinx extension: formulas by the MathJax that came with pip, so that pages are complete without
a network, and of it what these pages need, two thirds of the whole.

The package's own extension does not say that it may run in parallel; this one uses its files.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

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
    app.connect("config-inited", configure)
    app.connect("build-finished", copy)
    return {"version": "2", "parallel_read_safe": True, "parallel_write_safe": True}
