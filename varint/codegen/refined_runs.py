"""Runs with more and more steps, and their differences, in one call of c/refined_core.c."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from varint.codegen.core import refined_entry
from varint.codegen.few_steps import entries_of
from varint.codegen.kernel import Kernel, address_of
from varint.codegen.rows import RowFunction
from varint.codegen.two_runs import Course, HeldLooks

_COURSE = struct.Struct("13P11qP4qP4q")  # Refined, what belongs to the course
_TABLE = struct.Struct("2P4q")  # Table, which is the last of it
_NO_TABLE = _TABLE.pack(*[0] * 6)


class BendLooks(NamedTuple):
    """How steps are looked at in which forces may bend sharply with velocities.

    Attributes
    ----------
    push : RowFunction
        (q, v, t) → forces and the mass matrix' diagonal.
    looks : array (3, m)
        Parts of a step, and what makes the two highest coefficients of forces there.
    closer : array (5, m + 2)
        The same with both ends, and what makes of forces there how far those at the ends are off.
    """

    push: RowFunction
    looks: np.ndarray
    closer: np.ndarray


class StageLooks(NamedTuple):
    """How it is told from the stages of a step how well they show the motion.

    Attributes
    ----------
    heights : array (2, padded)
        What makes the two highest Legendre coefficients of what the stages have.
    counts : tuple of int
        Unknowns of a stage, stages, and with those that fill up vectors.
    """

    heights: np.ndarray
    counts: tuple[int, int, int]


def refined_course(
    kernel: Kernel,
    balance: RowFunction,
    forces: tuple[RowFunction | None, ...] | None,
    looks: tuple[np.ndarray, int, int, int],
    order: int,
    pieces: tuple[int, int],
    body: np.ndarray,
    turns: np.ndarray,
    limits: np.ndarray,
    held: HeldLooks | None = None,
    bends: BendLooks | None = None,
    stages: StageLooks | None = None,
    grows: int = 0,
    fitted: int = 0,
    by_velocity: bool = False,
) -> Course:
    """How a motion with forces or explicit time is run; `two_runs` runs it.

    Parameters
    ----------
    kernel : Kernel
    balance : RowFunction
        (q, p, t) → energy and the power of what changes it; (q, v, t) `by_velocity`.
    forces : tuple, optional
        (q, v, t) → forces and the mass matrix' diagonal, bounds of forces on the straight way
        between two nodes, and those of many steps at once, where they are data; None of scenes
        without explicit time.
    looks : tuple
        Parts of a step at which forces are looked at, how many of them before all others, how many
        groups of steps are bounded at once, and how many steps are looked at for that.
    order, pieces, body, turns
        As in `course_of`.
    limits : array
        Limits in c/refined_core.c.
    held : HeldLooks, optional
        Of a motion that constraint rows hold.
    bends : BendLooks, optional
        Of forces that bend with velocities.
    stages : StageLooks, optional
        Of motions whose error the stages of their steps tell.
    grows : int
        0: steps may be halved on the way; 1: and grow where the motion settles; 2: and beyond what
        stiff dampers stop at once; 3: there alone; −1: neither.
    fitted : int
        Steps at most of runs whose steps are shorter where forces bend; 0: none are.
    by_velocity : bool
        Velocities are made by the runs, for they have no formula.

    Raises
    ------
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    entry, on = refined_entry(), entries_of(kernel, balance)
    pushed = (x.at if x else 0 for x in forces or (bends and bends.push, None, None))
    places, *counted = looks
    arrays = limits, body, turns, places
    pivots, counted_looks = held and held.pivots, bends.looks.shape[1] if bends else 0
    bent = bends and np.concatenate((bends.looks.ravel(), bends.closer.ravel()))
    calls = on.run, on.scene, on.rows, on.energy, *pushed, *map(address_of, arrays)
    others = 0 if bent is None else address_of(bent), pivots.at if pivots else 0
    counts = on.n, on.carry, order, int(forces is not None), len(places), *counted
    kind = counted_looks, int(by_velocity), int(held is not None), kernel.note[1]
    at_stages = (0, 0, 0, 0) if stages is None else (address_of(stages.heights), *stages.counts)
    steps = *at_stages, grows, 0, fitted
    head = _COURSE.pack(*calls, *others, *counts, *pieces, kind[0], *steps, *kind[1:]) + _NO_TABLE
    return Course(entry, kernel, on.n, 2, head, (on, forces, held, bends, bent, stages, *arrays))


def with_table(course: Course, table: np.ndarray, places: np.ndarray) -> Course:
    """The same with controls, whose rows follow one another over the duration: (rows, 1 or stages,
    k); the rule looks at these places in a step, (stages,). A run's first steps are as many in each
    row.
    """
    rows, each, controls = table.shape
    told = address_of(table), address_of(places), rows, each, controls, len(places)
    head, held = course.head[: -_TABLE.size] + _TABLE.pack(*told), (*course.held, table, places)
    return course._replace(head=head, held=held)
