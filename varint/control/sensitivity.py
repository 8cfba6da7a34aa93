"""How an optimal control changes with what was given: parameters, ends, duration, bounds.

With L = f + λ·g + λ_x·x at the solution (Lagrangian of the program, multipliers with CasADi's sign)
the cost changes by dJ/dp = ∂L/∂p, by −λ_x with the bound of an unknown and by −λ with that of a
row; the solution by the quadratic program of `varint.nlp.kkt`, the active bounds staying active
(Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, §3.2; Büskens
& Maurer, J. Comput. Appl. Math. 120 (2000), §4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from varint.control.active import bounded_integrals, bounded_quantities
from varint.control.neighbourhood import constant_derivatives, kkt_system
from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription
from varint.errors import InputError, SolverError
from varint.nlp.kkt import KktSystem, times
from varint.nlp.solver import SolverResult
from varint.scene.system import parameter_entries

BROKEN = 1e-6  # a bound violated by more than this, in its own units, was softened


@dataclass(frozen=True, eq=False)
class Datum:
    """Something given: its name, the program's constants that hold it, and the unknowns and rows
    whose bounds do.
    """

    name: str
    constants: np.ndarray
    unknowns: np.ndarray
    rows: np.ndarray


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of an optimal control with respect to what was given, the active bounds fixed.

    Attributes
    ----------
    names : tuple of str
        What was varied, k of them.
    cost : ndarray (k,)
        dJ/dθ: positive where the cost grows with θ. Of several phases it is their total cost.
    doubtful : tuple of str
        Bounds met without a multiplier: with them derivatives may differ from side to side, and
        these hold where the bound stays as it was found.

    `q` (N + 1, n, k), `u` (N, r, controls, k), `v_ends` (2, n, k), `duration` (k,) and
    `parameters` (values, k) are the derivatives of the path at its nodes (which keep their share of
    the duration), of the controls and of what else was free. They are solved for when first asked
    for.
    """

    names: tuple[str, ...]
    cost: np.ndarray
    doubtful: tuple[str, ...]
    part: PhaseTranscription
    system: KktSystem
    data: tuple[Datum, ...]
    slopes: tuple

    def __repr__(self) -> str:
        slopes = (f"{name} {x:.6g}" for name, x in zip(self.names, self.cost, strict=True))
        return f"Sensitivity(cost by {', '.join(slopes)})"

    def __str__(self) -> str:
        width = max(map(len, self.names), default=0)
        rows = [f"{name:<{width}}  {x: .9g}" for name, x in zip(self.names, self.cost, strict=True)]
        return "\n".join(["derivative of the cost with respect to", *rows])

    @property
    def q(self) -> np.ndarray:
        """∂q_k/∂θ at the nodes, (N + 1, n, k)."""
        return self._changes[self.part.slots.q]

    @property
    def u(self) -> np.ndarray:
        """∂u/∂θ, (N, r, controls, k)."""
        return self._changes[self.part.slots.u]

    @property
    def v_ends(self) -> np.ndarray:
        """∂v/∂θ at the two ends, (2, n, k)."""
        return self._changes[self.part.slots.v]

    @property
    def duration(self) -> np.ndarray:
        """∂T/∂θ, (k,): of a fixed duration 1 for itself, else 0."""
        return self._shared[1]

    @property
    def parameters(self) -> np.ndarray:
        """∂c/∂θ of the parameter values in the order of ``system.c``, (values, k)."""
        return self._shared[2:]

    @cached_property
    def _shared(self) -> np.ndarray:
        """Changes of t0, T and c."""
        places = self.part.slots.shared
        given = np.array(
            [
                [self.part.first_shared + i in x.constants for x in self.data]
                for i in range(len(places))
            ],
            dtype=float,
        ).reshape(len(places), len(self.data))
        return np.where((places >= 0)[:, None], self._changes[places], given)

    @cached_property
    def _changes(self) -> np.ndarray:
        """∂x/∂θ of all unknowns, (unknowns, k)."""
        _, mixed, by_constant = self.slopes
        count = len(self.data)
        dp = np.zeros((mixed.shape[1], count))
        moved, b = np.zeros((mixed.shape[0], count)), np.zeros((by_constant.shape[0], count))
        for k, datum in enumerate(self.data):
            dp[datum.constants, k], moved[datum.unknowns, k], b[datum.rows, k] = 1.0, 1.0, 1.0
        change = self.system.solve(times(mixed, dp), b - times(by_constant, dp), moved)
        if change is None:
            raise SolverError(
                f"the derivatives of path and controls with respect to {', '.join(self.names)} are "
                "not determined: the solution is no strict minimum (report() says in which "
                "direction), or not all of its active bounds can be kept; those of the cost are. "
                "Ask for some of them by name",
                status="Not_Determined",
            )
        return change


def sensitivity(
    problem: ControlProblem,
    part: PhaseTranscription,
    outcome: SolverResult,
    wrt: Sequence[str],
) -> Sensitivity:
    """Derivatives of a solution with respect to the data named, or to all that was given."""
    nlp, x = outcome.nlp, outcome.x
    if np.maximum(nlp.x_low - x, x - nlp.x_high).max(initial=0.0) > BROKEN:
        raise InputError("this plan violates bounds that were softened: it has no derivative")
    bounds = bound_data(part, outcome)
    known = {datum.name: datum for datum in (*given_data(problem, part, nlp), *bounds)}
    if unknown := [name for name in wrt if not isinstance(name, str) or name not in known]:
        raise InputError(
            f"sensitivity() does not know {unknown}; what was given here is {sorted(known)}"
        )
    chosen = [known[name] for name in wrt] if wrt else list(known.values())
    system, slopes = kkt_system(problem, outcome), constant_derivatives(problem, outcome)
    cost = [
        slopes[0][x.constants].sum() - outcome.lam_x[x.unknowns].sum() - outcome.lam_g[x.rows].sum()
        for x in chosen
    ]
    weak = [
        bound.name
        for bound in bounds
        if system.unknowns.doubtful[bound.unknowns].any() or system.rows.doubtful[bound.rows].any()
    ]
    return Sensitivity(
        tuple(x.name for x in chosen),
        np.array(cost),
        tuple(weak),
        part,
        system,
        tuple(chosen),
        slopes,
    )


def given_data(problem: ControlProblem, part: PhaseTranscription, nlp) -> list[Datum]:
    """Parameters, duration, start time and ends of a phase, as far as they are fixed."""
    phase, slots, first = part.phase, part.slots, part.first_shared
    none = np.zeros(0, dtype=int)
    found = []

    def add(name: str, constants=none, unknowns=none, rows=none) -> None:
        found.append(Datum(name, *(np.atleast_1d(x) for x in (constants, unknowns, rows))))

    for i, name in enumerate(parameter_entries(phase.system)):
        if slots.shared[2 + i] < 0:
            add(name, constants=first + 2 + i)
    later = [x for x in problem.phases if x.first_datum > part.first_datum]
    follow = [x.first_shared for x in later if x.slots.shared[0] < 0]
    if slots.shared[1] < 0:
        add("duration", constants=np.array([first + 1, *follow]))
    if slots.shared[0] < 0:
        add("t0", constants=np.array([first, *follow]))
    conditions = (
        len(part.rows.start) - phase.bounds.at_points.numel() - phase.start.low.size,
        len(part.rows.last) - phase.end.low.size,
    )
    sides = (
        ("start", 0, phase.start, part.rows.start, conditions[0]),
        ("end", 1, phase.end, part.rows.last, conditions[1]),
    )
    for side, k, end, rows, before in sides:
        for letter, names, index in (
            ("q", phase.system.names, slots.q[-k]),
            ("v", phase.system.names, slots.v[k]),
            ("states", phase.states.names(phase.system), slots.states[-k]),
        ):
            for name, i in zip(names, index, strict=True):
                if nlp.x_low[i] == nlp.x_high[i]:
                    add(f"{side}.{letter}.{name}", unknowns=i)
        for j, i in enumerate(end.momenta):
            row = rows[before + j]
            if row >= 0 and nlp.g_low[row] == nlp.g_high[row]:
                add(f"{side}.p.{phase.system.names[i]}", rows=row)
    return found


def bound_data(part: PhaseTranscription, outcome: SolverResult) -> list[Datum]:
    """Bounds along the path, in the words of `active_bounds`, and those on integrals."""
    nlp, none = outcome.nlp, np.zeros(0, dtype=int)
    found: dict[str, Datum] = {}
    for quantity in (*bounded_quantities(part, outcome), *bounded_integrals(part, outcome)):
        places = quantity.places
        if quantity.is_row:
            low, high, pull = nlp.g_low[places], nlp.g_high[places], outcome.lam_g[places]
        else:  # those that an end gives are not held by the bound along the path
            places = places[nlp.x_low[places] < nlp.x_high[places]]
            low, high, pull = nlp.x_low[places], nlp.x_high[places], outcome.lam_x[places]
        both = quantity.low == quantity.high
        for name, bound, sign in quantity.sides():
            held = (high if sign > 0 else low) == bound
            own = places[held & (both | (sign * pull > 0))]
            name = f"{quantity.name} = {bound:g}" if both else name
            before = found.get(name, Datum(name, none, none, none))
            found[name] = Datum(
                name,
                none,
                before.unknowns if quantity.is_row else np.append(before.unknowns, own),
                np.union1d(before.rows, own) if quantity.is_row else before.rows,
            )
    return list(found.values())
