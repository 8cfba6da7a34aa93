"""Several paths between the same end points: many starts, many winding numbers, each solution
once.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from varint.boundary.least_action import doubt_of, solutions
from varint.boundary.problem import start_of
from varint.boundary.search import along_its_way, on_its_steps
from varint.boundary.winding import Round, round_path, with_winding
from varint.errors import InputError, SolverError, parsed_or_refused
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.free import Free
from varint.scene.inputs import finite_array, generator, guesses_of, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, require_system

WAVES = 4  # sines in a trial path: half a period to two
SAME = 1e-6  # of the range of a path: two solutions this close are one
NO_PATH = 0.1  # an error from which on the path with every step halved is another one, or none
NODES = 33  # of a trial path, for every turn


def paths(
    system: System,
    rule: Rule | None = None,
    *,
    q0: Any = None,
    q_start: Any = None,
    q_end: Any,
    duration: float | Free | None = None,
    steps: int | None = None,
    tol: float | None = None,
    starts: int | Sequence[Any] = 20,
    winding: Mapping[Any, Iterable[int]] | None = None,
    spread: Any = None,
    seed: int = 0,
    t0: float = 0.0,
    u: Any = None,
    params: ParameterValues | None = None,
    bounds: Sequence[tuple[Any, Any, Any]] | None = None,
    energy: float | None = None,
) -> list[Trajectory]:
    """Paths of stationary action between the same end points, sorted by action: ∂S_d = 0 from many
    first paths.

    Parameters
    ----------
    system, rule, q0, q_start, q_end, duration, steps, tol, t0, u, params, bounds, energy
        As for `least_action`.
    starts : int or sequence of guesses
        Number of first paths (the straight line, then the line with random sines added), or the
        guesses themselves.
    winding : dict of coordinate names and whole numbers, optional
        Turns added to the end of angles: ``{"theta": range(-2, 3)}`` looks for paths to q_end + 2π
        k as well. Of Cartesian coordinates of a place, two or three names: first paths go round the
        origin, ``{("x", "y"): range(-2, 2)}`` to the end's direction plus 2π k, in the plane of
        both ends and the origin; 0 is the first way forwards, −1 the first way backwards.
    spread : float or array (n,), optional
        Size of the sines. Default: the distance between the ends, at least 1.
    seed : int
        Of the random numbers; the same seed gives the same first paths.

    Returns
    -------
    list of Trajectory
        Each solution once, but for those that change by more than a tenth of their range with every
        step halved: a warning says how many first paths led to such. The list is complete only as
        far as the starts reach. Where places wind, ``stats["winding"]`` says how often each path
        goes round, whatever was asked for, and both paths of a number of turns are looked for, the
        fast and the slow one.

    Raises
    ------
    InputError
        As for `least_action`, or if a wound coordinate does not exist.
    SolverError
        If no start leads to a path, or all of them to such whose steps are too few for them.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> found = vi.paths(
    ...     pendulum, vi.gauss(3), q0=0.0, q_end=1.0, duration=5.0, steps=40, starts=10)
    >>> [path.morse_index for path in found]
    [0, 0, 1]
    """
    require_system(system)
    n, names = system.structure.n, system.names
    q0 = start_of(q0, q_start)
    if q0 is None:
        raise InputError("give q0, where the paths begin")
    start, end = vector("q0", q0, n, names), vector("q_end", q_end, n, names)
    given = dict(q_start=start, t0=t0, u=u, params=params, energy=energy)
    given |= dict(periodic=False, symmetry=None)
    found: list[Trajectory] = []
    doubtful: list[Trajectory] = []
    failure: SolverError | None = None
    for angles, rounds in _turns(winding, names):
        goal, asked_ways = end + 2 * np.pi * angles, 0
        for guess in _guesses(starts, start, goal, rounds, spread, seed):
            own = not isinstance(starts, (int, np.integer)) or (rounds and not asked_ways)
            search = along_its_way if own else on_its_steps
            every = solutions(
                search, system, rule, duration, steps, tol, bounds, q_end=goal, guess=guess, **given
            )
            try:
                for path in every:
                    wound = with_winding(path, rounds)
                    if not _error(wound) <= NO_PATH:
                        doubtful.append(wound)
                        continue
                    asked_ways += wound.stats.get("winding") == {
                        tuple(names[i] for i in one.coordinates): one.turns for one in rounds
                    }
                    if not any(_same(wound, other) for other in found):
                        found.append(wound)
            except SolverError as error:
                failure = error
    if not found:
        _refuse(doubtful, failure)
        return []
    usual = steps is None and tol is None
    if doubtful:
        left = f"{len(doubtful)} first paths led to what may be none, which was left out: "
        warnings.warn(f"{left}{doubt_of(doubtful[0], usual)}", stacklevel=2)
    if doubt := doubt_of(max(found, key=_error), usual):
        warnings.warn(doubt, stacklevel=2)
    return sorted(found, key=lambda path: path.action)


def _refuse(doubtful: Sequence[Trajectory], failure: SolverError | None) -> None:
    """Say why first paths led to none."""
    if doubtful:
        raise SolverError(
            f"no path was found but what may be none: {doubt_of(doubtful[0], False)}",
            status="too few steps",
            iterate=doubtful[0],
        )
    if failure is not None:
        raise failure


def _error(path: Trajectory) -> float:
    return float(path.stats["error_estimate"])


def _turns(
    winding: Mapping[Any, Iterable[int]] | None, names: tuple[str, ...]
) -> list[tuple[np.ndarray, list[Round]]]:
    """Whole turns of all angles, and of all places, every combination."""
    winding = {} if winding is None else winding
    if not isinstance(winding, Mapping):
        raise InputError(
            f"winding must be a dictionary such as {{{names[0]!r}: range(-2, 3)}}, got {winding!r}"
        )
    keys = [key if isinstance(key, tuple) else (key,) for key in winding]
    unknown = sorted({str(name) for key in keys for name in key} - set(names))
    if unknown:
        raise InputError(f"winding names {unknown}; the coordinates are {list(names)}")
    if any(len(key) not in (1, 2, 3) or len(set(key)) < len(key) for key in keys):
        raise InputError(
            "winding takes the name of an angle, or the two or three names of the Cartesian "
            f"coordinates of a place, got {list(winding)}"
        )
    choices = parsed_or_refused(
        lambda: [list(choice) for choice in winding.values()],
        lambda: f"winding takes a list of whole numbers for each coordinate, got {dict(winding)}",
    )
    if not all(isinstance(k, (int, np.integer)) for choice in choices for k in choice):
        raise InputError(f"winding numbers are whole numbers, got {dict(winding)}")
    every = []
    for turns in itertools.product(*choices):
        angles, rounds = np.zeros(len(names)), []
        for key, count in zip(keys, turns, strict=True):
            index = tuple(names.index(name) for name in key)
            if len(key) == 1:
                angles[index[0]] = count
            else:
                rounds.append(Round(index, int(count)))
        every.append((angles, rounds))
    return every


def _guesses(
    starts: int | Sequence[Any],
    start: np.ndarray,
    end: np.ndarray,
    rounds: Sequence[Round],
    spread: Any,
    seed: int,
) -> list[Any]:
    """First paths: the user's own, or the straight line (round the origin where it winds) with
    random sines that vanish at the ends.
    """
    if not isinstance(starts, (int, np.integer)):
        return guesses_of(starts)
    starts = positive_integer("starts", starts)
    size = np.maximum(np.abs(end - start), 1.0) if spread is None else _sizes(spread, start.shape)
    random = generator(seed)
    turns = max((abs(one.turns) + 1 for one in rounds), default=1)
    s, wave = np.linspace(0, 1, (NODES - 1) * turns + 1), np.arange(1, WAVES + 1)
    line = start + s[:, None] * (end - start)
    sines = np.sin(np.pi * np.outer(s, wave)) / np.sqrt(wave)
    guesses = []
    for number in range(starts):
        waves = sines @ random.standard_normal((WAVES, len(start))) if number else 0 * line
        guess = line + waves * size
        for one in rounds:
            index = list(one.coordinates)
            guess[:, index] = round_path(start[index], end[index], one.turns, s, waves[:, index])
        guesses.append(guess)
    return guesses


def _sizes(spread: Any, shape: tuple[int, ...]) -> np.ndarray:
    return parsed_or_refused(
        lambda: np.broadcast_to(finite_array("spread", spread), shape),
        lambda: (
            f"spread must be one number or one for each of {shape[0]} coordinates, got {spread!r}"
        ),
    )


def _same(a: Trajectory, b: Trajectory) -> bool:
    """Whether two paths from the same start are one, as far as their errors tell: with steps of
    their own they agree where their start momenta and durations do, else where all nodes do.
    """
    if a.sizes is None and b.sizes is None and len(a) == len(b):
        size = max(float(np.ptp(a.q, axis=0).max()), np.finfo(float).tiny)
        apart, allowed = float(np.abs(a.q - b.q).max()) / size, SAME
    else:
        size = max(float(np.abs(a.p).max()), np.finfo(float).tiny)
        apart = float(np.abs(a.p[0] - b.p[0]).max()) / size
        allowed = max(SAME, *(2 * path.stats["error_estimate"] for path in (a, b)))
    return max(apart, abs(a.duration / b.duration - 1)) <= allowed
