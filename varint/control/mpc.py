"""Model predictive control: one problem built once, solved again and again from new states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from varint.control.build import build_control_solver
from varint.control.controller import Controller
from varint.control.guess import build_start
from varint.control.phase import Phase, start_of
from varint.control.problem import transcribe
from varint.discrete.lagrangian import point_function
from varint.errors import InputError, SolverError
from varint.integration.simulate import simulate
from varint.nlp.solver import choose_backend
from varint.numerics.limits import check_memory
from varint.results.trajectory import Trajectory
from varint.scene.inputs import finite_array, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import given_parameters, parameters_by_name

SOLVES = 500  # of one controller, about: what compiling its kernels is weighed against


def mpc(
    phase: Phase,
    *,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> Controller:
    """A controller that looks ahead: build the problem once, solve it from each new state in
    milliseconds.

    Parameters
    ----------
    phase : Phase
        The problem over the horizon: system, rule, duration, steps, costs, end, bounds; leave the
        start free.
    solver, options, backend
        As in `optimal_control`.

    Returns
    -------
    Controller
        Call it with a state: ``controller(q, v, previous)``; a state outside its bounds is no
        error.

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
    >>> cost = q**2 + v**2 + force**2
    >>> ahead = vi.Phase(cart, vi.gauss(2), 3.0, 15, cost, bounds=[(-1, force, 1)])
    >>> controller = vi.mpc(ahead)
    >>> round(float(controller([2.0], [0.0]).u[0, 0, 0]), 6)
    -1.0
    """
    if not isinstance(phase, Phase):
        raise InputError(f"mpc takes a varint.Phase, got {type(phase).__name__}")
    start = start_of(phase)
    if start or not isinstance(start, Mapping):
        raise InputError(
            "mpc() gets its start with every call; leave start=, q0=, v0= and p0= out of the phase"
        )
    if phase.states:
        raise InputError(
            "mpc() starts from coordinates and velocities; states= beside the mechanics have no "
            "measured start there. Solve again by prepare(phase)(start=…, guess=…)"
        )
    problem = transcribe([phase], [], 0.0, choose_backend(solver, backend), SOLVES, True)
    x = build_start(problem)
    own = options if solver == "ipopt" else None
    return Controller(problem, build_control_solver(problem, x, solver, options), x, own)


def closed_loop(
    controller: Controller,
    q0: Any,
    v0: Any,
    steps: int,
    *,
    plant: Any = None,
    disturbance: Any = None,
    params: ParameterValues | Callable[[float], ParameterValues] | None = None,
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
        The scene that really moves, with the same coordinates and controls; default: the
        controller's own.
    disturbance : array (steps, n), optional
        Added to the momentum after each step.
    params : dict or function of t, optional
        Parameter values for the controller, such as a set-point that moves; without a plant of its
        own also for what moves.

    Returns
    -------
    motion : Trajectory
        ``u`` holds the controls applied. Where ``params`` change with time its parameters are those
        at its start, and its momenta those of its velocities with them.
    plans : list of Trajectory
        Where bounds on states had to be violated, ``stats["softened"]`` says by how much.

    Raises
    ------
    InputError
        If the input does not fit the controller.
    SolverError
        If no plan is found at some time; its ``iterate`` is the motion until then.
    """
    if not isinstance(controller, Controller):
        raise InputError(
            f"closed_loop takes a controller made by mpc(), got {type(controller).__name__}"
        )
    phase = controller.problem.phases[0].phase
    n, names = phase.system.structure.n, phase.system.names
    steps = positive_integer("steps", steps)
    check_memory(f"a loop of {steps} steps", steps * n, "take fewer steps")
    kicks = (
        np.zeros((steps, n)) if disturbance is None else finite_array("disturbance", disturbance)
    )
    if kicks.shape != (steps, n):
        raise InputError(
            f"disturbance must be finite numbers ({steps}, {n}), one row a step; got shape "
            f"{kicks.shape}"
        )
    h = phase.duration[0] * float(phase.mesh[1])
    known = parameters_by_name(phase.system, phase.c)

    def now(t: float) -> dict[str, Any]:
        """The controller's parameters at time t."""
        given = params(t) if callable(params) else params
        return {**known, **given_parameters(phase.system, given)}

    def move(q: np.ndarray, k: int, u: np.ndarray, v0: Any = None, p0: Any = None) -> Trajectory:
        system, own = (phase.system, now(k * h)) if plant is None else (plant, None)
        return simulate(
            system, phase.rule, q0=q, v0=v0, p0=p0, h=h, steps=1, t0=k * h, u=u, params=own
        )

    plans: list[Trajectory] = []
    q, v = vector("q0", q0, n, names), vector("v0", v0, n, names)
    u: list[np.ndarray] = []
    nodes = [move(q, 0, _rest(phase), v0=v)[:1]]
    for k in range(steps):
        given = None if params is None else now(k * h)
        try:
            plans.append(controller(q, v, plans[-1] if plans else None, k * h, given))
        except SolverError as error:
            raise SolverError(
                f"no plan at t = {k * h:.6g}, step {k} of {steps}: {error}. Here error.iterate is "
                "the motion until then",
                status=error.status,
                iterate=_join(nodes, np.array(u), h) if u else nodes[0],
            ) from error
        u.append(plans[-1].u[0])
        moved = move(q, k, u[-1][None] if u[-1].shape[0] > 1 else u[-1], v0=v)
        if kicks[k].any():
            moved = move(moved.q[-1], k + 1, _rest(phase), p0=moved.p[-1] + kicks[k])[:1]
        q, v = moved.q[-1], moved.v[-1]
        nodes.append(moved[-1:])
    return _join(nodes, np.array(u), h), plans


def _rest(phase) -> np.ndarray:
    return np.zeros((1, phase.system.structure.controls))


def _join(nodes: list[Trajectory], u: np.ndarray, h: float) -> Trajectory:
    k, first = np.arange(len(nodes)), nodes[0]
    q, p = (np.concatenate([getattr(node, x) for node in nodes]) for x in "qp")
    for i, node in enumerate(nodes):
        if not np.array_equal(node.c, first.c):  # a motion has one set of parameters
            moving = point_function(first.system)(node.q[-1], node.v[-1], 0, node.t[-1], first.c)
            p[i] = np.asarray(moving[1]).ravel()
    return replace(first, t=h * k, q=q, p=p, k=k, u=u, h=h)
