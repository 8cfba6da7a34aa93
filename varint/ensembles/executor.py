"""Chunks of members on any `concurrent.futures.Executor`: sized by measurement, each done once,
lost ones again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    ProcessPoolExecutor,
    wait,
)
from functools import lru_cache
from typing import Any

from varint.ensembles.batch import step_chunk
from varint.ensembles.chunk import Chunk
from varint.ensembles.members import Members
from varint.errors import VarintError
from varint.numerics.plain import plain
from varint.rules.rule import Rule
from varint.scene.serialisation import describe, revive, rule_of
from varint.scene.system import System

SECONDS = 0.5  # of work a chunk: long against sending it, short against losing it
# members that a compiled loop steps together: chunks hold whole groups, so that groups are always
# the same
GROUP = 8
SAMPLE = 16  # members that are timed
# in the result of a chunk: 16 MB, and some times as much while it is worked on
MOST_NUMBERS = 2_000_000
ROUNDS = 4  # chunks a worker has at least, so that fast ones help slow ones
UNKNOWN_WORKERS = 16
MOST_TRIES = 4  # of a chunk whose worker is lost

Range = tuple[int, int]


def compute(
    system: System,
    rule: Rule | None,
    members: Members,
    todo: list[Range],
    executor: Executor | None,
    backend: str,
) -> Iterator[Chunk]:
    """The chunks of the ranges (first, number) that are to be done, in the order in which they
    come.
    """
    queue = _cut(todo, [GROUP, SAMPLE])
    began, done = time.perf_counter(), 0
    # the first builds the functions, the second tells what a member costs
    for first, count in queue[:2]:
        began, done = time.perf_counter(), count
        yield step_chunk(system, rule, members[first : first + count], backend)
    left = sum(count for _, count in queue[2:])
    if not left:
        return
    per_member = max((time.perf_counter() - began) / done, 1e-9)
    numbers = 2 * len(members.k) * system.structure.n
    size = max(min(int(SECONDS / per_member), MOST_NUMBERS // numbers), 1)
    if executor is None:
        for first, count in _cut(queue[2:], [_whole_groups(size)] * left):
            yield step_chunk(system, rule, members[first : first + count], backend)
        return
    size = _whole_groups(min(size, -(-left // (ROUNDS * _workers(executor)))))
    yield from _distribute(system, rule, members, _cut(queue[2:], [size] * left), executor, backend)


def _whole_groups(size: int) -> int:
    return max(size // GROUP, 1) * GROUP


def _cut(ranges: list[Range], sizes: list[int]) -> list[Range]:
    """The ranges in pieces of at most these sizes, one after the other; what is left when the
    sizes end stays whole.
    """
    pieces, sizes = [], list(reversed(sizes))
    for first, count in ranges:
        while count:
            size = min(sizes.pop(), count) if sizes else count
            pieces.append((first, size))
            first, count = first + size, count - size
    return pieces


def _distribute(
    system: System,
    rule: Rule | None,
    members: Members,
    queue: list[Range],
    executor: Executor,
    backend: str,
) -> Iterator[Chunk]:
    """Chunks from the workers; never more of them under way than the workers need, so that
    memory stays bounded.
    """
    what = json.dumps({"system": describe(system), "rule": plain(rule), "backend": backend})
    window, own = ROUNDS * _workers(executor), None
    waiting, tries = list(reversed(queue)), dict.fromkeys(queue, 0)
    running: dict[Any, Range] = {}
    try:
        while waiting or running:
            lost: list[tuple[Range, BaseException]] = []
            while waiting and len(running) < window:
                piece = waiting.pop()
                try:
                    running[executor.submit(work, what, members[piece[0] : sum(piece)])] = piece
                except BrokenExecutor as error:
                    lost.append((piece, error))
                    break
            for future in wait(running, return_when=FIRST_COMPLETED).done if running else ():
                piece = running.pop(future)
                try:
                    chunk = future.result()
                except BaseException as error:
                    if not _is_loss(error):
                        raise
                    lost.append((piece, error))
                else:
                    yield chunk
            for piece, cause in lost:
                tries[piece] += 1
                if tries[piece] >= MOST_TRIES:
                    raise VarintError(
                        f"members {piece[0]} to {sum(piece) - 1} were lost with their workers "
                        f"{MOST_TRIES} times ({type(cause).__name__}); is there enough memory? "
                        "With store= all other members are kept"
                    ) from cause
                waiting.append(piece)
            if any(isinstance(cause, BrokenExecutor) for _, cause in lost) and not running:
                if own is not None:
                    own.shutdown(wait=False)
                own = executor = _replacement(executor)
    finally:
        for future in running:
            future.cancel()
        if own is not None:
            own.shutdown(wait=False)


def work(what: str, members: Members) -> Chunk:
    """A chunk in a worker: plain data in, plain data out."""
    system, rule, backend = _scene(what)
    return step_chunk(system, rule, members, backend)


@lru_cache(maxsize=8)
def _scene(what: str) -> tuple[System, Rule | None, str]:
    """System, rule and backend of a description; kept, so that a worker builds its functions
    once.
    """
    data = json.loads(what)
    rule = None if data["rule"] is None else rule_of(data["rule"])
    return revive(data["system"]), rule, data["backend"]


def _is_loss(error: BaseException) -> bool:
    """Whether a worker was lost, and not the work wrong."""
    known = isinstance(error, (BrokenExecutor, CancelledError, ConnectionError, EOFError))
    return known or type(error).__module__.startswith("distributed")


def _workers(executor: Executor) -> int:
    for name in ("_max_workers", "num_workers"):
        count = getattr(executor, name, None)
        if isinstance(count, int) and count > 0:
            return count
    return UNKNOWN_WORKERS


def _replacement(executor: Executor) -> Executor:
    """A pool of processes breaks as a whole when one of them is killed; a new one takes over."""
    if type(executor).__module__.partition(".")[0] == "loky":
        import loky

        return loky.ProcessPoolExecutor(_workers(executor))
    if not isinstance(executor, ProcessPoolExecutor):
        raise VarintError(
            f"the executor {type(executor).__name__} broke and cannot be replaced; give a new one"
        )
    return ProcessPoolExecutor(
        _workers(executor), mp_context=getattr(executor, "_mp_context", None)
    )
