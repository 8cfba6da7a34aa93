"""Runs of the pages' Python blocks, kept until the blocks or the package's code change."""

from __future__ import annotations

import hashlib
import json
import time
from base64 import b64decode, b64encode
from pathlib import Path

from blocks import Outcome, outcome
from gallery import package_state, say

FORMAT = "text, figures, formula"  # of what is kept


class PageError(Exception):
    """A block of a page failed."""

    def __init__(self, block: int, error: Exception) -> None:
        super().__init__(f"{type(error).__name__}: {error}")
        self.block = block


def outcomes(codes: list[str], page: str, scratch: Path) -> list[Outcome]:
    """What the blocks of a page print and draw, one after the other; kept in `scratch` until they
    or the package's code change.
    """
    if not codes:
        return []
    text = "\0".join([FORMAT, package_state(), *codes])
    kept = scratch / "executed" / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"
    if kept.exists():
        return [
            Outcome(text, tuple((words, b64decode(png)) for words, png in figures), formula)
            for text, figures, formula in json.loads(kept.read_text(encoding="utf-8"))
        ]
    namespace: dict = {"__name__": "page"}
    results, started = [], time.perf_counter()
    for k, code in enumerate(codes):
        try:
            results.append(outcome(code, namespace, f"{page}, block {k + 1}"))
        except Exception as error:
            raise PageError(k, error) from error
    say(f"executed {page}: {len(codes)} blocks in {time.perf_counter() - started:.1f} s")
    rows = [
        [x.text, [[w, b64encode(png).decode()] for w, png in x.figures], x.formula] for x in results
    ]
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(rows), encoding="utf-8")
    return results
