"""The optimal controls played back by the simulation: the same kernel, hence the same motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.control.solution import ControlSolution
from varint.stepping.simulate import simulate
from varint.trajectory import Trajectory


def replay(motion: Trajectory, solution: ControlSolution) -> Trajectory:
    """Simulate from the solution's start with its controls, step for step."""
    controls = motion.u if motion.u.shape[1] > 1 or not motion.u.size else motion.u[:, 0]

    def run(q, p, t: float, h: float, first: int, steps: int) -> Trajectory:
        u = controls[first : first + steps] if motion.u.size else None
        return simulate(
            motion.system, motion.rule, q0=q, p0=p, h=h, steps=steps, t0=float(t), u=u, params=motion.parameters
        )

    if motion.sizes is None:
        return run(motion.q[0], motion.p[0], motion.t[0], motion.h, 0, len(motion.u))
    parts = [run(motion.q[0], motion.p[0], motion.t[0], float(motion.sizes[0]), 0, 1)]
    for k in range(1, len(motion.sizes)):
        parts.append(run(parts[-1].q[-1], parts[-1].p[-1], motion.t[k], float(motion.sizes[k]), k, 1))
    q, p = (np.vstack([getattr(parts[0], x)[:1], *(getattr(part, x)[1:] for part in parts)]) for x in "qp")
    return replace(parts[0], t=motion.t, q=q, p=p, h=motion.h, sizes=motion.sizes, k=motion.k, u=motion.u)


def defect(motion: Trajectory, again: Trajectory) -> float:
    """Largest difference in position between a path and its replay, relative to the path's extent (at least 1)."""
    extent = np.maximum(np.ptp(motion.q, axis=0), 1.0)
    return float((np.abs(motion.q - again.q) / extent).max())
