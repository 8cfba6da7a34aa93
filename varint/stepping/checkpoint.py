"""Checkpoints: a run that is killed at any moment goes on from its last one, and ends with the same bytes."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from varint.description import differences, identity
from varint.errors import InputError
from varint.files import write_whole
from varint.rules import Rule
from varint.stepping.run import Block, Position, Task
from varint.system import System
from varint.trajectory import Event

FORMAT = "varint checkpoint 2"
PAUSE = 1.0  # seconds between two checkpoints, more where writing them would take more than a tenth of the run
MOST_SHARE = 0.1
NODES = ("k", "t", "q", "p")
POSITION = ("x", "scale", "inertia", "carry")


@dataclass(eq=False)
class Checkpoint:
    """The file of one run, and when it was last written."""

    path: Path
    identity: dict[str, str]
    cost: float = 0.0
    last: float = field(default_factory=perf_counter)

    def due(self) -> bool:
        """Whether it is time to write."""
        return perf_counter() - self.last >= max(PAUSE, self.cost / MOST_SHARE)

    def write(self, t0: float, h: float, nodes: list[Block], events: list[Event]) -> None:
        """Write the nodes so far and where to go on from; the old file stays until the new one is whole."""
        began, at = perf_counter(), nodes[-1].after
        if at is None:
            return
        times = [t0 + h * block.k if block.t is None else block.t for block in nodes]
        arrays: dict[str, Any] = {name: np.concatenate([getattr(b, name) for b in nodes]) for name in "kqp"}
        arrays |= {"t": np.concatenate(times), "x": at.x, "scale": at.scale, "inertia": at.inertia}
        arrays |= {} if at.carry is None else {"carry": at.carry}
        header = {
            "format": FORMAT,
            "identity": self.identity,
            "k": at.k,
            "largest": at.largest,
            "by_newton": at.by_newton,
            "residual": max(block.residual for block in nodes),
            "iterations": sum(block.iterations for block in nodes),
            "events": [asdict(event) for event in [*events, *(e for block in nodes for e in block.events)]],
        }
        write_whole(self.path, lambda file: np.savez(file, header=np.array(json.dumps(header)), **arrays))
        self.last = perf_counter()
        self.cost = self.last - began

    def read(self) -> Block | None:
        """All nodes of the run so far as one block; None if there is no file yet.

        Raises
        ------
        InputError
            If the file is torn, no checkpoint, or one of another run.
        """
        if not self.path.exists():
            if not self.path.parent.is_dir():
                raise InputError(f"there is no folder {self.path.parent} for the checkpoint {self.path.name}")
            return None
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as data:
                header: dict[str, Any] = json.loads(str(data["header"]))
                if header["format"] != FORMAT:
                    raise ValueError(f"its format is {header['format']!r}, not {FORMAT!r}")
                k, t, q, p = (data[name] for name in NODES)
                state = {name: data[name] for name in POSITION if name in data}
                taken_over = bool(header["by_newton"])
                after = Position(k=int(header["k"]), largest=int(header["largest"]), by_newton=taken_over, **state)
                events = tuple(Event(**event) for event in header["events"])
                block = Block(
                    k, q, p, float(header["residual"]), len(k), t=t, events=events,
                    iterations=int(header["iterations"]), after=after,
                )  # fmt: skip
                changed = differences(header["identity"], self.identity)
        except Exception as error:  # torn and foreign files fail in many ways; all mean the same
            raise InputError(
                f"{self.path} is torn or no checkpoint of varint ({type(error).__name__}: {error}); "
                "move it away to start the run anew, or give another path"
            ) from None
        if changed:
            raise InputError(
                f"the checkpoint {self.path} belongs to another run: it differs in {changed}; repeat the call that "
                "wrote it, or give another path"
            )
        return block


def checkpoint_of(path: Any, system: System, rule: Rule, task: Task, **words: str) -> Checkpoint:
    """The checkpoint of a run at a path; `words` say what else its bytes depend on.

    Raises
    ------
    InputError
        If the scene has contacts.
    """
    if not isinstance(path, (str, Path)):
        raise InputError(f"checkpoint must be the path of a file, got {path!r}")
    if system.structure.contacts:
        raise InputError("a run with contacts cannot be taken up from a checkpoint; leave checkpoint= out")
    numbers = {name: getattr(task, name) for name in ("q0", "p0", "t0", "h", "steps", "save_every", "u", "level")}
    return Checkpoint(Path(path), identity(system, rule, params=task.c, **numbers, **words))
