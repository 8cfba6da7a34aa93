"""Sphinx extension: blocks of code and output fit their page. Wide ones are set smaller, the widest
are broken; tables in characters stay in columns on narrow pages, where others are broken.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.transforms import SphinxTransform

FITS = 103  # characters in a line on a page at full width
SMALLER = (110, 120, 130, 140)  # classes of varint.css
COLUMNS = re.compile(r"──|^ *\S+( \S+)*( {2,}\S+( \S+)*){2,}", re.M)


def classes(text: str, language: str) -> list[str]:
    """How a block is set."""
    longest = max(map(len, text.splitlines()), default=0)
    wide = next((f"wide-{most}" for most in SMALLER if longest <= most), "wrapped")
    columns = language != "python" and COLUMNS.search(text)
    return [*([wide] if longest > FITS else []), *(["columns"] if columns else [])]


class Fit(SphinxTransform):
    """Gives every literal block its classes."""

    default_priority = 230  # after outputs have been put in

    def apply(self, **_: object) -> None:
        for block in self.document.findall(nodes.literal_block):
            language = str(block.get("language", "text"))
            block["classes"] += classes(block.astext(), language)


def setup(app):
    app.add_transform(Fit)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
