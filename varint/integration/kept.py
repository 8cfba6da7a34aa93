"""Motions of runs whose steps are chosen, in checkpoint files: whole ones, once they are found.

What such a run will be is known at its end alone: its steps may follow the scene, grow, or end at
switches, by the best of several runs. So it is made as without a file, by whichever way is the
shortest, and the motion that comes of it is kept.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from time import perf_counter
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.integration.checkpoint import Checkpoint, path_of, watched_as_words
from varint.integration.fixed_steps import watches_of
from varint.integration.from_files import whole_motion
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start
from varint.integration.switches.joined import BetweenNodes
from varint.integration.switches.within_rows import WithinRows, first_scene
from varint.integration.time_transformation.time_scale import AUTO, FLIGHT, transformed_scene
from varint.integration.to_tolerance import whole_problem
from varint.integration.tolerance import DEFAULT_TOL
from varint.integration.trajectories import with_stats
from varint.numerics.plain import field_of, plain
from varint.results.save import INNER, parts_of
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.inputs import number, positive_integer
from varint.scene.serialisation import identity
from varint.scene.system import System

FORMAT = "varint checkpoint of a motion 1"
NOT_KEPT = "the motion is not kept in its checkpoint: {}"
SCALE = "time scale"  # in headers
Parts = tuple[dict[str, Any], dict[str, Any]]  # what is not an array, and what is


def kept_motion(
    make: Callable[[], Trajectory],
    system: System,
    rule: Rule | None,
    start: Start,
    options: RunOptions,
    times: np.ndarray | None,
    began: float,
) -> Trajectory:
    """The motion in the file `options.checkpoint`, or else the one that is made, which is kept
    there; with the warnings that there were of it. One that Ctrl-C ended is not kept.

    Raises
    ------
    InputError
        If the file is torn, none of this format, of another run, or cannot be written.
    """
    if options.duration is None:
        return make()  # which says what is missing
    with warnings.catch_warnings():  # what is said of the start is said with the run
        warnings.simplefilter("ignore")
        file = _file_of(system, rule, start, options, times)
    found = file.opened(FORMAT, partial(_read, system))
    if found is not None:
        motion, told = found
        for text in told:
            warnings.warn(text, stacklevel=3)
        return with_stats(motion, seconds=perf_counter() - began)
    said: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            motion = make()
        if not motion.stats["interrupted"]:
            told = [str(x.message) for x in said if x.category is UserWarning]
            file.put(lambda: _contents(file, motion, told), NOT_KEPT, 4)
    finally:
        for one in said:
            warnings.warn(one.message, one.category, stacklevel=3)
    return motion


def _file_of(
    system: System, rule: Rule | None, start: Start, options: RunOptions, times: np.ndarray | None
) -> Checkpoint:
    """The file, and all that the bytes of the motion depend on."""
    path, own = path_of(options.checkpoint), plan(system, rule).rule
    problem = whole_problem(system, own, start, options.duration)
    numbers = {name: getattr(problem, name) for name in ("q0", "p0", "t0", "u")}
    numbers |= {
        "v0": [] if start.v0 is None else np.array(start.v0, dtype=float),
        "params": problem.c,
        "duration": number("duration", options.duration),
        "tol": DEFAULT_TOL if options.tol is None else options.tol,
        "scale": [] if options.scale is None else _scale_of(options.scale),
        "save_every": positive_integer("save_every", options.save_every),
        "at": [] if times is None else times,
    }
    words = watched_as_words(system, *watches_of(options.until, options.events))
    words |= {"backend": str(options.backend), "on_failure": str(options.on_failure)}
    words["given rule"] = json.dumps(plain(rule))
    return Checkpoint(path, identity(system, own, **numbers, **words))


def _scale_of(scale: Any) -> np.ndarray:
    return parsed_or_refused(
        lambda: np.array(scale, dtype=float),
        lambda: f"scale must be numbers, got {type(scale).__name__}",
    )


def _contents(file: Checkpoint, motion: Trajectory, told: list[str]) -> Parts:
    """What the file is to hold."""
    if file.path.exists():
        raise InputError(f"{file.path} has been written meanwhile, by another run")
    header, arrays = parts_of(motion)
    header |= {"format": FORMAT, "identity": file.identity, "warnings": told}
    known = {"": motion}
    inner = motion.fictitious
    if inner is not None:
        known[INNER] = inner
        header["fictitious"][SCALE] = _word_of(motion.system, inner)
    for first, one in known.items():
        if "v" in one.__dict__:  # by the loop, to its last digit
            arrays[first + "v"] = one.v
    return header, arrays


def _word_of(system: System, inner: Trajectory) -> str:
    """By which of the scene's own time scales steps vary."""
    for word in (AUTO, FLIGHT):
        with suppress(InputError):  # where it has none
            if transformed_scene(system, word).system is inner.system:
                return word
    raise InputError("its steps follow a time scale that is none of the scene's own")


def _read(
    system: System, header: dict[str, Any], arrays: dict[str, np.ndarray]
) -> tuple[Trajectory, list[str]]:
    """The motion of the system that a file holds, and what was said of it."""

    def scene_in(about: dict[str, Any]) -> System:
        if about is header:
            return system
        return transformed_scene(system, field_of(about, SCALE, str)).system

    told = field_of(header, "warnings", list[str])
    try:
        motion = whole_motion(header, arrays, scene_in)
        inner, between, scene = motion.fictitious, motion.dense_output, system
        if inner is not None:
            scene = inner.system
            _say_how(inner, scene)
        elif isinstance(between, (BetweenNodes, WithinRows)):
            scene = first_scene(system, between).system
        _say_how(motion, scene)
    except InputError as error:
        raise InputError(f"the checkpoint is not whole: {error}") from None
    except Exception as error:  # what a foreign header makes fail; a whole one fails in nothing
        why = f"{type(error).__name__}: {error}"
        raise InputError(f"the checkpoint is not whole ({why})") from None
    return motion, told


def _say_how(motion: Trajectory, scene: System) -> None:
    """Give a motion that was just read what its header says in words: the plan, of the scene whose
    steps it has.
    """
    stats = {**motion.stats, "plan": plan(scene, motion.rule)}
    motion.__dict__["stats"] = MappingProxyType(stats)
