"""Mesh refinement: solve with s and s + 1 stages, compare, then split the steps that differ or keep
the higher order; non-holonomic rows have one order only, and half the steps stand in for it.

The difference of the two costs estimates the error of the cheaper one; the result is the better
one. Where the two controls differ in a few steps only (a switch, the entry to a bound), those steps
are split; where they differ everywhere the path is smooth, and the order rises.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, overload

import numpy as np

from varint.control.optimal import assess, solve_phases
from varint.control.solution import ControlSolution, Origin
from varint.errors import InputError, SolverError, parsed_or_refused
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.inputs import number, positive_integer

MARKED = 0.3  # of the largest difference: such steps are split
SMOOTH = 0.5  # of the steps marked: the order rises instead
MOST_STAGES = 8
MOST_STEPS = 10_000  # of a phase whose order cannot rise
SAMPLES = np.linspace(0.05, 0.95, 7)  # places in a step where the two solutions are compared


@overload
def refine(
    motion: Trajectory,
    tol: float = 1e-8,
    *,
    rounds: int = 20,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> Trajectory: ...
@overload
def refine(
    motion: Sequence[Trajectory],
    tol: float = 1e-8,
    *,
    rounds: int = 20,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> list[Trajectory]: ...


def refine(
    motion: Trajectory | Sequence[Trajectory],
    tol: float = 1e-8,
    *,
    rounds: int = 20,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> Trajectory | list[Trajectory]:
    """The same optimal control to a tolerance in its cost, by steps of different size and by higher
    order.

    Parameters
    ----------
    motion : Trajectory or list of Trajectory
        From `optimal_control`, or all phases from `optimal_phases`: their meshes are refined
        together.
    tol : float
        Wanted error of the cost, relative to it (absolute where the cost is below 1e-8).
    rounds : int
        Most rounds; each solves twice, starting warm.
    solver, options, backend
        As in `optimal_control`.

    Returns
    -------
    Trajectory or list of Trajectory
        ``stats["error"]`` is the estimated error of the cost, ``stats["rounds"]`` lists (rule,
        steps, cost, error).

    Raises
    ------
    SolverError
        If the tolerance is not reached; the best solution is attached as ``iterate``.

    Examples
    --------
    >>> import casadi as ca, numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> torque = ca.SX.sym("torque")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=torque, control=torque)
    >>> rough = vi.optimal_control(
    ...     pendulum, vi.gauss(2), duration=3, steps=15, cost=torque**2, start=dict(q=[0], v=[0]),
    ...     end=dict(q=[np.pi], v=[0]))
    >>> round(vi.refine(rough, 1e-8).cost, 6)
    36.640289
    """
    if not number("tol", tol) > 0:
        raise InputError(f"tol must be a positive number, got {tol!r}")
    rounds, single = positive_integer("rounds", rounds), isinstance(motion, Trajectory)
    low = _solved_together(_motions(motion))
    t0, links = float(low[0].t[0]), _origin(low[0]).problem.given_links
    history: list[tuple[str, int, float, float]] = []

    def solve(
        rules: Sequence[Rule], meshes: Sequence[np.ndarray], guesses: Sequence[Trajectory]
    ) -> list[Trajectory]:
        phases = [
            replace(_origin(guess).phase.given, rule=rule, mesh=mesh, steps=0, guess=guess)
            for rule, mesh, guess in zip(rules, meshes, guesses, strict=True)
        ]
        return solve_phases(phases, links, t0, solver, options, backend, None)

    for _ in range(rounds):
        rules, meshes = [x.rule for x in low], [_solution(x).mesh for x in low]
        higher, finer = zip(*map(_next, low), strict=True)
        if max(map(len, finer)) > MOST_STEPS:
            break
        high = solve(higher, finer, low)
        cost, before = _solution(high[0]).total_cost, _solution(low[0]).total_cost
        wanted = tol * (abs(cost) if abs(cost) > SMALL else 1.0)
        different = [
            _differences(_solution(x), _solution(y)) for x, y in zip(low, high, strict=True)
        ]
        marked = [x >= MARKED * max(y.max() for y in different) for x in different]
        smooth = bool(np.concatenate(marked).mean() > SMOOTH)
        error, best = abs(cost - before), high
        kinks = any(_solution(x).active for x in high) or not smooth
        # near a kink both rules can err alike: ask a mesh of half the steps
        if error <= wanted and kinks:
            best = solve(higher, [_bisect(x) for x in finer], high)
            error = max(error, abs(_solution(best[0]).total_cost - cost))
        words = ", ".join(dict.fromkeys(map(str, rules)))
        history.append((words, sum(len(x) - 1 for x in meshes), before, error))
        if error <= wanted:
            about = {"error": error, "rounds": tuple(history)}
            found = [replace(x, stats=MappingProxyType({**x.stats, **about})) for x in best]
            found = assess(found, stacklevel=3)
            return found[0] if single else found
        if smooth and max(len(x.nodes) for x in higher) < MOST_STAGES:
            low = high
        else:
            low = solve(rules, [_bisect(x, y) for x, y in zip(meshes, marked, strict=True)], high)
    known = history[-1][3] if history else np.inf
    raise SolverError(
        f"after {len(history)} rounds the cost is known to {known:.1e} only, wanted {tol:.1e} "
        "relative; more rounds, or phases where the controls switch",
        status="Tolerance_Not_Reached",
        iterate=low[0] if single else low,
    )


SMALL = 1e-8  # a cost below this is compared as it is


def _motions(given: Trajectory | Sequence[Trajectory]) -> list[Trajectory]:
    if isinstance(given, Trajectory):
        return [given]
    words = f"refine takes a Trajectory or all those of optimal_phases, got {given!r}"
    motions = parsed_or_refused(lambda: list(given), lambda: words)
    if not all(isinstance(motion, Trajectory) for motion in motions):
        raise InputError(words)
    return motions


def _solution(motion: Trajectory) -> ControlSolution:
    if not isinstance(motion.solution, ControlSolution):
        raise InputError("refine() takes a trajectory from optimal_control")
    return motion.solution


def _origin(motion: Trajectory) -> Origin:
    origin = _solution(motion).origin
    if origin is None:
        raise InputError(
            "this motion was loaded from a file, which does not hold its problem; solve it with "
            "guess=motion"
        )
    return origin


def _solved_together(motions: list[Trajectory]) -> list[Trajectory]:
    """The phases of one problem, in its order."""
    origins = [_origin(x) for x in motions]
    wanted = origins[0].problem.phases if origins else []
    if not origins or [x.transcription for x in origins] != wanted:
        raise InputError(
            f"refine() takes one trajectory, or all {len(wanted)} phases that optimal_phases "
            f"returned, in their order; got {len(motions)}"
        )
    return motions


def _next(motion: Trajectory) -> tuple[Rule, np.ndarray]:
    """The rule of the same family with one stage more; non-holonomic rows have one order only: half
    the steps.
    """
    rule, mesh = motion.rule, _solution(motion).mesh
    if motion.system.structure.nonholonomic:
        return rule, _bisect(mesh)
    stages = len(rule.nodes) + 1
    return lobatto(stages) if rule.points == rule.nodes else gauss(stages), mesh


def _bisect(mesh: np.ndarray, steps: np.ndarray | slice = slice(None)) -> np.ndarray:
    """The mesh with some (all) steps halved."""
    return np.sort(np.concatenate([mesh, ((mesh[:-1] + mesh[1:]) / 2)[steps]]))


def _differences(low: ControlSolution, high: ControlSolution) -> np.ndarray:
    """How much controls and path of the two solutions differ in every step, relative to their
    ranges, (N,).
    """
    mesh = low.mesh
    at = (mesh[:-1, None] + np.diff(mesh)[:, None] * SAMPLES).ravel()
    total = np.zeros(len(mesh) - 1)
    for a, b in ((low.q, high.q), (low.u, high.u)):
        if not b.values.size:
            continue
        coarse, fine = a(at), b(at)
        extent = np.maximum(np.ptp(fine, axis=0), np.abs(fine).max(axis=0) * 1e-3) + 1e-300
        gap = (np.abs(coarse - fine) / extent).max(axis=1).reshape(-1, len(SAMPLES)).max(axis=1)
        total = np.maximum(total, gap)
    return total * np.diff(mesh)
