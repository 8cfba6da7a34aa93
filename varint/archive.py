"""Trajectories on disk and in xarray: one ``.npz`` file, no pickle, read back with its system."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.control.solution import ControlSolution, restored, stored
from varint.description import describe, revive, rule_of
from varint.errors import InputError, VarintError, converted
from varint.manifold import Phase
from varint.stepping.step_function import action_function, step_function
from varint.trajectory import Event, Trajectory

FORMAT = "varint trajectory 1"
INNER = "fictitious_"  # before the names of arrays in fictitious time
CONTROL = "control_"  # before those of an optimal control
ARRAYS = ("t", "q", "p", "k", "u", "c")
OPTIONAL = ("phase", "closure")


def save(trajectory: Trajectory, path: Any) -> None:
    """Write `trajectory` to ``path`` (``.npz`` is appended where it is missing).

    The file holds the arrays, the rule, the step, parameter values, symbol names, the system as a serialised CasADi
    function and the version of varint.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    from varint import __version__

    path = _file(path)
    header, arrays = _parts(trajectory)
    header |= {"format": FORMAT, "version": __version__}
    if trajectory.fictitious is not None:
        header["fictitious"], inner = _parts(trajectory.fictitious)
        arrays |= {INNER + name: value for name, value in inner.items()}
    if isinstance(trajectory.solution, ControlSolution):
        header["control"], found = stored(trajectory.solution)
        arrays |= {CONTROL + name: value for name, value in found.items()}
    try:
        with path.open("wb") as file:
            np.savez_compressed(file, header=np.array(json.dumps(header)), **arrays)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


def load(path: Any) -> Any:
    """The trajectory in the file ``path``, with its system: `value`, `at`, `energy` and plots work as before, and so do
    `cost`, `costates`, `u_at`, `replay()` and `report()` of an optimal control.

    Parameters
    ----------
    path : path
        A file written by `Trajectory.save`, or the folder ``store=`` of an ensemble.

    Returns
    -------
    Trajectory or Ensemble

    Raises
    ------
    InputError
        If there is no such file, or it is no trajectory of a format that this version reads.

    Examples
    --------
    >>> import tempfile, os
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> fall = vi.simulate(vi.System(q, v, v**2 / 2 - 9.81 * q), q0=0, v0=1, h=0.1, steps=10)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fall.save(os.path.join(folder, "fall.npz"))
    ...     again = vi.load(os.path.join(folder, "fall.npz"))
    >>> bool((again.q == fall.q).all()), again.rule == fall.rule
    (True, True)
    """
    if _path(path).is_dir():
        from varint.ensembles.ensemble import load_ensemble

        return load_ensemble(path)
    path = _file(path)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            header = json.loads(str(data["header"]))
            if header.get("format") != FORMAT:
                raise InputError(f"{path} has the format {header.get('format')!r}; this version reads {FORMAT!r}")
            arrays = {name: data[name] for name in data if name != "header"}
            missing = [name for name in ARRAYS if name not in arrays]
            if missing:
                raise InputError(f"{path} is no whole trajectory: {missing} are missing")
    except FileNotFoundError:
        raise InputError(f"there is no file {path}") from None
    except InputError:
        raise
    except Exception as error:  # a torn or foreign file fails in many ways; all mean the same
        raise InputError(f"{path} is no trajectory written by varint ({type(error).__name__}: {error})") from None
    inner, control = (
        {name.removeprefix(first): arrays.pop(name) for name in list(arrays) if name.startswith(first)}
        for first in (INNER, CONTROL)
    )
    motion = _assembled(header, arrays)
    return replace(
        motion,
        fictitious=_assembled(header["fictitious"], inner) if inner else None,
        solution=restored(header["control"], control) if control else None,
    )


def _parts(trajectory: Trajectory) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is not an array, and what is."""
    header = {
        "h": trajectory.h,
        "origin": trajectory.origin,
        "sizes": None if trajectory.sizes is None else trajectory.sizes.tolist(),
        "rule": asdict(trajectory.rule),
        "system": describe(trajectory.system),
        "phases": [asdict(phase) for phase in trajectory.phases],
        "events": [asdict(event) for event in trajectory.events],
        "stats": {k: str(v) if k == "plan" else v for k, v in trajectory.stats.items() if k == "plan" or _is_plain(v)},
    }
    held = {name: getattr(trajectory, name) for name in (*ARRAYS, *OPTIONAL)}
    return header, {name: value for name, value in held.items() if value is not None}


def _assembled(header: dict[str, Any], arrays: dict[str, Any]) -> Trajectory:
    system = revive(header["system"])
    rule = rule_of(header["rule"])
    return Trajectory(
        system=system,
        rule=rule,
        h=header["h"],
        origin=header.get("origin"),
        sizes=None if header.get("sizes") is None else np.array(header["sizes"]),
        functions=lambda scene=system: (step_function(scene, rule), action_function(scene, rule)),
        phases=tuple(Phase(**{k: tuple(v) for k, v in phase.items()}) for phase in header["phases"]),
        events=tuple(Event(**event) for event in header["events"]),
        stats=MappingProxyType(header["stats"]),
        **arrays,
    )


def to_xarray(trajectory: Trajectory) -> Any:
    """q, v, p and energy as an `xarray.Dataset` over ``time`` and ``coordinate``."""
    try:
        import xarray
    except ImportError:
        raise VarintError("to_xarray() needs the package xarray: pip install varint-mechanics[xarray]") from None
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
        attrs={"rule": trajectory.rule.name, "h": trajectory.h, **_plain(trajectory.parameters)},
    )


def _plain(parameters: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: value.tolist() for name, value in parameters.items()}


def _path(path: Any) -> Path:
    return converted(lambda: Path(path), lambda: f"the path of a file must be a word or a Path, got {path!r}")


def _file(path: Any) -> Path:
    path = _path(path)
    return path if path.suffix == ".npz" else path.with_name(path.name + ".npz")


def _is_plain(value: Any) -> bool:
    return isinstance(value, (str, int, float))
