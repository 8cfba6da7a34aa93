"""Mechanics by the principle of least action, on CasADi."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.parameters import Parameters
from varint.rules import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.system import System, coordinates, time

if TYPE_CHECKING:
    from varint import diagnostics, models
    from varint.archive import load
    from varint.boundary.derivatives import action_derivatives
    from varint.boundary.families import paths
    from varint.boundary.least_action import least_action
    from varint.control.links import Link
    from varint.control.lqr import lqr
    from varint.control.mpc import closed_loop, mpc
    from varint.control.multistart import multistart
    from varint.control.optimal import optimal_control, optimal_phases
    from varint.control.phase import Phase
    from varint.control.refine import refine
    from varint.ensembles.ensemble import ensemble
    from varint.ensembles.result import Ensemble
    from varint.geodesics import geodesic
    from varint.horizon import free
    from varint.projection import project
    from varint.sketch import Sketch
    from varint.stepping.plan import Plan, plan
    from varint.stepping.simulate import simulate
    from varint.stepping.step_function import step_function
    from varint.stepping.time_scale import close_encounters
    from varint.stepping.two_point import start_momentum
    from varint.symmetry import Symmetries, Symmetry, noether, symmetries
    from varint.trajectory import State, Trajectory

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "Ensemble", "InputError", "Link", "Parameters", "Phase", "Plan", "Rule", "Sketch",
    "SolverError", "State", "Symmetries", "Symmetry", "System", "Trajectory", "VarintError", "action_derivatives",
    "close_encounters", "closed_loop", "composition", "coordinates", "diagnostics", "ensemble", "free", "gauss",
    "geodesic", "least_action", "load", "lobatto", "lqr", "midpoint", "models", "mpc", "multistart", "noether",
    "optimal_control", "optimal_phases", "paths", "plan", "project", "refine", "simulate", "start_momentum",
    "step_function", "symmetries", "time", "trapezoidal",
]  # fmt: skip

# loaded when first named: nobody pays for what he does not use
_LATER = {
    "Ensemble": "varint.ensembles.result",
    "Link": "varint.control.links",
    "Phase": "varint.control.phase",
    "Plan": "varint.stepping.plan",
    "Sketch": "varint.sketch",
    "State": "varint.trajectory",
    "Symmetries": "varint.symmetry",
    "Symmetry": "varint.symmetry",
    "Trajectory": "varint.trajectory",
    "action_derivatives": "varint.boundary.derivatives",
    "close_encounters": "varint.stepping.time_scale",
    "closed_loop": "varint.control.mpc",
    "ensemble": "varint.ensembles.ensemble",
    "free": "varint.horizon",
    "geodesic": "varint.geodesics",
    "least_action": "varint.boundary.least_action",
    "load": "varint.archive",
    "lqr": "varint.control.lqr",
    "mpc": "varint.control.mpc",
    "multistart": "varint.control.multistart",
    "noether": "varint.symmetry",
    "optimal_control": "varint.control.optimal",
    "optimal_phases": "varint.control.optimal",
    "paths": "varint.boundary.families",
    "plan": "varint.stepping.plan",
    "project": "varint.projection",
    "refine": "varint.control.refine",
    "simulate": "varint.stepping.simulate",
    "start_momentum": "varint.stepping.two_point",
    "step_function": "varint.stepping.step_function",
    "symmetries": "varint.symmetry",
}
_LATER_MODULES = ("diagnostics", "models")


def __getattr__(name: str) -> Any:
    if name in _LATER:
        found = globals()[name] = getattr(import_module(_LATER[name]), name)
        return found
    if name in _LATER_MODULES:
        return import_module(f"varint.{name}")
    raise AttributeError(f"module 'varint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
