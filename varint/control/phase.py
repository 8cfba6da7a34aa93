"""What the user wants of one phase of motion, checked: scene, rule, mesh, duration, cost, ends,
bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.control.ends import End, end_conditions
from varint.errors import InputError, parsed_or_refused
from varint.nlp.bounds import PathBounds, path_bounds
from varint.nlp.expressions import scalar
from varint.numerics.limits import check_memory
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.free import Free
from varint.scene.inputs import finite_array, positive_integer
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, given_parameters, parameter_values


@dataclass(frozen=True, eq=False)
class Phase:
    """One phase of an optimal control problem; the arguments of `optimal_control` that belong to
    one motion.

    See `optimal_control` for their meaning. `mesh` holds the ends of the steps as fractions of the
    duration, (steps + 1,) from 0 to 1, where they are not equally long.
    """

    system: System
    rule: Rule | None = None
    duration: float | Free | None = None
    steps: int = 0
    cost: Any = 0
    terminal_cost: Any = 0
    start: Mapping[str, Any] | None = None
    end: Mapping[str, Any] | None = None
    bounds: Sequence[tuple[Any, Any, Any]] = ()
    control: str = "nodes"
    params: ParameterValues | None = None
    guess: Any = None
    mesh: Any = None
    q0: Any = None
    v0: Any = None
    p0: Any = None


@dataclass(frozen=True, eq=False)
class CheckedPhase:
    """A phase after validation: arrays and column expressions, nothing optional.

    Attributes
    ----------
    duration : tuple of float
        Guess, lower and upper bound; equal where it is fixed.
    mesh : ndarray (N + 1,)
        Ends of the steps as fractions of the duration.
    samples : int
        Values of each control a step: r, or 1 where it is constant.
    c, c_low, c_high : ndarray
        Parameter guesses and bounds; equal where they are fixed.
    cost, terminal : SX
        Expressions of q, v, u, t, c and of q, v, t, c.
    """

    system: System
    rule: Rule
    duration: tuple[float, float, float]
    mesh: np.ndarray
    samples: int
    c: np.ndarray
    c_low: np.ndarray
    c_high: np.ndarray
    cost: ca.SX
    terminal: ca.SX
    start: End
    end: End
    bounds: PathBounds
    guess: Any
    given: Phase

    @property
    def steps(self) -> int:
        """Number N of steps."""
        return len(self.mesh) - 1

    @property
    def control_places(self) -> np.ndarray:
        """Where in a step the controls have their values: at the nodes, or one in the middle."""
        return np.array(self.rule.nodes) if self.samples > 1 else np.array([0.5])

    @property
    def control_weights(self) -> np.ndarray:
        """The share of a step that belongs to each of them."""
        return np.array(self.rule.weights) if self.samples > 1 else np.ones(1)

    @property
    def shortest_step(self) -> float:
        """Duration of the shortest step."""
        return float(self.duration[0] * np.diff(self.mesh).min())

    @property
    def free_duration(self) -> bool:
        """Is the duration an unknown?"""
        return self.duration[1] < self.duration[2]

    @property
    def free_parameters(self) -> np.ndarray:
        """Indices of the parameters that are unknowns."""
        return np.flatnonzero(self.c_low < self.c_high)


def check_phase(phase: Phase) -> CheckedPhase:
    """The phase with everything filled in, or a clear refusal."""
    system = phase.system
    if not isinstance(system, System):
        raise InputError(f"optimal control takes a varint.System, got {type(system).__name__}")
    rule = _rule(system, phase.rule)
    duration = _duration(phase.duration)
    c, c_low, c_high = _parameters(system, phase.params)
    if not system.structure.controls and duration[1] == duration[2] and (c_low == c_high).all():
        raise InputError(
            "nothing can be chosen: the scene has no control and neither duration nor parameters "
            "are free; give control= to the System, or use least_action for a path between fixed "
            "ends"
        )
    if phase.control not in ("nodes", "constant"):
        raise InputError(
            f"control={phase.control!r} is unknown; 'nodes' (a value at every node) or 'constant'"
        )
    s = system
    state = ca.vertcat(s.q, s.v, s.t, s.c)
    return CheckedPhase(
        system=system,
        rule=rule,
        duration=duration,
        mesh=_mesh(phase.steps, phase.mesh),
        samples=len(rule.nodes) if phase.control == "nodes" else 1,
        c=c,
        c_low=c_low,
        c_high=c_high,
        cost=scalar(
            "cost",
            phase.cost,
            ca.vertcat(state, s.control),
            "q, v, the controls, t and the parameters",
        ),
        terminal=scalar(
            "terminal_cost", phase.terminal_cost, state, "q, v, t and the parameters at the end"
        ),
        start=end_conditions(system, "start", start_of(phase)),
        end=end_conditions(system, "end", phase.end),
        bounds=path_bounds(system, phase.bounds),
        guess=phase.guess,
        given=phase,
    )


def start_of(phase: Phase) -> Mapping[str, Any]:
    """The conditions at the start, q0, v0 and p0 among them under the names of its dictionary."""
    start = {} if phase.start is None else phase.start
    given = {"q": phase.q0, "v": phase.v0, "p": phase.p0}
    given = {name: x for name, x in given.items() if x is not None}
    if isinstance(start, Mapping) and (twice := sorted(set(start) & set(given))):
        name = twice[0]
        raise InputError(f"the start is given twice: leave out {name}0 or start=dict({name}=…)")
    return {**start, **given} if given and isinstance(start, Mapping) else start


def _rule(system: System, rule: Rule | None) -> Rule:
    structure = system.structure
    lacking = {"contacts": structure.contacts, "non-holonomic constraints": structure.nonholonomic}
    found = [name for name, count in lacking.items() if count]
    if found:
        remedy = "; describe impacts by phases and links" if structure.contacts else ""
        raise InputError(f"optimal control does not handle {' or '.join(found)}{remedy}")
    if structure.degenerate:
        raise InputError(
            "the Lagrangian is degenerate (∂²L/∂v² = 0): it has no end velocities to control"
        )
    if rule is None:
        return lobatto(3) if structure.constraints else gauss(2)
    if not isinstance(rule, Rule):
        raise InputError(f"rule must be a rule such as gauss(3), got {rule!r}")
    if not rule.points:
        raise InputError(
            f"{rule} is a composition with weights of both signs; optimal control takes gauss or "
            "lobatto"
        )
    return rule


def _duration(value: Any) -> tuple[float, float, float]:
    if value is None:
        raise InputError("give the duration: a number, or free(guess, lower, upper)")
    if isinstance(value, Free):
        if value.guess.shape != ():
            raise InputError(f"the duration is one number, got {value}")
        if not value.lower > 0:
            raise InputError(f"a free duration needs a positive lower bound, got {value}")
        return float(value.guess), float(value.lower), float(value.upper)
    duration = parsed_or_refused(
        lambda: float(value),
        lambda: f"the duration must be a number or free(guess, lower, upper), got {value!r}",
    )
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be positive and finite, got {value!r}")
    return duration, duration, duration


def _mesh(steps: Any, mesh: Any) -> np.ndarray:
    if mesh is None:
        check_memory(
            f"a path of {positive_integer('steps', steps)} steps", steps, "take fewer steps"
        )
        return np.arange(steps + 1) / steps
    mesh = finite_array("mesh", mesh)
    if (
        mesh.ndim != 1
        or len(mesh) < 2
        or mesh[0] != 0
        or mesh[-1] != 1
        or not (np.diff(mesh) > 0).all()
    ):
        raise InputError("mesh must hold fractions of the duration that increase from 0 to 1")
    if positive_integer("steps", steps, 0) not in (0, len(mesh) - 1):
        raise InputError(f"steps={steps} but the mesh has {len(mesh) - 1}; give one of the two")
    return mesh


def _parameters(
    system: System, params: ParameterValues | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Guess, lower and upper bound of the parameter vector."""
    given = given_parameters(system, params)

    def part(name: str) -> np.ndarray:
        shapes = {k: np.shape(v) for k, v in system.defaults.items()}
        values = {
            k: np.broadcast_to(getattr(v, name), shapes.get(k, v.guess.shape))
            if isinstance(v, Free)
            else v
            for k, v in given.items()
        }
        return parameter_values(system, values)

    infinite = {k: v for k, v in given.items() if isinstance(v, Free)}
    if any(not np.isfinite([v.lower, v.upper]).all() for v in infinite.values()):
        raise InputError(f"free parameters need finite bounds, got {infinite}")
    return part("guess"), part("lower"), part("upper")
