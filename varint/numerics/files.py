"""Files that are whole or absent, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from typing import IO, TYPE_CHECKING, Any

from varint.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

VERSION = "0.2.0"  # of varint; files and the identity of runs tell it
PART = ".part"


def write_atomically(path: Path, write: Callable[[IO[bytes]], Any]) -> None:
    """Write a file under another name, bring it to the disk, and rename it: a crash or a full disk
    leaves the old file or the new one.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written, or the disk is full.
    """
    import shutil  # which take as long to import as a tenth of all that a run needs
    from pathlib import Path

    try:
        whole = Path(os.path.realpath(path))  # of a link: the file that it stands for
        # one name a writer: what two of them write at once is not mixed up
        part = whole.with_name(f"{whole.name}.{os.getpid()}-{threading.get_ident()}{PART}")
        try:
            with part.open("wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            if whole.exists():
                shutil.copymode(whole, part)
            part.replace(whole)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    if os.name == "posix":
        with contextlib.suppress(OSError):  # some file systems cannot; the file itself is safe
            folder = os.open(whole.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def remove_parts(path: Path) -> None:
    """Remove what writers of this file left behind when they were killed."""
    for part in path.parent.iterdir() if path.parent.is_dir() else ():
        if part.name.startswith(f"{path.name}.") and part.name.endswith(PART):
            with contextlib.suppress(OSError):
                part.unlink()
