"""Mechanics by the principle of least action, on CasADi."""

from varint.archive import load
from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.noether import Symmetries, Symmetry, noether, symmetries
from varint.rules import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.stepping.plan import Plan, plan
from varint.stepping.simulate import simulate
from varint.stepping.step_function import step_function
from varint.system import Parameters, System, coordinates, time
from varint.trajectory import State, Trajectory

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "InputError", "Parameters", "Plan", "Rule", "SolverError", "State", "Symmetries", "Symmetry",
    "System", "Trajectory", "VarintError", "composition", "coordinates", "gauss", "load", "lobatto", "midpoint",
    "noether", "plan", "simulate", "step_function", "symmetries", "time", "trapezoidal",
]  # fmt: skip
