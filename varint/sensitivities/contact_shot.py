"""The run behind a flow of a scene with contacts: its impacts, stops and detachments come as they
do from the start at hand, and its derivatives go through them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.integration.simulate import simulate
from varint.numerics.arrays import call, over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System, parameters_by_name
from varint.sensitivities.carrier import Carrier
from varint.sensitivities.contact_curvature import Ahead, carried_ahead, contact_curvature
from varint.sensitivities.course import course_of
from varint.sensitivities.flow_inputs import kept_run, shapes_of_inputs
from varint.sensitivities.gradient import pulled_back
from varint.sensitivities.second_order import node_hessian, start_hessian, twice
from varint.sensitivities.start import output_slopes, scenes_at, start_slopes
from varint.sensitivities.tangents import Asked, of_outputs


@dataclass(eq=False)
class ContactShot:
    """As `Shot`; a start that no run can begin from, or a run that cannot be finished, has no
    numbers, and one that grazes no derivatives.
    """

    system: System
    rule: Rule
    h: float
    steps: int
    nodes: tuple[int, ...]
    t0: float
    backend: str
    last: tuple[bytes, Trajectory | None] | None = field(default=None)
    ahead: tuple[Trajectory, Ahead] | None = field(default=None)

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Shapes of the inputs."""
        return shapes_of_inputs(self.system, self.steps)

    def run(self, given: list[np.ndarray]) -> Trajectory | None:
        """The run, with nodes at whole steps and at events."""
        found: Trajectory | None = kept_run(self, given)
        return found

    def begun(
        self, q: np.ndarray, v: np.ndarray, c: np.ndarray, u: np.ndarray
    ) -> Trajectory | None:
        if not all(np.isfinite(x).all() for x in (q, v, c, u)):
            return None
        try:
            return simulate(
                self.system,
                self.rule,
                q0=q,
                v0=v,
                h=self.h,
                steps=self.steps,
                t0=self.t0,
                params=parameters_by_name(self.system, c),
                u=u.reshape(self.steps, -1) if self.system.structure.controls else None,
            )
        except (ConvergenceError, InputError):
            return None

    def _kept(self, motion: Trajectory) -> np.ndarray:
        """Where the nodes of the flow stand among those of a run: at whole steps, before what
        happens in the step behind.
        """
        return np.searchsorted(motion.k, self.nodes)

    def values(self, given: list[np.ndarray]) -> list[np.ndarray]:
        """q and v at the nodes, (nodes, n) each."""
        motion = self.run(given)
        if motion is None:
            return [np.full((len(self.nodes), len(given[0])), np.nan)] * 2
        kept = self._kept(motion)
        return [motion.q[kept], motion.v[kept]]

    def jacobian(self, given: list[np.ndarray]) -> np.ndarray:
        """∂(q, v)/∂(q0, v0, c, u): rows are q of the first node, …, v of the last."""
        n, columns = len(given[0]), sum(a * b for a, b in self.sizes)
        motion, rows = self.run(given), 2 * n * len(self.nodes)
        if motion is None:
            return np.full((rows, columns), np.nan)
        kept = self._kept(motion)
        try:
            change, outer = self._ahead(motion).changes(), self._asked(motion).outer
        except ConvergenceError:  # it grazes
            return np.full((rows, columns), np.nan)
        wanted = ca.vertcat(self.system.q, self.system.v)
        found = of_outputs(motion[kept], wanted, change[kept], outer[: len(motion.c)])
        by_output = found.reshape(len(kept), 2, n, columns).transpose(1, 0, 2, 3)
        return by_output.reshape(rows, columns)

    def _ahead(self, motion: Trajectory) -> Ahead:
        """The tangents of a run, for Jacobians and Hessians at the same place."""
        if self.ahead is None or self.ahead[0] is not motion:
            self.ahead = motion, carried_ahead(motion, self._asked(motion), self.backend)
        return self.ahead[1]

    def _asked(self, motion: Trajectory) -> Asked:
        """All inputs, the controls last."""
        n, many, columns = motion.q.shape[1], len(motion.c), sum(a * b for a, b in self.sizes)
        contacts, controls = self.system.structure.contacts, self.sizes[3][0] * self.steps
        of_q, of_v, of_c, _ = start_slopes(motion)
        tangent, outer = np.zeros((2 * n, columns)), np.zeros((many + 2 + contacts, columns))
        tangent[:n, :n], tangent[n:, :n], tangent[n:, n : 2 * n] = np.eye(n), of_q, of_v
        outer[:many, 2 * n : 2 * n + many] = np.eye(many)
        tangent[n:, 2 * n : 2 * n + many] = of_c
        return Asked(tangent, outer, columns - controls if controls else -1)

    def hessian(self, given: list[np.ndarray], of_q: np.ndarray, of_v: np.ndarray) -> np.ndarray:
        """Second derivatives of Σ of_q·q + of_v·v over the nodes, (nodes, n) each, by all inputs;
        see `contact_curvature`.
        """
        n, columns, motion = len(given[0]), sum(a * b for a, b in self.sizes), self.run(given)
        if motion is None:
            return np.full((columns, columns), np.nan)
        kept, weights = self._kept(motion), np.hstack([of_q, of_v])
        seeds, _ = self._seeds(motion, weights)
        try:
            ahead = self._ahead(motion)
            found, at = contact_curvature(ahead, seeds)
        except ConvergenceError:
            return np.full((columns, columns), np.nan)
        change, c, t = ahead.changes()[kept], motion.c, motion.t[kept, None]
        if change[:, 2 * n].any():  # a node at an event moves with it, on one side of it alone
            return np.full((columns, columns), np.nan)
        outer = self._asked(motion).outer[: len(c)]
        constant = np.broadcast_to(outer, (len(kept), *outer.shape))
        along = np.concatenate([change[:, : 2 * n], constant], 1)
        for some, scene in scenes_at(motion[kept], slice(None)):
            at_node = motion.q[kept][some], motion.p[kept][some], t[some], c, weights[some]
            found += twice(over_columns(node_hessian(scene), *at_node)[0], along[some])
        begin = given[0], given[1], np.array([self.t0]), c, np.ascontiguousarray(at.z[n : 2 * n])
        size = 2 * n + len(c)
        found[:size, :size] += call(start_hessian(self.system), *begin)[0].reshape(size, size)
        return (found + found.T) / 2

    def adjoint(self, given: list[np.ndarray], of_q: np.ndarray, of_v: np.ndarray) -> np.ndarray:
        """The gradient of Σ of_q·q + of_v·v over the nodes, (nodes, n) each, by all inputs."""
        n, many, columns = len(given[0]), len(given[2]), sum(a * b for a, b in self.sizes)
        motion = self.run(given)
        if motion is None:
            return np.full(columns, np.nan)
        seeds, of_c = self._seeds(motion, np.hstack([of_q, of_v]))
        try:
            found = pulled_back(motion, Carrier(course_of(motion), self.backend), seeds)
        except ConvergenceError:
            return np.full(columns, np.nan)
        by_q, by_p = found.z[:n], found.z[n : 2 * n]
        p_of_q, p_of_v, p_of_c, _ = start_slopes(motion)
        of_c = of_c + found.z[2 * n + 1 : 2 * n + 1 + many] + p_of_c.T @ by_p
        return np.concatenate([by_q + p_of_q.T @ by_p, p_of_v.T @ by_p, of_c, found.u.ravel()])

    def _seeds(self, motion: Trajectory, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the weighted sum by (q, p, t) of every node, and by the parameters."""
        kept, n, many = self._kept(motion), motion.q.shape[1], len(motion.c)
        seeds, of_c = np.zeros((len(motion), 2 * n + 1)), np.zeros(many)
        for some, scene in scenes_at(motion[kept], slice(None)):
            at, w = kept[some], weights[some]
            given = motion.q[at], motion.p[at], motion.t[at, None], motion.c
            by_x, by_c, by_t = (
                x.reshape(len(at), -1, 2 * n) for x in over_columns(output_slopes(scene), *given)
            )
            seeds[at, : 2 * n] += np.einsum("kxo,ko->kx", by_x, w)
            seeds[at, 2 * n] += np.einsum("kxo,ko->k", by_t, w)
            of_c += np.einsum("kco,ko->c", by_c, w)
        return seeds, of_c
