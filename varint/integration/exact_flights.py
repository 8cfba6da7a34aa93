"""Runs for a wanted accuracy where bodies fly through uniform fields from one contact to the next.

Every rule gives the exact parabola there, whatever its steps, and impacts are located to round-off:
two runs with other nodes differ by round-off and by what impacts make of it, and that is all the
error that there is.
"""

from __future__ import annotations

import math
from functools import partial

import casadi as ca
import numpy as np

from varint.codegen.contacts import Flight
from varint.discrete.constraints import ActiveSet
from varint.integration.error_scale import below_largest, scales_of_nodes
from varint.integration.events.short_flights import ShortFlight, motion_of_flight, short_flight
from varint.integration.flight_choice import flies, flights_for
from varint.integration.plain_start import begin_at, room_of, rooms
from varint.integration.plan import Plan, plan
from varint.integration.problem import InitialValueProblem
from varint.integration.round_off import CHANCE, FAR_BELOW, parted, with_other_digits
from varint.integration.rule_choice import FEWEST, candidates, iteration_level
from varint.integration.second_looks import has_switches
from varint.integration.start import are_defined, rows_at_start
from varint.integration.steppers.uniform_field import is_uniform
from varint.integration.two_runs import FLOOR, LEFT
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.restitution import restitution_at
from varint.scene.system import System

COARSE, FINE = 2 * FEWEST, 4 * FEWEST  # steps: the last two of three runs that agree


def exact_call(
    system: System,
    rule: Rule | None,
    start: tuple[object, object, float, ParameterValues | None],
    duration: float,
    tol: float,
    began: float,
) -> Trajectory | None:
    """The motion from a start (q0, v0, t0, params), if it is of such flights and two runs agree on
    it; None where another way is to be taken.
    """
    chosen = exact_plan(system, rule)
    if chosen is None or duration <= 0:
        return None
    q0, v0, t0, params = start
    pool = rooms(system, False)
    room = pool.pop() if pool else room_of(system, False)
    try:
        c = begin_at(room, system, q0, v0, t0, params)
        if c is None:
            return None
        q, p, c = room.q.copy(), room.values[: room.n].copy(), room.c.copy()
    finally:
        pool.append(room)
    rows = rows_at_start(system, q, t0, c)
    if not (are_defined(rows) and rows[: system.structure.contacts].min() >= 0):
        return None
    restitution_at(system, c)
    level, u = iteration_level(tol, FINE), np.empty((FINE, 1, 0))
    grid = float(t0), duration / FINE, FINE, 1, u, c, len(chosen.rule.nodes)
    problem = InitialValueProblem(q, p, *grid, level=level)
    flights = flights_for(system, chosen.rule, problem, "auto")
    run = flights and short_flight(system, chosen, problem, flights, COARSE)
    if not run or not _is_exact(system, run):
        return None
    scales = below_largest(
        scales_of_nodes(system, run.found.q, np.zeros(len(q)), np.array((problem.t0,)), c),
        run.found.q,
    )
    estimate, made = _estimate(problem, run.found, scales), 2
    if FAR_BELOW * tol < estimate <= tol:  # impacts may have made more of round-off
        grown, more = parted(partial(_way_apart, system, chosen, problem, run, scales), 0.0, tol)
        estimate, made = max(estimate, grown), made + more
    if not estimate <= tol:
        return None
    told = {"tol": tol, "error_estimate": estimate, "rule": str(chosen.rule), "runs": made}
    return motion_of_flight(system, chosen, problem, run, began, told)


def _is_exact(system: System, run: ShortFlight) -> bool:
    """Whether nothing has held but what leaves the field uniform."""
    held = [part for part in run.stretches if part.active_set.holding]
    return not held or is_straight(system)


def _estimate(problem: InitialValueProblem, run: Flight, scales: np.ndarray) -> float:
    """Error of a run by how far it is from one in fewer steps."""
    floor = FLOOR * float((np.abs(run.q).max(axis=0) / scales).max(initial=1.0))
    left = LEFT * problem.level * math.sqrt(problem.steps) if run.iterations else 0.0
    return max(CHANCE * float((run.apart / scales).max()), floor, left)


def _way_apart(
    system: System,
    chosen: Plan,
    problem: InitialValueProblem,
    run: ShortFlight,
    scales: np.ndarray,
    way: int,
) -> float:
    """How far the run is from one whose start has other last digits."""
    q, p = with_other_digits(problem.q0, problem.p0, way)
    other = problem._replace(q0=q, p0=p)
    flights = flights_for(system, chosen.rule, other, "auto")
    found = flights and short_flight(system, chosen, other, flights)
    if not found:
        return math.inf
    return float((np.abs(_ends_of_steps(found) - _ends_of_steps(run)) / scales).max())


def _ends_of_steps(run: ShortFlight) -> np.ndarray:
    """Coordinates at the nodes of the grid: behind them come those of impacts in the next step."""
    k = run.found.k
    first = np.ones(len(k), dtype=bool)
    np.not_equal(k[1:], k[:-1], out=first[1:])
    return run.found.q[first]


@per_scene
def exact_plan(system: System, rule: Rule | None) -> Plan | None:
    """By the rule, or the only one that there is; None where flights are not sure to be exact."""
    s = system.structure
    if not flies(system) or s.constraints or s.nonholonomic or has_switches(system):
        return None
    chosen = plan(system, rule)
    several = rule is None and len(candidates(system, False)) > 1
    if several or not chosen.rule.points or not is_uniform(ActiveSet(()).scene(system)):
        return None
    return chosen if is_straight(system) or bounces(system) else None


@per_scene
def is_straight(system: System) -> bool:
    """Whether gaps are linear: what they hold flies on through a uniform field, too."""
    at = ca.vertcat(system.q, system.t)
    return not ca.depends_on(ca.jacobian(system.contact, at), at)


def bounces(system: System) -> bool:
    """Whether every contact may: those that do not hold what comes to them."""
    return not any(x.is_zero() for x in ca.vertsplit(system.bounce))
