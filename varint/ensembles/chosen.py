"""Members whose steps are chosen: each is what `simulate` makes of it to an accuracy, by a rule and
steps of its own, at times that all of them share.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from threading import Lock
from time import perf_counter
from typing import Any

import numpy as np

from varint.ensembles.chunk import Chunk, Said, empty_chunk
from varint.ensembles.members import Members, start_of
from varint.errors import ConvergenceError, InputError
from varint.integration.asked_times import only_at
from varint.integration.short_call import short_call
from varint.integration.simulate import simulate
from varint.integration.trajectories import with_stats
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_NAMED = 20  # members named in a warning
NUMBERS = re.compile(r"[-+]?\d[\d.e+-]*")
# Python hears warnings of a process, not of a thread: threads take turns
HEARING = Lock()


def chosen_chunk(system: System, rule: Rule | None, members: Members) -> Chunk:
    """The nodes of all members of a chunk, and what was said of them."""
    chunk, said = empty_chunk(system, members), list[Said]()
    assert members.asked is not None
    times = members.asked.times
    with HEARING, warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        for i in range(len(members)):
            motion: Trajectory | None
            try:
                motion = run_chosen(system, rule, members, i, times)
                told = motion.stats  # made at the first look
                chunk.step[i], chunk.estimate[i] = told["steps"], told["error_estimate"]
            except ConvergenceError as error:
                motion = nodes_before(error, times)
                chunk.step[i] = error.step
                chunk.failed[i] = error.residual if np.isfinite(error.residual) else np.inf
            except InputError as error:
                raise InputError(f"member {members.first + i}: {error}") from None
            if motion is not None:
                good = chunk.good[i] = len(motion.t)
                chunk.q[i, :good], chunk.p[i, :good] = motion.q, motion.p
                chunk.residual[i] = motion.stats["residual"]
            if heard:
                own = members.first + i, float(chunk.estimate[i])
                said += [Said(*own, one.category, str(one.message)) for one in heard]
                heard.clear()
    return replace(chunk, said=tuple(said))


def run_chosen(
    system: System, rule: Rule | None, members: Members, i: int, times: np.ndarray | None = None
) -> Trajectory:
    """One member alone, with nodes at these times or with its own."""
    asked = members.asked
    assert asked is not None
    q0, v0, p0, t0, params, u = start_of(system, members, i)
    params = params or None
    if u is None and (v0 is None) != (p0 is None) and asked.backend == "auto":
        # what `simulate` would try first: all its other arguments are looked at here once for all
        begin, how = (q0, v0, t0, params), (asked.duration, asked.tol, perf_counter(), None, times)
        tried = short_call(system, rule, begin, p0, *how)
        if type(tried) is Trajectory:
            return tried if times is None else only_at(tried, times)
    motion = simulate(
        system,
        rule,
        q0=q0,
        v0=v0,
        p0=p0,
        duration=asked.duration,
        t0=t0,
        u=u,
        params=params,
        at=times,
        tol=asked.tol,
        progress=False,
        backend=asked.backend,
    )
    if motion.stats.get("interrupted"):
        raise KeyboardInterrupt  # what it has until then is no member
    return motion


def chosen_member(system: System, rule: Rule | None, members: Members, i: int) -> Trajectory:
    """One member once more, up to its failure, quietly, with the nodes of all members; with its own
    where it has none of those.

    Raises
    ------
    ConvergenceError
        If it did not move at all.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        motion = chosen_nodes(system, rule, members, i)
        if motion is None:
            try:
                motion = run_chosen(system, rule, members, i)
            except ConvergenceError as error:
                if error.trajectory is None:
                    raise
                motion = error.trajectory
    return with_stats(motion, member=i)


def chosen_nodes(system: System, rule: Rule | None, members: Members, i: int) -> Trajectory | None:
    """The nodes of one member once more, up to its failure, quietly; None where it has none."""
    assert members.asked is not None
    times = members.asked.times
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            return run_chosen(system, rule, members, i, times)
        except ConvergenceError as error:
            return nodes_before(error, times)


def nodes_before(error: ConvergenceError, times: np.ndarray) -> Trajectory | None:
    """The motion before a failure, with the nodes that it reached; None where there are none."""
    motion = error.trajectory
    if motion is None:
        return None
    ahead = (times - motion.t[-1]) * (1.0 if motion.h > 0 else -1.0)
    reached = times[ahead <= 0]
    return only_at(motion, reached) if len(reached) else None


def warn_of_said(said: list[Said]) -> None:
    """One warning for all members of which the same was said, in the words that were said of the
    one with the largest error.
    """
    alike: dict[Any, list[Said]] = {}
    for one in said:
        kind = NUMBERS.sub("", one.text.partition(":")[0])
        alike.setdefault((one.category, kind), []).append(one)
    for (category, _), some in alike.items():
        worst = max(some, key=lambda one: np.nan_to_num(one.estimate))
        numbers = sorted({one.member for one in some})
        who = f"member {worst.member}"
        if len(numbers) > 1:
            more = " …" if len(numbers) > MOST_NAMED else ""
            who = f"{len(numbers)} members, {numbers[:MOST_NAMED]}{more}; of {who}"
        warnings.warn(f"{who}: {worst.text}", category, stacklevel=3)
