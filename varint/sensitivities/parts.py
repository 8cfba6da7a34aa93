"""Parts of steps: where a run comes to an event, and where a node lies within a step.

What varies is z = (x, t, c, h, t0, e): state and time at which the part begins, parameters, the
grid's step and start, coefficients of restitution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.rules.polynomials import lagrange_slopes, lagrange_values
from varint.sensitivities.steps_at_once import Sweeper, step_slopes


class Parts(NamedTuple):
    """Parts of steps of one scene, one a row.

    Attributes
    ----------
    step : ndarray of int (N,)
        Whole steps before, from the start of the run.
    x, after : ndarray (N, 2n)
        (q, p) at both ends: as the motion leaves the one, as it comes to the other.
    v, v_after : ndarray (N, n)
    t, h : ndarray (N,)
        When it begins, and how long it lasts.
    u : ndarray (N, r, k)
        Controls of the steps.
    passed : ndarray (N,)
        What share of the step has passed at t.
    whole : ndarray (N,)
        The size of the step.
    """

    step: np.ndarray
    x: np.ndarray
    after: np.ndarray
    v: np.ndarray
    v_after: np.ndarray
    t: np.ndarray
    h: np.ndarray
    u: np.ndarray
    passed: np.ndarray
    whole: np.ndarray


class Slopes(NamedTuple):
    """Derivatives of what parts of steps lead to: x, t, then the running loss where there is one.

    Attributes
    ----------
    clock : int
        Place of t in z, and among the rows.
    of_z : ndarray (N, rows, Z)
    of_size : ndarray (N, rows)
        With respect to the duration, where it is free.
    of_u : ndarray (N, rows, r·k)
        With respect to the controls of the step.
    loss : ndarray (N,)
    """

    clock: int
    of_z: np.ndarray
    of_size: np.ndarray
    of_u: np.ndarray
    loss: np.ndarray


def part_slopes(by: Sweeper, parts: Parts, c: np.ndarray, contacts: int) -> Slopes:
    """Derivatives of parts of steps of any duration."""
    n2, many, count = parts.x.shape[1], len(c), len(parts.t)
    nodes, held = np.array(by.rule.nodes), parts.u.shape[1] == 1
    at = parts.passed[:, None] + nodes * (parts.h / parts.whole)[:, None]
    values = _tables(lagrange_values, nodes, at, held)
    controls = values @ parts.u
    ends = parts.x, parts.after, parts.v, parts.v_after
    phi, outside, _, *lossy = step_slopes(by, *ends, parts.t, parts.h, controls, c)
    rows, grid = n2 + 1 + bool(lossy), n2 + 1 + many  # t0 comes behind h at `grid`
    of_z, of_size = np.zeros((count, rows, grid + 2 + contacts)), np.zeros((count, rows))
    of_z[:, n2, n2] = of_size[:, n2] = 1.0
    which = [*range(n2), *([n2 + 1] if lossy else [])]
    of_x, of_e = phi.transpose(0, 2, 1), outside.transpose(0, 2, 1)
    if lossy:
        of_x = np.concatenate([of_x, lossy[1][:, None]], 1)
        of_e = np.concatenate([of_e, lossy[2][:, None]], 1)
    of_nodes = of_e[:, :, many + 2 :].reshape(count, len(which), len(nodes), -1)
    of_u = np.zeros((count, rows, parts.u[0].size))
    of_u[:, which] = np.einsum("najk,nji->naik", of_nodes, values).reshape(count, len(which), -1)
    of_z[:, which, :n2] = of_x
    of_z[:, which, n2] = of_e[:, :, many + 1]
    of_z[:, which, n2 + 1 : grid] = of_e[:, :, :many]
    of_size[:, which] = of_e[:, :, many]
    if not held:  # where the nodes of the part lie on the polynomial of the step's controls
        rates = _tables(lagrange_slopes, nodes, at, held) @ parts.u
        moved = np.einsum("najk,njk->naj", of_nodes, rates) / parts.whole[:, None, None]
        of_z[:, which, n2] += moved.sum(2)
        of_size[:, which] += moved @ nodes
        of_z[:, which, grid + 1] -= moved.sum(2)
        of_z[:, which, grid] -= np.einsum("naj,nj->na", moved, parts.step[:, None] + at)
    loss = lossy[0][:, 0] if lossy else np.zeros(count)
    return Slopes(n2, of_z, of_size, of_u, loss)


def _tables(basis, nodes: np.ndarray, at: np.ndarray, held: bool) -> np.ndarray:
    """The basis at the nodes of every part, (N, nodes, r)."""
    if held:
        return np.ones((*at.shape, 1))
    return basis(nodes, at.ravel()).reshape(*at.shape, len(nodes))


def with_size(slopes: Slopes, of_z: np.ndarray, of_u: np.ndarray | None = None) -> Slopes:
    """The same where the duration varies with z and u as these rows (N, Z), (N, r·k) say."""
    along = slopes.of_size[:, :, None]
    moved = slopes.of_u if of_u is None else slopes.of_u + along * of_u[:, None]
    return slopes._replace(
        of_z=slopes.of_z + along * of_z[:, None],
        of_size=np.zeros_like(slopes.of_size),
        of_u=moved,
    )


def to_time(slopes: Slopes, of_end: np.ndarray) -> Slopes:
    """The parts that end at times which vary as these rows (N, Z) say."""
    return with_size(slopes, of_end - np.eye(of_end.shape[1])[slopes.clock])
