"""An ensemble on disk: one folder, what it is in one file, each chunk of members in another; or a zarr group."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from varint.description import describe, differences, identity, revive, rule_of
from varint.ensembles.batch import Chunk
from varint.ensembles.members import Members
from varint.ensembles.zarr_store import Group, begun, given, group_of, header_of, is_zarr
from varint.errors import InputError
from varint.files import write_whole
from varint.rules import Rule
from varint.system import System

FORMAT = "varint ensemble 1"
INDEX = "ensemble.npz"
ROWS = ("q0", "v0", "p0", "u", "c")


@dataclass(frozen=True, eq=False)
class Store(Sequence):
    """The chunks in a folder or a zarr group as a sequence in order of members; each is read when asked for."""

    place: Folder | Group

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, number) of the chunks that are complete."""
        return self.place.ranges

    @property
    def sizes(self) -> list[int]:
        """Number of members of each chunk."""
        return [count for _, count in self.ranges]

    def __len__(self) -> int:
        return len(self.ranges)

    def __getitem__(self, i: Any) -> Any:
        return self.place.chunk(*self.ranges[i])

    def __iter__(self) -> Iterator[Chunk]:
        return (self.place.chunk(first, count) for first, count in self.ranges)

    def add(self, chunk: Chunk) -> None:
        """Write a chunk."""
        self.place.add(chunk)


@dataclass(frozen=True, eq=False)
class Folder:
    """The chunks in a folder: a file is written under another name and then renamed."""

    path: Path

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, number) of the chunks that are complete."""
        names = sorted(path.stem.split("_") for path in self.path.glob("members_*_*.npz"))
        return [(int(first), int(count)) for _, first, count in names]

    def chunk(self, first: int, count: int) -> Chunk:
        """One of them."""
        arrays = _read(self._path(first, count))
        return Chunk(first, *(arrays[f.name] for f in fields(Chunk)[1:]))

    def add(self, chunk: Chunk) -> None:
        """Write a chunk."""
        arrays: dict[str, Any] = {f.name: getattr(chunk, f.name) for f in fields(Chunk)[1:]}
        write_whole(self._path(chunk.first, len(chunk)), lambda file: np.savez(file, **arrays))

    def _path(self, first: int, count: int) -> Path:
        return self.path / f"members_{first:010}_{count:07}.npz"


def opened(where: Any, system: System, rule: Rule, members: Members, backend: str) -> Store:
    """The store of this ensemble in a folder or a zarr group: a new one, or the one that an earlier call began.

    Raises
    ------
    InputError
        If another ensemble or something else is there, or it cannot be written.
    """
    present = {name: getattr(members, name) for name in ROWS if getattr(members, name) is not None}
    rows: dict[str, Any] = {name: present.get(name, np.zeros(0)) for name in ROWS}
    numbers = {name: getattr(members, name) for name in ("t0", "h", "steps", "save_every")}
    mine = identity(system, rule, backend=backend, **rows, **numbers)
    header = {
        "format": FORMAT, "identity": mine, "system": describe(system), "rule": asdict(rule), **numbers,
        "given": list(present),
    }  # fmt: skip
    if is_zarr(where):
        group = group_of(where, "a")
        found = header_of(group)
        if found is None:
            begun(group, header, rows, len(members), len(members.k))
        else:
            _refuse_another(found, mine, "zarr group")
        return Store(Group(group))
    if not isinstance(where, (str, Path)):
        raise InputError(f"store must be the path of a folder, or a zarr group, got {type(where).__name__}")
    folder = Path(where)
    index = folder / INDEX
    try:
        if index.exists():
            _refuse_another(json.loads(str(_read(index)["header"])), mine, f"folder {folder}")
            return Store(Folder(folder))
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"the folder {folder} is not empty and holds no ensemble; give a new or an empty one")
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot make the folder {folder}: {getattr(error, 'strerror', None) or error}") from None
    write_whole(index, lambda file: np.savez(file, header=np.array(json.dumps(header)), **rows))
    return Store(Folder(folder))


def _refuse_another(header: dict[str, Any], mine: dict[str, str], where: str) -> None:
    if changed := differences(header.get("identity", {}), mine):
        raise InputError(
            f"the {where} holds another ensemble: it differs in {changed}; repeat the call that made it, "
            "or give another folder"
        )


def loaded(where: Any) -> tuple[System, Rule, Members, Store]:
    """System, rule, members and chunks of a complete ensemble on disk."""
    if is_zarr(where):
        group = group_of(where, "r")
        store, header = Store(Group(group)), header_of(group)
        if header is None:
            raise InputError(f"the zarr group {where} is empty")
        data = given(group)
    else:
        store, data = Store(Folder(Path(where))), _read(Path(where) / INDEX)
        header = json.loads(str(data["header"]))
    if header.get("format") != FORMAT:
        raise InputError(f"{where} has the format {header.get('format')!r}; this version reads {FORMAT!r}")
    rows: dict[str, Any] = {name: data[name] if name in header["given"] else None for name in ROWS}
    members = Members(0, t0=header["t0"], h=header["h"], steps=header["steps"], save_every=header["save_every"], **rows)
    if sum(store.sizes) < len(members):
        raise InputError(
            f"the ensemble in {where} is not complete ({sum(store.sizes)} of {len(members)} members); repeat the call "
            "that began it"
        )
    return revive(header["system"]), rule_of(header["rule"]), members, store


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    except Exception as error:  # a torn or foreign file fails in many ways; all mean the same
        raise InputError(f"{path} is torn or not from varint ({type(error).__name__}: {error}); delete it") from None
