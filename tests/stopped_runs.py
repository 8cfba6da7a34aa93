"""Runs that end at a checkpoint, to go on from it."""

from __future__ import annotations

import pytest

import varint as vi
from varint.integration import checkpoint as module

ARRAYS = ("t", "q", "p", "k")


class Stopped(Exception):
    """What ends a run as a kill would, and nothing else."""


def stopped_after(monkeypatch, blocks: int, error: type[BaseException]) -> None:
    """The next run ends with an error as its `blocks`-th checkpoint has been written."""
    monkeypatch.setattr(module, "PAUSE", 0.0)
    monkeypatch.setattr(module, "MOST_SHARE", 1e9)
    write, left = module.Checkpoint.write, [blocks]

    def counted(self, *arguments):
        write(self, *arguments)
        left[0] -= 1
        if not left[0]:
            raise error

    monkeypatch.setattr(module.Checkpoint, "write", counted)


def simulate_until_stopped(monkeypatch, blocks: int, *scene, **start) -> None:
    """A run that is lost as its `blocks`-th checkpoint has been written."""
    with monkeypatch.context() as patch:
        stopped_after(patch, blocks, Stopped)
        with pytest.raises(Stopped):
            vi.simulate(*scene, **start)


def assert_same_bytes(one: vi.Trajectory, other: vi.Trajectory, *more: str) -> None:
    for name in (*ARRAYS, *more):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
