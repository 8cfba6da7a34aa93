"""Mechanics by the principle of least action, on CasADi."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.noether import Symmetries, Symmetry, noether, symmetries
from varint.projection import project
from varint.rules import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.stepping.plan import Plan, plan
from varint.stepping.simulate import simulate
from varint.stepping.step_function import step_function
from varint.system import Parameters, System, coordinates, time
from varint.trajectory import State, Trajectory

if TYPE_CHECKING:
    from varint import diagnostics, models
    from varint.archive import load
    from varint.control.links import Link
    from varint.control.lqr import lqr
    from varint.control.mpc import closed_loop, mpc
    from varint.control.multistart import multistart
    from varint.control.optimal import optimal_control, optimal_phases
    from varint.control.phase import Phase
    from varint.control.refine import refine
    from varint.horizon import free

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "InputError", "Link", "Parameters", "Phase", "Plan", "Rule", "SolverError", "State",
    "Symmetries", "Symmetry", "System", "Trajectory", "VarintError", "closed_loop", "composition", "coordinates",
    "diagnostics", "free", "gauss", "load", "lobatto", "lqr", "midpoint", "models", "mpc", "multistart", "noether",
    "optimal_control", "optimal_phases", "plan", "project", "refine", "simulate", "step_function", "symmetries",
    "time", "trapezoidal",
]  # fmt: skip

# loaded when first named: a simulation does not pay for what it does not use
_LATER = {
    "Link": "varint.control.links",
    "Phase": "varint.control.phase",
    "free": "varint.horizon",
    "multistart": "varint.control.multistart",
    "closed_loop": "varint.control.mpc",
    "load": "varint.archive",
    "lqr": "varint.control.lqr",
    "mpc": "varint.control.mpc",
    "refine": "varint.control.refine",
    "optimal_control": "varint.control.optimal",
    "optimal_phases": "varint.control.optimal",
}
_LATER_MODULES = ("diagnostics", "models")


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    if name in _LATER_MODULES:
        return import_module(f"varint.{name}")
    raise AttributeError(f"module 'varint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
