"""Files that varint wrote, read back: trajectories with their systems, ensembles, orbits."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.boundary import leaning
from varint.boundary.minimise import ActiveBounds
from varint.control.solution import ControlSolution, from_arrays
from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.many_steps import steps_again
from varint.integration.switches.within_rows import dense_output_of
from varint.integration.time_transformation.physical_time import at_times
from varint.numerics.archive import read_archive
from varint.numerics.limits import MOST_STEPS
from varint.numerics.plain import field_of, finite, record_of
from varint.orbits.files import FORMAT as ORBITS
from varint.results.records import Event
from varint.results.save import (
    ARRAYS,
    CONTROL,
    FORMAT,
    INNER,
    OPTIONAL,
    SWITCHES,
    as_path,
    file_path,
)
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.serialisation import UNTRUSTED, revive, rule_of
from varint.scene.system import System

OLD = "varint trajectory 1"  # with systems as serialised CasADi functions
WHOLE = ("k", "phase")  # arrays of whole numbers
FINITE = ("t", "c", "sizes")
FILLED = ("t", "sizes")  # arrays with at least one row


def load(path: Any, *, trust: bool = False) -> Any:
    """The trajectory in the file ``path``, with its system: `value`, `at`, `energy` and plots work
    as before, and so do `cost`, `costates`, `u_at`, `replay()` and `report()` of an optimal
    control.

    Parameters
    ----------
    path : path
        A file written by `Trajectory.save` or by `save` of a result of `varint.orbits`, or the
        folder ``store=`` of an ensemble.
    trust : bool
        Also read files of older versions, whose systems are serialised CasADi functions. To open
        one runs whatever is in it, so it must come from somebody you trust. Other files are read
        without: they hold numbers, names and elementary operations, and nothing in them is
        executed.

    Returns
    -------
    Trajectory, Ensemble, or a result of `varint.orbits`

    Raises
    ------
    InputError
        If there is no such file, or it is no whole file of a format that this version reads.

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
    if as_path(path).is_dir():
        from varint.ensembles.ensemble import load_ensemble

        return load_ensemble(path, trust=trust)
    path = file_path(path)
    header, arrays = read_archive(path, "trajectory written by varint")
    known = _whole
    if header.get("format") == ORBITS:
        known = _orbits
    elif header.get("format") not in (FORMAT, *((OLD,) if trust else ())):
        old = f"; {UNTRUSTED}" if header.get("format") == OLD else ""
        raise InputError(
            f"{path} has the format {header.get('format')!a}; this version reads {FORMAT!r}{old}"
        )
    try:
        return known(header, arrays, trust)
    except InputError as error:
        raise InputError(f"{path} is no whole file of varint: {error}") from None
    except Exception as error:  # what a foreign header makes fail; a whole one fails in nothing
        raise InputError(
            f"{path} is no whole file of varint ({type(error).__name__}: {error})"
        ) from None


def _whole(header: dict[str, Any], arrays: dict[str, np.ndarray], trust: bool) -> Trajectory:
    """The trajectory, with its motion in fictitious time and its solution where it has one."""
    inner, control, switches = (
        {
            name.removeprefix(first): arrays.pop(name)
            for name in list(arrays)
            if name.startswith(first)
        }
        for first in (INNER, CONTROL, SWITCHES)
    )
    motion = _assembled(header, arrays, trust)
    solution: ControlSolution | ActiveBounds | None = None
    dense_output: Any = at_times if inner else None
    if switches:
        dense_output = dense_output_of(motion.system, motion.rule, switches)
    if control:
        solution = from_arrays(field_of(header, "control", dict), control)
        _check_control(motion, solution)
    elif "bounds" in header:
        solution = _bounds(motion, header["bounds"])
        dense_output = leaning.at_times
    return replace(
        motion,
        fictitious=_assembled(field_of(header, "fictitious", dict), inner, trust)
        if inner
        else None,
        dense_output=dense_output,
        solution=solution,
    )


def _check_control(motion: Trajectory, solution: ControlSolution) -> None:
    """Path, controls and costates have a value for every step and coordinate of the motion."""
    steps, n = len(motion) - 1, motion.q.shape[1]
    found = {
        "mesh": len(solution.mesh) - 1,
        "u": len(motion.u),
        "sizes": steps if motion.sizes is None else len(motion.sizes),
    }
    if off := {name: count for name, count in found.items() if count != steps}:
        raise InputError(f"the control has {steps} steps, but {off}")
    shapes = {
        "q_values": (solution.q.values.shape[2:], (n,)),
        "u_values": (solution.u.values.shape[2:], motion.u.shape[2:]),
        "costate_values": (solution.costate.values.shape[2:], (n,)),
        "v_ends": (solution.v_ends.shape, (2, n)),
        "mu_q": (solution.costates.q.shape, (steps + 1, n)),
        "mu_p": (solution.costates.p.shape, (steps + 1, n)),
    }
    for name, (shape, wanted) in shapes.items():
        if shape != wanted:
            raise InputError(f"{name} of the control has numbers {shape}, not {wanted}")


def _orbits(header: dict[str, Any], arrays: dict[str, np.ndarray], trust: bool) -> Any:
    """A result of `varint.orbits`."""
    from varint.orbits.files import restored
    from varint.orbits.kinds import KINDS
    from varint.orbits.read import READ, orbits_of

    if header.get("kind") in READ:
        return orbits_of(header, arrays)
    return restored(header, arrays, KINDS)


def _bounds(motion: Trajectory, data: Any) -> ActiveBounds:
    """Where a path leans on its bounds, for every control point of the path."""
    bounds: ActiveBounds = record_of(ActiveBounds, "bounds", data)
    degree, count = len(motion.rule.points) - 1, len(bounds.t)
    each = (count, len(bounds.bounds))
    shapes = (bounds.t.ndim, bounds.points.shape, bounds.values.shape, bounds.multipliers.shape)
    if shapes != (1, (count, motion.q.shape[1]), each, each) or degree < 1 or (count - 1) % degree:
        raise InputError(f"the bounds do not fit a path by {motion.rule}: {shapes}")
    return bounds


def _assembled(header: dict[str, Any], arrays: dict[str, np.ndarray], trust: bool) -> Trajectory:
    """A trajectory of checked parts."""
    system = revive(header.get("system"), trust=trust)
    rule = rule_of(header.get("rule"))
    if sizes := field_of(header, "sizes", list[float] | None):  # of format 1
        arrays["sizes"] = np.array(sizes)
    active_sets = field_of(header, "phases", tuple[ActiveSet, ...])
    _check_active_sets(system, active_sets)
    stats = field_of(header, "stats", dict[str, str | bool | int | float])
    field_of(stats, "error_estimate", float | int | None)
    h = finite("h", field_of(header, "h", float))
    if h == 0:
        raise InputError("h must not be zero")
    return Trajectory(
        system=system,
        rule=rule,
        h=h,
        origin=field_of(header, "origin", float | None),
        functions=steps_again(rule),
        active_sets=active_sets,
        events=field_of(header, "events", tuple[Event, ...]),
        stats=MappingProxyType(stats),
        **_checked(system, rule, arrays, len(active_sets)),
    )


def _check_active_sets(system: System, active_sets: tuple[ActiveSet, ...]) -> None:
    held = system.constraint.numel(), system.contact.numel(), system.contact.numel()
    for one in active_sets:
        for rows, count in zip((one.rows, one.contacts, one.holding), held, strict=True):
            if any(not 0 <= row < count for row in rows):
                raise InputError(f"the active set {one} holds rows that the system does not have")


def _checked(
    system: System, rule: Rule, arrays: dict[str, np.ndarray], active_sets: int
) -> dict[str, Any]:
    """The arrays of a trajectory by their names in it, if shapes and numbers are possible."""
    missing = [name for name in ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{missing} are missing")
    nodes, n, controls = arrays["t"].shape[:1], system.q.numel(), system.control.numel()
    wanted: dict[str, tuple[tuple[int, ...], ...]] = {
        "t": (nodes,),
        "q": ((*nodes, n),),
        "p": ((*nodes, n),),
        "k": (nodes,),
        "u": tuple((*arrays["u"].shape[:1], r, controls) for r in (1, len(rule.nodes))),
        "c": ((system.c.numel(),),),
        "phase": (nodes,),
        "closure": ((n, n + 1),),
        "sizes": (arrays["sizes"].shape[:1] if "sizes" in arrays else (),),
    }
    found: dict[str, Any] = {}
    for name, shapes in wanted.items():
        if name not in arrays:
            continue
        array, whole = arrays[name], name in WHOLE
        if array.shape not in shapes or 0 in array.shape[: name in FILLED]:
            raise InputError(f"{name} has shape {array.shape}; it must be {shapes[0]}")
        if (array.dtype.kind in "iu") != whole:
            raise InputError(f"{name} holds numbers of type {array.dtype}")
        if name in FINITE and not np.isfinite(array).all():
            raise InputError(f"{name} is not finite")
        found[OPTIONAL.get(name, name)] = array.astype(int if whole else float, copy=False)
    limits = {"k": MOST_STEPS, "phase": active_sets - 1}
    for name, most in limits.items():
        if name in arrays and not ((arrays[name] >= 0) & (arrays[name] <= most)).all():
            raise InputError(f"{name} holds numbers that are not between 0 and {most}")
    if controls and not len(arrays["u"]):
        raise InputError("there are no controls")
    return found
