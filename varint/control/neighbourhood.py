"""What surrounds an optimal control: which bounds hold, second derivatives, and in which units to
measure a change of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.control.transcription import PhaseTranscription
from varint.nlp.assembly import assemble, with_constants_as_unknowns
from varint.nlp.kkt import KktSystem, activity
from varint.nlp.program import NonlinearProgram
from varint.nlp.solver import SolverResult

# what the motion follows from (start, controls, duration, parameters) measures a change of it; the
# path itself, which may grow along the way, hardly: a little, since nothing may go unseen
FOLLOWS = 1e-4


def kkt_system(problem: ControlProblem, outcome: SolverResult) -> KktSystem:
    """The Karush–Kuhn–Tucker system at a solution.

    Its metric is that of ∫ |δu|² dt / T in the problem's own units, with the free values at the
    start, the free duration and the free parameters.
    """
    nlp, x = outcome.nlp, outcome.x
    scales = choose_scales(problem, x)
    share, row_share, weight = np.ones(len(x)), np.ones(nlp.rows), np.ones(len(x))
    for part in problem.phases:
        for index, value in _shares(part):
            share[index] = value
        for index, value in _row_shares(part):
            row_share[index[index >= 0]] = value[index >= 0]
        slots = part.slots
        for index in (
            slots.q[1:],
            slots.inner,
            slots.lam,
            slots.lam_inner,
            slots.states[1:],
            slots.slack,
            slots.end_slack,
        ):
            weight[index] = FOLLOWS * share[index]
        weight[slots.u] = share[slots.u]
        states = slots.u[..., part.phase.states.index]
        weight[states] = FOLLOWS * share[states]
        weight[slots.v[1]] = FOLLOWS
    g, jacobian = nlp.program.jacobian(x, nlp.p)
    hessian = ca.triu2symm(nlp.program.hessian(x, nlp.p, 1.0, outcome.lam_g))
    value, unit = np.array(g).ravel(), 1 / scales.g
    return KktSystem(
        nlp,
        activity(x, nlp.x_low, nlp.x_high, outcome.lam_x, scales.x, share / scales.x / scales.f),
        activity(value, nlp.g_low, nlp.g_high, outcome.lam_g, unit, row_share / unit / scales.f),
        hessian,
        jacobian,
        _stages(problem, nlp),
        scales,
        weight / scales.x**2,
    )


LAST = np.iinfo(int).max


def _stages(problem: ControlProblem, nlp: NonlinearProgram) -> tuple[np.ndarray, np.ndarray]:
    """The order in which unknowns and rows follow each other along the phases; what all of them
    share comes last, a link where the first of its phases ends.

    A stage's unknowns and rows are numbered behind its coordinates and its momentum matching.
    """
    x, g, first = np.full(nlp.unknowns, -1), np.full(nlp.rows, -1), 0
    for part in problem.phases:
        slots, rows, count = part.slots, part.rows, part.phase.steps
        along = first + np.arange(count + 1)[:, None]
        x[slots.q], g[rows.momentum], x[slots.v] = along, along, along[[0, -1]]
        g[rows.start[rows.start >= 0]], g[rows.last[rows.last >= 0]] = first, first + count
        x[slots.shared[slots.shared >= 0]] = LAST
        g[rows.integrals] = LAST
        first += count + 1
    for element in (element for link in problem.links for element in link.elements):
        known = x[element.x[0]]
        stage = known[known >= 0].min(initial=LAST)
        x[element.x[0][known < 0]], g[element.g[element.g >= 0]] = stage, stage
    return _filled(x), _filled(g)


def _filled(stages: np.ndarray) -> np.ndarray:
    """Where nothing is known (−1), what is known of the one before."""
    known = np.maximum.accumulate(np.where(stages >= 0, np.arange(len(stages)), 0))
    return stages[known]


def _shares(part: PhaseTranscription) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Unknowns along the path, and the share of the duration that each stands for."""
    phase, slots, steps = part.phase, part.slots, np.diff(part.phase.mesh)
    by_step = steps[:, None, None] / phase.rule.degree
    by_value = steps[:, None] * phase.control_weights
    if len(slots.u) > phase.steps:  # one at every end of a step
        beside = np.append(steps[:1], steps), np.append(steps, steps[-1:])
        by_value = (beside[0] + beside[1])[:, None] / 2
    yield slots.u, np.broadcast_to(by_value[..., None], slots.u.shape)
    by_node = steps[:, None] * np.array(phase.rule.weights)
    yield slots.slack, np.broadcast_to(by_node[..., None], slots.slack.shape)
    for index in (slots.q[1:, None], slots.inner, slots.lam[1:, None], slots.lam_inner):
        yield index, np.broadcast_to(by_step, index.shape)


def _row_shares(part: PhaseTranscription) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The same of rows: bounds at the nodes and at the control points."""
    phase, rows, steps = part.phase, part.rows, np.diff(part.phase.mesh)[:, None]
    of_a_node = phase.bounds.at_nodes.numel() + phase.slacks.rows.numel()
    nodes = steps * np.repeat(phase.rule.weights, of_a_node)
    yield rows.nodes, nodes
    yield rows.points, np.broadcast_to(steps / phase.rule.degree, rows.points.shape)


def constant_derivatives(
    problem: ControlProblem, outcome: SolverResult
) -> tuple[np.ndarray, ca.DM, ca.DM]:
    """∂L/∂p, ∂²L/∂x∂p and ∂g/∂p of the Lagrangian L = f + λ·g in the program's constants p."""
    n, p = len(outcome.x), outcome.nlp.p
    elements = [element for part in problem.phases for element in part.elements]
    elements += [element for link in problem.links for element in link.elements]
    program = assemble(with_constants_as_unknowns(elements, n), n + len(p), 0, len(outcome.lam_g))
    z, none = np.append(outcome.x, p), np.zeros(0)
    gradient = np.array(program.gradient(z, none)[1]).ravel()
    jacobian = program.jacobian(z, none)[1][:, n:]
    hessian = program.hessian(z, none, 1.0, outcome.lam_g)
    slope = gradient[n:] + np.array(ca.mtimes(jacobian.T, outcome.lam_g)).ravel()
    return slope, hessian[:n, n:], jacobian
