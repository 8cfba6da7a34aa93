"""The order of unknowns and rows in which a solver gets a problem: as it is, or as a chain of
stages.

A chain x_{k+1} = F(x_k, u_k) is what Fatrop's Riccati recursion needs: state (q_k, p_k, what is
shared), control (λ_k, u_k, inner points, the next position q⁺). Rows of stage k: the dynamics
q_{k+1} − q⁺ = 0, p_{k+1} − p⁺(q_k, q⁺, u_k) = 0 and shared quantities kept; then p_k − p⁻(q_k, q⁺,
u_k) = 0, inner rows, constraints and bounds. The multiplier of p_k − p⁻_k = 0 is that of momentum
matching, the costate of p.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.interval_values import interval_rows
from varint.control.kernels import end_term
from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription, pick
from varint.errors import InputError
from varint.nlp.arrangement import Arrangement
from varint.nlp.assembly import Element, assemble


def arrange_as_stages(problem: ControlProblem) -> Arrangement:
    """A problem of one phase as a chain of stages."""
    if len(problem.phases) != 1 or problem.links:
        raise InputError(
            'solver="fatrop" takes one phase whose start and end are not tied to each other; '
            'solve several phases, links and periodic motions by solver="ipopt"'
        )
    transcription = problem.phases[0]
    _refuse_what_is_no_chain(transcription)
    slots, rows, count = transcription.slots, transcription.rows, transcription.phase.steps
    (_, n), m, stage = slots.q.shape, slots.lam.shape[1], transcription.interval.stage.numel()
    free = np.flatnonzero(slots.shared >= 0)
    states, rest = 2 * n + len(free), stage - n
    width = states + rest + n  # of a stage; stage 0 also chooses v_0, the last one v_N and λ_N
    at = np.append(0, n + width * np.arange(1, count + 1))[:, None]
    q, p, shared = at + np.arange(n), at + n + np.arange(n), at + 2 * n + np.arange(len(free))
    chosen, following = at[:-1] + states + np.arange(rest), at[:-1] + states + rest + np.arange(n)
    v = np.array([width + np.arange(n), at[-1] + states + np.arange(n)])
    lam = v[1, -1] + 1 + np.arange(m)
    source = np.full(v[1, -1] + 1 + m, -1)
    pairs = [(q, slots.q), (shared[0], slots.shared[free]), (v, slots.v), (lam, slots.lam[-1])]
    for here, there in [*pairs, (chosen, slots.q[:-1, :1] + n + np.arange(rest))]:
        source[here] = there
    bounded = source >= 0
    x = np.empty(problem.unknowns, dtype=int)
    x[source[bounded]] = np.flatnonzero(bounded)
    source[following], source[shared] = slots.q[1:], slots.shared[free]

    along = np.hstack([rows.momentum[:-1], rows.inner, rows.gaps, rows.nodes, rows.points])
    new, end = np.full(states, -1), np.concatenate([rows.momentum[-1], rows.last])
    order = [np.concatenate([new, line[line >= 0]]) for line in along] + [end[end >= 0]]
    order[0] = np.concatenate([order[0], new[:n], rows.start[rows.start >= 0]])
    row = np.concatenate(order)
    begins = np.cumsum([0, *map(len, order)])[:-1]
    # the last one: rows that are left out
    g = np.append(np.empty(len(problem.nlp.g_low), dtype=int), -1)
    g[row[row >= 0]] = np.flatnonzero(row >= 0)
    dynamics = begins[:-1, None] + np.arange(states)
    started = states + int((along[0] >= 0).sum()) + np.arange(n)
    places = [g[x] for x in (along, rows.start, end)]
    indices = dict(q=q, p=p, shared=shared, chosen=chosen, following=following, v=v, lam=lam)
    elements = _elements(transcription, free, indices, dynamics, started, places)
    sizes = np.array([states] * (count + 1)), np.diff(np.append(at, len(source))) - states
    others = np.array([len(line) for line in order]) - np.append(sizes[0][:-1], 0)
    return Arrangement(
        program=assemble(elements, len(source), len(problem.nlp.p), len(row), problem.kernels),
        source=source,
        bounded=bounded,
        row=row,
        x=x,
        g=g[:-1],
        start=lambda x, data: _start(problem, transcription, source, p, x, data),
        momenta=p,
        momentum=rows.momentum[0],
        started=started,
        dynamics=dynamics,
        states=at[1:] + np.arange(states),
        options=dict(structure_detection="manual", N=count)
        | {
            name: size.tolist()
            for name, size in zip(("nx", "nu", "ng"), (*sizes, others), strict=True)
        },
    )


def _refuse_what_is_no_chain(transcription: PhaseTranscription) -> None:
    phase, slots = transcription.phase, transcription.slots
    found = {
        "integrals over a phase": phase.integrals.low.size,
        "states beside the mechanics": slots.states.size,
        'control="linear" and control_rate': phase.closing_controls,
        "vi.abs and vi.max in the terminal cost": slots.end_slack.size,
    }
    if unknown := [what for what, size in found.items() if size]:
        raise InputError(f'solver="fatrop" takes no {unknown[0]}; solve by solver="ipopt"')


def _start(
    problem: ControlProblem,
    transcription: PhaseTranscription,
    source: np.ndarray,
    momenta: np.ndarray,
    x: np.ndarray,
    data: np.ndarray,
) -> np.ndarray:
    """z of the problem's unknowns; momenta by the discrete Legendre transforms."""
    n = transcription.phase.system.structure.n
    _, rows = interval_rows(problem, transcription, x, data)
    z = x[source]
    z[momenta] = np.vstack([-rows[:, :n], rows[-1:, -n:]])
    return z


def _elements(
    transcription: PhaseTranscription, free: np.ndarray, at: dict, dynamics, started, places
) -> list[Element]:
    """The stage and the two ends; `places`: where the rows of interval, start and end are."""
    term, count, n = transcription.interval, transcription.phase.steps, at["q"].shape[1]
    known = np.flatnonzero(transcription.slots.shared < 0)
    fixed = transcription.first_shared + known
    shared = transcription.shared.column
    unknown, given = pick(shared, free), pick(shared, known)
    p0, q1, p1, kept = (
        ca.SX.sym(name, k) for name, k in zip("abcd", (n, n, n, len(free)), strict=True)
    )
    along, at_start, at_end = places
    step = transcription.first_datum + np.arange(count)[:, None]
    moves = [q1 - term.q1, p1 - term.p_plus, kept - unknown]
    blocks = [at["q"][:-1], at["chosen"], at["p"][:-1], at["shared"][:-1], at["following"]]
    interval = Element(
        variables=ca.vertcat(term.stage, p0, unknown, term.q1, q1, p1, kept),
        constants=ca.vertcat(term.mesh, given),
        cost=term.cost,
        rows=ca.vertcat(*moves, p0 - term.p_minus, term.inner, term.gaps, term.nodes, term.points),
        x=np.hstack([*blocks, at["q"][1:], at["p"][1:], at["shared"][1:]]),
        p=np.hstack([step, count + step, np.tile(fixed, (count, 1))]),
        g=np.hstack([dynamics, along]),
    )

    def end(last: bool) -> Element:
        term, k, lam = (
            end_term(transcription.phase, transcription.shared, last),
            -int(last),
            at["lam"] if last else at["lam"][:0],
        )
        if last:
            shares, g = [p0 - term.momentum, term.hidden, term.rows], at_end
        else:
            shares = [term.momentum - p0, term.gap, term.hidden, term.rows, term.points]
            g = np.concatenate([started, at_start])
        return Element(
            variables=ca.vertcat(term.q, p0, unknown, term.v, term.lam),
            constants=ca.vertcat(term.mesh, given),
            cost=term.cost,
            rows=ca.vertcat(*shares),
            x=np.concatenate([at["q"][k], at["p"][k], at["shared"][k], at["v"][k], lam])[None],
            p=np.concatenate([step[k], count + step[k], fixed])[None],
            g=g[None],
        )

    return [interval, end(False), end(True)]
