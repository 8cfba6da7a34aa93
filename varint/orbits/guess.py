"""From a user's guess to states along a period, and steps that are short enough for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.orbits.mesh import meshed, uneven
from varint.orbits.orbit import Orbit
from varint.orbits.phase import Units, on_manifold, state_of, units_of
from varint.orbits.shooting import Iterate, Shooting, linearise, runs
from varint.results.records import State
from varint.results.trajectory import Trajectory
from varint.scene.inputs import number, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values

PIECES = 8  # of a period, in which the error of the steps is measured
FEWEST, MOST = 4, 2**14  # steps of such a piece
HOPELESS = 2**10  # steps with which a motion that can be run at all is run, however badly
ROUND_OFF = 1e-10  # errors that no longer shrink are this small at most, or the steps too long
STEEP, GENTLE = 300.0, 30.0  # growth of the tangent map in a period, and in a segment
MOST_SEGMENTS = 32
MODERATE = 64  # steps of a piece: where more are needed, uneven ones may be fewer


@dataclass(frozen=True, eq=False)
class Guess:
    """A state (q, p) near an orbit, or a motion near it, with a period."""

    x: np.ndarray
    period: float
    t0: float
    c: np.ndarray
    shift: np.ndarray
    motion: Trajectory | None = None


def guess_of(
    system: System,
    given: Any,
    period: float | None,
    params: ParameterValues | None,
    t0: float,
    turns: Mapping[str, int] | None,
) -> Guess:
    """What the user hands over, checked."""
    motion = given.motion if isinstance(given, Orbit) else given
    c, shift = parameter_values(system, params), turns_of(system, turns)
    if isinstance(given, Orbit) and turns is None:
        shift = given.shooting.shift
    if isinstance(motion, Trajectory):
        if motion.system is not system:
            raise InputError("the guess is a motion of another system; give one of this system")
        long = motion.duration if period is None else _period(period)
        if not 0 < long <= motion.duration * (1 + 1e-9):
            raise InputError(
                f"the guess lasts {motion.duration:g}, less than the period {long:g}: give a "
                "longer motion, or a state"
            )
        c = motion.c if params is None else c
        x = np.concatenate([motion.q[0], motion.p[0]])
        return Guess(x, long, float(motion.t[0]), c, shift, motion)
    if period is None:
        raise InputError("give period=, the first guess of it (with energy=) or the one to hold")
    n, names = system.structure.n, system.names
    if isinstance(given, State):
        given = given.q, given.v
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise InputError(
            "the guess must be a pair (q0, v0), a State, a Trajectory or an Orbit, got "
            f"{type(given).__name__}"
        )
    q, v = vector("q0", given[0], n, names), vector("v0", given[1], n, names)
    return Guess(state_of(system, q, v, t0, c), _period(period), t0, c, shift)


def _period(x: Any) -> float:
    value = number("period", x)
    if value <= 0:
        raise InputError(f"period must be positive, got {x!r}")
    return value


def turns_of(system: System, turns: Mapping[str, int] | None) -> np.ndarray:
    """What coordinates gain in a period."""
    shift = np.zeros(system.structure.n)
    for name, count in (turns or {}).items():
        if name not in system.names or not isinstance(count, (int, np.integer)):
            raise InputError(
                f"turns={turns!r} must give whole numbers for angles among {list(system.names)}"
            )
        shift[system.names.index(name)] = 2 * np.pi * count
    return shift


def prepared(
    shooting: Shooting, guess: Guess, steps: int | None, segments: int | None, tol: float
) -> tuple[Shooting, Iterate, Units]:
    """Steps and segments for a guess, and the states at their beginnings."""
    given = steps is not None
    if given:
        steps = positive_integer("steps", steps)
    elif segments is None:
        moderate = _steps(shooting, guess, tol, MODERATE)
        if moderate is None:
            mesh = uneven(shooting, *_known(guess), tol)
            if mesh is not None:
                made = meshed(shooting, mesh)
                x = kept(made, mesh.x, guess.period, guess.c)
                return made, Iterate(x, guess.period, guess.c), units_of(mesh.nodes)
        steps = moderate
    steps = enough_steps(shooting, guess, tol) if steps is None else steps
    once = replace(shooting, segments=1, each=steps)
    at = Iterate(guess.x[None], guess.period, guess.c)
    if guess.motion is None:
        nodes = runs(once, at)[0].x
    else:
        nodes = _states(guess, steps)
    units = units_of(nodes)
    if segments is None:
        segments = 1 if guess.motion is None else PIECES
        if guess.motion is None:
            whole = linearise(once, at, runs(once, at), units, None).monodromy
            segments = _segments(float(np.linalg.norm(whole, 2)))
        if given:
            segments = max(k for k in range(1, segments + 1) if steps % k == 0)
    else:
        segments = positive_integer("segments", segments)
    each = -(-steps // segments)
    if given and each * segments != steps:
        raise InputError(f"steps={steps} is no multiple of segments={segments}")
    shooting = replace(shooting, segments=segments, each=each)
    if guess.motion is not None:
        x = _states(guess, segments)
    elif segments == 1:
        x = guess.x[None]
    else:
        finer = replace(once, each=each * segments)
        x = runs(finer, at)[0].x[: each * segments : each]
    return shooting, Iterate(kept(shooting, x, guess.period, guess.c), guess.period, guess.c), units


def kept(shooting: Shooting, x: np.ndarray, period: float, c: np.ndarray) -> np.ndarray:
    """States along a period, put on the manifold of the constraints."""
    times = shooting.t0 + period * shooting.beginnings
    system = shooting.system
    return np.array([on_manifold(system, y, t, c) for y, t in zip(x, times, strict=True)])


def _segments(growth: float) -> int:
    """So many that none grows too much."""
    if growth <= STEEP:
        return 1
    if not np.isfinite(growth):
        return MOST_SEGMENTS
    return int(min(np.ceil(np.log(growth) / np.log(GENTLE)), MOST_SEGMENTS))


def _states(guess: Guess, count: int) -> np.ndarray:
    """States (q, p) of the guess's motion at the beginnings of so many parts of a period."""
    assert guess.motion is not None
    times = guess.t0 + np.arange(count) * (guess.period / count)
    found = guess.motion.at(times)
    return np.hstack([found.q, found.p])


def _known(guess: Guess) -> tuple[Iterate, Callable[[float], np.ndarray | None]]:
    """The guess as an orbit of one segment, and the states of its motion, if it is one."""
    at = Iterate(guess.x[None], guess.period, guess.c)
    if guess.motion is None:
        return at, lambda part: None
    motion = guess.motion

    def there(part: float) -> np.ndarray:
        found = motion.at(guess.t0 + part * guess.period)
        return np.concatenate([found.q, found.p])

    return at, there


def enough_steps(shooting: Shooting, guess: Guess, tol: float) -> int:
    """Steps of a period whose errors, from where pieces of it begin, are below `tol` ranges.

    Raises
    ------
    ConvergenceError
        If the motion cannot be run.
    """
    found = _steps(shooting, guess, tol, MOST)
    if found is not None:
        return found
    tried = HOPELESS if np.isinf(_step_error(shooting, guess, HOPELESS)) else MOST
    before = _step_error(shooting, guess, tried)
    raise ConvergenceError(
        f"the guess cannot be run over its period with an error of {tol:g}: "
        f"{PIECES * tried} steps leave {before:.1e}",
        step=0,
        time=guess.t0,
        residual=before,
        cause="a collision, a period that is much too long, or a tol below round-off",
    )


def _steps(shooting: Shooting, guess: Guess, tol: float, most: int) -> int | None:
    """The same, if they are at most so many a piece."""
    each, before = FEWEST, np.inf
    while each <= most:
        error = _step_error(shooting, guess, each)
        if error <= tol or (before < ROUND_OFF and error > before / 4):
            break
        if each >= HOPELESS and not np.isfinite(error):
            return None
        before, each = error, 2 * each
    else:
        return None
    if 0 < error < tol:
        each = int(np.ceil(each * max((error / tol) ** (1 / shooting.rule.order), 0.5)))
    return PIECES * each


def _step_error(shooting: Shooting, guess: Guess, each: int) -> float:
    """How far apart pieces of the period end that take `each` steps, and twice as many."""
    at = Iterate(guess.x[None], guess.period, guess.c)
    coarse = replace(shooting, segments=PIECES, each=each)
    try:
        if guess.motion is None:
            whole = runs(replace(coarse, segments=1, each=PIECES * each), at)[0].x
            x = whole[:-1:each]
        else:
            x = kept(coarse, _states(guess, PIECES), guess.period, guess.c)
        pieces = [runs(one, at._replace(x=x)) for one in (coarse, replace(coarse, each=2 * each))]
    except ConvergenceError:
        return np.inf
    nodes = np.concatenate([piece.x for piece in pieces[0]])
    last = [np.array([piece.x[-1] for piece in some]) for some in pieces]
    error = float((np.abs(last[1] - last[0]) / units_of(nodes).scale).max())
    return error if np.isfinite(error) else np.inf
