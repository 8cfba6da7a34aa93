"""Optimal control: the cheapest motion that discrete mechanics allows."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from varint.control import nlp
from varint.control.guess import start_values
from varint.control.links import Link
from varint.control.nlp import Outcome
from varint.control.phase import Phase
from varint.control.problem import Problem, problem
from varint.control.solution import trajectories
from varint.control.warm import start_multipliers
from varint.errors import InputError, SolverError, converted
from varint.horizon import Free
from varint.parameters import number
from varint.rules import Rule
from varint.system import System
from varint.trajectory import Trajectory


def optimal_control(
    system: System,
    rule: Rule | None = None,
    *,
    duration: float | Free,
    steps: int = 0,
    cost: Any = 0,
    terminal_cost: Any = 0,
    start: Mapping[str, Any] | None = None,
    end: Mapping[str, Any] | None = None,
    bounds: Sequence[tuple[Any, Any, Any]] = (),
    control: str = "nodes",
    params: Mapping[str, Any] | None = None,
    guess: Any = None,
    mesh: Any = None,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
    progress: bool | None = None,
) -> Trajectory:
    """Controls of least cost ∫ cost dt + terminal_cost under discrete mechanics, p⁺_{k−1} = p⁻_k (DMOC).

    Parameters
    ----------
    system : System
        A scene with controls; constraints need a Lobatto rule.
    rule : Rule, optional
        Default: `gauss(2)`, with constraints `lobatto(3)`.
    duration : float or Free
        T, or ``free(guess, lower, upper)``.
    steps : int
        Number of steps N.
    cost, terminal_cost : SX
        Running cost, of q, v, u, t and the parameters, and cost at the end, of q, v, t; for a minimum time
        ``terminal_cost=system.t`` or ``cost=1``.
    start, end : dict, optional
        ``q=``, ``v=``, ``p=``: n entries each, a number, None (free) or ``free(guess, lower, upper)``; ``bounds=``:
        list of (lower, expression of q, v, t, upper); at the end also ``periodic=True`` or offsets (n,): q and v end
        as they began, plus the offset. Whatever is not given is free.
    bounds : list of (lower, expression, upper), optional
        Along the path. A coordinate or expression of q and t is held at all control points, an expression of
        velocities or controls at the quadrature nodes. None is no bound.
    control : {"nodes", "constant"}
        A value of each control at every quadrature node (keeps the rule's order), or one a step.
    params : dict, optional
        Parameter values; ``free(…)`` makes a parameter an unknown.
    guess : Trajectory or dict, optional
        Where to start: any trajectory (a previous solution starts warm), or ``q=``, ``u=`` as samples (M, n) evenly
        spaced or functions of t. Default: a straight line, with the controls that come closest to it.
    mesh : array (N + 1,), optional
        Ends of the steps as fractions of the duration, instead of `steps` equal ones.
    t0 : float
        Start time.
    solver : str
        Name of a CasADi NLP solver. ``"fatrop"`` gets the problem as a chain of stages (one phase, not periodic).
    options : dict, optional
        Options for `casadi.nlpsol`, verbatim, for instance ``{"ipopt": {"max_iter": 100}}``.
    backend : {"auto", "compiled", "interpreted"}
        How the kernels of the program run: ``"auto"`` compiles them where it pays and a compiler is there.
    progress : bool, optional
        Show the iterations. Default: in a terminal, when it takes longer than a second.

    Returns
    -------
    Trajectory
        With ``u`` (N, r, k), ``cost``, ``costates``, ``replay()``, ``report()`` and ``solution``.

    Raises
    ------
    InputError
        If the problem is not well posed; the message says what to change.
    SolverError
        If the solver does not find a solution: its status in words, and the last iterate.

    Notes
    -----
    Ober-Blöbaum, Junge, Marsden, Discrete mechanics and optimal control, ESAIM: COCV 17 (2011), §3.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> move = vi.optimal_control(
    ...     cart, vi.gauss(2), duration=1, steps=5, cost=force**2, start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    >>> round(move.cost, 9)
    12.0
    """
    phase = Phase(system, rule, duration, steps, cost, terminal_cost, start, end, bounds, control, params, guess, mesh)
    return optimal_phases([phase], t0=t0, solver=solver, options=options, backend=backend, progress=progress)[0]


def optimal_phases(
    phases: Sequence[Phase],
    links: Sequence[Link] | None = None,
    *,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
    progress: bool | None = None,
) -> list[Trajectory]:
    """Several motions in one problem, Σ cost → min, tied by links.

    Parameters
    ----------
    phases : sequence of Phase
        Each with its own system, rule, mesh, duration, cost, ends and bounds.
    links : sequence of Link, optional
        Default: each phase continues where the one before ended.
    t0, solver, options, backend, progress
        As in `optimal_control`.

    Returns
    -------
    list of Trajectory
        One a phase.

    Raises
    ------
    InputError, SolverError
        As in `optimal_control`.
    """
    phases = converted(lambda: list(phases), lambda: f"optimal_phases takes a list of varint.Phase, got {phases!r}")
    if not phases or not all(isinstance(phase, Phase) for phase in phases):
        raise InputError("optimal_phases takes a list of varint.Phase, at least one")
    ties = [Link(i, i + 1) for i in range(len(phases) - 1)] if links is None else links
    return solved(problem(phases, ties, number("t0", t0), nlp.backend_for(solver, backend)), solver, options, progress)


def solved(one: Problem, name: str, options: Mapping[str, Any] | None, progress: bool | None) -> list[Trajectory]:
    """Build the solver, solve from the guess, judge the end."""
    x = start_values(one)
    run = nlp.solver(one, x, name, options)
    multipliers = start_multipliers(one)
    outcome = run(x, multipliers, progress=progress)
    if multipliers is not None and not outcome.success and not outcome.stopped:
        outcome = run(x, progress=progress)  # multipliers of another problem can mislead
    return judged(one, outcome)


FEASIBLE = 1e-6  # a row or bound violated by more is violated


def judged(one: Problem, outcome: Outcome) -> list[Trajectory]:
    """The trajectories, or an error in words."""
    found = trajectories(one, outcome)
    if outcome.stopped:
        warnings.warn(f"stopped on request after {len(outcome.history.get('cost', ()))} iterations", stacklevel=4)
        return found
    if outcome.success and outcome.violation <= FEASIBLE:
        return found
    status = outcome.status.removeprefix("EXIT: ")
    words = nlp.WORDS.get(status, "no solution was found from this guess")
    raise SolverError(
        f"{status}: {words}. Largest violation of a condition: {outcome.violation:.1e}; "
        "error.iterate is the last iterate",
        status=status,
        iterate=found[0] if len(found) == 1 else found,
    )
