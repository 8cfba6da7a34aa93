"""Model predictive control: one problem built once, solved again and again from new states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.arrays import over_columns
from varint.control import nlp
from varint.control.guess import start_values
from varint.control.leg import Leg
from varint.control.onto import gaps_function
from varint.control.optimal import judged
from varint.control.phase import Phase
from varint.control.problem import Problem, problem
from varint.control.solution import trajectories
from varint.errors import InputError
from varint.grid import affordable, checked_steps
from varint.manifold import rows_function
from varint.parameters import finite_array, number, whole
from varint.stepping.initial import vector
from varint.stepping.simulate import simulate
from varint.trajectory import Trajectory

SOLVES = 500  # of one controller, about: what compiling its kernels is weighed against


@dataclass(frozen=True, eq=False)
class Controller:
    """A problem that is solved from any start; see `mpc`."""

    problem: Problem
    solver: nlp.Solver
    start: np.ndarray

    def __call__(self, q: Any, v: Any, previous: Trajectory | None = None, t: float | None = None) -> Trajectory:
        """The optimal motion from (q, v), warm from the previous one, which began one step earlier.

        Parameters
        ----------
        q, v : array (n,)
            The state now.
        previous : Trajectory, optional
            The last answer of this controller.
        t : float, optional
            Time now, for scenes that depend on time.

        Returns
        -------
        Trajectory
            ``u[0]`` are the controls to apply in the step that begins now.

        Raises
        ------
        InputError
            If the state has the wrong shape or lies outside the bounds.
        SolverError
            If no control is found.
        """
        one, now = self.problem.legs[0], 0.0 if t is None else number("t", t)
        if t is not None:
            checked_steps(now, one.phase.shortest_step, 1)
        n, names = one.phase.system.structure.n, one.phase.system.names
        low, high = self.problem.x_low.copy(), self.problem.x_high.copy()
        for what, value, slot in (("q", q, one.slots.q[0]), ("v", v, one.slots.v[0])):
            state = vector(what, value, n, names)
            outside = (state < low[slot]) | (state > high[slot])
            if outside.any():
                raise InputError(f"{what} of {np.array(names)[outside].tolist()} lies outside its bounds: {state}")
            low[slot] = high[slot] = state
        _on_constraints(one, low[one.slots.q[0]], low[one.slots.v[0]], now)
        data = self.problem.p.copy()
        if t is not None:
            data[2 * one.phase.steps] = now
        x, multipliers = self.start, None
        if previous is not None:
            origin = getattr(getattr(previous, "solution", None), "origin", None)
            if origin is None or len(origin.outcome.x) != self.problem.unknowns:
                raise InputError("previous= takes the last answer of this controller")
            outcome = origin.outcome
            x = _shifted_unknowns(one, outcome.x)
            multipliers = _shifted_unknowns(one, outcome.lam_x), _shifted_rows(one, outcome.lam_g)
        outcome = self.solver(np.clip(x, low, high), multipliers, x_low=low, x_high=high, p=data, progress=False)
        if not outcome.success and multipliers is not None:
            outcome = self.solver(np.clip(x, low, high), x_low=low, x_high=high, p=data, progress=False)
        if outcome.success:
            return trajectories(self.problem, outcome, data)[0]
        return judged(self.problem, outcome)[0]


OFF = 1e-6  # of the state's size: a simulated state is closer to its constraints


def _on_constraints(one: Leg, q: np.ndarray, v: np.ndarray, t: float) -> None:
    """The state must be one that the constraints allow."""
    s = one.phase.system
    if not s.structure.constraints:
        return
    gap = over_columns(gaps_function(s), q[None], np.array([[t]]), one.phase.c)[0]
    hidden = over_columns(rows_function(s), q[None], v[None], np.array([[t]]), one.phase.c)[0]
    for what, rows, size in (("q violates constraint", gap, q), ("v violates G v = 0 of constraint", hidden, v)):
        for i in np.flatnonzero(np.abs(rows[0]) > OFF * (1 + np.abs(size).max())):
            raise InputError(f"the state's {what} {i} by {rows[0, i]:.3g}; vi.project brings a state onto constraints")


def mpc(
    phase: Phase, *, solver: str = "ipopt", options: Mapping[str, Any] | None = None, backend: str = "auto"
) -> Controller:
    """A controller that looks ahead: build the problem once, solve it from each new state in milliseconds.

    Parameters
    ----------
    phase : Phase
        The problem over the horizon: system, rule, duration, steps, costs, end, bounds; leave the start free.
    solver, options, backend
        As in `optimal_control`.

    Returns
    -------
    Controller
        Call it with a state: ``controller(q, v, previous)``.

    Raises
    ------
    InputError
        If the problem is not well posed or its start is given.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> ahead = vi.Phase(cart, vi.gauss(2), 3.0, 15, q**2 + v**2 + force**2, bounds=[(-1, force, 1)])
    >>> controller = vi.mpc(ahead)
    >>> round(float(controller([2.0], [0.0]).u[0, 0, 0]), 6)
    -1.0
    """
    if not isinstance(phase, Phase):
        raise InputError(f"mpc takes a varint.Phase, got {type(phase).__name__}")
    if phase.start is not None and not (isinstance(phase.start, Mapping) and not phase.start):
        raise InputError("mpc() gets its start with every call; leave start= out of the phase")
    one = problem([phase], [], 0.0, nlp.backend_for(solver, backend), SOLVES, True)
    x = start_values(one)
    return Controller(one, nlp.solver(one, x, solver, options), x)


def closed_loop(
    controller: Controller, q0: Any, v0: Any, steps: int, *, plant: Any = None, disturbance: Any = None
) -> tuple[Trajectory, list[Trajectory]]:
    """Apply a controller for some steps: the motion of the plant, and the plans it followed.

    Parameters
    ----------
    controller : Controller
    q0, v0 : array (n,)
        Start.
    steps : int
        Number of steps of the controller's own size.
    plant : System, optional
        The scene that really moves, with the same coordinates and controls; default: the controller's own.
    disturbance : array (steps, n), optional
        Added to the momentum after each step.

    Returns
    -------
    motion : Trajectory
        ``u`` holds the controls applied.
    plans : list of Trajectory
    """
    if not isinstance(controller, Controller):
        raise InputError(f"closed_loop takes a controller made by mpc(), got {type(controller).__name__}")
    phase, n = controller.problem.legs[0].phase, controller.problem.legs[0].phase.system.structure.n
    steps = whole("steps", steps)
    affordable(f"a loop of {steps} steps", steps * n, "take fewer steps")
    kicks = np.zeros((steps, n)) if disturbance is None else finite_array("disturbance", disturbance)
    if kicks.shape != (steps, n):
        raise InputError(f"disturbance must be finite numbers ({steps}, {n}), one row a step; got shape {kicks.shape}")
    system = phase.system if plant is None else plant
    h = phase.duration[0] * float(phase.mesh[1])
    plans: list[Trajectory] = []
    q, v, u = vector("q0", q0, n, phase.system.names), vector("v0", v0, n, phase.system.names), []
    nodes = [simulate(system, phase.rule, q0=q, v0=v, h=h, steps=1, u=_rest(phase))[:1]]
    for k in range(steps):
        plans.append(controller(q, v, plans[-1] if plans else None, k * h))
        u.append(plans[-1].u[0])
        applied = u[-1][None] if u[-1].shape[0] > 1 else u[-1]
        moved = simulate(system, phase.rule, q0=q, v0=v, h=h, steps=1, t0=k * h, u=applied)
        if kicks[k].any():
            p = moved.p[-1] + kicks[k]
            moved = simulate(system, phase.rule, q0=moved.q[-1], p0=p, h=h, steps=1, t0=(k + 1) * h, u=_rest(phase))[:1]
        q, v = moved.q[-1], moved.v[-1]
        nodes.append(moved[-1:])
    return _joined(nodes, np.array(u), h), plans


def _rest(phase) -> np.ndarray:
    return np.zeros((1, phase.system.structure.controls))


def _joined(nodes: list[Trajectory], u: np.ndarray, h: float) -> Trajectory:
    k = np.arange(len(nodes))
    q, p = (np.concatenate([getattr(node, x) for node in nodes]) for x in "qp")
    return replace(nodes[0], t=h * k, q=q, p=p, k=k, u=u, h=h)


def _shifted_unknowns(one: Leg, x: np.ndarray) -> np.ndarray:
    """Unknowns one step later; the last step is repeated."""
    moved = x.copy()
    s = one.slots
    for index in (s.q, s.lam, s.u, s.inner, s.lam_inner):
        moved[index[:-1]] = x[index[1:]]
    moved[s.v[0]] = x[s.v[0]]
    return moved


def _shifted_rows(one: Leg, lam: np.ndarray) -> np.ndarray:
    moved, r = lam.copy(), one.rows
    for index in (r.momentum, r.inner, r.gaps, r.nodes, r.points):
        old, new = index[1:], index[:-1]
        both = (old >= 0) & (new >= 0)
        moved[new[both]] = lam[old[both]]
    return moved
