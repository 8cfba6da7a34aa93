"""Optimal control: the cheapest motion that discrete mechanics allows."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from varint.control.excess import FAR, excess_between_nodes
from varint.control.kinks import warn_of_kinks
from varint.control.links import Link, default_links
from varint.control.phase import Phase
from varint.control.problem import transcribe
from varint.control.replay import LARGE, error_estimate, remedy
from varint.control.saddles import warn_of_saddle
from varint.control.solve import Callback, solve
from varint.errors import InputError, parsed_or_refused
from varint.nlp.slacks import Soft
from varint.nlp.solver import choose_backend
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.free import Free
from varint.scene.inputs import number
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def optimal_control(
    system: System,
    rule: Rule | None = None,
    *,
    duration: float | Free,
    steps: int = 0,
    cost: Any = 0,
    terminal_cost: Any = 0,
    q0: Any = None,
    v0: Any = None,
    p0: Any = None,
    start: Mapping[str, Any] | None = None,
    end: Mapping[str, Any] | None = None,
    bounds: Sequence[tuple[Any, Any, Any] | Soft] = (),
    control: str = "nodes",
    params: ParameterValues | None = None,
    guess: Any = None,
    mesh: Any = None,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
    progress: bool | None = None,
    integral: Sequence[tuple[Any, Any, Any]] = (),
    states: Mapping[Any, Any] | None = None,
    callback: Callable[[int, float, float, Any], Any] | None = None,
    closed: Sequence[int] = (),
) -> Trajectory:
    """Controls of least cost ∫ cost dt + terminal_cost under discrete mechanics, p⁺_{k−1} = p⁻_k
    (DMOC).

    Parameters
    ----------
    system : System
        A scene with controls; constraints need a Lobatto rule, non-holonomic rows `midpoint` or
        `trapezoidal`.
    rule : Rule, optional
        Default: `gauss(2)`, with constraints `lobatto(3)`, with non-holonomic rows `midpoint()`
        (`trapezoidal()` with both).
    duration : float or Free
        T, or ``free(guess, lower, upper)``.
    steps : int
        Number of steps N.
    cost, terminal_cost : SX
        Running cost, of q, v, u, t and the parameters, and cost at the end, of q, v, t; for a
        minimum time ``terminal_cost=system.t`` or ``cost=1``. |x| and largest values are
        `vi.abs` and `vi.max`.
    q0, v0, p0 : array (n,), optional
        Start coordinates, and velocities or momenta, as for `simulate`; an entry may also be None
        (free) or ``free(guess, lower, upper)``. Short for ``start=dict(q=…, v=…, p=…)``.
    start, end : dict, optional
        ``q=``, ``v=``, ``p=``: n entries each, a number, None (free) or ``free(guess, lower,
        upper)``; ``bounds=``: list of (lower, expression of q, v, t, upper); at the end also
        ``periodic=True`` or offsets (n,): q and v end as they began, plus the offset. Whatever is
        not given is free.
    bounds : list of (lower, expression, upper), optional
        Along the path. A coordinate or expression of q and t is held at all control points, an
        expression of velocities or controls at the quadrature nodes. None is no bound. An entry
        ``soft(expression, lower, upper, weight)`` may be violated at a price.
    control : {"nodes", "constant", "linear"}
        A value of each control at every quadrature node (keeps the rule's order), one a step, or
        one at every end of a step and a straight line between them. The last two have a
        `control_rate` for cost and bounds.
    params : dict, optional
        Parameter values by name or symbol; ``free(…)`` makes a parameter an unknown.
    guess : Trajectory or dict, optional
        Where to start: any trajectory (a previous solution starts warm), or ``q=``, ``u=`` as
        samples (M, n) evenly spaced or functions of t. Default: a straight line, with the controls
        that come closest to it.
    mesh : array (N + 1,), optional
        Ends of the steps as fractions of the duration, instead of `steps` equal ones.
    t0 : float
        Start time.
    solver : str
        Name of a CasADi NLP solver. ``"fatrop"`` gets the problem as a chain of stages (one phase,
        not periodic).
    options : dict, optional
        Options for `casadi.nlpsol`, verbatim, for instance ``{"ipopt": {"max_iter": 100}}``.
    backend : {"auto", "compiled", "interpreted"}
        How the kernels of the program run: ``"auto"`` compiles them where it pays and a compiler is
        there.
    progress : bool, optional
        Show the iterations. Default: in a terminal, when it takes longer than a second.
    integral : list of (lower, expression, upper), optional
        Bounds on ∫ expression dt over the motion, expressions as in the running cost.
    states : dict, optional
        Controls of the system that obey dx/dt = f, ``{mass: -thrust / c}``: states beside the
        mechanics, such as a mass that burns, collocated at the nodes of the rule. ``start`` and
        ``end`` take their values as ``states={mass: 1.0}``; ``stats["states"]`` has them at the
        nodes of the path, ``u`` at the quadrature nodes.
    callback : callable, optional
        (iteration, cost, violation, path) of every iterate (Ipopt): the largest violation of a
        condition, and the path as a Trajectory. What it returns stops the solver if it is true.
        `live_plot` draws them.
    closed : sequence of int, optional
        Numbers of the system's contacts that are closed during the motion and only push; the
        others stay open, gap ≥ 0. See `optimal_phases` for contacts that close and open.

    Returns
    -------
    Trajectory
        With ``u`` (N, r, k), ``cost``, ``costates``, ``replay()``, ``report()`` and ``solution``.
        ``stats["error_estimate"]`` is how far the controls, replayed in quarter steps, lead away
        from the path, relative to the range of each coordinate; a warning is given where that is
        above 0.01. ``stats["beyond"]`` has what goes beyond bounds on velocities between the
        quadrature nodes, if anything does, by name and relative to its range; above 0.1 a warning
        is given.

    Raises
    ------
    InputError
        If the problem is not well posed; the message says what to change.
    SolverError
        If the solver does not find a solution: its status in words, and the last iterate.

    Notes
    -----
    What is found is a minimum near the start. Where the equations of motion are not linear, as in
    swing-ups, there are others as a rule: from the default start the cost may jump as `steps` grow,
    for another one is met. `multistart` tries many starts; a solution on few steps as the guess of
    one on more stays with its minimum as a rule.

    Ober-Blöbaum, Junge, Marsden, Discrete mechanics and optimal control, ESAIM: COCV 17 (2011), §3.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> move = vi.optimal_control(
    ...     cart, vi.gauss(2), duration=1, steps=5, cost=force**2,
    ...     q0=0, v0=0, end=dict(q=[1], v=[0]))
    >>> round(move.cost, 9)
    12.0
    """
    phase = Phase(
        system,
        rule,
        duration,
        steps,
        cost,
        terminal_cost,
        start,
        end,
        bounds,
        control,
        params,
        guess,
        mesh,
        q0,
        v0,
        p0,
        integral,
        states,
        closed,
    )
    told = callback if callback is None else _single(_require_callback(callback, solver))
    found = solve_phases([phase], None, t0, solver, options, backend, progress, told)
    return assess(found, stacklevel=3)[0]


def _require_callback(callback: Any, solver: str) -> Callable[..., Any]:
    if callable(callback) and solver == "ipopt":
        return callback
    raise InputError(
        "callback must be a function of (iteration, cost, violation, path), and "
        f'solver="ipopt" calls it; got {callback!r} and solver={solver!r}'
    )


def _single(callback: Callable[..., Any]) -> Callable[..., Any]:
    """A callback that gets the only path of a list."""
    return lambda iteration, cost, violation, paths: callback(iteration, cost, violation, paths[0])


def optimal_phases(
    phases: Sequence[Phase],
    links: Sequence[Link] | None = None,
    *,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
    progress: bool | None = None,
    callback: Callable[[int, float, float, list[Trajectory]], Any] | None = None,
) -> list[Trajectory]:
    """Several motions in one problem, Σ cost → min, tied by links.

    Parameters
    ----------
    phases : sequence of Phase
        Each with its own system, rule, mesh, duration, cost, ends and bounds; with ``closed=``
        numbers of the contacts that are closed in it.
    links : sequence of Link, optional
        Default: each phase continues where the one before ended; contacts and constraints that
        begin to hold there stop the motion across them, a plastic impact.
    t0, solver, options, backend, progress, callback
        As in `optimal_control`; the callback gets the paths of all phases as a list.

    Returns
    -------
    list of Trajectory
        One a phase.

    Raises
    ------
    InputError, SolverError
        As in `optimal_control`.
    """
    found = solve_phases(phases, links, t0, solver, options, backend, progress, callback)
    return assess(found, stacklevel=3)


def solve_phases(
    phases: Sequence[Phase],
    links: Sequence[Link] | None,
    t0: float,
    solver: str,
    options: Mapping[str, Any] | None,
    backend: str,
    progress: bool | None,
    callback: Callback | None = None,
) -> list[Trajectory]:
    """`optimal_phases` without a judgement of its accuracy."""
    phases = parsed_or_refused(
        lambda: list(phases), lambda: f"optimal_phases takes a list of varint.Phase, got {phases!r}"
    )
    if not phases or not all(isinstance(phase, Phase) for phase in phases):
        raise InputError("optimal_phases takes a list of varint.Phase, at least one")
    ties = default_links(len(phases)) if links is None else links
    if callback is not None:
        _require_callback(callback, solver)
    problem = transcribe(phases, ties, number("t0", t0), choose_backend(solver, backend))
    warn_of_kinks([part.phase for part in problem.phases], stacklevel=3)
    return solve(problem, solver, options, progress, callback)


def assess(found: list[Trajectory], stacklevel: int) -> list[Trajectory]:
    """The trajectories with an estimate of their error in `stats`, and with what goes beyond bounds
    between the nodes; a warning where one of them is large, and of a saddle.
    """
    errors = [error_estimate(x, x.solution.u) for x in found]
    beyond = [excess_between_nodes(x) for x in found]
    solved = all(x.solution.success for x in found)
    if (worst := max(errors)) > LARGE and solved:
        warnings.warn(
            f"the solution is too coarse: its controls, replayed in quarter steps, lead "
            f"{worst:.1g} of a coordinate's range away from its path; {remedy(found)}",
            stacklevel=stacklevel,
        )
    warn_of_saddle(found, stacklevel)
    excess = sorted((part, name) for x in beyond for name, part in x.items())
    if excess and excess[-1][0] > FAR and solved:
        part, name = excess[-1]
        warnings.warn(
            f"{name} goes beyond its bound by {part:.1g} of its range between the quadrature "
            "nodes, which alone keep to it; take more steps, or control='constant'",
            stacklevel=stacklevel,
        )
    told = [
        {"error_estimate": x} | ({"beyond": y} if y else {})
        for x, y in zip(errors, beyond, strict=True)
    ]
    return [
        replace(x, stats=MappingProxyType({**x.stats, **more}))
        for x, more in zip(found, told, strict=True)
    ]
