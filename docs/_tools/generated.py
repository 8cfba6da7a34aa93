"""Sphinx extension: writes the gallery, the verification page and the benchmark page before
pages are read.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import benchmark_page
import gallery
import reference_page
import verification_page
from state import say


def write(app) -> None:
    source = Path(app.srcdir)
    gallery.write(source / "gallery", os.cpu_count() or 1)
    say("measuring the verification page")
    verification_page.write(source / "verification.md")
    say("writing benchmarks and reference, reading pages")
    benchmark_page.write(source / "benchmarks.md")
    reference_page.write(source / "reference.rst")


def copy_cards(app, error) -> None:
    """The gallery's small pictures, which its index alone shows."""
    if error is None and app.builder.format == "html":
        target = Path(app.outdir) / "_cards"
        target.mkdir(exist_ok=True)
        for card in (Path(app.srcdir) / "gallery").glob("*-card.png"):
            shutil.copy(card, target / f"{card.stem.removesuffix('-card')}.png")


def pages_read(app, env) -> None:
    """The second half of what Sphinx does in silence."""
    say("pages read, writing them")


def setup(app):
    app.connect("env-updated", pages_read)
    app.connect("build-finished", copy_cards)
    app.connect("builder-inited", write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
