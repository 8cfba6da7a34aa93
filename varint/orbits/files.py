"""Results of this floor on disk: one ``.npz`` file, no pickle."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.numerics.archive import write_archive
from varint.numerics.files import VERSION, write_atomically
from varint.numerics.plain import field_of, plain
from varint.results.save import file_path

FORMAT = "varint orbits 1"
PLAIN = {"int": int, "float": float, "str": str}  # annotations of fields that are no arrays


def save(result: Any, path: Any) -> None:
    """Write a result made of arrays, numbers and words to ``path``.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written, or the disk is full.
    """
    header: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "kind": type(result).__name__,
        "words": {},
    }
    arrays: dict[str, np.ndarray] = {}
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = value
        elif isinstance(value, tuple) and value and isinstance(value[0], np.ndarray):
            arrays |= {f"{field.name}.{i}": x for i, x in enumerate(value)}
        else:
            header["words"][field.name] = plain(value)
    write_atomically(
        file_path(path), lambda file: write_archive(file, header, arrays, compress=True)
    )


def restored(header: dict[str, Any], arrays: dict[str, np.ndarray], kinds: dict[str, type]) -> Any:
    """The result in a file, one of these kinds.

    Raises
    ------
    InputError
        If it is of no kind that is known, or not whole: every field must be there, and be an array,
        arrays, or a word or number as the class says.
    """
    kind = kinds.get(str(header.get("kind")))
    if kind is None:
        raise InputError(f"it holds a {header.get('kind')!a}; known: {sorted(kinds)}")
    words = field_of(header, "words", dict)
    found: dict[str, Any] = {}
    for field in fields(kind):
        name, annotation = field.name, str(field.type)
        several = sorted(key for key in arrays if key.startswith(f"{name}."))
        if annotation == "np.ndarray" and name in arrays:
            found[name] = arrays[name]
        elif several:
            found[name] = tuple(arrays[key] for key in several)
        elif annotation.startswith("tuple") and isinstance(words.get(name), list):
            found[name] = tuple(map(str, words[name]))
        elif annotation in PLAIN and name in words:
            found[name] = field_of(words, name, PLAIN[annotation])
        else:
            raise InputError(f"{name} of {kind.__name__} is missing")
    return kind(**found)
