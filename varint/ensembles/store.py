"""An ensemble on disk: one folder, what it is in one file, each chunk of members in another; or
a zarr group.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from varint.ensembles.asked import Asked
from varint.ensembles.chunk import ARRAYS, NEW, Chunk, from_arrays
from varint.ensembles.members import Members
from varint.ensembles.zarr_store import (
    Group,
    begin_group,
    group_of,
    header_of,
    is_zarr,
    read_arguments,
    refuse_misshapen,
)
from varint.errors import InputError
from varint.numerics.archive import read_archive, write_archive
from varint.numerics.files import write_atomically
from varint.numerics.limits import MOST_STEPS, check_memory
from varint.numerics.plain import field_of, finite, plain
from varint.rules.rule import Rule
from varint.scene.serialisation import (
    UNTRUSTED,
    describe,
    differences,
    identity,
    revive,
    rule_of,
)
from varint.scene.system import System

FORMAT = "varint ensemble 2"
OLD = "varint ensemble 1"  # with systems as serialised CasADi functions
INDEX = "ensemble.npz"
CHUNK = re.compile(r"members_(\d{10,})_(\d{7,})\.npz", re.ASCII)
ROWS = ("q0", "v0", "p0", "u", "c")


@dataclass(frozen=True, eq=False)
class Store(Sequence):
    """The chunks in a folder or a zarr group as a sequence in order of members; each is read
    when asked for.
    """

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
    """The chunks in a folder, of members of so many nodes and coordinates: a file is written under
    another name and then renamed.
    """

    path: Path
    shape: tuple[int, int]

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, number) of the chunks that are complete."""
        names = sorted(path.name for path in self.path.iterdir())
        found = [match for name in names if (match := CHUNK.fullmatch(name))]
        return [(int(match[1]), int(match[2])) for match in found]

    def chunk(self, first: int, count: int) -> Chunk:
        """One of them."""
        path = self._path(first, count)
        _, arrays = _read(path)
        wanted = {
            name: (count, *(self.shape if name in ("q", "p") else ()))
            for name in ARRAYS
            if name in arrays or name not in NEW
        }
        wrong = [
            name for name, x in wanted.items() if name not in arrays or arrays[name].shape != x
        ]
        if wrong:
            raise InputError(f"{path} is torn or not from varint: {wrong} do not fit; delete it")
        return from_arrays(first, arrays)

    def add(self, chunk: Chunk) -> None:
        """Write a chunk."""
        arrays: dict[str, Any] = {name: getattr(chunk, name) for name in ARRAYS}
        write_atomically(
            self._path(chunk.first, len(chunk)),
            lambda file: write_archive(file, {}, arrays, compress=False),
        )

    def _path(self, first: int, count: int) -> Path:
        return self.path / f"members_{first:010}_{count:07}.npz"


def open_store(
    where: Any, system: System, rule: Rule | None, members: Members, backend: str
) -> Store:
    """The store of this ensemble in a folder or a zarr group: a new one, or the one that an earlier
    call began.

    Raises
    ------
    InputError
        If another ensemble or something else is there, or it cannot be written.
    """
    present = {name: getattr(members, name) for name in ROWS if getattr(members, name) is not None}
    rows: dict[str, Any] = {name: present.get(name, np.zeros(0)) for name in ROWS}
    numbers = {name: getattr(members, name) for name in ("t0", "h", "steps", "save_every")}
    if (asked := members.asked) is not None:
        rows["times"] = asked.times
        numbers |= {"duration": asked.duration, "tol": asked.tol}
    mine = identity(system, rule, backend=backend, **rows, **numbers)
    header = {
        "format": FORMAT,
        "identity": mine,
        "system": describe(system),
        "rule": plain(rule),
        **numbers,
        "given": list(present),
    }
    if asked is not None:
        header["backend"] = asked.backend
    shape = (len(members.k), system.structure.n)
    if is_zarr(where):
        group = group_of(where, "a")
        found = header_of(group)
        if found is None:
            begin_group(group, header, rows, len(members), len(members.k))
        else:
            _refuse_another(found, mine, "zarr group")
        return Store(Group(group))
    if not isinstance(where, (str, Path)):
        raise InputError(
            f"store must be the path of a folder, or a zarr group, got {type(where).__name__}"
        )
    folder = Path(where)
    index = folder / INDEX
    try:
        if index.exists():
            _refuse_another(_read(index)[0], mine, f"folder {folder}")
            return Store(Folder(folder, shape))
        if folder.exists() and any(folder.iterdir()):
            raise InputError(
                f"the folder {folder} is not empty and holds no ensemble; give a new or an empty "
                "one"
            )
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot make the folder {folder}: {getattr(error, 'strerror', None) or error}"
        ) from None
    write_atomically(index, lambda file: write_archive(file, header, rows, compress=False))
    return Store(Folder(folder, shape))


def _refuse_another(header: dict[str, Any], mine: dict[str, str], where: str) -> None:
    if header.get("format") != FORMAT:
        raise InputError(
            f"the {where} has the format {header.get('format')!a}, and this version writes "
            f"{FORMAT!r}; give another folder"
        )
    if changed := differences(field_of(header, "identity", dict[str, str]), mine):
        raise InputError(
            f"the {where} holds another ensemble: it differs in {changed}; repeat the call that "
            "made it, or give another folder"
        )


def load_store(where: Any, *, trust: bool = False) -> tuple[System, Rule | None, Members, Store]:
    """System, rule, members and chunks of a complete ensemble on disk."""
    if is_zarr(where):
        group = group_of(where, "r")
        found = header_of(group)
        if found is None:
            raise InputError(f"the zarr group {where} is empty")
        header, data = found, read_arguments(group)
    else:
        group = None
        header, data = _read(Path(where) / INDEX)
    if header.get("format") not in (FORMAT, *((OLD,) if trust else ())):
        old = f"; {UNTRUSTED}" if header.get("format") == OLD else ""
        raise InputError(
            f"{where} has the format {header.get('format')!a}; this version reads {FORMAT!r}{old}"
        )
    try:
        system, members = _members(header, data, trust)
        own = header.get("rule")
        rule = None if own is None and members.asked is not None else rule_of(own)
    except InputError as error:
        raise InputError(f"{where} is no whole ensemble: {error}") from None
    shape = (len(members.k), system.q.numel())
    store = Store(Folder(Path(where), shape) if group is None else Group(group))
    if group is not None:
        refuse_misshapen(group, (len(members), *shape))
    at = 0
    for first, count in store.ranges:
        if first != at:
            break
        at += count
    if at != len(members):
        raise InputError(
            f"the ensemble in {where} is not complete ({at} of {len(members)} members); repeat the "
            "call that began it"
        )
    return system, rule, members, store


def _members(
    header: dict[str, Any], data: dict[str, np.ndarray], trust: bool
) -> tuple[System, Members]:
    """System and members of a store, if numbers and shapes are possible."""
    system = revive(header.get("system"), trust=trust)
    given = field_of(header, "given", list[str])
    missing = [name for name in ("q0", "c", *given) if name not in data]
    if missing:
        raise InputError(f"{missing} are missing")
    rows: dict[str, Any] = {name: data[name] if name in given else None for name in ROWS}
    q0, n, sizes = data["q0"], system.q.numel(), (1, len(data["q0"]))
    steps, every = (field_of(header, name, int) for name in ("steps", "save_every"))
    if not (1 <= steps <= MOST_STEPS and every >= 1):
        raise InputError(f"it has {steps} steps, of which every {every}th is kept")
    check_memory("its nodes", steps / every, "read it on a larger one")
    u = system.control.numel()
    fits = {
        "q0": q0.ndim == 2 and q0.shape[1] == n and len(q0) > 0,
        "v0": rows["v0"] is None or rows["v0"].shape == q0.shape,
        "p0": rows["p0"] is None or rows["p0"].shape == q0.shape,
        "c": data["c"].ndim == 2 and data["c"].shape[1] == system.c.numel(),
        "u": rows["u"] is None or (rows["u"].ndim in (2, 3, 4) and rows["u"].shape[-1] == u),
    }
    for name, fit in fits.items():
        x = rows[name]
        if not fit or (x is not None and (len(x) not in sizes or x.dtype.kind != "f")):
            raise InputError(f"{name} does not fit the system: shape {data[name].shape}")
    return system, Members(
        0,
        t0=finite("t0", field_of(header, "t0", float)),
        h=finite("h", field_of(header, "h", float)),
        steps=steps,
        save_every=every,
        asked=_asked(header, data),
        **rows,
    )


def _asked(header: dict[str, Any], data: dict[str, np.ndarray]) -> Asked | None:
    """What the members of a store were asked for; None where their steps were given."""
    if "tol" not in header:
        return None
    times = data.get("times", np.zeros(0))
    if times.ndim != 1 or not len(times) or times.dtype != float or not np.isfinite(times).all():
        raise InputError("the times of its nodes are not finite numbers")
    return Asked(
        times,
        finite("duration", field_of(header, "duration", float)),
        finite("tol", field_of(header, "tol", float)),
        field_of(header, "backend", str),
    )


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    try:
        return read_archive(path, "part of an ensemble")
    except InputError as error:
        raise InputError(f"{error} (torn or not from varint); delete it") from None
