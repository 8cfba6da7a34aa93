"""Archives of arrays with a header: ``.npz`` files that `numpy.load` reads, too, without pickle.

What an archive declares is looked at before memory is asked for it, and nothing in it is executed.
"""

from __future__ import annotations

import json
import math
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from varint.errors import InputError
from varint.numerics.limits import check_memory

HEADER, LONG = "header", "its header is no text of at most {} letters"
KINDS = "fiub"  # of arrays: numbers of a fixed size
MOST_HEADER = 2**26  # letters; the lists and words that they become take some ten times as much
MOST_ARRAYS = 10_000
# what deflate can make of a byte, and what a member of no length may hold besides (RFC 1951)
MOST_INFLATED, SLACK = 1032, 1032
COPIES = 2  # of what is read that memory must hold: it is there to be computed with
PIECE = 2**20  # bytes that are unpacked at once
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date of the format: equal contents, equal bytes


class _Declared(NamedTuple):
    """What an array says about itself."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype


def write_archive(
    file: IO[bytes], header: Mapping[str, Any], arrays: Mapping[str, Any], *, compress: bool
) -> None:
    """Write a header of plain data and arrays of numbers.

    Raises
    ------
    InputError
        If the header is so long that it would not be read again.
    """
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    text = json.dumps(header)
    if len(text) > MOST_HEADER:
        raise InputError(LONG.format(MOST_HEADER))
    contents = {HEADER: np.array(text)} | dict(arrays)
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, value in contents.items():
            about = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            about.compress_type = method
            with archive.open(about, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)


def read_archive(path: Path, what: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of the file; `what` it should be, for the message.

    Raises
    ------
    InputError
        If there is no such file, or it is torn, foreign, or declares more than it can hold or this
        machine has memory for.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = _members(archive, os.fstat(file.fileno()).st_size)
            text = str(_read(archive, members.pop(HEADER, None), "U"))
            header = json.loads(text)
            if not isinstance(header, dict):
                raise InputError(f"its header is a {type(header).__name__}")
            return header, {name: _read(archive, one, KINDS) for name, one in members.items()}
    except FileNotFoundError:
        raise InputError(f"there is no file {path}") from None
    except InputError as error:
        raise InputError(f"{path} is no {what}: {error}") from None
    except Exception as error:  # a torn or foreign file fails in many ways; all mean the same
        raise InputError(f"{path} is torn or no {what} ({type(error).__name__}: {error})") from None


def _members(archive: zipfile.ZipFile, length: int) -> dict[str, zipfile.ZipInfo]:
    """The arrays by name, if the file can hold them all."""
    found, packed = archive.infolist(), 0
    names = [one.filename.removesuffix(".npy") for one in found]
    if len(found) > MOST_ARRAYS or len(set(names)) < len(found):
        raise InputError(f"it holds {len(found)} arrays, or two of one name")
    for one in found:
        stored = one.compress_type == zipfile.ZIP_STORED
        if not (stored or one.compress_type == zipfile.ZIP_DEFLATED) or one.flag_bits & 1:
            raise InputError(f"{one.filename} is packed in a way that varint does not write")
        most = one.compress_size * (1 if stored else MOST_INFLATED) + (0 if stored else SLACK)
        packed += one.compress_size
        if packed > length or one.file_size > most:
            raise InputError(
                f"{one.filename} declares {one.file_size} bytes, more than the file's can hold"
            )
    numbers = COPIES * sum(one.file_size for one in found) / 8
    check_memory("what it declares", numbers, "read it on a larger one")
    return dict(zip(names, found, strict=True))


def _read(archive: zipfile.ZipFile, about: zipfile.ZipInfo | None, kinds: str) -> np.ndarray:
    """An array whose kind is allowed and whose size is what the archive says."""
    if about is None:
        raise InputError("it has no header")
    with archive.open(about) as member:
        shape, fortran, dtype = _declared(member)
        size = math.prod(shape) * dtype.itemsize
        if (
            dtype.kind not in kinds
            or dtype.hasobject
            or dtype.subdtype
            or min(shape, default=0) < 0
        ):
            raise InputError(f"{about.filename} holds {dtype} of shape {shape}")
        if kinds == "U" and (shape or dtype.itemsize > 4 * MOST_HEADER):
            raise InputError(LONG.format(MOST_HEADER))
        if member.tell() + size != about.file_size:
            raise InputError(f"{about.filename} declares another size than the archive")
        room, at = np.empty(size, np.uint8), 0
        while at < size:
            piece = member.read(min(PIECE, size - at))
            if not piece:
                raise InputError(f"{about.filename} ends too early")
            room[at : at + len(piece)] = np.frombuffer(piece, np.uint8)
            at += len(piece)
        member.read(1)  # at the end its checksum is compared
    if not size:
        return np.empty(shape, dtype)
    array = room.view(dtype).reshape(shape, order="F" if fortran else "C")
    return array.astype(dtype.newbyteorder("="), copy=False)


def _declared(member: IO[bytes]) -> _Declared:
    """Shape, order and type of an array; of version 1, whose own header is at most 64 kB long."""
    version = np.lib.format.read_magic(member)
    if version != (1, 0):
        raise InputError(f"it holds an array of version {version}")
    return _Declared(*np.lib.format.read_array_header_1_0(member))
