"""The verb for paths: between fixed end points, closed, of given energy, as a minimum under
bounds.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from time import perf_counter
from types import NoneType
from typing import Any

import numpy as np

from varint.boundary.divided_steps import with_steps
from varint.boundary.minimise import minimise_action
from varint.boundary.newton import NewtonResult
from varint.boundary.problem import boundary_value_problem, first_path, start_of
from varint.boundary.refinement import LARGE
from varint.boundary.result import conjugate_ends, path_of
from varint.boundary.search import Search, along_its_way, on_its_steps
from varint.boundary.stationary import BoundaryValueProblem
from varint.boundary.winding import other_way, with_ways_compared
from varint.errors import InputError, SolverError
from varint.integration.tolerance import DEFAULT_TOL, LEAST_TOL, MOST_TOL
from varint.numerics.progress import notice
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.free import Free
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, require_system

FIRST_STEPS = 16  # that refinement begins with
LEAST_STEPS, MOST_STEPS = 20, 160  # of a path whose action is minimised, where nothing is said
LEAST_ERROR = 1e-5  # of such a path: where it leans on a bound no rule has a high order


def least_action(
    system: System,
    rule: Rule | None = None,
    *,
    q0: Any = None,
    q_start: Any = None,
    q_end: Any = None,
    duration: float | Free | None = None,
    steps: int | None = None,
    tol: float | None = None,
    t0: float = 0.0,
    guess: Any = None,
    u: Any = None,
    params: ParameterValues | None = None,
    bounds: Sequence[tuple[Any, Any, Any]] | None = None,
    periodic: bool = False,
    symmetry: Any = None,
    energy: float | None = None,
) -> Trajectory:
    """Path of stationary action, ∂S_d/∂q_k = D2 L_d(q_{k−1}, q_k) + D1 L_d(q_k, q_{k+1}) = 0 with
    the ends given.

    The action of a path is stationary, not always least: `Trajectory.morse_index` counts the
    directions in which it is a maximum, `Trajectory.conjugate_times` say when they arise. It is
    minimised (by Ipopt) only where there are `bounds` or the duration has bounds of its own.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: `gauss(6)`, with constraints `lobatto(6)`, where steps are chosen for an accuracy
        (4 stages where the action is minimised); else the scene's own, or `gauss(2)` where that has
        no path between its nodes and the action is minimised.
    q0, q_end : array (n,)
        End points; both are left out for periodic paths.
    q_start : array (n,)
        Another name of q0.
    duration : float or Free
        Time from start to end. ``free(guess, lower, upper)``: the action is least with respect to
        the duration as well (least time, where S is the time); with `energy`, no more than a guess
        and a check of the result.
    steps : int, optional
        Number of steps, all equal; with `tol` the number to begin with.
    tol : float, optional
        Error wanted of q and p at the nodes, relative to the range of each coordinate and to the
        largest momentum: steps are then divided where the path needs it (`Trajectory.sizes`). With
        neither `steps` nor `tol` it is 1e-9 as for `simulate`, and a path whose error stays above
        that comes with a warning. Where the action is minimised `tol` cannot be given; without
        `steps` these are 20 to 160 of `gauss(4)`, until the error is below 1e-5.
    t0 : float
        Start time.
    guess : array (k, n) or Trajectory, optional
        Configurations at equally spaced times, the first and last at the ends. Default: the
        straight line, bent to a side where it leads through a singular place. The path goes the way
        of the guess, for instance as often round a centre of attraction, where one is found. A
        periodic path needs a guess.
    u : array (steps, k) or (steps, r, k) or (k,), optional
        Controls, as for `simulate`; where steps are chosen, each row of a table is over as long.
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.
    bounds : sequence of (lower, expression, upper), optional
        Inequalities on q, t and the parameters at every control point; the action is then
        minimised.
    periodic : bool
        The path closes, q(T) = S q(0) + b and p(0) = Sᵀ p(T).
    symmetry : array (n, n) or (n, n + 1), optional
        S, or [S | b], of a periodic path; default the identity.
    energy : float, optional
        Energy of the path; the duration is then found (Maupertuis and Jacobi).

    Returns
    -------
    Trajectory
        With forces it is the path of the Lagrange–d'Alembert principle. Started from its first q
        and p, `simulate` reproduces it to round-off, where all steps are equal. With bounds,
        `solution` tells where the path leans on them (`ActiveBounds`); such a path is no motion
        from its start, and has no derivatives by it. ``stats["error_estimate"]``
        is the path's own error as for `tol` (of a path of least action that of q and the duration
        alone), measured by the path with every step halved; where it is large a warning says so.
        With a `guess`, ``stats["winding"]`` says how often the path goes round each place where the
        scene is singular, the origin or another body, and ``stats["winding_of_guess"]`` how often
        the guess does; where they differ a warning says so.

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says what to change.
    SolverError
        If no path was found, or none with an error of `tol` that was given; `iterate` is the last
        one tried.
        Another `guess` or more steps may help. If the ends are conjugate to each other: then no
        path or a whole family of them joins the ends.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> oscillator = vi.System(q, v, (v**2 - q**2) / 2)
    >>> path = vi.least_action(
    ...     oscillator, vi.gauss(4), q0=0.0, q_end=1.0, duration=4.0, steps=20)
    >>> path.morse_index, path.conjugate_times.round(6)
    (1, array([3.141593]))
    """
    given = dict(q_start=start_of(q0, q_start), q_end=q_end, t0=t0, guess=guess, u=u)
    closed = dict(params=params, periodic=periodic, symmetry=symmetry, energy=energy)
    search = on_its_steps if guess is None else along_its_way
    with notice("looking for a path of least action"):
        found = solutions(search, system, rule, duration, steps, tol, bounds, **given, **closed)
        path = next(found)
    for doubt in (doubt_of(path, steps is None and tol is None), other_way(path)):
        if doubt:
            warnings.warn(doubt, stacklevel=2)
    return path


def doubt_of(path: Trajectory, usual: bool) -> str | None:
    """What to say of a path that may be none, or that misses the usual tolerance."""
    error, steps = path.stats["error_estimate"], len(path) - 1
    if not error <= LARGE:
        how = (
            f"the path changes by {error:.1g} of its range" if np.isfinite(error) else "it is none"
        )
        return (
            f"{steps} steps of {path.rule} are too few for this path: with every step halved {how}"
            ". Take more steps, or give tol=, which makes steps short where the path needs it"
        )
    wanted, more = (DEFAULT_TOL, "tol=") if path.solution is None else (LEAST_ERROR, "steps=")
    if usual and not error <= wanted:
        return (
            f"with {steps} steps of {path.rule} the error of this path is {error:.1e}, more than "
            f"the usual {wanted:g}; give {more} for another accuracy, or a rule of higher order"
        )
    return None


def solutions(
    search: Search,
    system: System,
    rule: Rule | None,
    duration: float | Free | None,
    steps: int | None,
    tol: float | None,
    bounds: Sequence[tuple[Any, Any, Any]] | None,
    **given: Any,
) -> Iterator[Trajectory]:
    """The paths that a search finds, the nearest to its first path first; the arguments are those
    of `least_action`.
    """
    began = perf_counter()
    require_system(system)
    if not isinstance(bounds, (Sequence, NoneType)):
        raise InputError(
            f"bounds must be a list of (lower, expression, upper), got {type(bounds).__name__}"
        )
    minimise = bool(bounds) or (isinstance(duration, Free) and given["energy"] is None)
    asked, chosen = tol is not None, steps is None or tol is not None
    if chosen and not asked and not minimise:
        tol = DEFAULT_TOL
    if rule is None:
        rule = _usual_rule(system, chosen, minimise)
    begin = _steps(steps, tol, minimise, _rows(system, given["u"]))
    problem, nodes, (time, *window) = boundary_value_problem(
        system, rule, duration=duration, steps=begin, **given
    )
    if minimise:
        most = MOST_STEPS if chosen else problem.steps
        yield _minimised(problem, nodes, time, (window[0], window[1]), bounds or [], began, most)
        return
    for mesh, outcome, error in search(problem, nodes, time, tol):
        path = path_of(mesh, outcome, error, began)
        _check_solved(mesh, outcome, path)
        if not window[0] <= outcome.iterate.duration <= window[1]:
            raise SolverError(
                f"the path has the duration {outcome.iterate.duration:g}, outside {window[0]:g} … "
                f"{window[1]:g}",
                status="duration outside its bounds",
                iterate=path,
            )
        _check_error(path, error, tol, asked)
        yield (
            path if given["guess"] is None or given["periodic"] else with_ways_compared(path, nodes)
        )


def _minimised(
    problem: BoundaryValueProblem,
    nodes: np.ndarray,
    time: float,
    window: tuple[float, float],
    bounds: Sequence[tuple[Any, Any, Any]],
    began: float,
    most: int,
) -> Trajectory:
    """The path of least action, on twice as many steps up to so many until its error is small."""
    while True:
        try:
            first = first_path(problem, nodes, time)
            path = minimise_action(problem, first, window, bounds, began)
            if path.stats["error_estimate"] <= LEAST_ERROR or 2 * problem.steps > most:
                return path
        except SolverError:
            if 2 * problem.steps > most:
                raise
        problem = with_steps(problem, np.full(problem.steps, 2))


def _check_solved(problem: BoundaryValueProblem, outcome: NewtonResult, path: Trajectory) -> None:
    """The outcome is a path, and the only one near it."""
    if conjugate_ends(problem, outcome, path):
        raise SolverError(
            f"the end is conjugate to the start at t = {path.t[-1]:g}: no path or a whole family "
            "of paths joins them; change the duration or the end points a little",
            status="conjugate end points",
            iterate=path,
        )
    if not outcome.solved:
        raise SolverError(
            f"no path was found: Newton's method ended after {outcome.iterations} iterations with "
            f"{outcome.status} (last correction {outcome.correction:.1e} of the path, residual "
            f"{outcome.residual:.1e} of the momenta); give a guess nearer to the path, another "
            "number of steps or a shorter duration",
            status=outcome.status,
            iterate=path,
        )


def _check_error(path: Trajectory, error: float, tol: float | None, asked: bool) -> None:
    """Refuse a path that misses a `tol` that was asked for, or the usual one by far."""
    if tol is not None and not error <= (tol if asked else LARGE):
        raise SolverError(
            f"tol={tol:g} was not met: with {len(path) - 1} steps the error is {error:.1e}; take a "
            "larger tol or a rule of higher order",
            status="tol out of reach",
            iterate=path,
        )


def _usual_rule(system: System, chosen: bool, minimise: bool) -> Rule | None:
    """The rule of paths whose steps are chosen; None: the scene's own."""
    constrained = bool(system.structure.constraints)
    if chosen:
        stages = 4 if minimise else 6
        return lobatto(stages) if constrained else gauss(stages)
    # a composition has no path between its nodes
    return gauss(2) if minimise and not constrained else None


def _rows(system: System, u: Any) -> int:
    """Rows of a table of controls, those of the steps that refinement begins with."""
    try:
        shape = np.shape(u)
    except (ValueError, TypeError, RuntimeError):  # refused, in words, where controls are read
        return FIRST_STEPS
    table = len(shape) > 1 or (len(shape) == 1 and shape != (system.structure.controls,))
    return shape[0] if table and shape[0] else FIRST_STEPS


def _steps(steps: int | None, tol: float | None, minimise: bool, first: int) -> int:
    """Number of steps, or of those that refinement begins with."""
    if tol is None:
        return LEAST_STEPS if steps is None else steps
    if not isinstance(tol, (int, float)) or not LEAST_TOL <= tol <= MOST_TOL:
        raise InputError(
            f"tol is relative to the range of the path, between {LEAST_TOL:g} and {MOST_TOL:g}; "
            f"got {tol!r}"
        )
    if minimise:
        raise InputError(
            "tol is for stationary paths: a path of least action within bounds or of free duration "
            "takes steps, or none"
        )
    return first if steps is None else steps
