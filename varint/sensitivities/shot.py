"""The run behind a flow: its values, its Jacobian, and products with a row of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from varint.errors import ConvergenceError
from varint.integration.backend import kernel_for
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import call, over_columns
from varint.numerics.limits import check_memory
from varint.rules.rule import Rule
from varint.scene.system import System
from varint.sensitivities.flow_inputs import kept_run, shapes_of_inputs
from varint.sensitivities.pieces import Piece, all_nodes, velocities
from varint.sensitivities.second_order import curvature, node_hessian, start_hessian, twice
from varint.sensitivities.start import momentum_function, momentum_slopes, output_slopes
from varint.sensitivities.steps_at_once import Directions, Sweeper
from varint.sensitivities.sweeps import backwards, forwards


@dataclass(eq=False)
class Shot:
    """The run behind a flow; the last one is remembered, for values and derivatives are asked for
    at the same place.
    """

    system: System
    rule: Rule
    h: float
    steps: int
    nodes: tuple[int, ...]
    t0: float
    by: Sweeper
    last: tuple[bytes, Piece | None] | None = field(default=None)

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Shapes of the inputs."""
        return shapes_of_inputs(self.system, self.steps)

    def run(self, given: list[np.ndarray]) -> Piece | None:
        """All nodes of the run, or None where it cannot be finished."""
        found: Piece | None = kept_run(self, given)
        return found

    def begun(self, q: np.ndarray, v: np.ndarray, c: np.ndarray, u: np.ndarray) -> Piece | None:
        steps = self.steps
        if not all(np.isfinite(x).all() for x in (q, v, c, u)):
            return None
        t = self.t0 + self.h * np.arange(steps + 1)
        p = call(momentum_function(self.system), q, v, t[:1], c)[0]
        held = np.ascontiguousarray(u.reshape(steps, 1, -1))
        problem = InitialValueProblem(
            q, p, self.t0, self.h, steps, 1, held, c, len(self.rule.nodes)
        )
        kernel = None
        if self.by.kernels:
            kernel = kernel_for(self.system, self.rule, problem._replace(steps=10**7), "auto")
        try:
            x = all_nodes(self.system, self.rule, problem, kernel)
        except ConvergenceError:
            return None
        sizes = np.full(steps, self.h)
        controls = problem.controls(0, steps)
        speeds = velocities(self.system, x, t, c)
        return Piece(0, 1, 0, x, speeds, t[:-1], sizes, controls, np.array(self.nodes))

    def values(self, given: list[np.ndarray]) -> list[np.ndarray]:
        """q and v at the nodes, (nodes, n) each."""
        n, piece = len(given[0]), self.run(given)
        if piece is None:
            return [np.full((len(self.nodes), n), np.nan)] * 2
        kept = list(self.nodes)
        return [piece.x[kept, :n], piece.v[kept]]

    def slopes_at_nodes(self, piece: Piece, c: np.ndarray) -> list[np.ndarray]:
        """∂(q, v)/∂(q, p) (nodes, 2n, 2n) and ∂(q, v)/∂c (nodes, 2n, C) at the nodes."""
        kept, n = list(self.nodes), piece.v.shape[1]
        t = self.t0 + self.h * np.array(kept, dtype=float)
        x = piece.x[kept]
        flat = over_columns(output_slopes(self.system), x[:, :n], x[:, n:], t[:, None], c)
        return [y.reshape(len(kept), -1, 2 * n).transpose(0, 2, 1) for y in flat[:2]]

    def jacobian(self, given: list[np.ndarray]) -> np.ndarray:
        """∂(q, v)/∂(q0, v0, c, u): rows are q of the first node, …, v of the last."""
        n, piece = len(given[0]), self.run(given)
        c = given[2]
        rows, columns = 2 * n * len(self.nodes), sum(a * b for a, b in self.sizes)
        if piece is None:
            return np.full((rows, columns), np.nan)
        if columns > rows:
            seeds = np.eye(rows).reshape(rows, 2, len(self.nodes), n)
            return np.array([self.adjoint(given, one[0], one[1]) for one in seeds])
        every, outer = self.tangents(given, piece)
        of_x, by_c = self.slopes_at_nodes(piece, c)
        found = of_x @ every[list(self.nodes)] + by_c @ outer[: len(c)]
        return (
            found.reshape(len(self.nodes), 2, n, columns)
            .transpose(1, 0, 2, 3)
            .reshape(rows, columns)
        )

    def tangents(self, given: list[np.ndarray], piece: Piece) -> tuple[np.ndarray, np.ndarray]:
        """∂(q, p)/∂(q0, v0, c, u) at every node, and what of these are parameters, step and time,
        (C + 2, columns).
        """
        n, many = len(given[0]), len(given[2])
        of_q, of_v, of_c, _ = self._start(given)
        columns = sum(a * b for a, b in self.sizes)
        outer, begin = np.zeros((many + 2, columns)), np.zeros((2 * n, columns))
        outer[:many, 2 * n : 2 * n + many] = np.eye(many)
        begin[:n, :n], begin[n:, :n], begin[n:, n : 2 * n] = np.eye(n), of_q, of_v
        begin[n:, 2 * n : 2 * n + many] = of_c
        return forwards(self.by, piece, given[2], self._directions(outer), begin), outer

    def _directions(self, outer: np.ndarray) -> Directions:
        """Of all inputs, the controls last."""
        controls = self.sizes[3][0] * self.steps
        return Directions(outer, outer.shape[1] - controls if controls else -1, 1)

    def hessian(self, given: list[np.ndarray], of_q: np.ndarray, of_v: np.ndarray) -> np.ndarray:
        """Second derivatives of Σ of_q·q + of_v·v over the nodes, (nodes, n) each, by all inputs.

        See `second_order`.
        """
        n, piece, c = len(given[0]), self.run(given), given[2]
        many, columns = len(c), sum(a * b for a, b in self.sizes)
        if piece is None:
            return np.full((columns, columns), np.nan)
        tangent, outer = self.tangents(given, piece)
        check_memory("second derivatives of this run", 3 * tangent.size, "take fewer steps")
        kept, weights = list(self.nodes), np.hstack([of_q, of_v])
        of_x, _ = self.slopes_at_nodes(piece, c)
        seeds = np.zeros((self.steps + 1, 2 * n))
        seeds[kept] = np.einsum("ko,kox->kx", weights, of_x)
        found, mu = curvature(self.by, piece, c, seeds, tangent, self._directions(outer))
        x = piece.x
        t = self.t0 + self.h * np.array(kept, dtype=float)
        at = x[kept, :n], x[kept, n:], t[:, None], c, weights
        constant = np.broadcast_to(outer[:many], (len(kept), many, columns))
        found += twice(
            over_columns(node_hessian(self.system), *at)[0],
            np.concatenate([tangent[kept], constant], 1),
        )
        begin = given[0], given[1], np.array([self.t0]), c, np.ascontiguousarray(mu[n:])
        size = 2 * n + many
        found[:size, :size] += call(start_hessian(self.system), *begin)[0].reshape(size, size)
        return found

    def adjoint(self, given: list[np.ndarray], of_q: np.ndarray, of_v: np.ndarray) -> np.ndarray:
        """The gradient of Σ of_q·q + of_v·v over the nodes, (nodes, n) each, by all inputs."""
        n, piece, c = len(given[0]), self.run(given), given[2]
        if piece is None:
            return np.full(sum(a * b for a, b in self.sizes), np.nan)
        of_x, by_c = self.slopes_at_nodes(piece, c)
        weights = np.hstack([of_q, of_v])
        seeds = np.zeros((self.steps + 1, 2 * n))
        seeds[list(self.nodes)] = np.einsum("ko,kox->kx", weights, of_x)
        mu, pulled = backwards(self.by, piece, c, seeds[-1], seeds[:-1], 1)
        by_q, by_v, by_start, _ = self._start(given)
        of_c = pulled.outer[: len(c)] + np.einsum("ko,koc->c", weights, by_c) + by_start.T @ mu[n:]
        return np.concatenate(
            [mu[:n] + by_q.T @ mu[n:], by_v.T @ mu[n:], of_c, pulled.controls.ravel()]
        )

    def _start(self, given: list[np.ndarray]) -> list[np.ndarray]:
        q, v, c, _ = given
        flat = call(momentum_slopes(self.system), q, v, np.array([self.t0]), c)
        return [x.reshape(-1, len(q)).T for x in flat]
