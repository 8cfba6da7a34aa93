"""An ensemble in a zarr group: one array of all members for each quantity, on any storage that
zarr can write.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from varint.ensembles.chunk import ARRAYS, NEW, Chunk, from_arrays
from varint.ensembles.executor import GROUP, MOST_NUMBERS
from varint.errors import InputError
from varint.numerics.limits import check_memory

SUFFIX = ".zarr"
GIVEN = "given"  # group with the starts, parameters and controls
ATTRIBUTE = "varint"  # of the group: what the ensemble is, as JSON
# ways to pack numbers that only unpack them again, by the names of both versions of the format
CODECS = frozenset({"bytes", "transpose", "zstd", "blosc", "gzip", "zlib", "lz4", "crc32c"})
SHAPES = dict.fromkeys(("q", "p"), ("nodes", "n"))  # of one member; the rest are numbers


def is_zarr(where: Any) -> bool:
    """Whether ``store=`` names a zarr group: the group itself, or a path that ends in .zarr."""
    return type(where).__module__.partition(".")[0] == "zarr" or str(where).endswith(SUFFIX)


def group_of(where: Any, mode: Any) -> Any:
    """The zarr group.

    Raises
    ------
    InputError
        If zarr is missing, or the group cannot be opened.
    """
    try:
        import zarr
    except ImportError:
        raise InputError(
            "store= a zarr group needs zarr (pip install varint-mechanics[zarr]); a path without "
            ".zarr makes a folder of npz files, which needs nothing"
        ) from None
    if isinstance(where, zarr.Group):
        return where
    if not isinstance(where, (str, Path)):
        raise InputError(f"store must be a path or a zarr group, got a zarr {type(where).__name__}")
    try:
        return zarr.open_group(str(where), mode=mode)
    except Exception as error:  # storages fail in many ways; all mean the same
        raise InputError(
            f"cannot open the zarr group {where}: {type(error).__name__}: {error}"
        ) from None


@dataclass(frozen=True, eq=False)
class Group:
    """The members in a group that are done: those whose number of good nodes is written, which
    comes last.
    """

    group: Any

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, number) of pieces of what is done, small enough for memory."""
        done = _read(self.group, "good", slice(None)) > 0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], done.astype(int), [0]])))
        nodes, n = self.group["q"].shape[1:]
        most = max(MOST_NUMBERS // (2 * nodes * n) // GROUP, 1) * GROUP
        return [
            (first, min(most, end - first))
            for begin, end in edges.reshape(-1, 2).tolist()
            for first in range(begin, end, most)
        ]

    def chunk(self, first: int, count: int) -> Chunk:
        """A piece of what is done."""
        part = slice(first, first + count)
        return from_arrays(
            first, {name: _read(self.group, name, part) for name in names_in(self.group)}
        )

    def add(self, chunk: Chunk) -> None:
        """Write a chunk; that its members are done comes last."""
        part = slice(chunk.first, chunk.first + len(chunk))
        for name in sorted(names_in(self.group), key=lambda name: name == "good"):
            try:
                self.group[name][part] = getattr(chunk, name)
            except OSError as error:
                raise InputError(
                    f"cannot write to the zarr group: {error.strerror or error}"
                ) from None


def names_in(group: Any) -> list[str]:
    """Names of the arrays of members that are to be there: groups of earlier versions have less."""
    return [name for name in ARRAYS if name not in NEW or name in group]


def header_of(group: Any) -> dict[str, Any] | None:
    """What the ensemble in the group is; None in an empty group."""
    text = group.attrs.get(ATTRIBUTE)
    if text is None:
        if list(group):
            raise InputError(
                "the zarr group is not empty and holds no ensemble; give a new or an empty one"
            )
        return None
    try:
        header = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        header = None
    if not isinstance(header, dict):
        raise InputError("the zarr group holds no ensemble of varint: its header cannot be read")
    return header


def refuse_misshapen(group: Any, shape: tuple[int, int, int]) -> None:
    """Refuse a group whose arrays are not those of so many members, nodes and coordinates."""
    for name in names_in(group):
        found, wanted = _array(group, name).shape, shape if name in SHAPES else shape[:1]
        if found != wanted:
            raise InputError(
                f"the zarr array {name!r} has shape {found}, not {wanted}; delete the group"
            )


def begin_group(
    group: Any, header: dict[str, Any], rows: dict[str, np.ndarray], members: int, nodes: int
) -> None:
    """Make the arrays of a new ensemble; whole groups of members are chunks, so that none is
    written twice.
    """
    sizes = {"nodes": nodes, "n": rows["q0"].shape[1]}
    checked = _check(group)
    for name, value in rows.items():
        place = group.create_array(
            f"{GIVEN}/{name}", shape=value.shape, dtype=value.dtype, chunks="auto", **checked
        )
        place[...] = value
    for name in ARRAYS:
        shape = tuple(sizes[size] for size in SHAPES.get(name, ()))
        whole = np.int64 if name in ("good", "step") else np.float64
        rest = dict(dtype=whole, chunks=(GROUP, *shape), fill_value=0)
        group.create_array(name, shape=(members, *shape), **rest, **checked)
    group.attrs[ATTRIBUTE] = json.dumps(header)


def _check(group: Any) -> dict[str, Any]:
    """Compression with a checksum, without which a torn bit would pass for data; version 2 of
    the format has none.
    """
    if group.metadata.zarr_format < 3:
        return {}
    from zarr.codecs import ZstdCodec

    return {"compressors": [ZstdCodec(level=0, checksum=True)]}


def read_arguments(group: Any) -> dict[str, np.ndarray]:
    """Starts, parameters and controls."""
    try:
        names = list(group[GIVEN])
    except Exception as error:  # a foreign group fails in many ways; all mean the same
        raise _torn(GIVEN, error) from None
    return {name: _read(group, f"{GIVEN}/{name}", ...) for name in names}


def _read(group: Any, name: str, part: Any) -> np.ndarray:
    array = _array(group, name)
    rows = len(range(*part.indices(array.shape[0]))) if isinstance(part, slice) else None
    size = math.prod(array.shape if rows is None else (rows, *array.shape[1:]))
    check_memory(f"the zarr array {name!r}", size, "read it on a larger one")
    try:
        return np.asarray(array[part])
    except Exception as error:  # torn chunks fail in many ways; all mean the same
        raise _torn(name, error) from None


def _array(group: Any, name: str) -> Any:
    """An array of the group, of numbers, packed in ways that only unpack.

    Zarr unpacks by whatever codec the group names, and one of them is Python's pickle, which runs
    programs.
    """
    try:
        array = group[name]
        about = array.metadata.to_dict()
        packed = [*(about.get("codecs") or ()), *(about.get("filters") or ())]
        packed += [about["compressor"]] if about.get("compressor") else []
        codecs = {str(one.get("name", one.get("id"))) for one in packed}
        kind, chunk = array.dtype.kind, math.prod(array.chunks)
    except Exception as error:  # a foreign group fails in many ways; all mean the same
        raise _torn(name, error) from None
    if kind not in "fi" or not codecs <= CODECS:
        raise InputError(
            f"the zarr array {name!r} is not from varint: numbers of kind {kind!r} packed by "
            f"{sorted(codecs)}"
        )
    check_memory(f"a chunk of the zarr array {name!r}", chunk, "read it on a larger one")
    return array


def _torn(name: str, error: Exception) -> InputError:
    return InputError(
        f"the zarr array {name!r} is torn or not from varint ({type(error).__name__}: {error}); "
        "delete the group"
    )
