"""Runs from switch to switch in checkpoint files: whole ones, for their steps are known at their
end alone.
"""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.integration.checkpoint import Checkpoint
from varint.integration.choice import Choice
from varint.integration.many_steps import steps_again
from varint.integration.plan import plan
from varint.integration.switches.joined import BetweenNodes
from varint.integration.switches.within_rows import (
    WithinRows,
    dense_output_of,
    first_scene,
    sets_of,
)
from varint.numerics.archive import read_archive
from varint.numerics.plain import field_of, plain
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.serialisation import differences, rule_of
from varint.scene.system import System

FORMAT = "varint checkpoint of switches 1"
NODES, BRANCHES = ("t", "q", "p", "v", "k", "u", "c", "sizes"), "switches_"
HELD = "active_set"  # array of scenes with contacts


def kept_choice(file: Checkpoint, system: System) -> Choice | None:
    """The run in the file; None where there is none yet, or one of another kind.

    Raises
    ------
    InputError
        If the file is torn, or of another run.
    """
    if not file.path.exists():
        file.read()  # whether it can be written
        return None
    header, arrays = read_archive(file.path, "checkpoint of varint")
    if header.get("format") != FORMAT:
        return None
    changed = differences(field_of(header, "identity", dict[str, str]), file.identity)
    if changed:
        raise InputError(
            f"the checkpoint {file.path} belongs to another run: it differs in {changed}; repeat "
            "the call that wrote it, or give another path"
        )
    if any(name not in arrays for name in NODES):
        raise InputError(f"the checkpoint {file.path} is not whole; move it away")
    rule = rule_of(header.get("rule"))
    branches = {
        name.removeprefix(BRANCHES): x for name, x in arrays.items() if name.startswith(BRANCHES)
    }
    between = dense_output_of(system, rule, branches)
    scene, sets = first_scene(system, between), sets_of(between)
    stats: dict[str, Any] = field_of(header, "stats", dict[str, str | bool | int | float])
    nodes: dict[str, Any] = {name: arrays[name] for name in NODES}
    v = nodes.pop("v")
    if sets:
        if HELD not in arrays:
            raise InputError(f"the checkpoint {file.path} is not whole; move it away")
        nodes[HELD] = arrays[HELD]
    motion = Trajectory(
        system=system,
        rule=rule,
        h=field_of(header, "h", float),
        origin=field_of(header, "origin", float),
        functions=steps_again(rule),
        dense_output=between,
        active_sets=sets,
        events=field_of(header, "events", tuple[Event, ...]),
        stats=MappingProxyType({"plan": plan(scene.system, rule)} | stats),
        **nodes,
    )
    motion.__dict__["v"] = v
    estimate, steps, runs = (field_of(header, x, kind) for x, kind in CHOSEN.items())
    return Choice(rule, steps, motion, estimate, runs, field_of(header, "reached", bool))


CHOSEN: dict[str, type] = {"estimate": float, "steps": int, "runs": int}


def keep(file: Checkpoint, choice: Choice) -> None:
    """Write a run that has come to its end.

    Raises
    ------
    InputError
        If there is a file of another kind.
    """
    if file.path.exists():
        raise InputError(
            f"the checkpoint {file.path} belongs to another run: move it away, or give another path"
        )
    file.put(lambda: _contents(file, choice))


def _contents(file: Checkpoint, choice: Choice) -> tuple[dict[str, Any], dict[str, Any]]:
    motion = choice.motion
    between = motion.dense_output
    assert isinstance(between, (BetweenNodes, WithinRows))
    header = {
        "format": FORMAT,
        "identity": file.identity,
        "rule": plain(choice.rule),
        "h": motion.h,
        "origin": motion.origin,
        "events": plain(motion.events),
        "stats": {name: plain(x) for name, x in motion.stats.items() if name != "plan"},
        "reached": choice.reached,
    }
    header |= {name: getattr(choice, name) for name in CHOSEN}
    arrays: dict[str, Any] = {name: np.asarray(getattr(motion, name)) for name in NODES}
    if motion.active_set is not None:
        arrays[HELD] = motion.active_set
    return header, arrays | {BRANCHES + name: x for name, x in between.to_arrays().items()}


def words_of(backend: str, tol: float, scale: Any, rule: Any, every: int) -> dict[str, str]:
    """What else the bytes of a run depend on."""
    sizes = None if scale is None else np.asarray(scale, dtype=float).tolist()
    return {
        "backend": backend,
        "tol and scale": json.dumps([tol, sizes]),
        "given rule": json.dumps(plain(rule)),
        "every so many": str(every),
    }
