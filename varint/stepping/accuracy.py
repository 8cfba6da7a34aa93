"""Accuracy on demand: rule and step for a wanted error, from a short pilot and a check of the whole run.

The pilot runs candidate rules over a small part of the time against a tight run and reads off how many steps each
needs; the cheapest by the number of evaluations is taken (never by the clock: the same input gives the same digits).
The whole run is then done with steps h and 3h/2. Their difference, reduced by what half the rule's order makes of such
a change of step, bounds the error; the step is refined until the bound meets the wanted error, or the run is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from types import MappingProxyType

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.rules import Rule, composition, gauss, lobatto
from varint.stepping.plan import default_rule
from varint.system import System
from varint.trajectory import Trajectory

Run = Callable[..., Trajectory]  # (rule, duration, steps, save_every, tol) → trajectory

PILOT = 32  # the part of the time that the pilot runs
LEAST_TOL, MOST_TOL = 1e-13, 0.1
MOST_STEPS, MOST_PILOT_STEPS = 60_000_000, 40_000
FLOOR = 4e-15  # relative error that no comparison of two runs resolves
PILOT_AIM = 0.3  # of the wanted error
CAUTION = 0.5  # of the rule's order is counted on where a run is judged by a coarser one
LEAST_FINER, MUCH_FINER, PATIENCE = 1.3, 2.0, 5
NO_DIGITS = 0.01  # of the motion's size: runs that far apart say nothing but that the step is too large
MOST_RUNS = 10


@dataclass(frozen=True)
class Candidate:
    """A rule on the work–precision front: steps it needs for the pilot, and its order as seen there."""

    rule: Rule
    steps: float
    slope: float
    work: float


def candidates(system: System) -> dict[Rule, float]:
    """Rules worth a try, with the work of a step in evaluations of the right-hand side."""
    s = system.structure
    if s.nonholonomic or s.degenerate or s.contacts:
        return {default_rule(system): 1.0}
    if s.constraints:
        return {lobatto(k): (k - 1) ** 1.5 for k in (3, 5, 7)}
    rules = {gauss(k): 5.0 * k / min(k, 4) for k in (2, 4, 6, 8)}  # stages run side by side in vector registers
    if s.explicit:
        rules |= {r: float(len(r.kicks)) for r in (composition("blanes-moan4"), composition("kahan-li8"))}
    return rules


def for_tolerance(run: Run, system: System, rule: Rule | None, duration: float, tol: float) -> Trajectory:
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
    best = _pilot(run, {rule: 1.0} if rule else candidates(system), system, duration, tol)
    piloted = perf_counter() - began
    unit = max(math.ceil(best.steps / 3), 2)  # 3 units of fine steps against 2 of coarse ones: common nodes
    gain = 1.5 ** (-CAUTION * best.rule.order)
    differences: list[float] = []
    for runs in range(1, MOST_RUNS):
        if 3 * unit > MOST_STEPS:
            break
        try:
            coarse = run(best.rule, duration, 2 * unit, 2, tol)
            fine = run(best.rule, duration, 3 * unit, 1, tol)
        except ConvergenceError:
            unit = math.ceil(2 * unit)
            continue
        size = max(float(np.abs(fine.q).max()), np.finfo(float).tiny)
        differences.append(float(np.abs(fine.q[::3] - coarse.q).max()) / size)
        estimate = max(differences[-1] * gain, FLOOR)
        if estimate <= tol:
            stats = dict(fine.stats) | {
                "tol": tol, "error_estimate": estimate, "rule": str(best.rule), "runs": 2 * runs,
                "pilot_seconds": piloted, "seconds": perf_counter() - began,
            }  # fmt: skip
            return replace(fine, stats=MappingProxyType(stats))
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


def _pilot(run: Run, rules: dict[Rule, float], system: System, duration: float, tol: float) -> Candidate:
    part = duration / PILOT
    target = max(PILOT_AIM * tol / PILOT, 4 * FLOOR)  # errors of a regular motion grow in proportion to time
    tight, size = _tight(run, rules, part, target)
    found = [c for c in (_measured(run, rule, work, part, tight, size, target) for rule, work in rules.items()) if c]
    if not found:
        raise InputError(
            f"no rule reached {target:.1e} within {MOST_PILOT_STEPS} steps over the first {part:g} of the motion; take "
            "a larger tol, or give h and a rule"
        )
    return min(found, key=lambda c: c.work)


def _tight(run: Run, rules: dict[Rule, float], part: float, target: float) -> tuple[np.ndarray, float]:
    """q at quarters of the pilot by the rule of highest order, doubled until nothing changes."""
    rule = max(rules, key=lambda r: r.order)
    before, last, steps = None, math.inf, 8
    while steps <= MOST_PILOT_STEPS:
        try:
            q = run(rule, part, steps, steps // 4, None).q
        except ConvergenceError:
            steps *= 2
            continue
        size = max(float(np.abs(q).max()), np.finfo(float).tiny)
        if before is not None:
            change = float(np.abs(q - before).max()) / size
            settled = change <= target / 3 and change >= last / 2  # at round-off
            if settled or change <= max(target / (30 if rule.order > 2 else 3), FLOOR):
                return q, size
            last = change
        before, steps = q, 2 * steps
    raise InputError(
        f"the first {part:g} of the motion does not converge within {MOST_PILOT_STEPS} steps to {target:.1e}; take a "
        "shorter duration or a larger tol, or give h and a rule"
    )


def _measured(
    run: Run, rule: Rule, work: float, part: float, tight: np.ndarray, size: float, target: float
) -> Candidate | None:
    """Steps of the whole run at which the rule's error in the pilot is the target, and its observed order there."""
    steps, last, slope = 4, math.nan, float(rule.order)
    while steps <= MOST_PILOT_STEPS:
        try:
            error = float(np.abs(run(rule, part, steps, steps // 4, None).q - tight).max()) / size
        except ConvergenceError:
            error = math.inf
        if math.isfinite(error) and math.isfinite(last) and error > FLOOR:
            slope = math.log2(last / error)
        if error <= target:
            slope = min(max(slope, 1.0), float(rule.order))
            needed = steps * max(error / target, 1e-3) ** (1 / slope) if math.isfinite(last) else steps
            return Candidate(rule, needed * PILOT, slope, needed * work)
        last = error
        steps *= 2
    return None
