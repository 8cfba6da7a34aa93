"""Derivatives of every node of a run with respect to its start, parameters, controls and times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.numerics.limits import check_memory
from varint.results.trajectory import Trajectory
from varint.scene.parameters import values_by_name
from varint.scene.system import System, parameters_by_name
from varint.sensitivities.pieces import pieces, scene_of
from varint.sensitivities.start import slopes_of, start_slopes
from varint.sensitivities.sweeps import Directions, carried, forwards, sweeper

START = ("q0", "v0", "p0")
TIMES = ("h", "duration", "t0")


class Asked(NamedTuple):
    """What a run is to be varied by: the start's change (2n, m), the directions, and where the
    columns of each name lie.
    """

    tangent: np.ndarray
    directions: Directions
    columns: dict[str, slice]


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
        From `simulate` with h, steps and duration, or a path whose nodes are whole steps apart.
        Nodes that were left out (`save_every`) are computed once more.
    wrt : sequence
        Any of ``"q0"``, ``"v0"``, ``"p0"`` (start), ``"h"``, ``"duration"`` (at a fixed number of
        steps), ``"t0"``, ``"u"`` (every control value, in the order of ``motion.u``), and
        parameters by name or symbol. Where ``"p0"`` is among them momenta are held at the start
        while others vary, else velocities.
    outputs : SX (o,), optional
        Expression of q, v, t and parameters. Default: q and v.
    backend : {"auto", "compiled", "interpreted"}
        As in `simulate`.

    Returns
    -------
    ndarray (N + 1, o, m)
        Row k belongs to node k; columns in the order of `wrt`, matrices column after column. With
        constraints only combinations of columns that keep to them have a meaning.

    Raises
    ------
    InputError
        If `wrt` names what the scene does not have, or the run has impacts, a fictitious time or
        nodes within steps.
    ConvergenceError
        If a step has no regular derivative.

    Notes
    -----
    Hairer, Lubich & Wanner, Geometric Numerical Integration, VI.4; Marsden & West 2001, §1.5.

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
    scene = scene_of(motion)
    asked = asked_directions(motion, wrt)
    of_nodes = slopes_of(scene, _wanted(scene, outputs))
    rows, m = len(motion), asked.tangent.shape[1]
    found = np.empty((rows, of_nodes.size1_out(0), m))
    check_memory("the derivatives of this run", found.size, "ask for fewer of them, or save_every")
    by = sweeper(scene, motion.rule, int(motion.k[-1] - motion.k[0]), backend)
    tangent, columns = asked.tangent, asked.directions.outer
    for piece in pieces(motion):
        every = forwards(by, piece, motion.c, asked.directions, tangent)
        tangent, kept = every[-1], every[piece.kept]
        steps = piece.first + piece.kept
        place = slice(piece.node, piece.last + 1)
        slopes = over_columns(
            of_nodes, motion.q[place], motion.p[place], motion.t[place, None], motion.c
        )
        of_x, of_c, of_t = (x.reshape(len(kept), -1, found.shape[1]) for x in slopes)
        moved = np.einsum("kio,kim->kom", of_x, kept)
        if columns.any():
            clock = columns[-1] + steps[:, None] * columns[-2]
            moved += np.einsum("kco,cm->kom", of_c, columns[:-2])
            moved += of_t.transpose(0, 2, 1) * clock[:, None, :]
        found[place] = moved
    return found


def _wanted(scene: System, outputs: Any) -> ca.SX:
    return ca.vertcat(scene.q, scene.v) if outputs is None else outputs


def transition_matrix(motion: Trajectory, k0: int = 0, k1: int = -1) -> np.ndarray:
    """∂(q, p) at node k1 by ∂(q, p) at node k0, (2n, 2n); behind `Trajectory.transition_matrix`."""
    scene = scene_of(motion)
    first, last = (_node(motion, name, k) for name, k in (("k0", k0), ("k1", k1)))
    size = 2 * motion.q.shape[1]
    if first > last:
        raise InputError(
            f"node k0={k0} comes after node k1={k1}; the inverse of the matrix from {k1} to {k0} "
            "leads back"
        )
    by = sweeper(scene, motion.rule, int(motion.k[last] - motion.k[first]), "auto")
    tangent = np.eye(size)
    directions = Directions(np.zeros((len(motion.c) + 2, size)))
    for piece in pieces(motion, first, last):
        tangent = carried(by, piece, motion.c, directions, tangent)
    return tangent


def _node(motion: Trajectory, name: str, k: Any) -> int:
    if not isinstance(k, (int, np.integer)) or not -len(motion) <= k < len(motion):
        raise InputError(f"{name} must be the index of one of the {len(motion)} nodes, got {k!r}")
    return int(k) % len(motion)


def asked_directions(motion: Trajectory, wrt: Sequence[Any]) -> Asked:
    """The columns of what a run is to be varied by."""
    names = _names(motion.system, wrt)
    n, c, system = motion.q.shape[1], len(motion.c), motion.system
    places = parameters_by_name(system, np.arange(c))
    sizes = dict.fromkeys(START, n) | dict.fromkeys(TIMES, 1) | {"u": motion.u.size}
    sizes |= {name: at.size for name, at in places.items()}
    ends = np.cumsum([0, *(sizes[name] for name in names)])
    columns = {name: slice(a, b) for name, a, b in zip(names, ends, ends[1:], strict=False)}
    m = int(ends[-1])
    tangent, outer = np.zeros((2 * n, m)), np.zeros((c + 2, m))
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
            _vary_time(motion, name, outer[:, at])
        elif name in places:
            index = places[name].ravel(order="F")
            outer[index, np.arange(m)[at]] = 1.0
    if held:
        tangent[n:] += of_c @ outer[:c] + of_t @ outer[-1:]
    controls = -1
    if "u" in columns:  # those of all steps, of which the first kept node may have passed some
        controls = columns["u"].start + int(motion.k[0]) * motion.u[0].size
    return Asked(tangent, Directions(outer, controls, motion.u.shape[1]), columns)


def _vary_time(motion: Trajectory, name: str, outer: np.ndarray) -> None:
    if name == "t0":
        outer[-1] = 1.0
        return
    if motion.sizes is not None:
        raise InputError(f"steps of this run differ in size: it has no {name!r} to vary")
    outer[-2] = 1.0 if name == "h" else 1.0 / float(motion.k[-1] - motion.k[0])


def _names(system: System, wrt: Sequence[Any]) -> list[str]:
    """What is asked for by name, each once."""
    given = [wrt] if isinstance(wrt, (str, ca.SX)) else list(wrt)
    names = [next(iter(values_by_name([(x, None)]))) for x in given]
    known = [*START, *TIMES, *(["u"] if system.structure.controls else []), *system.defaults]
    if unknown := [x for x in names if x not in known]:
        raise InputError(f"unknown {unknown} in wrt; known: {known}")
    if not names or len(set(names)) < len(names):
        raise InputError(f"wrt names what the run is varied by, each once, got {names}")
    if "v0" in names and "p0" in names:
        raise InputError(
            "wrt has both v0 and p0, of which one follows from the other: leave one out"
        )
    if clash := [x for x in system.defaults if x in (*START, *TIMES, "u") and x in names]:
        raise InputError(
            f"{clash} are parameters of the scene and mean something else here: rename"
        )
    if "h" in names and "duration" in names:
        raise InputError("wrt has both h and duration, which are the same: leave one out")
    return names
