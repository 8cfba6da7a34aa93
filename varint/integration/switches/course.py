"""A motion that is to be followed from switch to switch, and its pieces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from varint.codegen.kernel import Kernel
from varint.integration.problem import InitialValueProblem
from varint.integration.switches.branch import Branch
from varint.integration.switches.timetable import Timetable
from varint.results.records import Event
from varint.rules.rule import Rule
from varint.scene.system import System


@dataclass(eq=False)
class Course:
    """A motion to be followed in one number of steps after another.

    Attributes
    ----------
    system : System
        The user's scene.
    rule : Rule
    problem : InitialValueProblem
        Of one step over the whole duration.
    timetable : Timetable
    backend : str
    units : dict
        Size of a unit of time on each branch, whatever its controls, found where it first comes up.
    known : dict
        The unit at first of each branch a piece of which has ended at a switch.
    kernels : dict
        The loop of each scene that moves.
    grid : float or None
        Step size, where that is given.
    tol : float
        The accuracy that is asked for; 0 where steps are given.
    left : float
        Of the motion's size, how far arcs lead that are left out.
    reached : float
        For how long the last run could be followed.
    say : callable
        Takes () → how far it is.
    """

    system: System
    rule: Rule
    problem: InitialValueProblem
    timetable: Timetable
    backend: str
    units: dict[Branch, float] = field(default_factory=dict)
    known: dict[Branch, float] = field(default_factory=dict)
    kernels: dict[Branch, Kernel | None] = field(default_factory=dict)
    grid: float | None = None
    tol: float = 0.0
    left: float = 0.0
    reached: float = 0.0
    say: Callable[[Callable[[], str]], None] = lambda note: None


def kernel_in(course: Course, branch: Branch) -> Kernel | None:
    """The loop of the scene of a branch, where there is one already."""
    return course.kernels.get(which_moves(branch))


def which_moves(branch: Branch) -> Branch:
    """What stands for all branches of one scene: they differ by numbers alone."""
    return branch._replace(values=(), controls=())


class Piece(NamedTuple):
    """A smooth piece of the motion: its branch, size and number of the steps it was begun with, its
    nodes with that of the switch it ends at, (q, p, v) there, (N + 1, 3, n), what contacts do where
    it begins, and all nodes, where there are others between even steps.
    """

    branch: Branch
    h: float
    steps: int
    t: np.ndarray
    states: np.ndarray
    iterations: int
    residual: float
    events: tuple[Event, ...] = ()
    every: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and states of all nodes."""
        return self.every or (self.t, self.states)
