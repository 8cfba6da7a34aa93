"""Sphinx extension: formulas by the MathJax that came with pip, so that pages are complete without
a network.

The package's own extension does not say that it may run in parallel; this one uses its files.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from sphinx.util.fileutil import copy_asset


def copy(app, error) -> None:
    found = find_spec("sphinx-mathjax-offline")
    if error is None and found is not None and found.origin is not None:
        copy_asset(
            Path(found.origin).parent / "static" / "mathjax",
            Path(app.outdir) / "_static" / "mathjax",
        )


def setup(app):
    app.connect("build-finished", copy)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
