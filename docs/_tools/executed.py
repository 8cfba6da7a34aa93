"""Sphinx extension: runs the Python blocks of every page and puts what they print and draw
beneath them.
"""

from __future__ import annotations

import hashlib
import os
from logging import getLogger
from pathlib import Path

from blocks import ANSWER_MARKS, FIGURE, FILM
from docutils import nodes
from page_runs import FORMAT, PageError, outcomes
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from state import package_state

os.environ.setdefault("MPLBACKEND", "Agg")
getLogger("matplotlib").setLevel(
    "WARNING"
)  # Sphinx shows the notes of all loggers, such as each film written
LOG = logging.getLogger(__name__)
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
            shown = ANSWER_MARKS.sub("", FILM.sub("", FIGURE.sub("", code))).rstrip()
            block.rawsource = shown
            block.children = [nodes.Text(shown)]
            self._insert(block, result)
            if ANSWER_MARKS.search(code):
                _fold(block)

    def _insert(self, block: nodes.literal_block, result) -> None:
        parent, at = block.parent, block.parent.index(block) + 1
        if result.text.strip():
            printed = result.text.rstrip()
            text = nodes.literal_block(printed, printed, classes=["output"])
            text["language"] = "text"
            parent.insert(at, text)
            at += 1
        if result.formula:
            math = nodes.math_block(result.formula, result.formula, classes=["formula"])
            math["number"] = math["label"] = None
            parent.insert(at, math)
            at += 1
        for words, light, dark in result.figures:
            uris = [self._stored(png, "png") for png in (light, dark)]
            parent.insert(at, figure(uris, words))
            at += 1
        for words, film in result.films:
            parent.insert(at, figure([self._stored(film, "gif")], words))
            at += 1

    def _stored(self, data: bytes, kind: str) -> str:
        """Path of the picture in the source folder's scratch space, from the root of the
        documentation.
        """
        folder = Path(self.env.srcdir) / "_build" / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{hashlib.sha256(data).hexdigest()[:16]}.{kind}"
        path.write_bytes(data)
        return "/" + str(path.relative_to(self.env.srcdir))


def figure(uris: list[str], words: str) -> nodes.figure:
    """A picture, or its versions for light and dark pages, with its description as caption and as
    alternative text; loaded when it comes into view.
    """
    node = nodes.figure(classes=["executed"], ids=[f"figure-{Path(uris[0]).stem}"])
    modes = [["only-light"], ["only-dark"]] if len(uris) == 2 else [["film"]]
    for uri, classes in zip(uris, modes, strict=True):
        node += nodes.image(uri=uri, alt=words, classes=classes, loading="lazy")
    node += nodes.caption(words, words)
    return node


def _fold(block: nodes.literal_block) -> None:
    """Hide an answer until its reader asks for it."""
    parent, at = block.parent, block.parent.index(block)
    opening = '<details class="answer"><summary>An answer</summary>'
    parent.insert(at, nodes.raw("", opening, format="html"))
    after = at + 2
    while after < len(parent) and "output" in parent[after].get("classes", ()):
        after += 1
    parent.insert(after, nodes.raw("", "</details>", format="html"))


def outdated(app, env, added, changed, removed) -> list[str]:
    """All pages where the package or the way in which pages are run has changed."""
    now = f"{FORMAT} {package_state()}"
    before, env.varint_state = getattr(env, "varint_state", None), now
    return [] if before == now else sorted(env.found_docs)


def setup(app):
    app.connect("env-get-outdated", outdated)
    app.add_transform(Execute)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
