"""Slacks in terms of the path: where a solver starts them, and what they say of a solution."""

from __future__ import annotations

import numpy as np

from varint.control.transcription import PhaseTranscription, control_points, controls_at_nodes
from varint.errors import InputError
from varint.numerics.arrays import over_columns

SEEN = 1e-7  # a soft bound violated by less is kept
LOOSE = 1e-6  # of its size: a largest value that is further from what it stands for is none


def write_slacks(x: np.ndarray, part: PhaseTranscription, shared: np.ndarray) -> None:
    """Put what they are on this path into the unknowns; `shared`: t0, duration, parameters."""
    slots = part.slots
    if slots.slack.size:
        values = over_columns(part.functions.slacks, *_nodes(x, part, shared), shared[2:])[0]
        x[slots.slack] = values.reshape(slots.slack.shape)
    if slots.end_slack.size:
        values = part.functions.end_slacks(
            x[slots.q[-1]],
            x[slots.v[1]],
            x[slots.states[-1]],
            shared[0] + shared[1],
            shared[2:],
        )
        x[slots.end_slack] = np.array(values).ravel()


def violations(x: np.ndarray, part: PhaseTranscription) -> dict[str, float]:
    """Largest violation of every soft bound that is violated."""
    own = part.phase.slacks
    sizes = x[part.slots.slack[..., : len(own.names)]].max(axis=(0, 1), initial=0.0)
    return {name: float(size) for name, size in zip(own.names, sizes, strict=True) if size > SEEN}


def refuse_loose(x: np.ndarray, part: PhaseTranscription, shared: np.ndarray) -> None:
    """Largest values that a solution holds above what they stand for, since the cost falls with
    them.
    """
    slots, own = part.slots, part.phase.slacks
    count = len(own.largest)
    if not count:
        return
    true = x.copy()
    write_slacks(true, part, shared)
    chosen, wanted = (y[slots.slack[..., -count:]] for y in (x, true))
    off = np.abs(chosen - wanted).max(axis=(0, 1)) > LOOSE * (1 + np.abs(wanted).max(axis=(0, 1)))
    slack = x[slots.slack].reshape(-1, own.count)
    at = _nodes(x, part, shared)
    slope = over_columns(part.functions.slack_slopes, *at, shared[2:], slack)[0]
    for i in np.flatnonzero(off & (slope < 0).any(axis=0)):
        raise InputError(
            f"the cost falls with {own.largest[i].symbol.name()} along the path: vi.abs and "
            "vi.max must stand where the cost grows with them (a convex cost)"
        )


def _nodes(x: np.ndarray, part: PhaseTranscription, shared: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, v, u, rates, t at all quadrature nodes, (N r, …) each."""
    phase, rule = part.phase, part.phase.rule
    points, steps = control_points(x, part), np.diff(phase.mesh)
    h, r = shared[1] * steps, len(rule.nodes)
    q = np.einsum("ij,kjn->kin", rule.basis, points)
    v = np.einsum("ij,kjn->kin", rule.slopes, points) / h[:, None, None]
    u = controls_at_nodes(x, part)
    u = np.broadcast_to(u, (len(h), r, u.shape[2]))
    rates = np.zeros((len(h), len(phase.rates.index)))
    if rates.size:
        samples = x[part.slots.u][:, 0, phase.rates.index]
        rates = np.diff(samples, axis=0) / h[:, None]
    t = shared[0] + shared[1] * phase.mesh[:-1, None] + h[:, None] * np.array(rule.nodes)
    q, v, u = (y.reshape(len(h) * r, y.shape[2]) for y in (q, v, u))
    return q, v, u, np.repeat(rates, r, axis=0), t.reshape(-1, 1)
