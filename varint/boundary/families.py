"""Several paths between the same end points: many starts, many winding numbers, each solution once."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from varint.boundary.least_action import least_action
from varint.errors import InputError, SolverError, converted
from varint.horizon import Free
from varint.parameters import finite_array, generator, guesses_of, whole
from varint.rules import Rule
from varint.stepping.initial import vector
from varint.system import System, require_system
from varint.trajectory import Trajectory

WAVES = 4  # sines in a trial path: half a period to two
SAME = 1e-6  # of the range of a path: two solutions this close are one
NODES = 33  # of a trial path


def paths(
    system: System,
    rule: Rule | None = None,
    *,
    q_start: Any,
    q_end: Any,
    duration: float | Free | None = None,
    steps: int,
    starts: int | Sequence[Any] = 20,
    winding: Mapping[str, Iterable[int]] | None = None,
    spread: Any = None,
    seed: int = 0,
    t0: float = 0.0,
    u: Any = None,
    params: Mapping[str, Any] | None = None,
    bounds: Sequence[tuple[Any, Any, Any]] | None = None,
    energy: float | None = None,
) -> list[Trajectory]:
    """Paths of stationary action between the same end points, sorted by action: ∂S_d = 0 from many first paths.

    Parameters
    ----------
    system, rule, q_start, q_end, duration, steps, t0, u, params, bounds, energy
        As for `least_action`.
    starts : int or sequence of guesses
        Number of first paths (the straight line, then the line with random sines added), or the guesses themselves.
    winding : dict of coordinate name and whole numbers, optional
        Turns added to the end of angles: ``{"theta": range(-2, 3)}`` looks for paths to q_end + 2π k as well.
    spread : float or array (n,), optional
        Size of the sines. Default: the distance between the ends, at least 1.
    seed : int
        Of the random numbers; the same seed gives the same first paths.

    Returns
    -------
    list of Trajectory
        Each solution once. The list is complete only as far as the starts reach.

    Raises
    ------
    InputError
        As for `least_action`, or if a wound coordinate does not exist.
    SolverError
        If no start leads to a path.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> found = vi.paths(pendulum, vi.gauss(3), q_start=0.0, q_end=1.0, duration=5.0, steps=40, starts=10)
    >>> [path.morse_index for path in found]
    [0, 0, 1]
    """
    require_system(system)
    n, names = system.structure.n, system.names
    start, end = vector("q_start", q_start, n, names), vector("q_end", q_end, n, names)
    found: list[Trajectory] = []
    failure: SolverError | None = None
    for turns in _turns(winding, names):
        goal = end + 2 * np.pi * turns
        for guess in _guesses(starts, start, goal, spread, seed):
            try:
                path = least_action(
                    system, rule, q_start=start, q_end=goal, duration=duration, steps=steps, t0=t0, guess=guess, u=u,
                    params=params, bounds=bounds, energy=energy,
                )  # fmt: skip
            except SolverError as error:
                failure = error
                continue
            if not any(_same(path, other) for other in found):
                found.append(path)
    if not found and failure is not None:
        raise failure
    return sorted(found, key=lambda path: path.action)


def _turns(winding: Mapping[str, Iterable[int]] | None, names: tuple[str, ...]) -> list[np.ndarray]:
    """Whole turns of all coordinates, every combination."""
    winding = {} if winding is None else winding
    if not isinstance(winding, Mapping):
        raise InputError(f"winding must be a dictionary such as {{{names[0]!r}: range(-2, 3)}}, got {winding!r}")
    unknown = sorted(map(str, set(winding) - set(names)))
    if unknown:
        raise InputError(f"winding names {unknown}; the coordinates are {list(names)}")
    choices = converted(
        lambda: [list(winding.get(name, [0])) for name in names],
        lambda: f"winding takes a list of whole numbers for each coordinate, got {dict(winding)}",
    )
    if not all(isinstance(k, (int, np.integer)) for choice in choices for k in choice):
        raise InputError(f"winding numbers are whole numbers, got {dict(winding)}")
    return [np.array(turns, dtype=float) for turns in itertools.product(*choices)]


def _guesses(starts: int | Sequence[Any], start: np.ndarray, end: np.ndarray, spread: Any, seed: int) -> list[Any]:
    """First paths: the user's own, or the straight line with random sines that vanish at the ends."""
    if not isinstance(starts, (int, np.integer)):
        return guesses_of(starts)
    starts = whole("starts", starts)
    size = np.maximum(np.abs(end - start), 1.0) if spread is None else _sizes(spread, start.shape)
    random, s = generator(seed), np.linspace(0, 1, NODES)
    line = start + s[:, None] * (end - start)
    wave = np.arange(1, WAVES + 1)
    sines = np.sin(np.pi * np.outer(s, wave)) / np.sqrt(wave)
    return [line, *(line + sines @ (size * random.standard_normal((WAVES, len(start)))) for _ in range(starts - 1))]


def _sizes(spread: Any, shape: tuple[int, ...]) -> np.ndarray:
    return converted(
        lambda: np.broadcast_to(finite_array("spread", spread), shape),
        lambda: f"spread must be one number or one for each of {shape[0]} coordinates, got {spread!r}",
    )


def _same(a: Trajectory, b: Trajectory) -> bool:
    """Whether two paths agree at all nodes (and last equally long)."""
    size = max(float(np.ptp(a.q, axis=0).max()), np.finfo(float).tiny)
    apart = max(float(np.abs(a.q - b.q).max()) / size, abs(a.duration / b.duration - 1))
    return apart <= SAME
