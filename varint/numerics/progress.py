"""Progress bars for long work: tqdm where someone watches, nothing (and no import) where nobody
does.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.util import find_spec
from threading import Event, Thread
from time import perf_counter
from types import NoneType
from typing import Any

from varint.errors import InputError

PATIENCE = 1.0  # seconds before a bar appears unasked
SILENCE, MOST_SILENT = 1.9, 10.0  # seconds until a notice appears, and at most between two
COLUMNS, ROWS = 80, 24  # of terminals that say they have none


Move = Callable[[int, Callable[[], str]], object]


def progress_bar(
    total: int | None, unit: str, wanted: bool | None, done: int = 0
) -> AbstractContextManager[Move]:
    """A function of (finished units, () → note) that moves the bar; it shows the rate, and the note
    beside it.

    Parameters
    ----------
    total : int or None
        Number of units, if it is known.
    unit : str
        What is counted.
    wanted : bool or None
        None: a bar in a terminal or notebook, once the work has taken longer than a second.
    done : int
        Units that were finished before.
    """
    if not isinstance(wanted, (bool, NoneType)):
        raise InputError(
            f"progress must be True, False or None (a bar where someone watches), got {wanted!r}"
        )
    if wanted is False or (wanted is None and not _is_watched()):
        return nullcontext(_unseen)
    return _bar(total, unit, bool(wanted), done)


def _unseen(count: int, note: Callable[[], str]) -> None:
    """Nobody watches."""


@contextmanager
def _bar(total: int | None, unit: str, wanted: bool, done: int) -> Iterator[Move]:
    tqdm = bar_class()
    delay = 0 if wanted else PATIENCE
    how = {"total": total, "initial": done, "unit": unit, "unit_scale": True} | _size()
    with tqdm(**how, delay=delay, leave=wanted) as bar:
        latest: list[Callable[[], str]] = []

        def move(count: int, note: Callable[[], str]) -> None:
            latest[:] = [note]
            if bar.update(count):  # drawn: then the note is worth working out
                bar.set_postfix_str(note(), refresh=False)

        yield move
        if latest and wanted:  # the bar stays: with the last word
            bar.set_postfix_str(latest[0](), refresh=False)


@contextmanager
def notice(what: str, wanted: bool | None = None) -> Iterator[Callable[[Callable[[], str]], None]]:
    """Say what is being done where that takes longer than `SILENCE`, and again every so often, if
    someone watches and `wanted` is not False: a function that takes () → how far it is.
    """
    if wanted is False or not _is_watched():
        yield _unheard
        return
    with _lines(what) as say:
        yield say


@contextmanager
def told(what: str) -> Iterator[None]:
    """The same wherever standard error goes, a file, too: for searches whose length nobody can
    foretell.
    """
    with _lines(what):
        yield


@contextmanager
def told_beside(what: str, wanted: bool | None) -> Iterator[Callable[[Callable[[], str]], None]]:
    """The same beside a bar, where nobody watches it, unless `wanted` is False: a function that
    takes () → how far it is.
    """
    if wanted is not None or _is_watched():
        yield _unheard
        return
    with _lines(what) as say:
        yield say


def _unheard(note: Callable[[], str]) -> None:
    """The bar says it, or nobody wants to know."""


@contextmanager
def _lines(what: str) -> Iterator[Callable[[Callable[[], str]], None]]:
    """Lines on standard error, the first after `SILENCE`, with the latest note."""
    began, done = perf_counter(), Event()
    latest: list[Callable[[], str]] = []

    def tell() -> None:
        wait = SILENCE
        while not done.wait(wait):
            note = f", {latest[0]()}" if latest else ""
            seconds = f"{perf_counter() - began:.0f} s"
            print(f"{what}: {seconds}{note}", file=sys.stderr, flush=True)
            wait = min(2 * wait, MOST_SILENT)

    def say(note: Callable[[], str]) -> None:
        latest[:] = [note]

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield say
    finally:
        done.set()
        teller.join()


def bar_class() -> Any:
    """tqdm's bar for where we are: that of notebooks needs ipywidgets, without which a text bar
    does as well, and without a warning.
    """
    if "IPython" in sys.modules and find_spec("ipywidgets"):
        from tqdm.auto import tqdm

        return tqdm
    from tqdm.std import tqdm as plain

    return plain


def _size() -> dict[str, int]:
    """Columns and rows where a terminal does not know its own, so that tqdm would show nothing."""
    if sys.stderr.isatty() and 0 in os.get_terminal_size(sys.stderr.fileno()):
        return {"ncols": COLUMNS, "nrows": ROWS}
    return {}


def _is_watched() -> bool:
    """Whether what is printed goes to a terminal or a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return sys.stderr.isatty() or type(shell).__name__ == "ZMQInteractiveShell"
