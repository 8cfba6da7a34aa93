"""Runs of the pages' Python blocks, kept until the blocks or the package's code change."""

from __future__ import annotations

import hashlib
import json
import time
from base64 import b64decode, b64encode
from pathlib import Path

from blocks import Outcome, outcome
from state import package_state, say, write_whole

FORMAT = "text, figures on white and on black, formula, films"  # of what is kept


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
            Outcome(text, _decoded(figures), formula, _decoded(films))
            for text, figures, formula, films in json.loads(kept.read_text(encoding="utf-8"))
        ]
    namespace: dict = {"__name__": "page"}
    results, started = [], time.perf_counter()
    say(f"executing {page}")
    for k, code in enumerate(codes):
        try:
            results.append(outcome(code, namespace, f"{page}, block {k + 1}"))
        except Exception as error:
            raise PageError(k, error) from error
    say(f"executed {page}: {len(codes)} blocks in {time.perf_counter() - started:.1f} s")
    rows = [[x.text, _encoded(x.figures), x.formula, _encoded(x.films)] for x in results]
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_whole(kept, json.dumps(rows))
    return results


def _encoded(pictures: tuple[tuple, ...]) -> list[list[str]]:
    return [[words, *(b64encode(data).decode() for data in kinds)] for words, *kinds in pictures]


def _decoded(pictures: list[list[str]]) -> tuple[tuple, ...]:
    return tuple((words, *(b64decode(data) for data in kinds)) for words, *kinds in pictures)
