"""The order of unknowns and rows in which a solver gets a problem: as it is, or as a chain of stages.

A chain x_{k+1} = F(x_k, u_k) is what Fatrop's Riccati recursion needs: state (q_k, p_k, what is shared), control (λ_k,
u_k, inner points, the next position q⁺). Rows of stage k: the dynamics q_{k+1} − q⁺ = 0, p_{k+1} − p⁺(q_k, q⁺, u_k) = 0
and shared quantities kept; then p_k − p⁻(q_k, q⁺, u_k) = 0, inner rows, constraints and bounds. The multiplier of
p_k − p⁻_k = 0 is that of momentum matching, the costate of p.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.assembly import Element, Program, assembled
from varint.control.kernels import end_term
from varint.control.leg import Leg, picked
from varint.control.problem import Problem
from varint.errors import InputError


@dataclass(frozen=True, eq=False)
class Arrangement:
    """A program in unknowns z of its own order, and how z and its rows belong to those of the problem.

    Attributes
    ----------
    program : Program
        Value and derivatives in z; the constants are those of the problem.
    source : ndarray of int
        The unknown of the problem that starts z_i; −1 for none.
    bounded : ndarray of bool
        Does z_i carry the bounds of its source?
    row : ndarray of int
        The row of the problem whose bounds hold here; −1: the row is zero.
    x, g : ndarray of int
        Where the problem's unknowns are found in z, and its rows among these rows.
    start : callable
        (x, constants) → z.
    momenta, momentum : ndarray of int (N + 1, n), (n,)
        Where p_k sits in z; rows of the problem that have its units.
    started : ndarray of int (n,)
        The rows ∂L/∂v(q_0, v_0) − p_0.
    dynamics, states : ndarray of int (N, states)
        The rows x_{k+1} − F, and x_{k+1}, whose units are theirs.
    options : dict
        Sizes of the stages, for the solver.
    """

    program: Program
    source: np.ndarray
    bounded: np.ndarray
    row: np.ndarray
    x: np.ndarray
    g: np.ndarray
    start: Callable[[np.ndarray, np.ndarray], np.ndarray]
    momenta: np.ndarray
    momentum: np.ndarray
    started: np.ndarray
    dynamics: np.ndarray
    states: np.ndarray
    options: Mapping[str, Any] = field(default_factory=dict)

    def scales(self, x: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sizes of z and factors of the rows, from those of the problem."""
        size, factor = x[self.source], np.append(g, 1.0)[self.row]
        if self.momenta.size:
            size[self.momenta] = 1 / g[self.momentum]
            factor[self.started] = g[self.momentum]
            factor[self.dynamics] = 1 / size[self.states]
        return size, factor


def plain(problem: Problem) -> Arrangement:
    """The problem as it is."""
    x, g, none = np.arange(problem.unknowns), np.arange(len(problem.g_low)), np.zeros((0, 0), dtype=int)
    every = np.ones(len(x), dtype=bool)
    return Arrangement(problem.program, x, every, g, x, g, lambda start, _: start, none, none, none, none, none)


def staged(problem: Problem) -> Arrangement:
    """A problem of one phase as a chain of stages."""
    if len(problem.legs) != 1 or problem.links:
        raise InputError(
            'solver="fatrop" takes one phase whose start and end are not tied to each other; solve several phases, '
            'links and periodic motions by solver="ipopt"'
        )
    one = problem.legs[0]
    slots, rows, count = one.slots, one.rows, one.phase.steps
    (_, n), m, stage = slots.q.shape, slots.lam.shape[1], one.interval.stage.numel()
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
    g = np.append(np.empty(len(problem.g_low), dtype=int), -1)  # the last one: rows that are left out
    g[row[row >= 0]] = np.flatnonzero(row >= 0)
    dynamics = begins[:-1, None] + np.arange(states)
    started = states + int((along[0] >= 0).sum()) + np.arange(n)
    places = [g[x] for x in (along, rows.start, end)]
    indices = dict(q=q, p=p, shared=shared, chosen=chosen, following=following, v=v, lam=lam)
    elements = _elements(one, free, indices, dynamics, started, places)
    sizes = np.array([states] * (count + 1)), np.diff(np.append(at, len(source))) - states
    others = np.array([len(line) for line in order]) - np.append(sizes[0][:-1], 0)
    return Arrangement(
        program=assembled(elements, len(source), len(problem.p), len(row), problem.kernels),
        source=source, bounded=bounded, row=row, x=x, g=g[:-1], start=lambda x, data: _start(one, source, p, x, data),
        momenta=p, momentum=rows.momentum[0], started=started, dynamics=dynamics, states=at[1:] + np.arange(states),
        options=dict(structure_detection="manual", N=count)
        | {name: size.tolist() for name, size in zip(("nx", "nu", "ng"), (*sizes, others), strict=True)},
    )  # fmt: skip


def _start(one: Leg, source: np.ndarray, momenta: np.ndarray, x: np.ndarray, data: np.ndarray) -> np.ndarray:
    """z of the problem's unknowns; momenta by the discrete Legendre transforms."""
    slots, count, own = one.slots, one.phase.steps, data[one.first_datum :][: len(one.data)]
    shared = np.where(slots.shared >= 0, x[slots.shared], own[2 * count :])
    stages = x[slots.q[:-1, :1] + np.arange(one.interval.stage.numel())]
    mu = np.zeros((1, one.values_function.size1_in(4)))
    mesh = own[: 2 * count].reshape(2, count).T
    minus, plus = over_columns(one.values_function, stages, x[slots.q[1:]], mesh, shared, mu)[:2]
    z = x[source]
    z[momenta] = np.vstack([minus, plus[-1:]])
    return z


def _elements(one: Leg, free: np.ndarray, at: dict, dynamics, started, places) -> list[Element]:
    """The stage and the two ends; `places`: where the rows of interval, start and end are."""
    term, count, n = one.interval, one.phase.steps, at["q"].shape[1]
    known = np.flatnonzero(one.slots.shared < 0)
    fixed = one.first_datum + 2 * count + known
    unknown, given = picked(one.shared.column, free), picked(one.shared.column, known)
    p0, q1, p1, kept = (ca.SX.sym(name, k) for name, k in zip("abcd", (n, n, n, len(free)), strict=True))
    along, at_start, at_end = places
    step = one.first_datum + np.arange(count)[:, None]
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
        term, k, lam = end_term(one.phase, one.shared, last), -int(last), at["lam"] if last else at["lam"][:0]
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
