"""Changes carried along the legs of a run to its nodes, and adjoints carried back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from varint.sensitivities.carrier import Carrier, Rows
from varint.sensitivities.course import Leg
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.sweeps import backwards, carried, forwards
from varint.sensitivities.within import add_controls, moved, part_of_step, readings


def carried_on(
    carrier: Carrier, leg: Leg, z: np.ndarray, directions: Directions
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of (x, t) at every node of a leg (S + 1, 2n + 1, m) from that of z at its first, (Z,
    m); and z at its last.
    """
    clock, piece = carrier.places[0], leg.piece
    if leg.part:
        _, after = part_of_step(carrier, leg)
        every = np.stack([z[: clock + 1], moved(carrier, after, z, directions, piece.first)])
    else:
        x = forwards(carrier.by(leg.scene), piece, carrier.motion.c, directions, z[:clock])
        t = carrier.at_step(piece.first + np.arange(len(x))) @ z
        every = np.concatenate([x, t[:, None]], 1)
    return every, np.vstack([every[-1], z[clock + 1 :]])


def carried_through(
    carrier: Carrier, leg: Leg, z: np.ndarray, directions: Directions
) -> np.ndarray:
    """z at the last node of a leg alone."""
    if leg.part:
        return carried_on(carrier, leg, z, directions)[1]
    clock, piece = carrier.places[0], leg.piece
    x = carried(carrier.by(leg.scene), piece, carrier.motion.c, directions, z[:clock])
    return np.vstack([x, carrier.at_step(piece.first + len(piece.t)) @ z, z[clock + 1 :]])


def changes_at_rows(
    carrier: Carrier, leg: Leg, rows: Rows, every: np.ndarray, z: np.ndarray, directions: Directions
) -> np.ndarray:
    """Changes of (x, t) at the nodes wanted that lie in a leg, (rows, 2n + 1, m)."""
    found, inside = every[rows.place], rows.behind != 0
    if inside.any():
        clock = carrier.places[0]
        read = readings(carrier, leg, rows, inside)
        constant = np.broadcast_to(z[clock + 1 :], (len(read.of_z), *z[clock + 1 :].shape))
        before = np.concatenate([found[inside], constant], 1)
        later = read.of_z @ before
        for change, of_u, place in zip(later, read.of_u, rows.place[inside], strict=True):
            add_controls(change, of_u, directions, leg.piece.first + int(place))
        found[inside] = later
    return found


def start_of(carrier: Carrier, tangent: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """z at the first node from changes of (q, p) there, and of what stays: c, h, t0 and, behind
    them, coefficients of restitution.
    """
    return np.vstack([tangent, outer[-1 - carrier.motion.system.structure.contacts][None], outer])


@dataclass(frozen=True)
class Adjoint:
    """Derivatives of a number of the run, as they are carried back: by z at a node, by the controls
    of all steps (steps, r, k); the running loss so far.
    """

    z: np.ndarray
    u: np.ndarray
    loss: float = 0.0


def carried_back(carrier: Carrier, leg: Leg, seeds: np.ndarray, rows: Rows, at: Adjoint) -> Adjoint:
    """The adjoint at the first node of a leg from that at its last; `seeds` (rows, 2n + 1) are the
    derivatives by (x, t) of the nodes wanted in it.
    """
    clock, piece, motion = carrier.places[0], leg.piece, carrier.motion
    z, u, begin = at.z.copy(), at.u, int(motion.k[0])
    count = len(piece.x)
    if not leg.part and (rows.place == count - 1).all() and not rows.behind.any():
        z[: clock + 1] += seeds.sum(0)  # of its last node alone, if of any
        return _stepped_back(carrier, leg, z, None, at)
    placed, inside = np.zeros((count, clock + 1)), rows.behind != 0
    if not inside.any() and (np.diff(rows.place) > 0).all():
        placed[rows.place] = seeds
    else:
        np.add.at(placed, rows.place[~inside], seeds[~inside])
    if inside.any():
        read = readings(carrier, leg, rows, inside)
        pulled = np.einsum("rkz,rk->rz", read.of_z[:, : clock + 1], seeds[inside])
        np.add.at(placed, rows.place[inside], pulled[:, : clock + 1])
        z[clock + 1 :] += pulled[:, clock + 1 :].sum(0)
        by_u = np.einsum("rku,rk->ru", read.of_u[:, : clock + 1], seeds[inside])
        steps = begin + piece.first + rows.place[inside]
        np.add.at(u, steps, by_u.reshape(len(by_u), *u.shape[1:]))
    if leg.part:
        _, after = part_of_step(carrier, leg)
        ahead = np.append(z[: clock + 1] + placed[-1], np.ones(after.of_z.shape[1] - clock - 1))
        pulled_z = after.of_z[0].T @ ahead
        pulled_z[clock + 1 :] += z[clock + 1 :]
        pulled_z[: clock + 1] += placed[0]
        u[begin + piece.first] += (after.of_u[0].T @ ahead).reshape(u.shape[1:])
        return Adjoint(pulled_z, u, at.loss + float(after.loss[0]))
    z[: clock + 1] += placed[-1]
    z += placed[:-1, clock] @ carrier.at_step(piece.first + np.arange(count - 1))
    return _stepped_back(carrier, leg, z, placed[:-1, :clock], Adjoint(at.z, u, at.loss))


def _stepped_back(
    carrier: Carrier, leg: Leg, z: np.ndarray, seeds: np.ndarray | None, at: Adjoint
) -> Adjoint:
    """The adjoint z at the last node of whole steps carried to their first, where every node but
    the last adds its seed, (steps, 2n).
    """
    clock, piece, motion, u = carrier.places[0], leg.piece, carrier.motion, at.u
    z += z[clock] * carrier.at_step(piece.first + len(piece.t))[0]
    mu, pulled = backwards(carrier.by(leg.scene), piece, motion.c, z[:clock], seeds, u.shape[1])
    begin = int(motion.k[0]) + piece.first
    steps = slice(begin, begin + len(piece.t))
    u[steps] += pulled.controls
    z[:clock], z[clock] = mu, 0.0
    z[clock + 1 : clock + 1 + len(pulled.outer)] += pulled.outer
    return Adjoint(z, u, at.loss + pulled.loss)
