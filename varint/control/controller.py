"""A problem that is built once and solved from any state, with any parameter values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from varint.control.constrained_guess import dense_constraint_function
from varint.control.numbers import constants
from varint.control.outcome import has_converged, raise_unless_converged
from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.control.source import controller_function, write_source
from varint.control.trajectories import build_trajectories
from varint.control.transcription import PhaseTranscription
from varint.discrete.constraints import rows_function
from varint.errors import InputError
from varint.nlp.arrangement import plain_order
from varint.nlp.elastic import ElasticProgram, elastic_scales, soften
from varint.nlp.program import NonlinearProgram
from varint.nlp.solver import Solver, SolverResult, build_solver
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.inputs import vector
from varint.scene.parameters import ParameterValues
from varint.scene.travel import itself, stays

PRICE = 1e3  # of a violation of size one, in units of the cost: above usual multipliers
SEEN = 1e-7  # a bound violated by less is kept


@dataclass(frozen=True, eq=False)
class Controller:
    """A problem that is solved from any state in milliseconds; `mpc` builds it.

    Bounds on states are kept where that is possible. From a state outside them (a noisy
    measurement, a push) or one that must leave them they are softened: violated as little and as
    briefly as the controls allow, by an exact penalty. The plan says so in ``stats["softened"]``,
    a dictionary from bounds to largest violations, and in its report. Bounds on controls and
    conditions at the end are never softened.

    Attributes
    ----------
    problem : ControlProblem
        The problem over the horizon.
    solver : Solver
        Its solver.
    start : ndarray
        Where the first solve starts.
    options : mapping
        Of the solver for the softened problem.
    """

    problem: ControlProblem
    solver: Solver
    start: np.ndarray
    options: Mapping[str, Any] | None = None

    __reduce__ = stays("a controller")
    __copy__ = __deepcopy__ = itself

    def __call__(
        self,
        q: Any,
        v: Any,
        previous: Trajectory | None = None,
        t: float | None = None,
        params: ParameterValues | None = None,
    ) -> Trajectory:
        """The optimal motion from (q, v), warm from the previous one, which began one step earlier.

        Parameters
        ----------
        q, v : array (n,)
            The state now, in or out of its bounds.
        previous : Trajectory, optional
            The last answer of this controller.
        t : float, optional
            Time now, for scenes that depend on time.
        params : dict, optional
            Parameter values by name or symbol from now on, such as a set-point that the cost is
            written with; those not named are the phase's.

        Returns
        -------
        Trajectory
            ``u[0]`` are the controls to apply in the step that begins now.

        Raises
        ------
        InputError
            If the state has the wrong shape or is not finite, or a parameter is unknown.
        SolverError
            If no control is found.
        """
        part, nlp = self.problem.phases[0], self.problem.nlp
        phase, slots = part.phase, part.slots
        names = phase.system.names
        q, v = vector("q", q, len(names), names), vector("v", v, len(names), names)
        data = constants(part, nlp.p, t, params)
        _on_constraints(part, q, v, 0.0 if t is None else float(t), data)
        low, high = nlp.x_low.copy(), nlp.x_high.copy()
        outside = False
        for state, slot in ((q, slots.q[0]), (v, slots.v[0])):
            outside |= bool(((state < low[slot]) | (state > high[slot])).any())
            low[slot] = high[slot] = state
        x, multipliers = self.start, None
        if previous is not None:
            origin = getattr(getattr(previous, "solution", None), "origin", None)
            if origin is None or origin.problem is not self.problem:
                raise InputError("previous= takes the last answer of this controller")
            outcome = origin.outcome
            x = _shifted_unknowns(part, outcome.x)
            multipliers = (
                _shifted_unknowns(part, outcome.lam_x),
                _shifted_rows(part, outcome.lam_g),
            )
        x = np.clip(x, low, high)
        given: dict[str, Any] = dict(x_low=low, x_high=high, p=data, progress=False)
        if not outside:
            outcome = self.solver(x, multipliers, **given)
            if not outcome.success and multipliers is not None and not outcome.stopped:
                outcome = self.solver(x, **given)
            if outcome.success:
                return build_trajectories(self.problem, outcome, data)[0]
            if outcome.stopped or self._elastic is None:
                return raise_unless_converged(self.problem, outcome)[0]
        return self._softened(x, low, high, data)

    def source(self, path: Any, name: str = "controller_step") -> ca.Function:
        """Write one call of the controller as a C file that stands alone, and return the same
        function in CasADi.

        Parameters
        ----------
        path : str or Path
            Of the file, ending in ``.c``; it needs no header and nothing but the C library.
        name : str
            Of the C function. ``<name>_start`` gives the start of the first call: ``x, lam_x,
            lam_g, params``.

        Returns
        -------
        Function
            ``(q, v, t, params, x0, lam_x0, lam_g0) → (u, x, lam_x, lam_g, residual)``: u (controls,
            values a step) of the step that begins now; x, lam_x and lam_g, moved on by a step, are
            x0, lam_x0 and lam_g0 of the next call; residual is the largest violation of rows,
            bounds and stationarity, to be checked: about 1e-9 where a solution was found. Bounds on
            states are not softened.

        Raises
        ------
        InputError
            If the scene has constraints, or the path or the name cannot be used.

        Notes
        -----
        Sequential quadratic programming with exact Hessians, Nocedal & Wright, §18.1. In C the
        arguments are arrays of pointers, as CasADi's documentation describes.
        """
        if not isinstance(name, str) or not name.isidentifier() or not name.isascii():
            raise InputError(f"name must be a name in C such as 'controller_step', got {name!r}")
        part, nlp = self.problem.phases[0], self.problem.nlp
        ahead = ahead_by_a_step(part, nlp)
        functions = controller_function(self.problem, self.start, ahead, name)
        write_source(path, (functions.step, functions.start))
        return functions.step

    def _softened(
        self, x: np.ndarray, low: np.ndarray, high: np.ndarray, data: np.ndarray
    ) -> Trajectory:
        """The plan that violates the bounds on states as little as it can."""
        assert self._elastic is not None
        elastic, solver = self._elastic
        z_low, z_high = elastic.bounds(low, high)
        outcome = solver(elastic.start(x), x_low=z_low, x_high=z_high, p=data, progress=False)
        own = elastic.result(outcome, data)
        if not has_converged(own):
            return raise_unless_converged(self.problem, own)[0]
        plan = build_trajectories(self.problem, own, data)[0]
        softened = {**plan.stats.get("softened", {}), **self._violations(elastic, outcome)}
        return replace(plan, stats=MappingProxyType({**plan.stats, "softened": softened}))

    def _violations(self, elastic: ElasticProgram, outcome: SolverResult) -> dict[str, float]:
        """Largest violation of every softened bound that is violated."""
        part, found = self.problem.phases[0], {}
        excess = elastic.excess(outcome.x)
        for name, places in _softened_bounds(part):
            index = np.append(elastic.rows, -1 - elastic.unknowns)
            mine = excess[np.isin(index, places)]
            for side, size in (("above", mine.max(initial=0.0)), ("below", -mine.min(initial=0.0))):
                if size > SEEN:
                    found[f"{name} {side}"] = float(size)
        return found

    @cached_property
    def _elastic(self) -> tuple[ElasticProgram, Solver] | None:
        """The program with soft bounds on states and its solver, built when first needed; None
        where no state is bounded.
        """
        part, nlp = self.problem.phases[0], self.problem.nlp
        places = np.concatenate(
            [np.zeros(0, dtype=int), *(x for _, x in _softened_bounds(part))]
        ).astype(int)
        rows, unknowns = np.unique(places[places >= 0]), np.unique(-1 - places[places < 0])
        limited = np.isfinite(nlp.x_low[unknowns]) | np.isfinite(nlp.x_high[unknowns])
        unknowns = unknowns[limited & (nlp.x_low[unknowns] < nlp.x_high[unknowns])]
        if not len(rows) + len(unknowns):
            return None
        scales = choose_scales(self.problem, self.start)
        sizes = np.append(1 / scales.g[rows], scales.x[unknowns])
        elastic = soften(nlp, rows, unknowns, PRICE / scales.f / sizes)
        solver = build_solver(
            elastic.nlp,
            "ipopt",
            self.options,
            elastic_scales(elastic, scales),
            plain_order(elastic.nlp),
        )
        return elastic, solver


def _softened_bounds(part: PhaseTranscription) -> list[tuple[str, np.ndarray]]:
    """Names of the bounds on states, and their rows; −1 − i for the unknown i."""
    phase, slots, rows = part.phase, part.slots, part.rows
    system, bounds = phase.system, phase.bounds
    found = [
        (name, -1 - np.concatenate([slots.q[1:, i], slots.inner[..., i].ravel()]))
        for i, name in enumerate(system.names)
    ]
    found += [(f"velocity of {name}", -1 - slots.v[1:, i]) for i, name in enumerate(system.names)]
    for expressions, places, copies in (
        (bounds.at_points, rows.points, phase.rule.degree),
        (bounds.at_nodes, rows.nodes, len(phase.rule.nodes)),
    ):
        count = expressions.numel()
        for i in range(count):
            if not ca.depends_on(expressions[i], system.control):
                own = places.reshape(phase.steps, copies, -1)[..., i].ravel()
                if expressions is bounds.at_points:
                    own = np.append(own, rows.start[len(rows.start) - count + i])
                found.append((str(expressions[i]), own[own >= 0]))
    return found


OFF = 1e-6  # of the state's size: a simulated state is closer to its constraints


def _on_constraints(
    part: PhaseTranscription, q: np.ndarray, v: np.ndarray, t: float, data: np.ndarray
) -> None:
    """The state must be one that the constraints allow."""
    s = part.phase.system
    if not s.structure.velocity_rows:
        return
    now, c = np.array([[t]]), data[part.first_shared + 2 :][: len(part.phase.c)]
    gap = over_columns(dense_constraint_function(s), q[None], now, c)[0]
    hidden = over_columns(rows_function(s), q[None], v[None], now, c)[0]
    for what, rows, size in (
        ("q violates constraint", gap, q),
        ("v violates G v = 0 of constraint", hidden[:, : gap.shape[1]], v),
        ("v violates A v = 0 of non-holonomic row", hidden[:, gap.shape[1] :], v),
    ):
        for i in np.flatnonzero(np.abs(rows[0]) > OFF * (1 + np.abs(size).max())):
            raise InputError(
                f"the state's {what} {i} by {rows[0, i]:.3g}; vi.project brings a state onto "
                "constraints"
            )


def ahead_by_a_step(
    part: PhaseTranscription, nlp: NonlinearProgram
) -> tuple[np.ndarray, np.ndarray]:
    """Where each unknown and each row of the plan one step later stands in the plan now."""
    return (
        _shifted_unknowns(part, np.arange(nlp.unknowns)),
        _shifted_rows(part, np.arange(nlp.rows)),
    )


def _shifted_unknowns(part: PhaseTranscription, x: np.ndarray) -> np.ndarray:
    """Unknowns one step later; the last step is repeated."""
    moved = x.copy()
    s = part.slots
    for index in (s.q, s.lam, s.u, s.inner, s.lam_inner, s.slack):
        moved[index[:-1]] = x[index[1:]]
    moved[s.v[0]] = x[s.v[0]]
    return moved


def _shifted_rows(part: PhaseTranscription, lam: np.ndarray) -> np.ndarray:
    moved, r = lam.copy(), part.rows
    for index in (r.momentum, r.inner, r.gaps, r.nodes, r.points):
        old, new = index[1:], index[:-1]
        both = (old >= 0) & (new >= 0)
        moved[new[both]] = lam[old[both]]
    return moved
