"""Multiple shooting on the discrete flow: a period in segments, their ends, and the tangent maps of
the run itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from varint.errors import InputError
from varint.integration.backend import kernel_for, run_at_once
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import finite
from varint.orbits.phase import (
    VANISHING,
    Frame,
    Integrals,
    Units,
    frame,
    hamiltonian_fields,
    independent,
)
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.system import System
from varint.sensitivities.loops import sweeper
from varint.sensitivities.pieces import (
    Piece,
    cannot_go_on,
    nodes_with_velocities,
    velocities,
)
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.sweeps import carried

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

CALLS = 100  # tangent maps that a search is expected to take, when it is decided what to compile
STAGES, LOBATTO = 6, 5  # of the rules that orbits are found with: round-off in some 100 steps
LONG_RUN = 10**7  # steps for which loops are chosen: many runs of the same scene


@dataclass(frozen=True, eq=False)
class Shooting:
    """How one period of a scene is run.

    Attributes
    ----------
    system, rule : System, Rule
    segments, each : int
        Segments, and steps of each.
    t0 : float
        Time of the start.
    shift : ndarray (n,)
        What the coordinates have gained after a period: whole turns of angles.
    integrals : Integrals
    parts : ndarray (segments,) or None
        Durations of the segments in periods, so that steps are shorter in some; None: all alike.
    """

    system: System
    rule: Rule
    segments: int
    each: int
    t0: float
    shift: np.ndarray
    integrals: Integrals
    parts: np.ndarray | None = None

    @property
    def steps(self) -> int:
        return self.segments * self.each

    @property
    def sizes(self) -> np.ndarray:
        """Steps of the segments, in periods, (segments,)."""
        if self.parts is None:
            return np.full(self.segments, 1.0 / self.steps)
        return self.parts / self.each

    @property
    def beginnings(self) -> np.ndarray:
        """Where segments begin, in periods, (segments,)."""
        if self.parts is None:
            return np.arange(self.segments) / self.segments
        return np.concatenate([[0.0], np.cumsum(self.parts)[:-1]])

    @property
    def autonomous(self) -> bool:
        return self.system.structure.autonomous


class Iterate(NamedTuple):
    """An orbit on its way: states at the beginnings of the segments (M, 2n), period, parameters."""

    x: np.ndarray
    period: float
    c: np.ndarray


class Linear(NamedTuple):
    """The segments about an iterate, in the frames of their beginnings.

    Attributes
    ----------
    frames : list of Frame
    maps : ndarray (M, d, d)
        Tangent maps.
    by_period, by_parameter : ndarray (M, d)
        Derivatives of the ends; by_parameter is zero where none is varied.
    gaps : ndarray (M, d)
        Ends less the next beginnings.
    gradients : ndarray (k, d)
        Independent gradients of the integrals at the first beginning.
    phases : ndarray (M, k, d)
        Directions of the flow and the symmetries at each beginning.
    levels : ndarray (M, k, d)
        The gradients of the same combinations at each beginning.
    parameter : int or None
        That of by_parameter.
    """

    frames: list[Frame]
    maps: np.ndarray
    by_period: np.ndarray
    by_parameter: np.ndarray
    gaps: np.ndarray
    gradients: np.ndarray
    phases: np.ndarray
    levels: np.ndarray
    parameter: int | None = None

    @property
    def monodromy(self) -> np.ndarray:
        """The tangent map of the whole period in the first frame."""
        product = np.eye(len(self.maps[0]))
        for one in self.maps:
            product = one @ product
        return product


def orbit_rule(system: System, rule: Rule | None) -> Rule:
    """The rule of an orbit: with an error of round-off where none is asked for."""
    s = system.structure
    if rule is None and not s.nonholonomic:
        rule = lobatto(LOBATTO) if s.constraints else gauss(STAGES)
    return plan(system, rule).rule


def refuse_scene(system: System) -> None:
    """Scenes whose steps have no tangent map, or that have no flow of their own."""
    s = system.structure
    if s.contacts or s.degenerate:
        raise InputError(
            "periodic orbits are those of scenes without contacts whose Lagrangian is regular in "
            "the velocities"
        )
    if s.controls:
        raise InputError(
            f"the scene has the controls {list(system.control_names)}: make them parameters or "
            "functions of time, so that the motion follows from the start alone"
        )


def runs(shooting: Shooting, at: Iterate) -> list[Piece]:
    """Every segment with all its nodes.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    return _by(nodes_with_velocities, shooting, at)


def hasty_runs(shooting: Shooting, at: Iterate) -> list[Piece]:
    """The same, unless the iteration of a step fails, as where a guess was far off: then it is left
    at that, instead of setting up Newton's method.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved so.
    """
    return _by(_at_once, shooting, at)


Nodes = tuple[np.ndarray, np.ndarray | None]


def _by(
    run: Callable[[System, Rule, InitialValueProblem, Kernel | None], Nodes],
    shooting: Shooting,
    at: Iterate,
) -> list[Piece]:
    """The segments by a way to run one."""
    system, rule, n = shooting.system, shooting.rule, at.x.shape[1] // 2
    each, sizes = shooting.each, at.period * shooting.sizes
    begin = shooting.t0 + at.period * shooting.beginnings
    first = velocities(system, at.x, begin, at.c)
    held, steps, kept = np.empty((each, 1, 0)), np.arange(each + 1), np.array([0, each])
    found = []
    for x0, v0, h, t0 in zip(at.x, first, sizes, begin, strict=True):
        problem = InitialValueProblem(
            x0[:n].copy(), x0[n:].copy(), float(t0), float(h), each, 1, held, at.c, len(rule.nodes)
        )
        kernel = kernel_for(system, rule, problem._replace(steps=LONG_RUN), "auto")
        x, told = run(system, rule, problem, kernel)
        t = t0 + h * steps
        v = velocities(system, x, t, at.c) if told is None else np.vstack([v0, told])
        controls = problem.controls(0, each)
        found.append(Piece(0, 1, 0, x, v, t[:-1], np.full(each, h), controls, kept))
    return found


def _at_once(
    system: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel | None
) -> Nodes:
    if kernel is None:
        return nodes_with_velocities(system, rule, problem, kernel)
    found = run_at_once(system, rule, problem, kernel, short=False)
    if found is None or not found.done:
        raise cannot_go_on(problem, 0 if found is None else found.steps)
    rows = found.rows
    return np.ascontiguousarray(rows[:, :2]).reshape(len(rows), -1), rows[1:, 2]


def ends(shooting: Shooting, pieces: list[Piece]) -> np.ndarray:
    """Last states of the segments (M, 2n), the last one less its turns."""
    last = np.array([piece.x[-1] for piece in pieces])
    last[-1, : len(shooting.shift)] -= shooting.shift
    return last


def gaps(shooting: Shooting, at: Iterate, pieces: list[Piece], units: Units) -> np.ndarray:
    """Ends less the next beginnings, in units, (M, 2n)."""
    found: np.ndarray = (ends(shooting, pieces) - np.roll(at.x, -1, axis=0)) / units.scale
    return found


def linearise(
    shooting: Shooting,
    at: Iterate,
    pieces: list[Piece],
    units: Units,
    parameter: int | None,
) -> Linear:
    """Tangent maps of all segments, by the run's own steps."""
    system, n = shooting.system, at.x.shape[1] // 2
    by = sweeper(system, shooting.rule, CALLS * shooting.steps, "auto")
    times = shooting.t0 + at.period * shooting.beginnings
    frames = [frame(system, x, t, at.c, units) for x, t in zip(at.x, times, strict=True)]
    d = frames[0].into.shape[1]
    if any(one.into.shape[1] != d for one in frames):
        raise InputError("the rank of the constraints changes along the motion")
    outer = np.zeros((len(at.c) + 2, d + 2))
    if parameter is not None:
        outer[parameter, d + 1] = 1.0
    rows = []
    for i, piece in enumerate(pieces):
        seed = np.zeros((2 * n, d + 2))
        seed[:, :d] = frames[i].into
        following = frames[(i + 1) % len(frames)]
        outer[-2:, d] = shooting.sizes[i], shooting.beginnings[i]
        tangent = carried(by, piece, at.c, Directions(outer), seed)
        rows.append(following.onto @ tangent)
    whole = np.array(rows)
    left = gaps(shooting, at, pieces, units) * units.scale
    onto = [frames[(i + 1) % len(frames)].onto for i in range(len(frames))]
    apart = np.array([a @ b for a, b in zip(onto, left, strict=True)])
    flow = np.roll(whole[:, :, d], 1, axis=0)  # ∂x/∂T at the end of a segment begins the next
    gradients, phases, levels = _conserved(shooting, at, frames, flow)
    maps, by_period, by_parameter = whole[:, :, :d], whole[:, :, d], whole[:, :, d + 1]
    columns = by_period, by_parameter
    return Linear(frames, maps, *columns, apart, gradients, phases, levels, parameter)


def _conserved(
    shooting: Shooting, at: Iterate, frames: list[Frame], flow: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Independent gradients at the first beginning, the directions that change nothing, and the
    gradients of the same combinations everywhere.
    """
    found = [
        shooting.integrals.gradients(x, at.c) @ one.into
        for x, one in zip(at.x, frames, strict=True)
    ]
    size = np.linalg.norm(found[0], axis=1)
    kept = size > VANISHING * size.max(initial=0.0)
    first, held = independent(found[0][kept]), shooting.system.structure.nonholonomic
    # the same combinations everywhere: those that span the gradients at the first beginning
    mix = np.linalg.lstsq(found[0][kept].T, first.T, rcond=1e-9)[0].T if len(first) else np.eye(0)
    levels = np.array([mix @ g[kept] for g in found]).reshape(len(frames), *first.shape)
    if len(first) and not held:
        fields = [
            hamiltonian_fields(one.form, rows) for one, rows in zip(frames, levels, strict=True)
        ]
    else:
        fields = [np.zeros((0, one.into.shape[1])) for one in frames]
    if shooting.autonomous and (held or not shooting.integrals.energy):
        fields = [np.vstack(pair) for pair in zip(fields, flow[:, None], strict=True)]
    phases = np.array(fields)
    size = np.linalg.norm(phases, axis=(0, 2))
    return first, phases / np.where(size > 0, size, 1.0)[None, :, None], levels


def is_finite(at: Iterate) -> bool:
    return finite(at.x.ravel(), np.array([at.period]), at.c)
