"""Progress bars for long work: tqdm where someone watches, nothing (and no import) where nobody does."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from types import NoneType

from varint.errors import InputError

PATIENCE = 1.0  # seconds before a bar appears unasked


Move = Callable[[int, Callable[[], str]], object]


def progress_bar(total: int, unit: str, wanted: bool | None, done: int = 0) -> AbstractContextManager[Move]:
    """A function of (finished units, () → note) that moves the bar; it shows the rate, and the note beside it.

    Parameters
    ----------
    total : int
        Number of units.
    unit : str
        What is counted.
    wanted : bool or None
        None: a bar in a terminal or notebook, once the work has taken longer than a second.
    done : int
        Units that were finished before.
    """
    if not isinstance(wanted, (bool, NoneType)):
        raise InputError(f"progress must be True, False or None (a bar where someone watches), got {wanted!r}")
    if wanted is False or (wanted is None and not _is_watched()):
        return nullcontext(_unseen)
    return _bar(total, unit, bool(wanted), done)


def _unseen(count: int, note: Callable[[], str]) -> None:
    """Nobody watches."""


@contextmanager
def _bar(total: int, unit: str, wanted: bool, done: int) -> Iterator[Move]:
    from tqdm.auto import tqdm

    delay = 0 if wanted else PATIENCE
    with tqdm(total=total, initial=done, unit=unit, unit_scale=True, delay=delay, leave=wanted) as bar:

        def move(count: int, note: Callable[[], str]) -> None:
            if bar.update(count):  # drawn: then the note is worth working out
                bar.set_postfix_str(note(), refresh=False)

        yield move


def _is_watched() -> bool:
    """Whether what is printed goes to a terminal or a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return sys.stderr.isatty() or type(shell).__name__ == "ZMQInteractiveShell"
