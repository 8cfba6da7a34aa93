"""Mechanics by the principle of least action, on CasADi."""

from varint.errors import ConvergenceError, InputError, SolverError, VarintError
from varint.rules import Rule, composition, gauss, lobatto, midpoint, trapezoidal
from varint.system import Parameters, System, coordinates, time

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError", "InputError", "Parameters", "Rule", "SolverError", "System", "VarintError",
    "composition", "coordinates", "gauss", "lobatto", "midpoint", "time", "trapezoidal",
]  # fmt: skip
