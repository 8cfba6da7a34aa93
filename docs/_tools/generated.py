"""Sphinx extension: writes the gallery, the verification page and the benchmark page before
pages are read.
"""

from __future__ import annotations

import os
from pathlib import Path

import benchmark_page
import gallery
import reference_page
import verification_page


def write(app) -> None:
    source = Path(app.srcdir)
    gallery.write(source / "gallery", os.cpu_count() or 1)
    gallery.say("measuring the verification page")
    verification_page.write(source / "verification.md")
    gallery.say("writing benchmarks and reference, reading pages")
    benchmark_page.write(source / "benchmarks.md")
    reference_page.write(source / "reference.rst")


def setup(app):
    app.connect("builder-inited", write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
