"""What a run of few steps is looked at for by the core: energies of its nodes, and folds of its
constraint rows. Where these leave a doubt others look closer.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from varint.codegen.few_steps import Looks
from varint.codegen.kernel import address_of
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.two_runs import HeldLooks
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

# in the order of c/held.h, and of c/few_steps_core.c
_LEAPS = np.array([LEAST, ROUND_OFF, LEAP, APART, ALL, FEW])
_LIMITS = np.array([GROSS, NOTHING, HUGE, MISSED, POOR, *_LEAPS])


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
    pivots = least_pivots(system)
    if pivots is None and has_pivots(system):
        return None
    return Looks(energy, by_velocity, not kept, _LIMITS, may_leap(system), pivots)


def held_looks(system: System) -> HeldLooks | None:
    """How folds of rows and leaps of the energy are looked at; None where they are not data."""
    pivots = least_pivots(system)
    if pivots is None and has_pivots(system):
        return None
    return HeldLooks(pivots, _LEAPS if may_leap(system) else None)


def has_pivots(system: System) -> bool:
    """Whether several constraint rows may come to depend on one another: one has the pivot one."""
    return folds(system) and system.structure.velocity_rows > 1


@per_scene
def least_pivots(system: System) -> RowFunction | None:
    """(q, t) → the least pivot of such rows; None where there are none, or they are not data."""
    if not has_pivots(system):
        return None
    q, t, c = system.q, system.t, system.c
    return row_function_or_none("pivots", [q, t], c, [pivot_and_lengths(system)[0]])


@lru_cache(maxsize=256)
def looked_at(last: int) -> tuple[int, int, np.ndarray]:
    """Address of the numbers of nodes 0 … last that are looked at, how many they are, and what lies
    there.
    """
    nodes = nodes_looked_at(last)
    return address_of(nodes), len(nodes), nodes
