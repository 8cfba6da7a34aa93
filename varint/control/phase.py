"""What the user wants of one phase of motion, checked: scene, rule, mesh, duration, cost, ends,
bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.control.contacts import Contacts, check_contacts, with_contacts
from varint.control.ends import End, end_conditions
from varint.control.phase_inputs import duration_of, mesh_of, parameters_of_phase, rule_of
from varint.control.rates import Rates, check_rates
from varint.control.states import States, check_states
from varint.errors import InputError
from varint.nlp.bounds import Integrals, PathBounds, integrals_of, path_bounds
from varint.nlp.expressions import scalar
from varint.nlp.slacks import Slacks, Soft, refuse_concave, separate, slacks
from varint.rules.rule import Rule
from varint.scene.free import Free
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


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
    bounds: Sequence[tuple[Any, Any, Any] | Soft] = ()
    control: str = "nodes"
    params: ParameterValues | None = None
    guess: Any = None
    mesh: Any = None
    q0: Any = None
    v0: Any = None
    p0: Any = None
    integral: Sequence[tuple[Any, Any, Any]] = ()
    states: Mapping[Any, Any] | None = None
    closed: Sequence[int] = ()


@dataclass(frozen=True, eq=False)
class CheckedPhase:
    """A phase after validation: arrays and column expressions, nothing optional.

    Attributes
    ----------
    system : System
        With its closed contacts among the constraints.
    contacts : Contacts
        Which are closed, and gaps of the others.
    duration : tuple of float
        Guess, lower and upper bound; equal where it is fixed.
    mesh : ndarray (N + 1,)
        Ends of the steps as fractions of the duration.
    samples : int
        Values of each control a step: r, or 1 where it is constant.
    c, c_low, c_high : ndarray
        Parameter guesses and bounds; equal where they are fixed.
    cost, terminal : SX
        Expressions of q, v, u, slacks, t, c and of q, v, slacks, t, c.
    slacks, end_slacks : Slacks
        At every node and at the end.
    rates : Rates
        Rates of change of controls, which cost and bounds may hold.
    integrals : Integrals
        What is bounded over the whole phase.
    states : States
        Controls that obey differential equations.
    linear : bool
        Are the controls piecewise linear?
    """

    system: System
    contacts: Contacts
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
    slacks: Slacks
    end_slacks: Slacks
    rates: Rates
    integrals: Integrals
    states: States
    linear: bool
    guess: Any
    given: Phase

    @property
    def steps(self) -> int:
        """Number N of steps."""
        return len(self.mesh) - 1

    @property
    def control_places(self) -> np.ndarray:
        """Where in a step the controls have their values: at the nodes, one in the middle, or one
        at its beginning and the next at its end.
        """
        if self.linear:
            return np.array([0.0, 1.0])
        return np.array(self.rule.nodes) if self.samples > 1 else np.array([0.5])

    @property
    def control_weights(self) -> np.ndarray:
        """The share of a step that belongs to each of them."""
        return np.array(self.rule.weights) if self.samples > 1 else np.ones(1)

    @property
    def closing_controls(self) -> int:
        """Number of controls that have a value at the last node too: those of the next step
        matter to a step.
        """
        return self.system.structure.controls if self.linear or len(self.rates.index) else 0

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
    system, contacts = check_contacts(system, phase.closed)
    rule = rule_of(system, phase.rule)
    duration = duration_of(phase.duration)
    c, c_low, c_high = parameters_of_phase(system, phase.params)
    if not system.structure.controls and duration[1] == duration[2] and (c_low == c_high).all():
        raise InputError(
            "nothing can be chosen: the scene has no control and neither duration nor parameters "
            "are free; give control= to the System, or use least_action for a path between fixed "
            "ends"
        )
    if phase.control not in BASES:
        raise InputError(
            f"control={phase.control!r} is unknown; 'nodes' (a value at every node), 'constant' "
            "(one a step) or 'linear' (one at every end of a step)"
        )
    s = system
    hard, soft_bounds = separate(phase.bounds)
    given = [phase.cost, hard, [b.expression for b in soft_bounds], phase.integral]
    rates = check_rates(system, given, phase.control)
    states = check_states(system, phase.states, phase.control)
    along = ca.vertcat(s.q, s.v, s.control, rates.symbols)
    at_end = ca.vertcat(s.q, s.v, states.symbols(system))
    cost, own = _cost("cost", phase.cost, soft_bounds, along, system, c, WORDS)
    words = "q, v, t, states and the parameters at the end"
    terminal, last = _cost("terminal_cost", phase.terminal_cost, (), at_end, system, c, words)
    bounds = with_contacts(path_bounds(system, hard, rates.symbols), system, contacts)
    integrals = integrals_of(phase.integral, ca.vertcat(along, s.t), s.c)
    acting = [system.force, cost, own.rows, bounds.at_nodes, integrals.rows, states.rates]
    acting += [rates.controls(system), states.symbols(system)]
    _refuse_idle(system, ca.vertcat(*acting), bounds.u)
    return CheckedPhase(
        system=system,
        contacts=contacts,
        rule=rule,
        duration=duration,
        mesh=mesh_of(phase.steps, phase.mesh),
        samples=len(rule.nodes) if phase.control == "nodes" else 1,
        c=c,
        c_low=c_low,
        c_high=c_high,
        cost=cost,
        terminal=terminal,
        start=end_conditions(system, "start", start_of(phase), states),
        end=end_conditions(system, "end", phase.end, states),
        bounds=bounds,
        slacks=own,
        end_slacks=last,
        rates=rates,
        integrals=integrals,
        states=states,
        linear=phase.control == "linear",
        guess=phase.guess,
        given=phase,
    )


BASES = ("nodes", "constant", "linear")
WORDS = "q, v, the controls, t and the parameters"


def _cost(
    what: str,
    given: Any,
    soft_bounds: Sequence[Soft],
    path: ca.SX,
    system: System,
    values: np.ndarray,
    words: str,
) -> tuple[ca.SX, Slacks]:
    """A cost with the price of soft bounds, and the slacks of both; `values` of the parameters."""
    symbolic = given if isinstance(given, ca.SX) else ca.SX(0)
    rest = ca.vertcat(system.t, system.c)
    found = slacks(symbolic, soft_bounds, path, rest, words)
    cost = scalar(what, given, ca.vertcat(path, rest, found.symbols), words)
    refuse_concave(what, cost, found, system.c, values)
    return cost + found.price, found


def _refuse_idle(system: System, along: ca.SX, limits: np.ndarray) -> None:
    """A control acts through the force, the cost or a bound."""
    idle = [
        x.name()
        for i, x in enumerate(ca.vertsplit(system.control))
        if not ca.depends_on(along, x) and not np.isfinite(limits[:, i]).any()
    ]
    if idle:
        raise InputError(
            f"the controls {idle} do not act: neither force, cost nor bounds depend on them; "
            "leave them out"
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
