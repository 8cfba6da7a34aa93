"""What belongs to an optimal control beside its trajectory: cost, costates, active bounds, the
solver's way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.control.interval_values import node_costates
from varint.control.phase import CheckedPhase
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem
from varint.control.replay import LARGE, defect, error_estimate, remedy, replay
from varint.control.transcription import PhaseTranscription
from varint.errors import InputError
from varint.nlp.solver import SolverResult
from varint.numerics.plain import field_of, plain
from varint.results.records import Costates
from varint.results.trajectory import Trajectory

# what is asked of some solutions only is loaded when it is: a first solve takes as long as reading
# the code that it needs
if TYPE_CHECKING:
    from varint.control.second_order import SecondOrder
    from varint.control.sensitivity import Sensitivity


class Origin(NamedTuple):
    """A phase, the program it is part of, what the solver returned, and the program's constants
    then.
    """

    transcription: PhaseTranscription
    problem: ControlProblem
    outcome: SolverResult
    constants: np.ndarray

    @property
    def phase(self) -> CheckedPhase:
        """The phase as the user gave it, checked."""
        return self.transcription.phase


@dataclass(frozen=True, eq=False)
class ControlSolution:
    """What belongs to an optimal control beside its trajectory.

    Attributes
    ----------
    cost : float
        Cost of this phase, terminal cost included.
    total_cost : float
        Cost of all phases.
    q, u, costate : Piecewise
        Path, controls and costate of p as functions of the fraction of the duration.
    mesh : ndarray (N + 1,)
        Ends of the steps as fractions of the duration.
    v_ends : ndarray (2, n)
        Velocities at the two ends.
    status, success, violation, iterations, history, timings
        How the solver ended and got there; the largest violation of any condition; cost, violation
        and optimality after each iteration; seconds to build and to solve.
    origin : Origin or None
        The problem and the solver's own numbers, from which a further solve starts warm; None after
        loading a file.
    kept : mapping
        What a file held of `active`.
    held : Costates or None
        What a file held of `costates`.
    verdict : str
        What a file held of `second_order`, in words.
    """

    cost: float
    total_cost: float
    q: Piecewise
    u: Piecewise
    costate: Piecewise
    mesh: np.ndarray
    v_ends: np.ndarray
    status: str
    success: bool
    violation: float
    iterations: int
    history: Mapping[str, list[float]]
    timings: Mapping[str, float]
    origin: Origin | None = None
    kept: Mapping[str, np.ndarray] = field(default_factory=dict)
    held: Costates | None = None
    verdict: str = ""

    def __repr__(self) -> str:
        return f"ControlSolution(cost {self.cost:.9g}, {self.status}, {self.iterations} iterations)"

    def _repr_html_(self) -> str:
        """For notebooks: a short table and the controls."""
        from varint.drawing.notebook import solution_html

        return solution_html(self)

    def __getstate__(self) -> dict[str, Any]:
        """A copy, or what travels to another process, is what a file keeps: without the program
        and its functions.
        """
        state = {f.name: getattr(self, f.name) for f in fields(self)}
        return state | {
            "history": dict(self.history),
            "timings": dict(self.timings),
            "origin": None,
            "kept": self.active,
            "held": self.costates,
            "verdict": self._verdict,
        }

    @property
    def _verdict(self) -> str:
        return self.verdict if self.origin is None else str(self.second_order)

    @cached_property
    def costates(self) -> Costates:
        """Costates at the nodes."""
        if self.origin is None:
            assert self.held is not None
            return self.held
        x = self.origin
        return node_costates(x.problem, x.transcription, x.outcome.x, x.constants, x.outcome.lam_g)

    @cached_property
    def active(self) -> dict[str, np.ndarray]:
        """Bounds along the path that are met with equality, and the times where they are."""
        if self.origin is None:
            return dict(self.kept)
        from varint.control.active import active_bounds

        return active_bounds(self.origin.transcription, self.origin.outcome)

    @cached_property
    def second_order(self) -> SecondOrder:
        """Whether it is a strict minimum: the reduced Hessian along all changes that the active
        bounds allow, and its direction of least curvature.

        Raises
        ------
        InputError
            If the solution was loaded from a file, which does not hold its problem.
        """
        from varint.control.second_order import second_order

        origin = self._origin("second_order")
        return second_order(origin.problem, origin.transcription, origin.outcome)

    def sensitivity(self, *wrt: str) -> Sensitivity:
        """Derivatives of cost, path and controls with respect to what was given, dJ/dθ = ∂L/∂θ,
        the active bounds fixed.

        Parameters
        ----------
        *wrt : str
            Names of parameters, ``"duration"``, ``"t0"``, ends such as ``"start.q.x"``,
            ``"end.v.theta"``, ``"start.p.x"``, ``"end.states.m"``, and bounds in the words of
            `active`, such as ``"force <= 20"``, ``"integral of sq(force) <= 12"``. Default: all
            that was given. Where coordinates and constraints are
            given at one end, only their changes along the constraints mean something.

        Returns
        -------
        Sensitivity
            ``cost`` (k,), ``q`` (N + 1, n, k), ``u`` (N, r, controls, k), ``v_ends``,
            ``duration``, ``parameters``.

        Raises
        ------
        InputError
            If a name is not known or was free, or the solution was loaded from a file.
        SolverError
            When path and controls are asked for and are not determined to second order; see
            `second_order`.

        Notes
        -----
        Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, §3.2.

        Examples
        --------
        The least effort from rest to rest is J = 12 d² / T³.

        >>> import casadi as ca
        >>> import varint as vi
        >>> q, v = vi.coordinates("x")
        >>> force = ca.SX.sym("force")
        >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
        >>> move = vi.optimal_control(
        ...     cart, vi.gauss(2), duration=1, steps=5, cost=force**2,
        ...     q0=0, v0=0, end=dict(q=[1], v=[0]))
        >>> move.solution.sensitivity("end.q.x", "duration").cost.round(6)
        array([ 24., -36.])
        """
        from varint.control.sensitivity import sensitivity

        origin = self._origin("sensitivity()")
        part, outcome = origin.transcription, origin.outcome
        return sensitivity(origin.problem, part, outcome, wrt)

    def _origin(self, what: str) -> Origin:
        if self.origin is None:
            raise InputError(
                f"{what}: this solution was loaded from a file or copied, which does not hold its "
                "problem; solve it with guess=motion"
            )
        return self.origin

    def replay(self, motion: Trajectory) -> Trajectory:
        """`simulate` from the optimal start with the optimal controls: the same motion to
        round-off.
        """
        return replay(motion)

    def again(self, motion: Trajectory) -> Any:
        """The problem with its solver, to be called with other numbers; see `Trajectory.again`."""
        if self.origin is None:
            raise InputError(
                "this motion was loaded from a file, which does not hold its problem; solve it "
                "with optimal_control(…, guess=motion)"
            )
        problem = self.origin.problem
        if problem.again is None:
            raise InputError("this motion's problem has no solver of its own; use what solved it")
        return problem.again(motion, problem)

    def report(self, motion: Trajectory) -> str:
        """Status, cost, violation, replay defect, balance of energy and of momenta, active
        bounds.
        """
        from varint.control.balances import energy_balance, momentum_balance
        from varint.control.swings import CURE, swinging_controls

        shared = (
            f" of {self.total_cost:.12g}"
            if abs(self.total_cost - self.cost) > 1e-12 * abs(self.cost)
            else ""
        )
        lines = [
            f"optimal control by {motion.rule}, {len(self.mesh) - 1} steps, duration "
            f"{motion.duration:.12g}",
            f"  status               {self.status} after {self.iterations} iterations",
            f"  cost                 {self.cost:.12g}{shared}",
            f"  constraint violation {self.violation:.1e}",
            f"  replay defect        {defect(motion, replay(motion)):.1e}",
            f"  error of the path    {error_in_words(motion, self.u)}",
            *(
                f"  beyond a bound       {name} by {x:.1e} of its range, between the nodes"
                for name, x in motion.stats.get("beyond", {}).items()
            ),
            f"  time                 {self.timings['build']:.3f} s to build, "
            f"{self.timings['solve']:.3f} s to solve",
        ]
        if verdict := self._verdict:
            lines.append(f"  second order         {verdict}")
        gained, work = energy_balance(motion, self.q)
        lines.append(f"  energy               gained {gained:.9g}, work of the forces {work:.9g}")
        for name, change, impulse in momentum_balance(motion, self.q):
            lines.append(
                f"  {name}: momentum gained {change:.9g}, impulse of the force {impulse:.9g}"
            )
        if start := motion.stats.get("start"):
            lines.append(f"  start                {start}")
        if starts := motion.stats.get("starts"):
            costs = ", ".join(f"{cost:.6g}" for cost in starts)
            lines.append(
                f"  starts               costs of the minima found near the first start: {costs}; "
                "multistart looks further"
            )
        elif not motion.system.structure.linear:
            lines.append(
                "  minimum              one near the start; other guesses or numbers of steps may "
                "lead to others, multistart looks for them"
            )
        for i, at in swinging_controls(self.u).items():
            times = motion.t[0] + motion.duration * at
            lines.append(
                f"  swings               {motion.system.control_names[i]} goes up and down from "
                f"node to node, {times[0]:.4g} … {times[-1]:.4g}: only its mean matters there; "
                f"{CURE[len(self.u.points) > 1]} makes it smooth"
            )
        for bound, size in motion.stats.get("softened", {}).items():
            lines.append(f"  softened             {bound} its bound, violated by {size:.3g}")
        for bound, times in self.active.items():
            lines.append(
                f"  active               {bound}: {len(times)} times, {times[0]:.4g} … "
                f"{times[-1]:.4g}"
            )
        return "\n".join(lines)

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What a file keeps: numbers and words, and arrays; `from_arrays` reads them."""
        header: dict[str, Any] = {
            name: plain(getattr(self, name)) for name in (*PLAIN, "history", "timings")
        }
        header |= {"active": list(self.active), "verdict": self._verdict}
        arrays = {
            "mesh": self.mesh,
            "v_ends": self.v_ends,
            "mu_q": self.costates.q,
            "mu_p": self.costates.p,
        }
        for name in PIECES:
            piece = getattr(self, name)
            arrays |= {f"{name}_points": piece.points, f"{name}_values": piece.values}
        return header, arrays | {
            f"active_{i}": times for i, times in enumerate(self.active.values())
        }


def error_in_words(motion: Trajectory, controls: Piecewise) -> str:
    """The estimate made when the problem was solved, or one made now; what to do if it is large."""
    known = motion.stats.get("error_estimate")
    error = error_estimate(motion, controls) if known is None else float(known)
    cure = f": too coarse, {remedy([motion])}" if error > LARGE else ""
    return f"{error:.1e} of its range, by a replay in quarter steps{cure}"


PIECES = ("q", "u", "costate")
PLAIN = {
    "cost": float,
    "total_cost": float,
    "status": str,
    "success": bool,
    "violation": float,
    "iterations": int,
}


def from_arrays(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> ControlSolution:
    """A solution from what `ControlSolution.to_arrays` kept; a further solve can start from its
    path and controls.

    Raises
    ------
    InputError
        If something is missing or does not fit together.
    """
    active = field_of(header, "active", list[str])
    timings = field_of(header, "timings", dict[str, float])
    if missing := {"build", "solve"} - timings.keys():
        raise InputError(f"the timings of the control have no {sorted(missing)}")
    mesh = _held(arrays, "mesh", 1)
    if len(mesh) < 2:
        raise InputError("the mesh of the control has no step")
    pieces: dict[str, Any] = {
        name: Piecewise(
            mesh, _held(arrays, f"{name}_points", 1), _held(arrays, f"{name}_values", 3)
        )
        for name in PIECES
    }
    for name, piece in pieces.items():
        if piece.values.shape[:2] != (len(mesh) - 1, len(piece.points)):
            raise InputError(f"{name} of the control has values of shape {piece.values.shape}")
    return ControlSolution(
        **{name: field_of(header, name, kind) for name, kind in PLAIN.items()},
        **pieces,
        mesh=mesh,
        v_ends=_held(arrays, "v_ends", 2),
        held=Costates(_held(arrays, "mu_q", 2), _held(arrays, "mu_p", 2)),
        history=MappingProxyType(field_of(header, "history", dict[str, list[float]])),
        timings=MappingProxyType(timings),
        verdict=field_of({"verdict": "", **header}, "verdict", str),
        kept={name: _held(arrays, f"active_{i}", 1) for i, name in enumerate(active)},
    )


def _held(arrays: Mapping[str, np.ndarray], name: str, dimensions: int) -> np.ndarray:
    array = arrays.get(name)
    if array is None or array.ndim != dimensions or array.dtype.kind != "f":
        raise InputError(f"{name} of the control is missing, or no {dimensions}-dimensional array")
    return array
