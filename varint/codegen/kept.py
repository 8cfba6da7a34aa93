"""Tapes and tables in the user's cache folder: a scene that was seen before need not be arranged
again.

A file holds whole numbers, numbers, and their digest before them, and is named by the operations
that were arranged and by the code that arranged them, or by what tables are of. What is damaged is
not read, what cannot be written is left: all that is lost is time.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from functools import cache
from time import monotonic_ns

import casadi as ca
import numpy as np

import varint.numerics.operations
from varint.codegen.built import bytes_of
from varint.codegen.cache import CompileError, cache_place, refuse_foreign
from varint.codegen.tape import Sizes, Tape

KEPT_FROM = 100  # operations: fewer are arranged as fast as they are read
MOST_KEPT = 1000  # files; beyond, the half of them that were not read for longest go
FOLDER, DIGEST = "tapes", 32
# what decides how operations are arranged: files of this folder, and how CasADi's are read
ARRANGING = (
    *("algebra.py", "arranged.py", "dependence.py", "graph.py", "kept.py", "rolled.py"),
    *("routines.py", "tape.py", "c/tape.h", "c/graph.h", "c/powers.h", "c/raw_graph.h"),
    *("c/algebra_core.c", "c/dependence_core.c", "c/tape_core.c"),
)
WIDTHS = {"once": 6, "often": 6, "inputs": 3, "outputs": 3}
_COUNTS = len(Sizes._fields) + 3 + len(WIDTHS) + 1  # whole numbers that begin a tape


def key_of(*written: str, code: bytes | None = None) -> str:
    """A name for what is made from all this, by `code`: by default that which arranges."""
    found = hashlib.sha256(_code() if code is None else code)
    for text in written:
        found.update(f"{len(text)}\n{text}".encode())
    return found.hexdigest()[:40]


@cache
def _code() -> bytes:
    here = os.path.dirname(__file__)
    read = (os.path.join(here, *name.split("/")) for name in ARRANGING)
    return code_of(*read, varint.numerics.operations.__file__)


def code_of(*paths: str) -> bytes:
    """A digest of files, of CasADi's version and of the order of bytes here."""
    found = hashlib.sha256(f"{ca.__version__} {sys.byteorder}".encode())
    for path in paths:
        found.update(bytes_of(path))
    return found.digest()


def kept_tapes(key: str, names: list[str]) -> dict[str, Tape]:
    """The tapes that are kept under a key, in the order in which they were written; none where
    there are none that are whole.
    """
    content = kept_content(key)
    return dict(zip(names, _read(content, len(names)), strict=True)) if content else {}


def kept_content(key: str) -> bytes:
    """What is kept under a key; nothing where there is nothing that is whole."""
    try:
        folder = os.path.join(cache_place(), FOLDER)
        path = os.path.join(folder, key)
        refuse_foreign(folder)
        refuse_foreign(path)
        content = bytes_of(path)
        os.utime(path)
    except (OSError, CompileError):
        return b""
    if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
        with suppress(OSError):  # cut short by a full disk
            os.unlink(path)
        return b""
    return content[DIGEST:]


def keep_tapes(key: str, tapes: dict[str, Tape]) -> None:
    """Keep tapes under a key, if there is room."""
    keep_content(key, _written([*tapes.values()]))


def keep_content(key: str, content: bytes) -> None:
    """Keep anything under a key, if there is room."""
    try:
        folder = os.path.join(cache_place(), FOLDER)
        os.makedirs(folder, mode=0o700, exist_ok=True)
        refuse_foreign(folder)
        _make_room(folder)
        # a name of one's own; `tempfile` takes longer to import than all this to write
        name = os.path.join(folder, f"{key}-{os.getpid()}-{monotonic_ns()}")
        number = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(name, os.path.join(folder, key))
        except BaseException:
            with suppress(FileNotFoundError):
                os.unlink(name)
            raise
    except (OSError, CompileError):
        return


def _make_room(folder: str) -> None:
    if len(os.listdir(folder)) < MOST_KEPT:
        return
    with os.scandir(folder) as entries:
        ages = sorted((entry.stat().st_mtime_ns, entry.path) for entry in entries)
    for _, path in ages[: len(ages) // 2]:
        with suppress(FileNotFoundError):
            os.unlink(path)


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
