"""Tapes in the user's cache folder: a scene that was seen before need not be arranged again.

A file holds whole numbers, numbers, and their digest before them, and is named by the operations
that were arranged and by the code that arranged them. What is damaged is not read, what cannot be
written is left: all that is lost is time.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from time import monotonic_ns

import casadi as ca
import numpy as np

import varint.numerics.operations
from varint.codegen.cache import CompileError, cache_folder, refuse_foreign
from varint.codegen.tape import Sizes, Tape

KEPT_FROM = 100  # operations: fewer are arranged as fast as they are read
MOST_KEPT = 1000  # files; beyond, the half of them that were not read for longest go
FOLDER, DIGEST = "tapes", 32
# what decides how operations are arranged: files of this folder, and how CasADi's are read
ARRANGING = (
    *("algebra.py", "dependence.py", "emit.py", "graph.py", "kept.py", "powers.py", "rolled.py"),
    *("routines.py", "tape.py", "c/tape.h"),
)
WIDTHS = {"once": 6, "often": 6, "inputs": 3, "outputs": 3}
_COUNTS = len(Sizes._fields) + 3 + len(WIDTHS) + 1  # whole numbers that begin a tape


def key_of(*written: str) -> str:
    """A name for what is arranged from all this."""
    found = hashlib.sha256(_code())
    for text in written:
        found.update(f"{len(text)}\n{text}".encode())
    return found.hexdigest()[:40]


@cache
def _code() -> bytes:
    here = Path(__file__).parent
    read = (here / name for name in ARRANGING)
    found = hashlib.sha256(f"{ca.__version__} {sys.byteorder}".encode())
    for path in (*read, Path(varint.numerics.operations.__file__)):
        found.update(path.read_bytes())
    return found.digest()


def kept_tapes(key: str, names: list[str]) -> dict[str, Tape]:
    """The tapes that are kept under a key, in the order in which they were written; none where
    there are none that are whole.
    """
    try:
        path = cache_folder() / FOLDER / key
        refuse_foreign(path.parent)
        refuse_foreign(path)
        content = path.read_bytes()
        os.utime(path)
    except (OSError, CompileError):
        return {}
    if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
        with suppress(OSError):  # cut short by a full disk
            path.unlink()
        return {}
    return dict(zip(names, _read(content[DIGEST:], len(names)), strict=True))


def keep_tapes(key: str, tapes: dict[str, Tape]) -> None:
    """Keep tapes under a key, if there is room."""
    content = _written([*tapes.values()])
    try:
        folder = cache_folder() / FOLDER
        folder.mkdir(mode=0o700, exist_ok=True)
        refuse_foreign(folder)
        _make_room(folder)
        # a name of one's own; `tempfile` takes longer to import than all this to write
        name = folder / f"{key}-{os.getpid()}-{monotonic_ns()}"
        number = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(name, folder / key)
        except BaseException:
            name.unlink(missing_ok=True)
            raise
    except (OSError, CompileError):
        return


def _make_room(folder: Path) -> None:
    if len(os.listdir(folder)) < MOST_KEPT:
        return
    with os.scandir(folder) as entries:
        ages = sorted((entry.stat().st_mtime_ns, entry.path) for entry in entries)
    for _, path in ages[: len(ages) // 2]:
        Path(path).unlink(missing_ok=True)


def _written(tapes: list[Tape]) -> bytes:
    """Counts of all tapes, then their numbers."""
    counts, parts = list[int](), list[bytes]()
    for tape in tapes:
        tables = [getattr(tape, name) for name in WIDTHS]
        counts += [*tape.sizes, tape.uniforms, tape.numbers, tape.registers]
        counts += [*map(len, tables), len(tape.constants)]
        parts += [tape.constants.tobytes(), *(table.tobytes() for table in tables)]
    return np.array(counts, np.int64).tobytes() + b"".join(parts)


def _read(content: bytes, count: int) -> list[Tape]:
    heads = np.frombuffer(content, np.int64, count * _COUNTS).reshape(count, -1).tolist()
    tapes, at, sizes = list[Tape](), 8 * count * _COUNTS, len(Sizes._fields)
    for head in heads:
        uniforms, numbers, registers, *lengths, constants = head[sizes:]
        tables = [np.frombuffer(content, float, constants, at)]
        for width, length in zip(WIDTHS.values(), lengths, strict=True):
            at += tables[-1].nbytes
            flat = np.frombuffer(content, np.uint16, length * width, at)
            tables.append(flat.reshape(length, width))
        at += tables[-1].nbytes
        values, *others = tables
        found = dict(zip(WIDTHS, others, strict=True), constants=values)
        tapes.append(Tape(Sizes(*head[:sizes]), uniforms, numbers, registers, **found))
    return tapes
