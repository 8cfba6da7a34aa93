"""Checkpoints: a run that is killed at any moment goes on from its last one, and ends with the same bytes."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from varint.description import differences, identity
from varint.errors import InputError
from varint.files import write_whole
from varint.manifold import Phase
from varint.rules import Rule
from varint.stepping.run import Block, Position, Task
from varint.system import System
from varint.trajectory import Event

FORMAT = "varint checkpoint 3"
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
        phases = list(dict.fromkeys(block.phase for block in nodes if block.phase is not None))
        if phases:
            arrays["phase"] = np.concatenate([np.full(len(b.k), phases.index(b.phase)) for b in nodes if b.phase])
        header = {
            "format": FORMAT,
            "identity": self.identity,
            "k": at.k,
            "largest": at.largest,
            "by_newton": at.by_newton,
            "t": at.t,
            "phase": None if at.phase is None else asdict(at.phase),
            "phases": [asdict(phase) for phase in phases],
            "impacts": at.events,
            "residual": max(block.residual for block in nodes),
            "iterations": sum(block.iterations for block in nodes),
            "events": [asdict(event) for event in [*events, *(e for block in nodes for e in block.events)]],
        }
        write_whole(self.path, lambda file: np.savez(file, header=np.array(json.dumps(header)), **arrays))
        self.last = perf_counter()
        self.cost = self.last - began

    def read(self) -> list[Block]:
        """All nodes of the run so far, in a block as long as the same contacts held; nothing if there is no file yet.

        Raises
        ------
        InputError
            If the file is torn, no checkpoint, or one of another run.
        """
        if not self.path.exists():
            if not self.path.parent.is_dir():
                raise InputError(f"there is no folder {self.path.parent} for the checkpoint {self.path.name}")
            return []
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as data:
                header: dict[str, Any] = json.loads(str(data["header"]))
                if header["format"] != FORMAT:
                    raise ValueError(f"its format is {header['format']!r}, not {FORMAT!r}")
                k, t, q, p = (data[name] for name in NODES)
                state = {name: data[name] for name in POSITION if name in data}
                taken_over = bool(header["by_newton"])
                after = Position(
                    k=int(header["k"]), largest=int(header["largest"]), by_newton=taken_over, t=header["t"],
                    phase=_phase(header["phase"]), events=int(header["impacts"]), **state,
                )  # fmt: skip
                events = tuple(Event(**event) for event in header["events"])
                first = Block(
                    k, q, p, float(header["residual"]), len(k), t=t, events=events,
                    iterations=int(header["iterations"]), after=after,
                )  # fmt: skip
                phases = [_phase(phase) for phase in header["phases"]]
                blocks = _in_phases(first, data["phase"], phases) if phases else [first]
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
        return blocks


def _phase(data: dict[str, list[int]] | None) -> Phase | None:
    return None if data is None else Phase(**{name: tuple(rows) for name, rows in data.items()})


def _in_phases(whole: Block, which: np.ndarray, phases: list[Phase | None]) -> list[Block]:
    """The block in pieces of one phase each; what is counted once stays with the first."""
    edges = [0, *(np.flatnonzero(np.diff(which)) + 1).tolist(), len(which)]
    pieces = []
    for a, b in pairwise(edges):
        k, q, p = (x[a:b] for x in (whole.k, whole.q, whole.p))
        t = None if whole.t is None else whole.t[a:b]
        piece = whole._replace(k=k, q=q, p=p, t=t, good=b - a, phase=phases[which[a]])
        pieces.append(piece if a == 0 else piece._replace(events=(), iterations=0))
    return pieces


def checkpoint_of(path: Any, system: System, rule: Rule, task: Task, **words: str) -> Checkpoint:
    """The checkpoint of a run at a path; `words` say what else its bytes depend on."""
    if not isinstance(path, (str, Path)):
        raise InputError(f"checkpoint must be the path of a file, got {path!r}")
    numbers = {name: getattr(task, name) for name in ("q0", "p0", "t0", "h", "steps", "save_every", "u", "level")}
    return Checkpoint(Path(path), identity(system, rule, params=task.c, **numbers, **words))
