"""Files that varint wrote, read back: trajectories with their systems, ensembles, orbits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from varint.boundary.minimise import ActiveBounds
from varint.control.solution import ControlSolution, from_arrays
from varint.errors import InputError
from varint.integration.from_files import taken, whole_motion
from varint.numerics.archive import read_archive
from varint.numerics.plain import field_of, record_of
from varint.orbits.files import FORMAT as ORBITS
from varint.results.leaning import at_times
from varint.results.records import own_action, with_own_action
from varint.results.save import CONTROL, FORMAT, as_path, file_path
from varint.results.trajectory import Trajectory
from varint.scene.serialisation import UNTRUSTED, revive
from varint.scene.system import System

OLD = "varint trajectory 1"  # with systems as serialised CasADi functions


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

    def scene_in(about: dict[str, Any]) -> System:
        return revive(about.get("system"), trust=trust)

    control = taken(arrays, CONTROL)
    motion = whole_motion(header, arrays, scene_in)
    if control:
        solution = from_arrays(field_of(header, "control", dict), control)
        _check_control(motion, solution)
        return replace(motion, solution=solution)
    if "bounds" in header:
        bounds = _bounds(motion, header["bounds"])

        def path(part: Trajectory, **more: Any) -> Trajectory:
            changed = replace(part, solution=bounds, dense_output=at_times, **more)
            return with_own_action(changed, own_action(part))

        return path(motion, whole=None if motion.whole is None else path(motion.whole))
    return motion


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
