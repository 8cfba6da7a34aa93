"""Progress bars for long work: tqdm where someone watches, nothing (and no import) where nobody does."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PATIENCE = 1.0  # seconds before a bar appears unasked


@contextmanager
def progress_bar(total: int, unit: str, wanted: bool | None) -> Iterator[Callable[[int], object]]:
    """A function that counts finished units.

    Parameters
    ----------
    total : int
        Number of units.
    unit : str
        What is counted.
    wanted : bool or None
        None: a bar in a terminal, once the work has taken longer than a second.
    """
    if wanted is False or (wanted is None and not sys.stderr.isatty()):
        yield lambda count: None
        return
    from tqdm.auto import tqdm

    with tqdm(total=total, unit=unit, delay=0 if wanted else PATIENCE, leave=bool(wanted)) as bar:
        yield bar.update
