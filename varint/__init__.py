"""Mechanics by the principle of least action, on CasADi."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.noether import Symmetries, Symmetry, noether, symmetries
from varint.projection import project
from varint.rules import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.stepping.plan import Plan, plan
from varint.stepping.rescaled import close_encounters
from varint.stepping.simulate import simulate
from varint.stepping.step_function import step_function
from varint.system import Parameters, System, coordinates, time
from varint.trajectory import State, Trajectory

if TYPE_CHECKING:
    from varint import diagnostics, models
    from varint.archive import load

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "InputError", "Parameters", "Plan", "Rule", "SolverError", "State", "Symmetries",
    "Symmetry", "System", "Trajectory", "VarintError", "close_encounters", "composition", "coordinates",
    "diagnostics", "gauss", "load", "lobatto", "midpoint", "models", "noether", "plan", "project", "simulate",
    "step_function", "symmetries", "time", "trapezoidal",
]  # fmt: skip

# loaded when first named: a simulation does not pay for what it does not use
_LATER = {"load": "varint.archive"}
_LATER_MODULES = ("diagnostics", "models")


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    if name in _LATER_MODULES:
        return import_module(f"varint.{name}")
    raise AttributeError(f"module 'varint' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
