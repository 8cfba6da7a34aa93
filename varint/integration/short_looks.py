"""What a run of few steps is looked at for by the core: energies of its nodes, and folds of its
constraint rows. Where these leave a doubt others look closer.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from varint.codegen.few_steps import Looks
from varint.codegen.kernel import address_of
from varint.codegen.rows import row_function_or_none
from varint.discrete.legendre import velocity_function
from varint.discrete.row_independence import folds, pivot_and_lengths
from varint.integration.compiled_loop import POOR
from varint.integration.energy_check import (
    GROSS,
    HUGE,
    NOTHING,
    energy_rows,
    energy_rows_by_velocity,
    nodes_looked_at,
)
from varint.integration.energy_leap import ALL, APART, FEW, LEAP, LEAST, ROUND_OFF, may_leap
from varint.integration.work_bound import (
    MISSED,
    balance_rows,
    balance_rows_by_velocity,
    keeps_energy,
)
from varint.scene.memory import per_scene
from varint.scene.system import System

# in the order of c/few_steps_core.c
_LIMITS = np.array([GROSS, NOTHING, HUGE, MISSED, POOR, LEAST, ROUND_OFF, LEAP, APART, ALL, FEW])


@per_scene
def short_looks(system: System) -> Looks | None:
    """How energies of nodes are looked at, and folds of rows; None where they are not data."""
    kept, by_velocity = keeps_energy(system), not velocity_function(system).is_a("SXFunction")
    if kept:
        energy = energy_rows_by_velocity(system) if by_velocity else energy_rows(system)
    else:
        energy = balance_rows_by_velocity(system) if by_velocity else balance_rows(system)
    if energy is None:
        return None
    pivots = None
    if folds(system) and system.structure.velocity_rows > 1:  # one row alone has the pivot one
        q, t, c = system.q, system.t, system.c
        pivots = row_function_or_none("pivots", [q, t], c, [pivot_and_lengths(system)[0]])
        if pivots is None:
            return None
    return Looks(energy, by_velocity, not kept, _LIMITS, may_leap(system), pivots)


@lru_cache(maxsize=256)
def looked_at(last: int) -> tuple[int, int, np.ndarray]:
    """Address of the numbers of nodes 0 … last that are looked at, how many they are, and what lies
    there.
    """
    nodes = nodes_looked_at(last)
    return address_of(nodes), len(nodes), nodes
