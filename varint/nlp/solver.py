"""The nonlinear program handed to a solver, its progress watched and its end judged."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.nlp.arrangement import Arrangement, Scales
from varint.nlp.options import DIFFERENTIATED, EXTRA, KNOWN, solver_settings
from varint.nlp.program import NonlinearProgram, scale_program
from varint.nlp.watch import Watch
from varint.numerics.arrays import call

ITERATING = "Iterating"
INTERRUPTED = "NonIpopt_Exception_Thrown"  # Ctrl-C where no watch takes it as a request


@dataclass(frozen=True, eq=False)
class SolverResult:
    """What a solver returned: the program as it was solved, the point, the multipliers of f + λ·g +
    λ_x·x, how it ended, the way there.
    """

    nlp: NonlinearProgram
    x: np.ndarray
    lam_x: np.ndarray
    lam_g: np.ndarray
    cost: float
    success: bool
    status: str
    violation: float
    iterations: int
    history: dict[str, list[float]]
    seconds: float
    stopped: bool
    gave_up: bool = False


@dataclass(frozen=True, eq=False)
class Solver:
    """A solver built for one program; call it with a start point.

    Attributes
    ----------
    nlp : NonlinearProgram
    name : str
    attempts : callable
        (from multipliers too, watched) → Functions to try one after the other until one succeeds;
        built when they are first asked for.
    watch : Watch
    scales : Scales
    order : Arrangement
    """

    nlp: NonlinearProgram
    name: str
    attempts: Callable[[bool, bool], tuple[ca.Function, ...]]
    watch: Watch
    scales: Scales
    order: Arrangement

    def __call__(
        self,
        x: np.ndarray,
        multipliers: tuple[np.ndarray, np.ndarray] | None = None,
        *,
        x_low: np.ndarray | None = None,
        x_high: np.ndarray | None = None,
        g_low: np.ndarray | None = None,
        g_high: np.ndarray | None = None,
        p: np.ndarray | None = None,
        progress: bool | None = None,
        patience: float = np.inf,
        callback: Callable[[SolverResult], Any] | None = None,
    ) -> SolverResult:
        """Solve from x, warm if multipliers (lam_x, lam_g) are given, with other bounds or
        constants where given; give up when for so many iterations the rows come no closer;
        `callback` gets every iterate and stops the solver by returning something true (Ipopt).
        """
        began, own = perf_counter(), self.nlp
        nlp = replace(
            own,
            x_low=own.x_low if x_low is None else x_low,
            x_high=own.x_high if x_high is None else x_high,
            g_low=own.g_low if g_low is None else g_low,
            g_high=own.g_high if g_high is None else g_high,
            p=own.p if p is None else p,
        )
        self.watch.patience = patience
        self.watch.told = None if callback is None else _teller(self, nlp, callback)
        arguments = _to_solver(self, nlp, x, multipliers)
        cold = multipliers is None
        watched = (
            cold or progress is not False or callback is not None or bool(np.isfinite(patience))
        )
        attempts = self.attempts(not cold, watched)
        found, stats = _solve(self, attempts, arguments, progress, watched)
        return _from_solver(self, nlp, found, stats, perf_counter() - began)


def _to_solver(
    solver: Solver,
    nlp: NonlinearProgram,
    x: np.ndarray,
    multipliers: tuple[np.ndarray, np.ndarray] | None,
) -> dict[str, np.ndarray]:
    """Start, bounds and multipliers in the solver's order and units."""
    z, sf = solver.order, solver.scales.f
    sx, sg = z.scales(solver.scales.x, solver.scales.g)
    low, high = (
        np.where(z.bounded, side[z.source], free)
        for side, free in ((nlp.x_low, -np.inf), (nlp.x_high, np.inf))
    )
    arguments = {"x0": z.start(x, nlp.p) / sx, "p": nlp.p, "lbx": low / sx, "ubx": high / sx}
    arguments |= {
        side: np.append(rows, 0.0)[z.row] * sg
        for side, rows in (("lbg", nlp.g_low), ("ubg", nlp.g_high))
    }
    if multipliers is not None:
        lam_x, lam_g = (
            np.where(z.bounded, multipliers[0][z.source], 0.0),
            np.append(multipliers[1], 0.0)[z.row],
        )
        arguments |= {"lam_x0": lam_x * sx * sf, "lam_g0": lam_g / sg * sf}
    return arguments


def _solve(
    solver: Solver,
    attempts: tuple[ca.Function, ...],
    arguments: dict[str, np.ndarray],
    progress: bool | None,
    watched: bool,
) -> tuple[dict[str, ca.DM], dict[str, Any]]:
    """What the first attempt that succeeds returns, or the last one, and its statistics."""
    watch = solver.watch
    watch.g_low, watch.g_high, watch.factor = arguments["lbg"], arguments["ubg"], solver.scales.f
    with watch.running(progress, watched and solver.name == "ipopt"):
        for function in attempts:
            try:
                found = function(**arguments)
            except RuntimeError as error:
                raise InputError(_first_line(error, solver.name)) from None
            stats, arguments["x0"] = function.stats(), found["x"]
            if not watched and stats.get("return_status") == INTERRUPTED:
                raise KeyboardInterrupt
            if stats["success"]:
                break
    return found, stats


def _teller(
    solver: Solver, nlp: NonlinearProgram, callback: Callable[[SolverResult], Any]
) -> Callable[[int, dict[str, ca.DM]], Any]:
    """What a watch calls: the callback with every iterate as a result."""

    def tell(iteration: int, iterate: dict[str, ca.DM]) -> Any:
        stats = {"success": False, "return_status": ITERATING, "iter_count": iteration}
        return callback(_from_solver(solver, nlp, iterate, stats, 0.0))

    return tell


def _from_solver(
    solver: Solver,
    nlp: NonlinearProgram,
    found: dict[str, ca.DM],
    stats: dict[str, Any],
    seconds: float,
) -> SolverResult:
    """The point and the multipliers in the program's own order and units, and its largest
    violation there.
    """
    z, sf, ux, ug = solver.order, solver.scales.f, solver.scales.x, solver.scales.g
    sx, sg = z.scales(ux, ug)
    point, lam_x, lam_g = (found[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
    x = (point * sx)[z.x]
    g, success = call(nlp.program.value, x, nlp.p)[1], bool(stats["success"])
    return SolverResult(
        nlp=nlp,
        x=x,
        lam_x=(lam_x / sx)[z.x] / sf,
        lam_g=(lam_g * sg)[z.g] / sf,
        cost=float(found["f"]) / sf,
        success=success,
        status=_status(stats.get("return_status", ""), success),
        violation=_violation(
            x / ux, nlp.x_low / ux, nlp.x_high / ux, g * ug, nlp.g_low * ug, nlp.g_high * ug
        ),
        iterations=int(stats.get("iter_count", 0)),
        history=_history(stats, sf),
        seconds=seconds,
        stopped=solver.watch.stop,
        gave_up=solver.watch.gave_up,
    )


def build_solver(
    nlp: NonlinearProgram,
    name: str,
    options: Mapping[str, Any] | None,
    scales: Scales,
    order: Arrangement,
) -> Solver:
    """Build the solver `name` for a program in given units and order; options go to
    `casadi.nlpsol` as they are.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InputError(
            f'options must be a dictionary such as {{"ipopt": {{"max_iter": 100}}}}, got '
            f"{options!r}"
        )
    conditions, chosen = int((nlp.g_low == nlp.g_high).sum()), int((nlp.x_low < nlp.x_high).sum())
    if conditions > chosen:
        raise InputError(
            f"{conditions} conditions on {chosen} unknowns cannot hold together: free an end or "
            "the duration, or take "
            'more steps, or control="nodes"'
        )
    program = order.program
    if not scales.natural:
        program = scale_program(program, scales.f, *order.scales(scales.x, scales.g))
    z, p = ca.MX.sym("x", len(order.source)), ca.MX.sym("p", len(nlp.p))
    f, g = program.value(z, p)
    watch = Watch(len(order.source), len(order.row), len(nlp.p))

    @cache
    def built(extra: int, watched: bool) -> ca.Function:
        more = EXTRA.get(name, ({},))[extra]
        seen = watch if watched else None
        settings = solver_settings(program, name, options or {}, more, seen, order)
        try:
            return ca.nlpsol("nlp", name, {"x": z, "p": p, "f": f, "g": g}, settings)
        except RuntimeError as error:
            raise InputError(_first_line(error, name)) from None

    def attempts(warm: bool, watched: bool) -> tuple[ca.Function, ...]:
        if name == "ipopt":
            # handing an iterate to Python takes as long as a step of a small program: warm solves
            # that nobody watches are spared it
            return (built(1, watched),) if warm else (built(0, True),)
        return tuple(built(extra, True) for extra in range(len(EXTRA.get(name, ({},)))))

    attempts(False, True)  # what the solver refuses is refused at once
    return Solver(nlp, name, attempts, watch, scales, order)


def require_solver(name: Any) -> None:
    """Refuse a solver that is not installed."""
    if not isinstance(name, str) or not ca.has_nlpsol(name):
        known = [x for x in KNOWN if ca.has_nlpsol(x)]
        raise InputError(f"unknown solver {name!r}; installed: {known}")


def choose_backend(name: str, backend: str) -> str:
    """Compiled kernels have no derivatives of their own: solvers that are not handed ours get
    interpreted ones.
    """
    if name in DIFFERENTIATED or backend not in ("auto", "compiled"):
        return backend
    if backend == "compiled":
        raise InputError(
            f'solver={name!r} differentiates the program itself; it takes backend="interpreted"'
        )
    return "interpreted"


def _status(status: Any, success: bool) -> str:
    """The solver's own word; Fatrop has numbers, others nothing."""
    return status if isinstance(status, str) and status else "Solved" if success else "Not_Solved"


def _first_line(error: Exception, name: str) -> str:
    """The line of CasADi's message that says what is wrong; the rest is a dump."""
    lines = [re.sub(r"^\S*\.[ch]pp:\d+:\s*", "", x.strip()) for x in str(error).splitlines()]
    useful = [
        x for x in lines if x and not x.startswith(("Error in", "Error calling", "Assertion"))
    ] or ["no reason given"]
    return f"the solver {name!r} refused the problem or its options: {useful[0][:300]}"


def _violation(x, lower, upper, g, g_low, g_high) -> float:
    """Largest violation of bounds and rows in the solver's units; infinite where something is
    not finite.
    """
    if not (np.isfinite(x).all() and np.isfinite(g).all()):
        return float("inf")
    sides = (lower - x, x - upper, g_low - g, g - g_high)
    return float(max(max(side.max(initial=0.0), 0.0) for side in sides))


def _history(stats: Mapping[str, Any], factor: float) -> dict[str, list[float]]:
    found = stats.get("iterations") or {}
    history = {
        ours: [float(y) for y in found[theirs]] for ours, theirs in NAMES.items() if theirs in found
    }
    return history | ({"cost": [y / factor for y in history["cost"]]} if "cost" in history else {})


NAMES = {"cost": "obj", "violation": "inf_pr", "optimality": "inf_du", "barrier": "mu"}
NAMES |= {"regularisation": "regularization_size"}
