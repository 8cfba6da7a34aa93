"""Sphinx extension: a picture without words for those who do not see it is a warning, and so an
error.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.util import logging

LOG = logging.getLogger(__name__)
SHORTEST = 10  # characters
RAW = re.compile(r"<img\b[^>]*>")
ALT = re.compile(r'\balt="([^"]*)"')


def wordless(doctree: nodes.document) -> list[str]:
    """Pictures of a page that have no description, or next to none."""
    found = [
        image["uri"]
        for image in doctree.findall(nodes.image)
        if len(image.get("alt", "")) < SHORTEST
    ]
    for raw in doctree.findall(nodes.raw):
        for tag in RAW.findall(raw.astext()):
            words = ALT.search(tag)
            if words is None or len(words[1]) < SHORTEST:
                found.append(tag)
    return found


def check(app, doctree: nodes.document, docname: str) -> None:
    for picture in wordless(doctree):
        LOG.warning(f"{picture} needs alternative text", location=docname)


def setup(app):
    app.connect("doctree-resolved", check)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
