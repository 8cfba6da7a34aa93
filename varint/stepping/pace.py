"""How many steps an interpreted run takes between two looks at it, by what a step costs.

Typical sizes are renewed there, so the blocks show in the last digits: they follow from the scene and the rule alone,
not from the clock, and the same run always has the same.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete import point_function
from varint.rules import Rule
from varint.system import System, per_system

PATIENCE = 0.2  # seconds that Ctrl-C, the progress bar and checkpoints wait
MOST_STEPS = 10_000
INSTRUCTION = 4e-9  # seconds of CasADi's virtual machine for one operation
EVALUATIONS = 36  # of every stage in an implicit step, derivatives included
FACTOR = 9e-9  # seconds of it for an operation of a factorisation
UNKNOWN = 4e-6  # seconds of it for an unknown of Newton's method with constraints
CALL = 3e-7  # seconds of it for a step besides


@per_system
def steps_at_once(system: System, rule: Rule) -> int:
    """Steps of a block at most, a power of ten: what takes about `PATIENCE`."""
    most, cost = MOST_STEPS, _seconds(system, rule)
    while most > 1 and most * cost > PATIENCE:
        most //= 10
    return most


def _seconds(system: System, rule: Rule) -> float:
    """An estimate of an interpreted step's time, right to a factor of two or too long."""
    s = system.structure
    evaluation = point_function(system).n_instructions() * len(rule.nodes) * INSTRUCTION
    if rule.kicks and s.explicit:
        return evaluation + CALL
    degree = max(rule.degree, 1)
    if s.constraints or s.nonholonomic:
        return max((s.n + s.constraints + s.nonholonomic) * degree * UNKNOWN, evaluation)
    return evaluation * EVALUATIONS + _factorisation(system) * degree**3 * FACTOR


def _factorisation(system: System) -> int:
    """Operations of an LDLᵀ factorisation of a matrix in which the coordinates are coupled as in the scene."""
    s = system
    push = ca.gradient(s.lagrangian, s.q) + s.force
    slopes = [ca.jacobian_sparsity(e, x) for e in (s.momentum, push) for x in (s.q, s.v)]
    pattern = ca.Sparsity.diag(s.structure.n)
    for slope in slopes:
        pattern = pattern + slope + slope.T
    triangle = pattern.ldl()[0]  # transposed, without its diagonal: columns are rows of L
    filled = np.bincount(triangle.get_triplet()[0], minlength=s.structure.n)
    return int(((1 + filled) ** 2).sum())
