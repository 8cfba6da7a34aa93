"""Checkpoints: a run that is killed at any moment goes on from its last one, and ends with the
same bytes.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.events.crossings import Watch
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.numerics.archive import read_archive, write_archive
from varint.numerics.files import remove_parts, write_atomically
from varint.numerics.plain import field_of, plain
from varint.results.records import Event
from varint.rules.rule import Rule
from varint.scene.serialisation import differences, expression_as_data, identity
from varint.scene.system import System

Held = TypeVar("Held")
FORMAT = "varint checkpoint 6"
GOES_ON = (
    "the run goes on without its checkpoint: {}; what the file held before stays, and writing is "
    "tried again later"
)
# seconds between two checkpoints, more where writing them would take more than a tenth of the run
PAUSE = 1.0
MOST_SHARE = 0.1
NODES = ("k", "t", "q", "p")
POSITION = ("x", "scale", "inertia", "carry")


@dataclass(eq=False)
class Checkpoint:
    """The file of one run, and when it was last written."""

    path: Path
    identity: dict[str, str]
    cost: float = 0.0
    failed: bool = False  # whether it could not be written once; it is said once
    last: float = field(default_factory=perf_counter)

    def due(self) -> bool:
        """Whether it is time to write."""
        return perf_counter() - self.last >= max(PAUSE, self.cost / MOST_SHARE)

    def write(self, t0: float, h: float, nodes: list[NodeBlock], events: list[Event]) -> None:
        """Write the nodes so far and where to go on from; the old file stays until the new one
        is whole. A full disk does not end the run: it is said once, and tried again later.
        """
        ends = [i for i, block in enumerate(nodes, 1) if block.after]
        if not ends:
            return
        whole, last = nodes[: ends[-1]], nodes[ends[-1] - 1].after
        assert last is not None
        if len(whole) < len(nodes):  # the rest is done again
            time = t0 + h * last.k if last.t is None else last.t
            events = [event for event in events if (event.time - time) * h <= 0]
        self.put(lambda: self._contents(t0, h, whole, events, last))

    def put(
        self,
        contents: Callable[[], tuple[dict[str, Any], dict[str, Any]]],
        failed: str = GOES_ON,
        frames: int = 6,
    ) -> None:
        """Write a header and arrays; where that cannot be, say it so many frames further out."""
        began = perf_counter()
        try:
            header, arrays = contents()
            write_atomically(
                self.path, lambda file: write_archive(file, header, arrays, compress=False)
            )
        except (InputError, MemoryError) as error:
            if not self.failed:
                why = str(error) or "no memory is left"
                warnings.warn(failed.format(why), stacklevel=frames)
            self.failed = True
        self.last = perf_counter()
        self.cost = self.last - began

    def _contents(
        self, t0: float, h: float, nodes: list[NodeBlock], events: list[Event], at: RunState
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Header and arrays of the run so far."""
        times = [t0 + h * block.k if block.t is None else block.t for block in nodes]
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(b, name) for b in nodes]) for name in "kqp"
        }
        arrays |= {"t": np.concatenate(times), "x": at.x, "scale": at.scale, "inertia": at.inertia}
        arrays |= {} if at.carry is None else {"carry": at.carry}
        active_sets = list(
            dict.fromkeys(block.active_set for block in nodes if block.active_set is not None)
        )
        if active_sets:
            arrays["phase"] = np.concatenate(
                [np.full(len(b.k), active_sets.index(b.active_set)) for b in nodes if b.active_set]
            )
        header = {
            "format": FORMAT,
            "identity": self.identity,
            "k": at.k,
            "largest": at.largest,
            "by_newton": at.by_newton,
            "t": at.t,
            "phase": None if at.active_set is None else plain(at.active_set),
            "phases": plain(active_sets),
            "impacts": at.events,
            "residual": float(max(block.residual for block in nodes)),
            "iterations": int(sum(block.iterations for block in nodes)),
            "events": plain([*events, *(e for block in nodes for e in block.events)]),
        }
        return header, arrays

    def read(self) -> list[NodeBlock]:
        """All nodes of the run so far, in a block as long as the same contacts held; nothing if
        there is no file yet.

        Raises
        ------
        InputError
            Those of `opened`.
        """
        return self.opened(FORMAT, _blocks_of) or []

    def opened(
        self, form: str, held: Callable[[dict[str, Any], dict[str, np.ndarray]], Held]
    ) -> Held | None:
        """What a file of this format holds, by its header and arrays; None if there is no file yet.

        Raises
        ------
        InputError
            If the file is torn, none of this format, or one of another run, or cannot be written.
        """
        if not self.path.exists():
            if not self.path.parent.is_dir():
                raise InputError(
                    f"there is no folder {self.path.parent} for the checkpoint {self.path.name}"
                )
            if not os.access(self.path.parent, os.W_OK):
                raise InputError(
                    f"the folder {self.path.parent} of the checkpoint cannot be written; give "
                    "another path"
                )
            return None
        remove_parts(self.path)
        try:
            header, arrays = read_archive(self.path, "checkpoint of varint")
            if header.get("format") != form:
                raise InputError(
                    f"{self.path} has the format {header.get('format')!a}, not {form!r}"
                )
            changed = differences(field_of(header, "identity", dict[str, str]), self.identity)
            found = None if changed else held(header, arrays)
        except InputError as error:
            raise InputError(
                f"{error}; move it away to start the run anew, or give another path"
            ) from None
        if changed:
            raise InputError(
                f"the checkpoint {self.path} belongs to another run: it differs in {changed}; "
                "repeat the call that wrote it, or give another path"
            )
        return found


def _blocks_of(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> list[NodeBlock]:
    """The nodes of a checkpoint, in a block as long as the same contacts held."""
    missing = [name for name in (*NODES, "x", "scale", "inertia") if name not in arrays]
    if missing:
        raise InputError(f"the checkpoint is not whole: {missing} are missing")
    k, t, q, p = (arrays[name] for name in NODES)
    if k.dtype.kind != "i" or not len(k) == len(t) == len(q) == len(p) > 0 or q.shape != p.shape:
        raise InputError("the checkpoint is not whole: its nodes do not fit together")
    after = RunState(
        k=field_of(header, "k", int),
        largest=field_of(header, "largest", int),
        by_newton=field_of(header, "by_newton", bool),
        t=field_of(header, "t", float | None),
        active_set=field_of(header, "phase", ActiveSet | None),
        events=field_of(header, "impacts", int),
        **{name: arrays[name] for name in POSITION if name in arrays},
    )
    first = NodeBlock(
        k,
        q,
        p,
        field_of(header, "residual", float),
        len(k),
        t=t,
        events=field_of(header, "events", tuple[Event, ...]),
        iterations=field_of(header, "iterations", int),
        after=after,
    )
    active_sets = field_of(header, "phases", list[ActiveSet])
    if not active_sets:
        return [first]
    which = arrays.get("phase")
    if (
        which is None
        or which.shape != k.shape
        or not set(which.tolist()) <= {*range(len(active_sets))}
    ):
        raise InputError("the checkpoint is not whole: it does not say what held")
    return _by_active_set(first, which, active_sets)


def _by_active_set(
    whole: NodeBlock, which: np.ndarray, active_sets: list[ActiveSet]
) -> list[NodeBlock]:
    """The block in pieces of one active set each; what is counted once stays with the first."""
    edges = [0, *(np.flatnonzero(np.diff(which)) + 1).tolist(), len(which)]
    pieces = []
    for a, b in pairwise(edges):
        k, q, p = (x[a:b] for x in (whole.k, whole.q, whole.p))
        t = None if whole.t is None else whole.t[a:b]
        piece = whole._replace(k=k, q=q, p=p, t=t, good=b - a, active_set=active_sets[which[a]])
        pieces.append(piece if a == 0 else piece._replace(events=(), impacts=None, iterations=0))
    return pieces


def checkpoint_of(
    path: Any,
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    stop: Watch | None,
    watches: Sequence[Watch],
    **words: str,
) -> Checkpoint:
    """The checkpoint of a run at a path; `stop` ends it and `watches` are logged, `words` say what
    else its bytes depend on.
    """
    numbers = {
        name: getattr(problem, name)
        for name in ("q0", "p0", "t0", "h", "steps", "save_every", "u", "level")
    }
    words |= watched_as_words(system, stop, watches)
    words["active set"] = json.dumps(plain(problem.active_set))
    return Checkpoint(path_of(path), identity(system, rule, params=problem.c, **numbers, **words))


def path_of(path: Any) -> Path:
    """Where a user wants a checkpoint."""
    if not isinstance(path, (str, Path)):
        raise InputError(f"checkpoint must be the path of a file, got {path!r}")
    return Path(path)


def watched_as_words(
    system: System, stop: Watch | None, watches: Sequence[Watch]
) -> dict[str, str]:
    """What is watched for, to tell one run from another."""
    return {
        "until": json.dumps([_watch_as_data(system, watch) for watch in ([stop] if stop else [])]),
        "events": json.dumps([_watch_as_data(system, watch) for watch in watches]),
    }


def _watch_as_data(system: System, watch: Watch) -> list[str | int]:
    return [watch.name, watch.direction, expression_as_data(system, watch.expression, watch.name)]
