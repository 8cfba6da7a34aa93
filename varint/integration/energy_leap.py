"""An energy that leaps from one node of a scene with constraints to the next.

Where a node within a step, or one that is not saved, lies on a fold, the motion beyond is not
determined. The saved nodes show it by their energy alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.discrete.row_independence import folds
from varint.integration.energy_check import energies, energy_jump
from varint.integration.work_bound import keeps_energy
from varint.numerics.arrays import median
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

APART = 500  # steps between two energies that are compared in long runs: they cost little then
ALL = 100  # nodes of a run of which every one is looked at
LEAP = 100.0  # times what other steps nearby do at most
LEAST = 1e-8  # of the largest p·v: less is round-off that a fold makes larger
ROUND_OFF = 1e-12  # of the energy, which a scene at rest has alone
GROSS = 1e-3  # of the largest p·v: the branch is another one
AROUND = 10  # differences on either side that tell what is usual
BESIDE = 2  # next to the leap, which may take two steps: into the fold and out of it
FEW = 4  # differences that tell nothing
STAYS = 0.5  # of the leap that is left after it: what comes back was no leap


class EnergyLeap(NamedTuple):
    """Energies before and after a leap between two times, what is usual nearby, and the rows that
    are nearly dependent there.
    """

    times: tuple[float, float]
    energies: tuple[float, float]
    usual: float
    rows: tuple[int, ...]

    def alarm(self) -> str:
        """What is wrong, and what to do."""
        (t0, t1), (before, after) = self.times, self.energies
        fold = (
            f"the gradients of the constraint rows {list(self.rows)} are nearly dependent there (a "
            "fold), and the motion beyond is not determined: change h or the start a little, so "
            "that no node of a step lies on it"
        )
        return (
            f"the energy leapt from {before:.10g} to {after:.10g} between t = {t0:.6g} and t = "
            f"{t1:.6g}, where steps nearby change it by {self.usual:.1e} at most: "
            + (fold if self.rows else "h is too large there, try a smaller one")
        )


def energy_alarm(motion: Trajectory, wanted: float = 0.0) -> str | None:
    """What the energy says is wrong with a run that came to its end, and what to do."""
    if jump := energy_jump(motion):
        return jump.alarm(motion.h)
    leap = energy_leap(motion, wanted)
    return leap and leap.alarm()


def energy_leap(motion: Trajectory, wanted: float = 0.0) -> EnergyLeap | None:
    """The first leap of the energy of a scene with constraints that should keep it.

    A change of energy is a leap where it is large beside those of other steps nearby and stays, but
    not one within the error that is `wanted`, as part of the largest p·v, away from folds: steps in
    which all happens err by more than others.
    """
    if not may_leap(motion.system):
        return None
    if motion.active_set is not None or len(motion) <= FEW:
        return None
    return _leap_of(motion, wanted)


@per_scene
def may_leap(system: System) -> bool:
    """Whether constraint rows may let the energy leap, and nothing else changes it."""
    s = system.structure
    if not s.constraints or s.contacts or s.nonholonomic or s.degenerate:
        return False
    return folds(system) and keeps_energy(system)


@np.errstate(all="ignore")  # what is not finite is no leap, and told elsewhere
def _leap_of(motion: Trajectory, wanted: float) -> EnergyLeap | None:
    system = motion.system
    steps = max(int(motion.k[-1] - motion.k[0]), 1)
    every = max(min(APART * (len(motion) - 1) // steps, (len(motion) - 1) // ALL), 1)
    i = np.arange(0, len(motion), every)
    q, p, c = motion.q[i][None], motion.p[i][None], motion.c[None]
    energy, moving, _ = (x[0] for x in energies(system, q, p, motion.t[i], c, motion.h))
    change = np.abs(np.diff(energy))
    least = max(LEAST * moving.max(), ROUND_OFF * np.abs(energy).max())
    large = (change > least) & (change > LEAP * median(change))
    for j in np.flatnonzero(large).tolist():
        usual = _usual(change, j, change[j] > GROSS * moving.max())
        if change[j] > LEAP * usual and _stays(energy, j):
            from varint.integration.fold_watch import rows_of_fold

            a, b = int(i[j]), int(i[j + 1])
            rows = rows_of_fold(motion, a, b)
            if not rows and change[j] <= wanted * moving.max():
                continue
            times = float(motion.t[a]), float(motion.t[b])
            return EnergyLeap(times, (float(energy[j]), float(energy[j + 1])), usual, rows)
    return None


def _usual(change: np.ndarray, j: int, gross: bool) -> float:
    """The largest change near the one of number j, but not beside it, and only before it where it
    is gross: what follows is another motion then; ∞ where there are few.
    """
    before = change[max(j - AROUND, 0) : max(j - BESIDE, 0)]
    after = change[j + BESIDE + 1 : j + AROUND + 1]
    near = before if gross and len(before) >= FEW - 1 else np.concatenate([before, after])
    return float(near.max()) if len(near) >= FEW - 1 else np.inf


def _stays(energy: np.ndarray, j: int) -> bool:
    """Whether the energy after the change of number j is another one than before it."""
    before = median(energy[max(j - AROUND, 0) : max(j - 1, 0) + 1])
    after = median(energy[min(j + 2, len(energy) - 1) : j + AROUND])
    return bool(np.abs(after - before) > STAYS * np.abs(energy[j + 1] - energy[j]))
