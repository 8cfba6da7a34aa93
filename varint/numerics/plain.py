"""Records as plain data for JSON, and back: their annotations say what a file must hold."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np

from varint.errors import InputError

T = TypeVar("T")
SIMPLE = {int, float, str, bool, type(None)}
Reader = Callable[[str, Any], Any]  # (what it is, as a file holds it) → value, or InputError


def plain(value: Any) -> Any:
    """A record, array, mapping or number as lists, dictionaries, numbers and words."""
    if type(value) in SIMPLE:  # most of what there is
        return value
    if is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Mapping):
        return {name: plain(x) for name, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(x) for x in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def record_of(kind: Any, what: str, data: Any) -> Any:
    """A dataclass or named tuple from what `plain` made of it.

    Raises
    ------
    InputError
        If a field is missing or is not what its annotation says.
    """
    return reader_of(kind)(what, data)


def field_of(data: Any, name: str, kind: Any) -> Any:
    """One field of a header: what stands under the name, if it is of that kind.

    Raises
    ------
    InputError
        If it is missing, where it may not be None, or of another kind.
    """
    if not isinstance(data, dict):
        raise InputError(f"a header must be a dictionary, got {_short(data)}")
    return reader_of(kind)(name, data.get(name))


@cache
def reader_of(kind: Any) -> Reader:
    """How a value of an annotation is read: float, int, bool, str, None, arrays, lists, tuples,
    dictionaries of words, unions, dataclasses and named tuples.
    """
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _union([reader_of(x) for x in inner])
    if origin is tuple and inner[-1] is not ...:
        return _fixed([reader_of(x) for x in inner])
    if origin in (tuple, list):
        one = reader_of(inner[0])
        return lambda what, x: origin(one(what, y) for y in _of(what, x, list))
    if origin is dict:
        one = reader_of(inner[1])
        return lambda what, x: {name: one(what, y) for name, y in _of(what, x, dict).items()}
    if kind in _PLAIN:
        return _PLAIN[kind]
    hints = typing.get_type_hints(kind)
    readers = {name: reader_of(hint) for name, hint in hints.items()}
    if is_dataclass(kind):
        needed = {
            f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING
        }
    else:
        needed = readers.keys() - kind._field_defaults.keys()

    def record(what: str, x: Any) -> Any:
        data = _of(what, x, dict)
        if missing := sorted(needed - data.keys()):
            raise InputError(f"{what} has no {', '.join(missing)}")
        return kind(
            **{name: read(name, data[name]) for name, read in readers.items() if name in data}
        )

    return record


def _union(readers: list[Reader]) -> Reader:
    def first(what: str, x: Any) -> Any:
        for read in readers[:-1]:
            try:
                return read(what, x)
            except InputError:
                continue
        return readers[-1](what, x)

    return first


def _fixed(readers: list[Reader]) -> Reader:
    def each(what: str, x: Any) -> tuple[Any, ...]:
        if len(_of(what, x, list)) != len(readers):
            raise InputError(f"{what} must have {len(readers)} entries, got {_short(x)}")
        return tuple(read(what, y) for read, y in zip(readers, x, strict=True))

    return each


def _of(what: str, x: Any, kind: type[T]) -> T:
    if not isinstance(x, kind) or (kind is int and isinstance(x, bool)):
        raise InputError(f"{what} must be of type {kind.__name__}, got {_short(x)}")
    return x


def _float(what: str, x: Any) -> float:
    if isinstance(x, bool) or not isinstance(x, (int, float)):
        raise InputError(f"{what} must be a number, got {_short(x)}")
    try:
        return float(x)
    except OverflowError:
        raise InputError(f"{what} is larger than any number of double precision") from None


def _int(what: str, x: Any) -> int:
    if abs(_of(what, x, int)) >= 2**63:
        raise InputError(f"{what} is larger than any whole number of 64 bits")
    return x


def _str(what: str, x: Any) -> str:
    try:
        _of(what, x, str).encode()
    except UnicodeEncodeError:  # half of a pair
        raise InputError(f"{what} holds what is no text: {_short(x)}") from None
    return x


def _none(what: str, x: Any) -> None:
    if x is not None:
        raise InputError(f"{what} must be absent, got {_short(x)}")


def _array(what: str, x: Any) -> np.ndarray:
    try:
        return np.array(_of(what, x, list), dtype=float)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{what} must be an array of numbers, got {_short(x)}") from None


def _short(x: Any) -> str:
    return f"{type(x).__name__} {ascii(x)[:60]}"


def finite(what: str, x: float) -> float:
    """The number, which must be finite."""
    if not math.isfinite(x):
        raise InputError(f"{what} must be finite, got {x}")
    return x


_PLAIN: dict[Any, Reader] = {
    float: _float,
    int: _int,
    bool: lambda what, x: _of(what, x, bool),
    str: _str,
    list: lambda what, x: _of(what, x, list),
    dict: lambda what, x: _of(what, x, dict),
    type(None): _none,
    np.ndarray: _array,
}
