"""The library of loops for scenes as data that setup.py has built with the package."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from ctypes import CDLL, c_char, c_int
from functools import cache
from pathlib import Path


@cache
def built_library() -> CDLL | None:
    """What setup.py has built of these sources; None where there was no compiler."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted((here / "c").glob("*.[ch]")):
        digest.update(path.read_bytes())
    for path in here.glob("_core.*"):
        with suppress(OSError, ValueError):  # made for another machine, or of sources before
            built = CDLL(str(path))
            if (c_char * 64).in_dll(built, "digest").value == digest.hexdigest().encode():
                return built
    return None


def newer_functions() -> bool:
    """Whether that library takes the vector functions that are in the C library since glibc 2.35:
    what is compiled beside it does as it does.
    """
    built = built_library()
    return built is None or bool(c_int.in_dll(built, "newer_functions").value)
