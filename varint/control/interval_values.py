"""What every interval of a phase has at a point of the program, by the program's own kernels."""

from __future__ import annotations

import numpy as np

from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription
from varint.numerics.arrays import call, map_function
from varint.results.records import Costates


def interval_rows(
    problem: ControlProblem, part: PhaseTranscription, x: np.ndarray, constants: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cost (N,) and shares of rows (N, …) of every interval; −p⁻ first, p⁺ last."""
    element, (value, *_) = part.elements[0], problem.interval_kernels(part)
    count = len(element.x)
    cost, rows = call(map_function(value, count), x[element.x], constants[element.p])
    return cost, rows.reshape(count, -1)


def node_costates(
    problem: ControlProblem,
    part: PhaseTranscription,
    x: np.ndarray,
    constants: np.ndarray,
    lam_g: np.ndarray,
) -> Costates:
    """Costates of q, ∂(cost + Σ λ·rows)/∂q_k of the interval behind node k, at the last node minus
    that of the interval before it, (N + 1, n); costates of p, the multipliers of momentum
    matching.
    """
    element, (_, gradient, jacobian, _) = part.elements[0], problem.interval_kernels(part)
    n, stride, count = part.phase.system.structure.n, part.interval.stage.numel(), len(element.x)
    z, d = x[element.x], constants[element.p]
    row, column = (np.array(y, dtype=int) for y in jacobian.sparsity_out(0).get_triplet())
    slopes = call(map_function(jacobian, count), z, d)[0].reshape(count, -1)
    # a row with index −1 is left out
    slopes = slopes * np.append(lam_g, 0.0)[element.g][:, row]
    costs = call(map_function(gradient, count), z, d)[0].reshape(count, -1)

    def along(i: int) -> np.ndarray:
        """∂/∂ of the interval's i-th unknown."""
        return costs[:, i] + slopes[:, column == i].sum(axis=1)

    q = [np.append(along(i), -along(stride + i)[-1]) for i in range(n)]
    return Costates(np.column_stack(q), lam_g[part.rows.momentum])
