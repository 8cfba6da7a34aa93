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

from varint.assembly import Program, scaled
from varint.control.problem import Problem
from varint.control.scaling import Scales, scales
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
    history: dict[str, list[float]]
    seconds: float
    stopped: bool


@dataclass(frozen=True, eq=False)
class Solver:
    """A solver built for one problem; call it with a start point."""

    problem: Problem
    name: str
    cold: ca.Function
    warm: ca.Function
    watch: _Watch
    scales: Scales

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
        one = self.problem
        lower, upper = one.x_low if x_low is None else x_low, one.x_high if x_high is None else x_high
        data = one.p if p is None else p
        function = self.cold if multipliers is None else self.warm
        sx, sf, sg = self.scales.x, self.scales.f, self.scales.g
        arguments = dict(x0=x / sx, p=data, lbx=lower / sx, ubx=upper / sx, lbg=one.g_low * sg, ubg=one.g_high * sg)
        self.watch.g_low, self.watch.g_high, self.watch.factor = arguments["lbg"], arguments["ubg"], sf
        if multipliers is not None:
            arguments |= dict(lam_x0=multipliers[0] * sx * sf, lam_g0=multipliers[1] / sg * sf)
        with self.watch.running(progress):
            try:
                found = function(**arguments)
            except RuntimeError as error:
                raise InputError(_first_line(error, self.name)) from None
        stats = function.stats()
        point = np.array(found["x"]).ravel() * sx
        g = np.array(one.program.value(point, data)[1]).ravel()
        return Outcome(
            x=point,
            lam_x=np.array(found["lam_x"]).ravel() / (sx * sf),
            lam_g=np.array(found["lam_g"]).ravel() * sg / sf,
            cost=float(found["f"]) / sf,
            success=bool(stats["success"]),
            status=str(stats.get("return_status", "")) or ("Solved" if stats["success"] else "Failed"),
            violation=_violation(point / sx, lower / sx, upper / sx, g * sg, one.g_low * sg, one.g_high * sg),
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
        raise InputError(f"options must be a dictionary such as dict(ipopt=dict(max_iter=100)), got {options!r}")
    units = scales(problem, x)
    program = problem.program if units.natural else scaled(problem.program, units.x, units.f, units.g)
    z, p = ca.MX.sym("x", problem.unknowns), ca.MX.sym("p", len(problem.p))
    f, g = program.value(z, p)
    watch = _Watch(problem.unknowns, len(problem.g_low), len(problem.p))
    built = []
    for extra in ({}, WARM):
        settings = _settings(program, name, options or {}, extra, watch)
        try:
            built.append(ca.nlpsol("control", name, {"x": z, "p": p, "f": f, "g": g}, settings))
        except RuntimeError as error:
            raise InputError(_first_line(error, name)) from None
        if name != "ipopt":
            built *= 2
            break
    return Solver(problem, name, built[0], built[1], watch, units)


KNOWN = ("ipopt", "fatrop", "sqpmethod", "blocksqp", "knitro", "snopt", "worhp", "alpaqa", "sleqp", "uno", "madnlp")


def _settings(program: Program, name: str, given: Mapping[str, Any], extra: dict, watch: _Watch) -> dict[str, Any]:
    settings: dict[str, Any] = {"print_time": False, "error_on_fail": False}
    if name == "ipopt":
        settings |= dict(grad_f=program.gradient, jac_g=program.jacobian, hess_lag=program.hessian)
        settings |= {"no_nlp_grad": True, "calc_lam_p": False, "iteration_callback": watch, "ipopt": IPOPT | extra}
    for key, value in given.items():
        nested = isinstance(value, Mapping) and isinstance(settings.get(key), dict)
        settings[key] = settings[key] | dict(value) if nested else value
    return settings


def _first_line(error: Exception, name: str) -> str:
    """The line of CasADi's message that says what is wrong; the rest is a dump."""
    lines = [re.sub(r"^\S*\.[ch]pp:\d+:\s*", "", x.strip()) for x in str(error).splitlines()]
    useful = [x for x in lines if x and not x.startswith(("Error in", "Assertion"))] or ["no reason given"]
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

    def running(self, progress: bool | None):
        return _Running(self, progress)


class _Running:
    """While a solver runs: a progress bar, and Ctrl-C as a request to stop after the iteration."""

    def __init__(self, watch: _Watch, progress: bool | None):
        self.watch, self.progress = watch, progress
        self.previous: Any = None

    def __enter__(self) -> None:
        quiet = None if self.progress is None else not self.progress
        self.watch.stop = False
        from tqdm.auto import tqdm  # only here: most solves are over before a bar would show

        self.watch.bar = tqdm(
            unit="iteration", disable=quiet, delay=0 if self.progress else 1, leave=bool(self.progress)
        )
        if threading.current_thread() is threading.main_thread():
            self.previous = signal.signal(signal.SIGINT, self._ask)

    def _ask(self, *_: Any) -> None:
        self.watch.stop = True

    def __exit__(self, *_: Any) -> None:
        if self.previous is not None:
            signal.signal(signal.SIGINT, self.previous)
        if self.watch.bar is not None:
            self.watch.bar.close()
        self.watch.bar = None
