"""Derivatives of every node of a run with respect to its start, parameters, controls and times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.numerics.arrays import over_columns
from varint.numerics.limits import check_memory
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.parameters import values_by_name
from varint.scene.system import System, parameters_by_name
from varint.sensitivities.carrier import Carrier, rows_of
from varint.sensitivities.carry import carried_on, carried_through, changes_at_rows, start_of
from varint.sensitivities.course import course_of, ends_whole, legs, with_last
from varint.sensitivities.pieces import scene_of
from varint.sensitivities.rescaled import at_given_times, inner_of, inner_start
from varint.sensitivities.start import rate_at, scenes_at, slopes_of, start_slopes
from varint.sensitivities.steps_at_once import Directions

START = ("q0", "v0", "p0")
TIMES = ("h", "duration", "t0")
RESTITUTION = "restitution"


class Asked(NamedTuple):
    """What a run is to be varied by: changes of the start (2n, m), and of what stays: parameters,
    step, start time, restitution (C + 2 + contacts, m); the first of the columns that are the
    controls of step 0, 1, … in turn, −1 where there are none.
    """

    tangent: np.ndarray
    outer: np.ndarray
    controls: int = -1


def sensitivity(
    motion: Trajectory,
    wrt: Sequence[Any] = ("q0", "v0"),
    *,
    outputs: Any = None,
    backend: str = "auto",
) -> np.ndarray:
    """Exact derivatives of a run's nodes, ∂(q, v)_k/∂θ, of the discrete motion itself.

    Every step is solved implicitly by its equations F(x_k, y, θ) = 0, x_{k+1} = G(x_k, y, θ); its
    derivative follows from the implicit function theorem at the nodes of the run, and tangents are
    carried from step to step: δx_{k+1} = (G_x − G_y F_y⁻¹ F_x) δx_k + (G_θ − G_y F_y⁻¹ F_θ) δθ.

    Parameters
    ----------
    motion : Trajectory
        From `simulate`, its start among the nodes. Nodes that were left out (`save_every`, `at`)
        are computed once more.
    wrt : sequence
        Any of ``"q0"``, ``"v0"``, ``"p0"`` (start), ``"h"``, ``"duration"`` (at a fixed number of
        steps), ``"t0"``, ``"u"`` (every control value, in the order of ``motion.u``),
        ``"restitution"`` (of each contact, where it is no parameter's name), and parameters by name
        or symbol. Where ``"p0"`` is
        among them momenta are held at the start while others vary, else velocities.
    outputs : SX (o,), optional
        Expression of q, v, t and parameters. Default: q and v.
    backend : {"auto", "compiled", "native", "interpreted"}
        As in `simulate`.

    Returns
    -------
    ndarray (N + 1, o, m)
        Row k belongs to node k; columns in the order of `wrt`, matrices column after column. With
        constraints only combinations of columns that keep to them have a meaning. Nodes at whole
        steps move with h and t0, those of impacts and detachments with their events; nodes within
        steps, and all of a run with a time scale, stay at their times.

    Raises
    ------
    InputError
        If `wrt` names what the run does not have, or its first node lies within a step.
    ConvergenceError
        If a step has no regular derivative, or the motion grazes a contact.

    Notes
    -----
    Hairer, Lubich & Wanner, Geometric Numerical Integration, VI.4; Marsden & West 2001, §1.5;
    for impacts see `event_sensitivity`.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> c = vi.Parameters(k=4.0)
    >>> spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    >>> motion = vi.simulate(spring, vi.gauss(6), q0=1.0, v0=0.0, h=0.1, steps=10)
    >>> of = vi.sensitivity(motion, ["q0", "k"])  # x = q0 cos(√k t)
    >>> bool(np.allclose(of[-1, 0], [np.cos(2.0), -np.sin(2.0) / 4]))
    True
    """
    asked, wanted = asked_directions(motion, wrt), wanted_of(motion.system, outputs)
    m = asked.tangent.shape[1]
    count = len(motion) * (wanted.numel() + 2 * motion.q.shape[1] + 1) * m
    check_memory("the derivatives of this run", count, "ask for fewer of them, or save_every")
    change = changes(motion, asked, backend)
    return of_outputs(motion, wanted, change, asked.outer[: len(motion.c)])


def changes(motion: Trajectory, asked: Asked, backend: str) -> np.ndarray:
    """Changes of (q, p) and t at the nodes, (N + 1, 2n + 1, m)."""
    found = _carried(*begun(motion, asked, backend))
    if motion.fictitious is None:
        return found
    return at_given_times(motion, found)


def changes_within(motion: Trajectory, rows: Trajectory, asked: Asked, backend: str) -> np.ndarray:
    """`changes` at other states of the motion, ``rows = motion.at(times)``, of one without a time
    scale.
    """
    carrier = Carrier(course_of(motion)._replace(rows=rows), backend)
    outer = asked.outer[: len(motion.c) + 2]
    directions = Directions(outer, asked.controls, motion.u.shape[1])
    return _carried(carrier, start_of(carrier, asked.tangent, asked.outer), directions)


def _carried(carrier: Carrier, z: np.ndarray, directions: Directions) -> np.ndarray:
    """Changes of (q, p) and t at the nodes wanted."""
    found = np.empty((len(carrier.course.rows), carrier.places[1], z.shape[1]))
    first = True
    for leg in legs(carrier.course):
        every, later = carried_on(carrier, leg, z, directions)
        rows = rows_of(carrier, leg, first)
        found[rows.which] = changes_at_rows(carrier, leg, rows, every, z, directions)
        z, first = later, False
    return found


def begun(motion: Trajectory, asked: Asked, backend: str) -> tuple[Carrier, np.ndarray, Directions]:
    """What carries changes along a run, those at its start, and what acts on every step."""
    carrier, start = Carrier(course_of(inner_of(motion)), backend), (asked.tangent, asked.outer)
    if motion.fictitious is not None:
        start = inner_start(motion, *start)
    outer = start[1][: len(carrier.motion.c) + 2]
    return carrier, start_of(carrier, *start), Directions(outer, asked.controls, motion.u.shape[1])


def of_outputs(
    motion: Trajectory, wanted: ca.SX, change: np.ndarray, of_c: np.ndarray
) -> np.ndarray:
    """Changes of expressions at nodes from those of (q, p, t) there and of the parameters."""
    found = np.empty((len(motion), wanted.numel(), change.shape[2]))
    for nodes, scene in scenes_at(motion, slice(None)):
        at = motion.q[nodes], motion.p[nodes], motion.t[nodes, None], motion.c
        slopes = over_columns(slopes_of(scene, wanted), *at)
        by_x, by_c, by_t = (x.reshape(len(at[0]), -1, wanted.numel()) for x in slopes)
        moved = by_x.transpose(0, 2, 1) @ change[nodes, :-1]
        if of_c.any():
            moved += by_c.transpose(0, 2, 1) @ of_c
        found[nodes] = moved + by_t.transpose(0, 2, 1) * change[nodes, -1:]
    return found


def wanted_of(system: System, outputs: Any) -> ca.SX:
    """The outputs asked for, a column; q and v where none are."""
    if outputs is None:
        return ca.vertcat(system.q, system.v)
    return ca.vec(ca.densify(in_own_symbols(outputs, system)))


def transition_matrix(motion: Trajectory, k0: int = 0, k1: int = -1) -> np.ndarray:
    """∂(q, p) at node k1 by ∂(q, p) at node k0, (2n, 2n); behind `Trajectory.transition_matrix`."""
    first, last = (_node(motion, name, k) for name, k in (("k0", k0), ("k1", k1)))
    size = 2 * motion.q.shape[1]
    scene_of(motion)
    if first > last:
        raise InputError(
            f"node k0={k0} comes after node k1={k1}; the inverse of the matrix from {k1} to {k0} "
            "leads back"
        )
    tangent = np.eye(size)
    if first == last:
        return tangent
    part = motion[first : last + 1]
    outer = np.zeros((len(motion.c) + 2 + motion.system.structure.contacts, size))
    carrier, z, directions = begun(part, Asked(tangent, outer), "auto")
    for leg, at_end in with_last(legs(carrier.course)):
        rows = rows_of(carrier, leg, False)
        if not at_end or rows.place[-1] == len(leg.piece.t):
            z = carried_through(carrier, leg, z, directions)
            continue
        every, _ = carried_on(carrier, leg, z, directions)
        z = changes_at_rows(carrier, leg, rows, every, z, directions)[-1]
    if part.fictitious is not None:
        return at_given_times(part[-1:], z[None, : carrier.places[1]])[0, :size]
    late = z[size : size + 1]  # at an event, whose time depends on the state
    return z[:size] - rate_at(part, len(part) - 1)[:, None] * late if late.any() else z[:size]


def _node(motion: Trajectory, name: str, k: Any) -> int:
    if not isinstance(k, (int, np.integer)) or not -len(motion) <= k < len(motion):
        raise InputError(f"{name} must be the index of one of the {len(motion)} nodes, got {k!r}")
    return int(k) % len(motion)


def asked_directions(motion: Trajectory, wrt: Sequence[Any]) -> Asked:
    """The columns of what a run is to be varied by."""
    require_trajectory(motion)
    names = _names(motion.system, wrt)
    n, c, system = motion.q.shape[1], len(motion.c), motion.system
    contacts, places = system.structure.contacts, parameters_by_name(system, np.arange(c))
    sizes = dict.fromkeys(START, n) | dict.fromkeys(TIMES, 1)
    sizes |= {"u": motion.u.size, RESTITUTION: contacts}
    sizes |= {name: at.size for name, at in places.items()}
    ends = np.cumsum([0, *(sizes[name] for name in names)])
    columns = {name: slice(a, b) for name, a, b in zip(names, ends, ends[1:], strict=False)}
    m = int(ends[-1])
    tangent, outer = np.zeros((2 * n, m)), np.zeros((c + 2 + contacts, m))
    of_q, of_v, of_c, of_t = start_slopes(motion)
    held = "p0" not in names
    for name, at in columns.items():
        if name == "q0":
            tangent[:n, at] = np.eye(n)
            tangent[n:, at] = of_q if held else 0.0
        elif name == "v0":
            tangent[n:, at] = of_v
        elif name == "p0":
            tangent[n:, at] = np.eye(n)
        elif name in TIMES:
            _vary_time(motion, name, outer[: c + 2, at])
        elif name in places:
            index = places[name].ravel(order="F")
            outer[index, np.arange(m)[at]] = 1.0
        elif name == RESTITUTION:
            outer[c + 2 :, at] = np.eye(contacts)
    if held:
        tangent[n:] += of_c @ outer[:c] + of_t @ outer[c + 1 : c + 2]
    controls = -1
    if "u" in columns:  # those of all steps, of which the first kept node may have passed some
        controls = columns["u"].start + int(motion.k[0]) * motion.u[0].size
    return Asked(tangent, outer, controls)


def _vary_time(motion: Trajectory, name: str, outer: np.ndarray) -> None:
    if motion.fictitious is not None and name != "h":
        raise InputError(
            f"this run took its steps in a fictitious time and has no {name!r} to vary: nodes move "
            "with their velocities; take steps of h="
        )
    if name == "t0":
        outer[-1] = 1.0
        return
    if (motion.whole or motion).sizes is not None:
        raise InputError(f"steps of this run differ in size: it has no {name!r} to vary")
    if name == "duration" and not ends_whole(motion):
        raise InputError(
            "this run ends within a step: it has no 'duration' to vary; its end moves with its "
            "velocity"
        )
    outer[-2] = 1.0 if name == "h" else 1.0 / float(motion.k[-1] - motion.k[0])


def _names(system: System, wrt: Sequence[Any]) -> list[str]:
    """What is asked for by name, each once."""
    given = parsed_or_refused(
        lambda: [wrt] if isinstance(wrt, (str, ca.SX)) else list(() if wrt is None else wrt),
        lambda: f"wrt must be a list of names or symbols, got {wrt!r}",
    )
    names = [next(iter(values_by_name([(x, None)]))) for x in given]
    own = ["u"] * bool(system.structure.controls)
    own += [RESTITUTION] * bool(system.structure.contacts and RESTITUTION not in system.defaults)
    known = [*START, *TIMES, *own, *system.defaults]
    if unknown := [x for x in names if x not in known]:
        raise InputError(f"unknown {unknown} in wrt; known: {known}")
    if not names or len(set(names)) < len(names):
        raise InputError(f"wrt names what the run is varied by, each once, got {names}")
    if "v0" in names and "p0" in names:
        raise InputError(
            "wrt has both v0 and p0, of which one follows from the other: leave one out"
        )
    if clash := [x for x in system.defaults if x in (*START, *TIMES, *own) and x in names]:
        raise InputError(
            f"{clash} are parameters of the scene and mean something else here: rename"
        )
    if "h" in names and "duration" in names:
        raise InputError("wrt has both h and duration, which are the same: leave one out")
    return names
