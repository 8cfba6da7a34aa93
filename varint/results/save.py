"""Trajectories on disk and in xarray: one ``.npz`` file, no pickle, to be read back with its
system (`load`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from varint.errors import InputError, VarintError, parsed_or_refused
from varint.numerics.archive import write_archive
from varint.numerics.files import VERSION, write_atomically
from varint.numerics.plain import plain
from varint.results.records import OWN_ACTION, own_action
from varint.results.trajectory import Trajectory
from varint.scene.serialisation import describe

FORMAT = "varint trajectory 2"
BY_HAND = "interpreted"  # in headers: steps that are taken once more are
INNER = "fictitious_"  # before the names of arrays in fictitious time
WHOLE = "whole_"  # before those of the motion with all nodes
SWITCHES = "switches_"  # before those of the branches of a scene that switches
CONTROL = "control_"  # before those of an optimal control
ARRAYS = ("t", "q", "p", "k", "u", "c")
# in the file: of a trajectory
OPTIONAL = {"phase": "active_set", "closure": "closure", "sizes": "sizes"}


def save(trajectory: Trajectory, path: Any) -> None:
    """Write `trajectory` to ``path`` (``.npz`` is appended where it is missing).

    The file holds the arrays, the rule, the step, parameter values, symbol names, the system as a
    list of elementary operations and the version of varint. The file that was there stays until
    the new one is whole.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written, or the disk is full.
    """
    path = file_path(path)
    header, arrays = parts_of(trajectory)
    header |= {"format": FORMAT, "version": VERSION, "system": describe(trajectory.system)}
    if trajectory.fictitious is not None:
        header["fictitious"]["system"] = describe(trajectory.fictitious.system)
    if hasattr(trajectory.solution, "to_arrays"):
        header["control"], found = trajectory.solution.to_arrays()
        arrays |= {CONTROL + name: value for name, value in found.items()}
    elif trajectory.solution is not None:
        header["bounds"] = plain(trajectory.solution)
    write_atomically(path, lambda file: write_archive(file, header, arrays, compress=True))


def parts_of(trajectory: Trajectory) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a file holds of a motion, but for its scenes: what is not an array, and what is."""
    header, arrays = _parts(trajectory)
    if trajectory.fictitious is not None:
        header["fictitious"], inner = _parts(trajectory.fictitious)
        arrays |= {INNER + name: value for name, value in inner.items()}
    if trajectory.whole is not None:
        header["whole"], inner = _parts(trajectory.whole)
        arrays |= {WHOLE + name: value for name, value in inner.items()}
    if (branches := getattr(trajectory.dense_output, "to_arrays", None)) is not None:
        arrays |= {SWITCHES + name: value for name, value in branches().items()}
    return header, arrays


def _parts(trajectory: Trajectory) -> tuple[dict[str, Any], dict[str, Any]]:
    header = {
        "h": trajectory.h,
        "origin": trajectory.origin,
        BY_HAND: trajectory.functions.by_hand,
        "rule": plain(trajectory.rule),
        "phases": plain(trajectory.active_sets),
        "events": plain(trajectory.events),
        "stats": {
            k: str(v) if k == "plan" else plain(v)
            for k, v in trajectory.stats.items()
            if k == "plan" or isinstance(v, (str, int, float, np.number))
        },
    }
    if (action := own_action(trajectory)) is not None:
        header[OWN_ACTION] = action
    names = {name: name for name in ARRAYS} | OPTIONAL
    held = {stored: getattr(trajectory, name) for stored, name in names.items()}
    return header, {name: value for name, value in held.items() if value is not None}


def to_xarray(trajectory: Trajectory) -> Any:
    """q, v, p and energy as an `xarray.Dataset` over ``time`` and ``coordinate``."""
    try:
        import xarray
    except ImportError:
        raise VarintError(
            "to_xarray() needs the package xarray: pip install varint-mechanics[xarray]"
        ) from None
    names = list(trajectory.system.names)
    dims = ("time", "coordinate")
    return xarray.Dataset(
        {
            "q": (dims, trajectory.q),
            "v": (dims, trajectory.v),
            "p": (dims, trajectory.p),
            "energy": ("time", trajectory.energy),
        },
        coords={"time": trajectory.t, "coordinate": names},
        attrs={"rule": trajectory.rule.name, "h": trajectory.h, **plain(trajectory.parameters)},
    )


def as_path(path: Any) -> Path:
    return parsed_or_refused(
        lambda: Path(path), lambda: f"the path of a file must be a word or a Path, got {path!r}"
    )


def file_path(path: Any) -> Path:
    given, path = path, as_path(path)
    if not path.name:
        raise InputError(f"the path of a file ends in its name, got {given!r}")
    return path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
