"""From the solver's numbers back to mechanics: a trajectory for every phase, with its costates."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

import numpy as np

from varint.control.interval_values import interval_rows
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem
from varint.control.slack_values import refuse_loose, violations
from varint.control.solution import ControlSolution, Origin
from varint.control.transcription import (
    PhaseTranscription,
    control_points,
    control_samples,
    controls_at_nodes,
)
from varint.discrete.constraints import tangent_function
from varint.integration.many_steps import steps_again
from varint.nlp.solver import SolverResult
from varint.numerics.arrays import call, over_columns
from varint.results.trajectory import Trajectory


def build_trajectories(
    problem: ControlProblem, outcome: SolverResult, data: np.ndarray | None = None
) -> list[Trajectory]:
    """One trajectory a phase; `data`: the program's constants where they are not the problem's
    own.
    """
    constants = problem.nlp.p if data is None else data
    return [
        _trajectory(problem, outcome, transcription, constants) for transcription in problem.phases
    ]


def _trajectory(
    problem: ControlProblem,
    outcome: SolverResult,
    transcription: PhaseTranscription,
    constants: np.ndarray,
) -> Trajectory:
    phase, slots, x = transcription.phase, transcription.slots, outcome.x
    count, rule, system = phase.steps, phase.rule, phase.system
    shared = transcription.shared_values(x, constants)
    t0, duration, c = float(shared[0]), float(shared[1]), shared[2:]
    uniform = np.array_equal(phase.mesh, np.arange(count + 1) / count)
    k = np.arange(count + 1)
    t = t0 + duration / count * k if uniform else t0 + duration * phase.mesh
    points, u = control_points(x, transcription), controls_at_nodes(x, transcription)
    p, cost = _momenta_and_cost(problem, outcome, transcription, constants)
    refuse_loose(x, transcription, shared)
    solution = ControlSolution(
        cost=cost,
        total_cost=outcome.cost,
        q=Piecewise(phase.mesh, np.array(rule.points), points),
        u=Piecewise(phase.mesh, phase.control_places, control_samples(x, transcription)),
        costate=Piecewise(
            phase.mesh, np.array(rule.points), _costate_points(transcription, outcome)
        ),
        mesh=phase.mesh,
        v_ends=x[slots.v],
        status=outcome.status,
        success=outcome.success,
        violation=outcome.violation,
        iterations=outcome.iterations,
        history=MappingProxyType(outcome.history),
        timings=MappingProxyType({"build": problem.seconds, "solve": outcome.seconds}),
        origin=Origin(transcription, problem, outcome, constants),
    )
    return Trajectory(
        system=system,
        rule=rule,
        t=t,
        q=x[slots.q],
        p=p,
        h=duration / count,
        origin=float(t[0]),
        sizes=None if uniform else duration * np.diff(phase.mesh),
        k=k,
        u=u,
        c=c,
        functions=steps_again(rule),
        stats=MappingProxyType(
            {"plan": f"optimal control by {rule}", "steps": count, "seconds": outcome.seconds}
            | _extras(transcription, x)
        ),
        solution=solution,
    )


def _extras(transcription: PhaseTranscription, x: np.ndarray) -> dict[str, Any]:
    """What only some problems have: violations of soft bounds, states beside the mechanics."""
    phase = transcription.phase
    found: dict[str, Any] = {}
    if phase.slacks.names:
        found["softened"] = violations(x, transcription)
    if len(phase.states.index):
        names = phase.states.names(phase.system)
        values = x[transcription.slots.states].T
        found["states"] = dict(zip(names, values, strict=True))
    return found


def _costate_points(transcription: PhaseTranscription, outcome: SolverResult) -> np.ndarray:
    """μ at the control points: multipliers of momentum matching at nodes, of the inner rows
    between them.
    """
    rows, phase = transcription.rows, transcription.phase
    mu = outcome.lam_g[rows.momentum]
    inner = outcome.lam_g[rows.inner].reshape(phase.steps, -1, phase.system.structure.n)
    return np.concatenate([mu[:-1, None], inner, mu[1:, None]], axis=1)


def _momenta_and_cost(
    problem: ControlProblem,
    outcome: SolverResult,
    transcription: PhaseTranscription,
    constants: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Momenta at the nodes from the discrete Legendre transforms; the cost of the phase."""
    phase, slots, x = transcription.phase, transcription.slots, outcome.x
    shared, n = transcription.shared_values(x, constants), phase.system.structure.n
    costs, rows = interval_rows(problem, transcription, x, constants)
    p_minus, p_plus = -rows[:, :n], rows[:, -n:]
    terminal, p_end = call(
        transcription.functions.at_end,
        x[slots.q[-1]],
        x[slots.v[1]],
        x[slots.states[-1]],
        x[slots.end_slack],
        shared[:1] + shared[1:2],
        shared[2:],
    )
    p = np.vstack([p_minus, p_plus[-1:]])
    if phase.system.structure.velocity_rows:
        v, at = x[slots.v[0]], (shared[0], shared[2:])
        p[0] = transcription.functions.momentum(x[slots.q[0]], v, *at).full().ravel()
        t = shared[0] + shared[1] * phase.mesh
        p = (
            p
            + over_columns(tangent_function(phase.system), x[slots.q], p, t[:, None], shared[2:])[1]
        )
        p[-1] = p_end
    return p, float(costs.sum() + terminal[0])
