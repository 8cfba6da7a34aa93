"""Sphinx extension: runs the Python blocks of every page and puts what they print and draw
beneath them.
"""

from __future__ import annotations

import hashlib
import os
from logging import getLogger
from pathlib import Path

from blocks import FIGURE
from docutils import nodes
from page_runs import PageError, outcomes
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

os.environ.setdefault("MPLBACKEND", "Agg")
getLogger("matplotlib").setLevel(
    "WARNING"
)  # Sphinx shows the notes of all loggers, such as each film written
LOG = logging.getLogger(__name__)
WIDE = 105  # characters
NOT_HERE = {
    "still",
    "script",
    "illustration",
}  # run by the tests, the first two in ways of their own; the last never


class Execute(SphinxTransform):
    """Runs a page's Python blocks in order."""

    default_priority = 210  # before Sphinx collects images

    def apply(self, **_: object) -> None:
        found = self.document.findall(nodes.literal_block)
        runs = [
            block
            for block in found
            if block.get("language") == "python" and not NOT_HERE & set(block.get("classes", ()))
        ]
        codes = [block.astext() for block in runs]
        try:
            results = outcomes(codes, self.env.docname, Path(self.env.srcdir) / "_build")
        except PageError as failed:
            where = (self.env.docname, runs[failed.block].line)
            LOG.warning(f"the block failed: {failed}", location=where)
            return
        for block, code, result in zip(runs, codes, results, strict=True):
            shown = FIGURE.sub("", code).rstrip()
            block.rawsource = shown
            block.children = [nodes.Text(shown)]
            self._insert(block, result)

    def _insert(self, block: nodes.literal_block, result) -> None:
        parent, at = block.parent, block.parent.index(block) + 1
        if result.text.strip():
            wide = any(len(line) > WIDE for line in result.text.splitlines())
            kind = (
                ["output", "wrapped"] if wide and "──" not in result.text else ["output"]
            )  # tables stay in columns
            text = nodes.literal_block(result.text, result.text.rstrip(), classes=kind)
            text["language"] = "text"
            parent.insert(at, text)
            at += 1
        if result.formula:
            math = nodes.math_block(result.formula, result.formula, classes=["formula"])
            math["number"] = math["label"] = None
            parent.insert(at, math)
            at += 1
        for words, png in result.figures:
            parent.insert(at, figure(self._stored(png), words))
            at += 1

    def _stored(self, png: bytes) -> str:
        """Path of the picture in the source folder's scratch space, from the root of the
        documentation.
        """
        folder = Path(self.env.srcdir) / "_build" / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{hashlib.sha256(png).hexdigest()[:16]}.png"
        path.write_bytes(png)
        return "/" + str(path.relative_to(self.env.srcdir))


def figure(uri: str, words: str) -> nodes.figure:
    """A picture with its description as caption and as alternative text."""
    node = nodes.figure(classes=["executed"], ids=[f"figure-{Path(uri).stem}"])
    node += nodes.image(uri=uri, alt=words)
    node += nodes.caption(words, words)
    return node


def setup(app):
    app.add_transform(Execute)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
