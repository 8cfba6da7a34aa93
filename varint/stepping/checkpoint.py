"""Checkpoints: a run that is killed at any moment goes on from its last one, and ends with the same bytes."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from varint.description import differences
from varint.errors import InputError
from varint.files import write_whole
from varint.stepping.run import Block, Division, Position

FORMAT = "varint checkpoint 1"
PAUSE = 1.0  # seconds between two checkpoints, more where writing them would take more than a tenth of the run
MOST_SHARE = 0.1


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

    def write(self, nodes: list[Block]) -> None:
        """Write the nodes so far and where to go on from; the old file stays until the new one is whole."""
        began = perf_counter()
        at = nodes[-1].after
        header = {
            "format": FORMAT,
            "identity": self.identity,
            "k": at.k,
            "largest": at.largest,
            "residual": max(block.residual for block in nodes),
            "divided": [list(d) for block in nodes for d in block.divided],
        }
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(block, name) for block in nodes]) for name in ("k", "t", "q", "p")
        }
        arrays |= {"x": at.x, "scale": at.scale, "inertia": at.inertia}
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
                identity = header["identity"]
                k, t, q, p = (data[name] for name in ("k", "t", "q", "p"))
                x, scale, inertia = (data[name] for name in ("x", "scale", "inertia"))
                after = Position(x, scale, inertia, int(header["k"]), int(header["largest"]))
                divided = tuple(Division(*d) for d in header["divided"])
                residual = float(header["residual"])
        except Exception as error:  # torn and foreign files fail in many ways; all mean the same
            raise InputError(
                f"{self.path} is torn or no checkpoint of varint ({type(error).__name__}: {error}); "
                "move it away to start the run anew, or give another path"
            ) from None
        if changed := differences(identity, self.identity):
            raise InputError(
                f"the checkpoint {self.path} belongs to another run: it differs in {changed}; repeat the call that "
                "wrote it, or give another path"
            )
        return Block(k, t, q, p, residual, after, divided=divided)
