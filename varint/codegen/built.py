"""What setup.py has built with the package: the library of loops for scenes as data, and the module
that calls some of them at once.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from ctypes import CDLL, c_char, c_int
from functools import cache
from importlib import import_module
from types import ModuleType


@cache
def built_library() -> CDLL | None:
    """What setup.py has built of these sources; None where there was no compiler."""
    here = os.path.dirname(__file__)
    for name in os.listdir(here):
        if not name.startswith("_core."):
            continue
        with suppress(OSError, ValueError):  # made for another machine, or of sources before
            built = CDLL(os.path.join(here, name))
            if (c_char * 64).in_dll(built, "digest").value == _digest().encode():
                return built
    return None


@cache
def built_module() -> ModuleType | None:
    """c/direct.c as it was built of these sources; None where that was not so, as where Python came
    without its headers.
    """
    with suppress(ImportError):
        built = import_module("varint.codegen._direct")
        if built.digest == _digest():
            return built
    return None


@cache
def _digest() -> str:
    """Of the C sources."""
    here = os.path.join(os.path.dirname(__file__), "c")
    digest = hashlib.sha256()
    for name in sorted(os.listdir(here)):
        if name.endswith((".c", ".h")):
            digest.update(bytes_of(os.path.join(here, name)))
    return digest.hexdigest()


def bytes_of(path: str) -> bytes:
    """Of a short file, at once."""
    number = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    try:
        return os.read(number, os.fstat(number).st_size)
    finally:
        os.close(number)


def newer_functions() -> bool:
    """Whether that library takes the vector functions that are in the C library since glibc 2.35:
    what is compiled beside it does as it does.
    """
    built = built_library()
    return built is None or bool(c_int.in_dll(built, "newer_functions").value)
