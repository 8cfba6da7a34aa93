"""Self-tests on the user's own scene: order, structure, long-time behaviour, run time against
error.

Each takes a system and a rule, or any step function with the signature of `varint.step_function`.
"""

from varint.diagnostics.accuracy import Convergence, convergence
from varint.diagnostics.constraints import ConstraintDrift, constraint_drift
from varint.diagnostics.long_runs import EnergySlope, RoundOff, energy_slope, round_off
from varint.diagnostics.momentum import Conserved, MomentumMap
from varint.diagnostics.reversibility import ReversibilityDefect, reversibility_defect
from varint.diagnostics.self_test import SelfTest, self_test
from varint.diagnostics.symplecticity import SymplecticDefect, symplectic_defect
from varint.diagnostics.work import WorkPrecision, work_precision

__all__ = [
    "Conserved",
    "ConstraintDrift",
    "Convergence",
    "EnergySlope",
    "MomentumMap",
    "ReversibilityDefect",
    "RoundOff",
    "SelfTest",
    "SymplecticDefect",
    "WorkPrecision",
    "constraint_drift",
    "convergence",
    "energy_slope",
    "reversibility_defect",
    "round_off",
    "self_test",
    "symplectic_defect",
    "work_precision",
]
