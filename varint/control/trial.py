"""A first motion found by trial: many random controls within their bounds, and again near the best
of them (the cross-entropy method: Rubinstein & Kroese, The Cross-Entropy Method, §5).

For weak motors. A swing that must be built up over several periods is far from any straight line,
and no local solver finds it from there; some of a few hundred motions come near, and each of them
keeps the equations of motion and the bounds of the controls.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from varint.control.guess import Guess, read_guess
from varint.control.transcription import PhaseTranscription
from varint.integration.step_function import step_function

POPULATION, ELITE, ROUNDS = 128, 16, 12
KNOTS = 15  # of each control, linear between them
KEPT = 0.1  # of the mean and the deviation of the round before
OUTSIDE = 10.0  # price of a coordinate beyond its bounds


def can_be_tried(part: PhaseTranscription) -> bool:
    """Start and bounds of the controls are given, and something at the end."""
    phase = part.phase
    start, structure = phase.start, phase.system.structure
    given = (start.q[1] == start.q[2]).all() and (start.v[1] == start.v[2]).all()
    return bool(
        given
        and structure.controls
        and not structure.velocity_rows
        and np.isfinite(phase.bounds.u).all()
        and (phase.end.q[1] == phase.end.q[2]).any()
        and phase.end.periodic is None
    )


def tried(part: PhaseTranscription, seed: int = 0) -> Guess | None:
    """The motion that ends nearest to what is given at the end; None where steps fail."""
    phase, rng = part.phase, np.random.default_rng(seed)
    s, (low, high) = phase.system, phase.bounds.u
    controls, n = s.structure.controls, s.structure.n
    momentum = ca.Function("momentum", [s.q, s.v, s.t, s.c], [s.momentum])
    t = part.t0 + phase.duration[0] * phase.mesh
    ends = [
        np.array(momentum(end.q[0], np.nan_to_num(end.v[0]), at, phase.c)).ravel()
        for end, at in ((phase.start, t[0]), (phase.end, t[-1]))
    ]
    begin = np.concatenate([phase.start.q[0], ends[0]])
    fixed = [end[1] == end[2] for end in (phase.end.q, phase.end.v)]
    goal = np.concatenate([np.nan_to_num(phase.end.q[0]), ends[1]])
    asked = np.concatenate([fixed[0], np.full(n, fixed[1].all())])
    limits = np.concatenate([phase.bounds.q, np.array([[-np.inf], [np.inf]]) * np.ones(n)], axis=1)
    motions = _motions(part)
    middles = (phase.mesh[:-1] + phase.mesh[1:]) / 2
    hats = np.array([np.interp(middles, np.linspace(0, 1, KNOTS), e) for e in np.eye(KNOTS)]).T
    mean, spread = np.zeros((KNOTS, controls)) + (low + high) / 2, (high - low) / 2
    deviation, size, best = np.zeros((KNOTS, controls)) + spread, None, np.inf
    path = u = np.zeros(0)
    for _ in range(ROUNDS):
        knots = mean + deviation * rng.normal(size=(POPULATION, KNOTS, controls))
        trial = hats @ np.clip(knots, low, high)  # (population, steps, controls)
        try:
            x = motions(begin, trial)
        except RuntimeError:  # a step that cannot be solved ends all of them
            return None
        if size is None:
            size = np.nanstd(x, axis=(0, 1))
            size = np.where(size > 0, size, 1.0)
        outside = np.maximum(np.maximum(limits[0] - x, x - limits[1]), 0).max(axis=1)
        off = ((x[:, -1] - goal) / size)[:, asked]
        score = (off**2).sum(axis=1) + OUTSIDE * (outside / size).sum(axis=1)
        score = np.where(np.isfinite(score), score, np.inf)
        order = np.argsort(score)[:ELITE]
        if score[order[0]] < best:
            best, path, u = score[order[0]], x[order[0], :, :n], trial[order[0]]
        chosen = np.clip(knots[order], low, high)
        mean = KEPT * mean + (1 - KEPT) * chosen.mean(axis=0)
        deviation = KEPT * deviation + (1 - KEPT) * chosen.std(axis=0)
    if not np.isfinite(best):
        return None
    given = np.vstack([phase.start.q[0], path])
    own = read_guess(replace(phase, guess=None), part.t0)

    def coordinates(at: np.ndarray) -> np.ndarray:
        return np.array([np.interp(at, phase.mesh, column) for column in given.T]).T

    def forces(at: np.ndarray) -> np.ndarray:
        return np.array([np.interp(at, middles, column) for column in u.T]).T

    return replace(own, q=coordinates, u=forces)


def _motions(part: PhaseTranscription):
    """(start, controls (M, N, k)) → states at the ends of the steps, (M, N, 2 n)."""
    phase, s = part.phase, part.phase.system
    step = step_function(s, phase.rule)
    n, k = s.structure.n, s.structure.controls
    x, given = ca.MX.sym("x", 2 * n), ca.MX.sym("given", k + 2)
    u = ca.repmat(given[:k], 1, len(phase.rule.nodes))
    after = step(x[:n], x[n:], u, phase.c, given[k], given[k + 1])
    one = ca.Function("trial_step", [x, given], [ca.vertcat(after[0], after[1])])
    many = one.mapaccum("trial_motion", phase.steps).map(POPULATION)
    steps = phase.duration[0] * np.diff(phase.mesh)
    clock = np.stack([part.t0 + phase.duration[0] * phase.mesh[:-1], steps], axis=1)

    def motions(begin: np.ndarray, controls: np.ndarray) -> np.ndarray:
        clocks = np.broadcast_to(clock, (POPULATION, *clock.shape))
        data = np.concatenate([controls, clocks], axis=2).reshape(-1, k + 2)
        found = np.array(many(np.tile(begin[:, None], POPULATION), data.T))
        return found.T.reshape(POPULATION, phase.steps, 2 * n)

    return motions
