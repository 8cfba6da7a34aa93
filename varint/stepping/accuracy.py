"""Accuracy on demand: rule and step for a wanted error, from a short pilot and a check of the whole run.

The pilot runs candidate rules over a small part of the time, every time with twice as many steps, and reads off from
the differences how many each needs; the cheapest by the number of operations is taken (never by the clock: the same
input gives the same digits). The whole run is then done twice, with steps of different size. Their difference, reduced
by what three quarters of the rule's order make of such a change of step, bounds the error; the step is refined until
the bound meets the wanted error, or the run is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.grid import checked_steps
from varint.rules import Rule, composition, gauss, lobatto
from varint.stepping.backend import interpreted_seconds, repays
from varint.stepping.course import Course, course_of, first_node, trajectory
from varint.stepping.diagnosis import frequencies
from varint.stepping.initial import LEVEL, initial_task
from varint.stepping.plan import default_rule, plan
from varint.stepping.run import Task
from varint.system import System
from varint.trajectory import Trajectory

Run = Callable[..., Course | None]  # (rule, duration, steps, save_every, tol) → what became of it; None where it failed

PILOT = 32  # the part of the time that the pilot runs
LEAST_TOL, MOST_TOL = 1e-13, 0.1
MOST_STEPS, MOST_PILOT_STEPS = 60_000_000, 40_000
TINY = np.finfo(float).tiny
FLOOR = 4e-15  # relative error that no comparison of two runs resolves
PILOT_AIM = 0.3  # of the wanted error
CAUTION = 0.75  # of the rule's order is counted on where a run is judged by a coarser one
LEAST_FINER, MUCH_FINER, PATIENCE = 1.3, 2.0, 5
NO_DIGITS = 0.01  # of the motion's size: runs that far apart say nothing but that the step is too large
MOST_RUNS = 10
RADIANS = 3.0  # of the fastest motion in a step where the pilot begins
SECULAR = 2.0  # divided by the square of the number of steps: what iterations may leave adds up to a drift


@dataclass(frozen=True)
class Candidate:
    """A rule on the work–precision front: steps it needs for the whole run, and its order as seen in the pilot."""

    rule: Rule
    steps: float
    slope: float
    work: float


def candidates(system: System, compiled: bool) -> dict[Rule, float]:
    """Rules worth a try, with the work of a step: evaluations of a compiled one, seconds of an interpreted one."""
    s = system.structure
    if s.nonholonomic or s.degenerate or s.contacts:
        return {default_rule(system): 1.0}
    if s.constraints:
        return {lobatto(k): (k - 1) ** 1.5 for k in (3, 5, 7)}
    rules = {gauss(k): 5.0 * k / min(k, 4) for k in (2, 4, 6, 8)}  # stages run side by side in vector registers
    if s.explicit:
        rules |= {r: float(len(r.kicks)) for r in (composition("blanes-moan4"), composition("kahan-li8"))}
    return rules if compiled else {rule: interpreted_seconds(system, rule) for rule in rules}


def for_tolerance(
    system: System, rule: Rule | None, *, duration: float, tol: float, u: Any, backend: str, **given: Any
) -> Trajectory:
    """The motion over `duration` with an error of about `tol` times the size of q at every node.

    Raises
    ------
    InputError
        If the wanted error is out of reach: below round-off, or the motion is chaotic and past its horizon.
    """
    if not LEAST_TOL <= tol <= MOST_TOL:
        raise InputError(
            f"tol is relative to the size of the motion, between {LEAST_TOL:g} and {MOST_TOL:g}; got {tol!r}"
        )
    began = perf_counter()
    own = plan(system, rule).rule
    start = initial_task(system, own, h=None, steps=1, duration=duration, u=u, save_every=1, **given)
    checked_steps(start.t0, start.h, 1)
    first = _first_steps(system, own, start)
    compiled = backend == "compiled" or (backend == "auto" and repays(system, own, first * PILOT))
    rules = {own: 1.0} if rule else candidates(system, compiled)
    duration = start.h

    def run(chosen: Rule, span: float, steps: int, every: int, tol: float | None) -> Course | None:
        checked_steps(start.t0, span / steps, steps)
        level = 0.0 if tol is None else tol * min(LEVEL, SECULAR / steps**2)
        return _travelled(system, chosen, start, began, backend, span / steps, steps, every, level, tol is None)

    with np.errstate(all="ignore"):  # trials with steps too large are compared with others
        best = _pilot(run, rules, duration, tol, first)
        piloted = perf_counter() - began
        few, many = (1, 2) if 2**best.rule.order * tol < NO_DIGITS / 10 else (2, 3)
        counted_on = CAUTION * best.rule.order
        spare = (many / few) ** max(1 - counted_on / best.slope, 0.0)  # the bound is larger than the error
        unit = max(math.ceil(spare * best.steps / many), 2)
        differences: list[float] = []
        for runs in range(1, MOST_RUNS):
            if many * unit > MOST_STEPS:
                break
            coarse = run(best.rule, duration, few * unit, few, tol)
            fine = coarse and run(best.rule, duration, many * unit, 1, tol)
            if not (coarse and fine):
                unit = math.ceil(2 * unit)
                continue
            motion = trajectory(fine, fine.nodes)
            size = max(float(np.abs(motion.q).max()), TINY)
            differences.append(float(np.abs(motion.q[::many] - _q(coarse)).max()) / size)
            estimate = max(differences[-1] * (few / many) ** counted_on, FLOOR)
            if estimate <= tol:
                stats = dict(motion.stats) | {
                    "tol": tol, "error_estimate": estimate, "rule": str(best.rule), "runs": 2 * runs,
                    "pilot_seconds": piloted, "seconds": perf_counter() - began,
                }  # fmt: skip
                return replace(motion, stats=MappingProxyType(stats))
            if len(differences) > 1 and NO_DIGITS > differences[-1] > differences[-2] / 2:
                break
            if len(differences) >= PATIENCE and min(differences[-PATIENCE:]) > NO_DIGITS:
                break
            finer = 1.05 * (estimate / tol) ** (1 / best.rule.order)
            unit = math.ceil(unit * (MUCH_FINER if differences[-1] > NO_DIGITS else max(finer, LEAST_FINER)))
    raise InputError(
        f"tol={tol:g} is out of reach over the duration {duration:g}: smaller steps leave runs "
        f"{min(differences, default=math.nan):.1e} apart (relative to q). The motion is chaotic and past its horizon, "
        "or round-off is larger than the wanted error: take a shorter duration or a larger tol, or give h and judge "
        "invariants and statistics"
    )


def _travelled(
    system: System,
    rule: Rule,
    start: Task,
    began: float,
    backend: str,
    h: float,
    steps: int,
    every: int,
    level: float,
    trial: bool,
) -> Course | None:
    """A run from the start with all its blocks; None where a step failed, or a trial's iteration does not contract."""
    shape = steps, *start.u.shape[1:]
    u = np.broadcast_to(start.u[:1], shape) if start.u.size else np.empty(shape)  # the faster one
    task = start._replace(h=h, steps=steps, save_every=every, u=u, nodes=len(rule.nodes), level=level)
    course = course_of(system, plan(system, rule), task, began, backend=backend)
    for block in course.blocks:
        course.nodes.append(block)
        taken_over = course.kernel is not None and (block.after is None or block.after.by_newton)
        if block.good < len(block.k) or (trial and taken_over):
            return None
    return course


def _q(course: Course) -> np.ndarray:
    """q at the nodes."""
    return np.concatenate([block.q for block in course.nodes])


def _first_steps(system: System, rule: Rule, start: Task) -> int:
    """Where the pilot begins: a power of two, about a step for `RADIANS` of the start's fastest small motion."""
    rest = Course(system, plan(system, rule), start, [first_node(start)], iter(()), None, 0.0)
    fastest = frequencies(trajectory(rest, rest.nodes)).max(initial=0.0)
    wanted = abs(start.h) / PILOT * fastest / RADIANS if math.isfinite(fastest) else 0.0
    return 2 ** max(2, math.floor(math.log2(min(max(wanted, 1.0), MOST_PILOT_STEPS / 4))))


def _pilot(run: Run, rules: dict[Rule, float], duration: float, tol: float, first: int) -> Candidate:
    part = duration / PILOT
    target = max(PILOT_AIM * tol / PILOT, 4 * FLOOR)  # errors of a regular motion grow in proportion to time
    best: Candidate | None = None
    # the likely winner first: the others are soon left
    for rule, work in sorted(rules.items(), key=lambda pair: (pair[1] / pair[0].order, -pair[0].order)):
        most = MOST_PILOT_STEPS if best is None else min(MOST_PILOT_STEPS, best.work / (PILOT * work))
        found = _measured(run, rule, work, part, target, first, most) if most >= first / 2 else None
        if found and (best is None or found.work < best.work):
            best = found
    if best is None:
        raise InputError(
            f"no rule reached {target:.1e} within {MOST_PILOT_STEPS} steps over the first {part:g} of the motion; it "
            "does not converge: take a larger tol, or give h and a rule"
        )
    return best


def _measured(
    run: Run, rule: Rule, work: float, part: float, target: float, first: int, most: float
) -> Candidate | None:
    """Steps of the whole run at which the rule's error in the pilot is the target, and its observed order there.

    None where more than `most` steps would be needed in the pilot.
    """
    steps, slope, order = first, math.nan, float(rule.order)
    before, last = None, math.nan
    while steps <= max(2 * most, 4 * first):
        course = run(rule, part, steps, steps // 4, None)
        if course is None:
            before, last = None, math.nan
        else:
            q = _q(course)
            size = max(float(np.abs(q).max()), TINY)
            if before is not None:
                change = float(np.abs(q - before).max()) / size
                if change > FLOOR and last > change:
                    slope = min(max(math.log2(last / change), 1.0), order)
                counted = slope if math.isfinite(slope) else order / 2
                error = max(change / 2**counted, FLOOR / 4)  # of the run that was just done
                needed = steps * max(error / target, 1e-3) ** (1 / counted)
                if needed > 1.5 * most and math.isfinite(last):
                    return None
                if needed <= steps and (math.isfinite(last) or change <= FLOOR) and change < NO_DIGITS:
                    return Candidate(rule, needed * PILOT, counted, needed * PILOT * work)
                last = change
            before = q
        steps *= 2
    return None
