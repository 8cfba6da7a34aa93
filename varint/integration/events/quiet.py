"""Blocks of steps of a scene with contacts in which nothing happens, and where that ends."""

from __future__ import annotations

import numpy as np

from varint.discrete.constraints import multipliers_along
from varint.integration.cost import steps_at_once
from varint.integration.events.clearance import Nodes, may_close
from varint.integration.events.contacts import View, first_contact, least_pull, rates_function
from varint.integration.events.impacts import PULL, TOUCH
from varint.integration.interpreted_loop import (
    advance,
    count_good_nodes,
    iterations_at,
    next_block,
    residual_of,
    rollout,
)
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import state_layout
from varint.numerics.arrays import call, over_columns
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.system import System

FIRST_LOOK = 10  # steps after an event


def quiet_block(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState, here: View
) -> tuple[NodeBlock, bool]:
    """Steps from a node of the grid on in which no contact closes or lets go, and whether one
    does in the next.
    """
    assert at.active_set is not None and at.t is not None
    n, scene = system.structure.n, at.active_set.scene(system)
    count, _ = next_block(at.k, problem.steps, 1, at.largest, steps_at_once(scene, rule))
    k = at.k + np.arange(1, count + 1)
    t = problem.t0 + problem.h * np.append(at.k, k)
    arguments = (
        problem.controls(at.k, count),
        t[:-1].copy(),
        np.array([problem.h]),
        problem.c,
        at.scale,
    )
    states = call(rollout(scene, rule, count, 1), at.x, *arguments)[0].reshape(count, -1)
    good = int(count_good_nodes(states))
    quiet = first_event_between(system, rule, problem, at, here, states[:good], t[: good + 1])
    happens = quiet < good
    after = advance(at, states[:quiet], problem.h, 1)
    largest = FIRST_LOOK if happens else after.largest
    # sizes say which gaps touch, so they do not depend on how many steps a block has
    after = after._replace(t=float(t[quiet]), largest=largest, scale=at.scale)
    kept = quiet if happens else min(quiet + 1, count)
    failed = 0.0 if happens or good == count else residual_of(states[good])
    worst = float(states[quiet - 1, -1]) if quiet else 0.0
    count_of = int(iterations_at(at.x, states[:quiet])[-1]) if quiet else 0
    layout = state_layout(n)
    q, p = states[:quiet, layout.q], states[:quiet, layout.p]
    return NodeBlock(
        k[:kept], q, p, worst, quiet, failed, t[1 : quiet + 1], at.active_set, (), count_of, after
    ), happens


def first_event_between(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    at: RunState,
    here: View,
    states: np.ndarray,
    t: np.ndarray,
) -> int:
    """Number of nodes before the first step in which a contact closes or lets go."""
    assert at.active_set is not None
    if not len(states):
        return 0
    n, active_set = system.structure.n, at.active_set
    x = np.vstack([at.x, states])
    layout = state_layout(n)
    q, p = np.ascontiguousarray(x[:, layout.q]), np.ascontiguousarray(x[:, layout.p])
    v, gap, rate = over_columns(
        rates_function(system, active_set.rows, active_set.contacts), q, p, t[:, None], problem.c
    )
    close = TOUCH * here.sizes(at.x[:n], abs(problem.h) * at.scale[:n])
    happens = ~np.isfinite(gap[1:] + rate[1:]).all(axis=1)  # looked at more closely
    for i in set(range(gap.shape[1])) - set(active_set.holding):
        happens |= (gap[1:, i] < -close[i]) | ((gap[1:, i] < 0) & (problem.h * rate[1:, i] < 0))
    before = int(np.argmax(happens)) if happens.any() else len(states)
    whole = slice(before + 1)
    nodes = Nodes(x[whole], v[whole], gap[whole], rate[whole], t[whole], at.k)
    if before:
        happens[:before] |= may_close(system, rule, problem, at, nodes, close)
    if active_set.holding:
        u = (
            problem.u[at.k : at.k + len(states), -1]
            if problem.u.shape[1] == 1
            else controls_at_ends(rule, problem, at.k, len(states))
        )
        lam = multipliers_along(system, active_set, q[1:], v[1:], u, t[1:], problem.c)
        held = lam[:, [first_contact(system) + i for i in active_set.holding]]
        nothing = least_pull(system, active_set, q[1:], v[1:], u, t[1:], problem.c)
        weight = np.maximum(np.abs(lam).max(axis=1, initial=0.0), nothing)
        happens |= (held < -PULL * weight[:, None]).any(axis=1)
    return int(np.argmax(happens)) if happens.any() else len(states)


def controls_at_ends(rule: Rule, problem: InitialValueProblem, k: int, count: int) -> np.ndarray:
    """Controls at the ends of steps."""
    return lagrange_values(np.array(rule.nodes), np.ones(1))[0] @ problem.u[k : k + count]
