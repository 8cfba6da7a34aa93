"""The nonlinear program handed to a solver, its progress watched and its end judged."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.assembly import Program, full_derivatives, scaled
from varint.control.problem import Problem
from varint.control.scaling import Scales, scales
from varint.control.stages import Arrangement, plain, staged
from varint.errors import InputError

# a tenth of these is what KKT conditions and rows are met to; bounds are not relaxed, since 1e-8 shows in the cost
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-12,
    "acceptable_tol": 1e-9,
    "acceptable_iter": 3,
    "constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": 3000,
}
FATROP = {"print_level": 0, "tol": 1e-11}
LOOSER = {"tol": 1e-9}  # the next attempt, from where the first one stalled: rounding may forbid more
WARM = {
    "warm_start_init_point": "yes",
    "mu_init": 1e-6,
    "warm_start_bound_push": 1e-8,
    "warm_start_bound_frac": 1e-8,
    "warm_start_slack_bound_push": 1e-8,
    "warm_start_slack_bound_frac": 1e-8,
    "warm_start_mult_bound_push": 1e-8,
}
WORDS = {
    "Infeasible_Problem_Detected": "the conditions seem to contradict each other near the last iterate: relax bounds "
    "or ends, lengthen the duration, or start from another guess",
    "Maximum_Iterations_Exceeded": 'more iterations than allowed: options={"ipopt": {"max_iter": …}} or a better guess',
    "Restoration_Failed": "no feasible point was found from this guess: try another guess, more steps, looser bounds",
    "Error_In_Step_Computation": "no step could be computed: conditions may be imposed twice, or scales differ widely",
    "Not_Enough_Degrees_Of_Freedom": "more conditions than unknowns: free an end, the duration, or add controls",
    "Invalid_Number_Detected": "values are not finite: the guess passes through a singular point of the Lagrangian",
    "Invalid_Option": "an option is unknown or its value impossible (a linear solver that is not installed?)",
    "Diverging_Iterates": "the unknowns grow without bound: bound the controls or the duration",
    "Search_Direction_Becomes_Too_Small": "no progress at the last iterate: scale the scene or start elsewhere",
    "Not_Solved": "no solution was found from this guess; Fatrop also fails where conditions imply each other, such "
    'as a conserved momentum given at both ends: solver="ipopt" copes with that',
    "User_Requested_Stop": "stopped by the user",
    "Maximum_CpuTime_Exceeded": "the time allowed is used up",
    "Maximum_WallTime_Exceeded": "the time allowed is used up",
}


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a solver returned: the point, the multipliers of f + λ·g + λ_x·x, how it ended, the way there."""

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


@dataclass(frozen=True, eq=False)
class Solver:
    """A solver built for one problem; call it with a start point."""

    problem: Problem
    name: str
    cold: tuple[ca.Function, ...]  # attempts, one after the other until one succeeds
    warm: tuple[ca.Function, ...]
    watch: _Watch
    scales: Scales
    arrangement: Arrangement

    def __call__(
        self,
        x: np.ndarray,
        multipliers: tuple[np.ndarray, np.ndarray] | None = None,
        *,
        x_low: np.ndarray | None = None,
        x_high: np.ndarray | None = None,
        p: np.ndarray | None = None,
        progress: bool | None = None,
    ) -> Outcome:
        """Solve from x, warm if multipliers (lam_x, lam_g) are given."""
        began = perf_counter()
        one, z = self.problem, self.arrangement
        lower, upper = one.x_low if x_low is None else x_low, one.x_high if x_high is None else x_high
        data = one.p if p is None else p
        sf, (sx, sg) = self.scales.f, z.scales(self.scales.x, self.scales.g)
        arguments = dict(x0=z.start(x, data) / sx, p=data)
        for side, bound, of_row in (("lb", lower, one.g_low), ("ub", upper, one.g_high)):
            arguments[side + "x"] = np.where(z.bounded, bound[z.source], {"lb": -np.inf, "ub": np.inf}[side]) / sx
            arguments[side + "g"] = np.append(of_row, 0.0)[z.row] * sg
        self.watch.g_low, self.watch.g_high, self.watch.factor = arguments["lbg"], arguments["ubg"], sf
        if multipliers is not None:
            lam_x, lam_g = np.where(z.bounded, multipliers[0][z.source], 0.0), np.append(multipliers[1], 0.0)[z.row]
            arguments |= dict(lam_x0=lam_x * sx * sf, lam_g0=lam_g / sg * sf)
        with self.watch.running(progress, self.name == "ipopt"):
            for function in self.cold if multipliers is None else self.warm:
                try:
                    found = function(**arguments)
                except RuntimeError as error:
                    raise InputError(_first_line(error, self.name)) from None
                stats, arguments["x0"] = function.stats(), found["x"]
                if stats["success"]:
                    break
        point, lam_x, lam_g = (np.array(found[name]).ravel() for name in ("x", "lam_x", "lam_g"))
        point, lam_x, lam_g = (point * sx)[z.x], (lam_x / sx)[z.x] / sf, (lam_g * sg)[z.g] / sf
        g, success = np.array(one.program.value(point, data)[1]).ravel(), bool(stats["success"])
        ux, ug = self.scales.x, self.scales.g
        return Outcome(
            x=point,
            lam_x=lam_x,
            lam_g=lam_g,
            cost=float(found["f"]) / sf,
            success=success,
            status=_status(stats.get("return_status", ""), success),
            violation=_violation(point / ux, lower / ux, upper / ux, g * ug, one.g_low * ug, one.g_high * ug),
            iterations=int(stats.get("iter_count", 0)),
            history=_history(stats, sf),
            seconds=perf_counter() - began,
            stopped=self.watch.stop,
        )


def solver(problem: Problem, x: np.ndarray, name: str = "ipopt", options: Mapping[str, Any] | None = None) -> Solver:
    """Build the solver `name` for a problem, scaled about the point x; options go to `casadi.nlpsol` as they are."""
    if not isinstance(name, str) or not ca.has_nlpsol(name):
        known = [x for x in KNOWN if ca.has_nlpsol(x)]
        raise InputError(f"unknown solver {name!r}; installed: {known}")
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f'options must be a dictionary such as {{"ipopt": {{"max_iter": 100}}}}, got {options!r}')
    conditions, chosen = int((problem.g_low == problem.g_high).sum()), int((problem.x_low < problem.x_high).sum())
    if conditions > chosen:
        raise InputError(
            f"{conditions} conditions on {chosen} unknowns cannot hold together: free an end or the duration, or take "
            'more steps, or control="nodes"'
        )
    order = staged(problem) if name == "fatrop" else plain(problem)
    units = scales(problem, x)
    program = order.program if units.natural else scaled(order.program, units.f, *order.scales(units.x, units.g))
    z, p = ca.MX.sym("x", len(order.source)), ca.MX.sym("p", len(problem.p))
    f, g = program.value(z, p)
    watch = _Watch(len(order.source), len(order.row), len(problem.p))
    built = []
    for extra in EXTRA.get(name, ({},)):
        settings = _settings(program, name, options or {}, extra, watch, order)
        try:
            built.append(ca.nlpsol("control", name, {"x": z, "p": p, "f": f, "g": g}, settings))
        except RuntimeError as error:
            raise InputError(_first_line(error, name)) from None
    attempts = ((built[0],), (built[1],)) if name == "ipopt" else (tuple(built), tuple(built))
    return Solver(problem, name, *attempts, watch, units, order)


def backend_for(name: str, backend: str) -> str:
    """Compiled kernels have no derivatives of their own: solvers that are not handed ours get interpreted ones."""
    if name in DIFFERENTIATED or backend not in ("auto", "compiled"):
        return backend
    if backend == "compiled":
        raise InputError(f'solver={name!r} differentiates the program itself; it takes backend="interpreted"')
    return "interpreted"


EXTRA: dict[str, tuple[dict[str, Any], ...]] = {"ipopt": ({}, WARM), "fatrop": ({}, LOOSER)}
DIFFERENTIATED = ("ipopt", "fatrop")  # solvers that are handed all derivatives
KNOWN = ("ipopt", "fatrop", "sqpmethod", "blocksqp", "knitro", "snopt", "worhp", "alpaqa", "sleqp", "uno", "madnlp")


def _settings(program: Program, name: str, given: Mapping[str, Any], extra: dict, watch: _Watch, order: Arrangement):
    settings: dict[str, Any] = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
    if name == "ipopt":
        settings |= dict(grad_f=program.gradient, jac_g=program.jacobian, hess_lag=program.hessian)
        settings |= {"no_nlp_grad": True, "iteration_callback": watch, "ipopt": IPOPT | extra}
    if name == "fatrop":
        settings |= {"cache": full_derivatives(program), "fatrop": FATROP | extra, **order.options}
    if name in DIFFERENTIATED:
        settings |= {"calc_lam_p": False}
    for key, value in given.items():
        nested = isinstance(value, Mapping) and isinstance(settings.get(key), dict)
        settings[key] = settings[key] | dict(value) if nested else value
    return settings


def _status(status: Any, success: bool) -> str:
    """The solver's own word; Fatrop has numbers, others nothing."""
    return status if isinstance(status, str) and status else "Solved" if success else "Not_Solved"


def _first_line(error: Exception, name: str) -> str:
    """The line of CasADi's message that says what is wrong; the rest is a dump."""
    lines = [re.sub(r"^\S*\.[ch]pp:\d+:\s*", "", x.strip()) for x in str(error).splitlines()]
    useful = [x for x in lines if x and not x.startswith(("Error in", "Error calling", "Assertion"))] or [
        "no reason given"
    ]
    return f"the solver {name!r} refused the problem or its options: {useful[0][:300]}"


def _violation(x, lower, upper, g, g_low, g_high) -> float:
    """Largest violation of bounds and rows in the solver's units; infinite where something is not finite."""
    if not (np.isfinite(x).all() and np.isfinite(g).all()):
        return float("inf")
    sides = (lower - x, x - upper, g_low - g, g - g_high)
    return float(max(max(side.max(initial=0.0), 0.0) for side in sides))


def _history(stats: Mapping[str, Any], factor: float) -> dict[str, list[float]]:
    found = stats.get("iterations") or {}
    history = {ours: [float(y) for y in found[theirs]] for ours, theirs in NAMES.items() if theirs in found}
    return history | ({"cost": [y / factor for y in history["cost"]]} if "cost" in history else {})


NAMES = {"cost": "obj", "violation": "inf_pr", "optimality": "inf_du", "barrier": "mu"}


class _Watch(ca.Callback):
    """Called by the solver after each iteration: shows progress, stops on Ctrl-C."""

    def __init__(self, unknowns: int, rows: int, data: int):
        ca.Callback.__init__(self)
        self.sizes = dict(x=unknowns, f=1, g=rows, lam_x=unknowns, lam_g=rows, lam_p=data)
        self.stop, self.bar = False, None
        self.g_low = self.g_high = np.zeros(rows)
        self.factor = 1.0
        self.construct("watch", {})

    def get_n_in(self):
        return ca.nlpsol_n_out()

    def get_n_out(self):
        return 1

    def get_name_in(self, i):
        return ca.nlpsol_out(i)

    def get_name_out(self, i):
        return "stop"

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self.sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arg):
        if self.bar is not None:
            g = np.array(arg[2]).ravel()
            off = max(np.max(self.g_low - g, initial=0.0), np.max(g - self.g_high, initial=0.0))
            self.bar.set_postfix_str(f"cost {float(arg[1]) / self.factor:.8g}, violation {off:.1e}", refresh=False)
            self.bar.update()
        return [int(self.stop)]

    def running(self, progress: bool | None, called: bool):
        return _Running(self, progress, called)


class _Running:
    """While a solver runs that calls the watch: a progress bar, and Ctrl-C as a request to stop after the iteration."""

    def __init__(self, watch: _Watch, progress: bool | None, called: bool):
        self.watch, self.progress, self.called = watch, progress if called else False, called
        self.previous: Any = None

    def __enter__(self) -> None:
        quiet = None if self.progress is None else not self.progress
        self.watch.stop = False
        from tqdm.auto import tqdm  # only here: most solves are over before a bar would show

        self.watch.bar = tqdm(
            unit="iteration", disable=quiet, delay=0 if self.progress else 1, leave=bool(self.progress)
        )
        if self.called and threading.current_thread() is threading.main_thread():
            self.previous = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, *_: Any) -> None:
        self.watch.stop = True

    def __exit__(self, *_: Any) -> None:
        if self.previous is not None:
            signal.signal(signal.SIGINT, self.previous)
        if self.watch.bar is not None:
            self.watch.bar.close()
        self.watch.bar = None
