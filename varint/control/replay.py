"""The optimal controls played back by the simulation: on their own mesh the same kernel and hence
the same motion; on a finer mesh what the scene really does, and how far the path is from that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from varint.control.piecewise import Piecewise
from varint.control.quarter_steps import in_parts
from varint.errors import ConvergenceError
from varint.results.trajectory import Trajectory

PARTS = 4  # of a step: an error of second order is seen to 15/16, higher ones better
# of a coordinate's range: a path that is off by more is no picture of the motion. The estimate is
# the error to 10 % there (swing-ups by midpoint() in 200 to 800 steps): no false warning
LARGE = 1e-2
STILL = 1e-3  # of the largest range of a coordinate: smaller ranges are no measure of an error


def replay(motion: Trajectory) -> Trajectory:
    """Simulate from the optimal start with the optimal controls, step for step."""
    if motion.sizes is None:
        return _run(motion, motion.q[0], motion.p[0], 0, motion.h, motion.u)
    q, p = _ends(_legs(motion, motion.sizes, motion.u, 1), 1)
    return replace(
        _run(motion, motion.q[0], motion.p[0], 0, float(motion.sizes[0]), motion.u[:1]),
        t=motion.t,
        q=q,
        p=p,
        h=motion.h,
        sizes=motion.sizes,
        k=motion.k,
        u=motion.u,
    )


def defect(motion: Trajectory, again: Trajectory) -> float:
    """Largest difference in position between a path and its replay, relative to the path's
    extent (at least 1).
    """
    extent = np.maximum(np.ptp(motion.q, axis=0), 1.0)
    return float((np.abs(motion.q - again.q) / extent).max())


def error_estimate(motion: Trajectory, controls: Piecewise) -> float:
    """Largest difference in position between a path and its controls' replay in quarter steps,
    relative to the range of each coordinate; infinite where that replay fails.

    The controls between the nodes are the polynomials through their values; so this is the error
    of the discretisation, with all that an unstable scene makes of it until the end.
    """
    extent = np.ptp(motion.q, axis=0)
    extent = np.maximum(extent, STILL * extent.max())
    extent = np.where(extent > 0, extent, 1.0)
    q = _all_at_once(motion, extent)
    if q is None:
        legs = in_quarters(motion, controls)
        if not legs:
            return float("inf")
        q, _ = _ends(legs, PARTS)
    off = np.abs(motion.q - q).max(axis=0)
    return float((off / extent).max()) if np.isfinite(off).all() else float("inf")


def _all_at_once(motion: Trajectory, extent: np.ndarray) -> np.ndarray | None:
    """Positions at the nodes by quarter steps, where the problem is at hand and the path is nearly
    a motion.
    """
    solution = motion.solution
    if solution is None or solution.origin is None:
        return None
    part, problem = solution.origin.transcription, solution.origin.problem
    shared = part.shared_values(solution.origin.outcome.x, problem.nlp.p)
    terms = problem.interval_kernels(part)
    return in_parts(part, terms, shared, solution.q, solution.u, motion.p[0], PARTS, extent)


def in_quarters(motion: Trajectory, controls: Piecewise) -> list[Trajectory]:
    """The replay of an optimal control in quarter steps, a trajectory for all steps of one size
    that follow each other; none where it fails.

    The controls between the nodes are the polynomials through their values.
    """
    sizes = np.full(len(motion.u), motion.h) if motion.sizes is None else motion.sizes
    nodes = np.array(motion.rule.nodes)
    places = ((np.arange(PARTS)[:, None] + nodes) / PARTS).ravel()
    u = controls.within_steps(places).reshape(len(sizes) * PARTS, len(nodes), -1)
    try:
        return list(_legs(motion, sizes, u, PARTS))
    except ConvergenceError:
        return []


def remedy(motions: Sequence[Trajectory]) -> str:
    """What makes coarse solutions finer: steps where they are needed do more than many."""
    higher = not all(x.system.structure.nonholonomic for x in motions)
    refined = any("rounds" in x.stats for x in motions)
    call = f"vi.refine({'motion' if len(motions) == 1 else 'motions'}{', a smaller tol' * refined})"
    others = f"take more steps{' or a higher rule' if higher else ''}"
    return f"{call} adds steps where they are needed, or {others}"


def _legs(motion: Trajectory, sizes: np.ndarray, u: np.ndarray, parts: int) -> Iterator[Trajectory]:
    """The motion in steps of these sizes, each taken in equal parts: a leg for every size."""
    q, p, k = motion.q[0], motion.p[0], 0
    for size, run in groupby(sizes.tolist()):
        steps = len(list(run))
        some = u[k * parts : (k + steps) * parts]
        leg = _run(motion, q, p, k, size / parts, some)
        yield leg
        q, p, k = leg.q[-1], leg.p[-1], k + steps


def _ends(legs: Iterable[Trajectory], parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and momenta at the ends of steps that are taken in equal parts."""
    states = [(leg.q, leg.p) for leg in legs]
    q, p = zip(*((q[parts::parts], p[parts::parts]) for q, p in states), strict=True)
    first = states[0]
    return np.concatenate([first[0][:1], *q]), np.concatenate([first[1][:1], *p])


def _run(
    motion: Trajectory, q: np.ndarray, p: np.ndarray, k: int, h: float, u: np.ndarray
) -> Trajectory:
    """The simulation from node k in steps of h."""
    from varint.integration.simulate import simulate

    controls = u if u.shape[1] > 1 or not u.size else u[:, 0]
    return simulate(
        motion.system,
        motion.rule,
        q0=q,
        p0=p,
        h=h,
        steps=len(u),
        t0=float(motion.t[k]),
        u=controls if u.size else None,
        params=motion.parameters,
    )
