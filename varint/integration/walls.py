"""Motions that end before their duration does, however short the steps: collisions, dry friction
that holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from varint.errors import ConvergenceError
from varint.integration.vanishing_speeds import cause_at_rest, is_worth_more_steps, rate_at_rest
from varint.scene.system import System

# failures at one time: by steps that follow the scene, by equal ones, and steps of the last
VARYING, EQUAL, FEWEST = 6, 8, 2**18
STRAY = 2  # among them, which leapt over the end and were lost behind it
FEWEST_JUMPS = 2**16  # of forces that jump, which fail wherever a step happens to meet the jump
TOGETHER = 1e-5  # of the duration: failures by steps that follow the scene are at one time
CLOSE = 4.0  # steps within which equal ones fail there
TOO_FAST = "bodies collide there, or turn around each other ever faster"
SOON = 1e-2  # of the duration: where two runs came to no end of turns, there is none

Failure = tuple[int, ConvergenceError]  # the steps of a run, and how it ended


def require_way_on(
    failures: Sequence[Failure], total: float, *, varying: bool = False, jumps: bool = False
) -> None:
    """Refuse to try shorter steps where more and more of them have all failed at one time.

    Parameters
    ----------
    failures : sequence of (int, ConvergenceError)
        Of runs that followed each other, each with more steps than the one before.
    total : float
        The duration.
    varying : bool
        Whether the steps follow the rate of the scene.
    jumps : bool
        Whether forces of the scene jump.

    Raises
    ------
    ConvergenceError
        With the nodes of the last run, or where a force jumps of the one that came farthest; that
        of the last run itself where its step was refused.
    """
    few, end = failures[-1]
    if varying and _endless(failures, SOON * abs(total)):
        raise _no_end_of_turns(end)
    plain, enough = not (varying or jumps), VARYING if varying else EQUAL
    if not (at_one_time(failures, total, varying=varying) or (jumps and len(failures) >= enough)):
        return
    if end.refused:  # it is known why
        raise end
    if plain and math.isinf(rate_at_rest(end.trajectory)):
        raise no_way_on(failures, jumps)
    if not varying and few < (FEWEST_JUMPS if jumps else FEWEST):
        return
    if not (plain and is_worth_more_steps(end.trajectory, few)):
        raise no_way_on(failures, jumps)


def at_one_time(failures: Sequence[Failure], total: float, *, varying: bool = False) -> bool:
    """Whether enough of them were at the time of the last one; what comes through beside so many
    has leapt over it.
    """
    enough, end = VARYING if varying else EQUAL, failures[-1][1]
    at_once = sum(
        abs(error.time - end.time) <= abs(total) * (TOGETHER if varying else CLOSE / steps)
        for steps, error in failures[-(enough + STRAY) :]
    )
    return at_once >= enough


def _endless(failures: Sequence[Failure], apart: float) -> bool:
    """Whether the last two of them turned ever faster, at about one time."""
    two = [error for _, error in failures[-2:]]
    if len(two) < 2 or abs(two[0].time - two[1].time) > apart:
        return False
    # other causes are not looked for
    return all(math.isinf(error.residual) and error.cause == TOO_FAST for error in two)


def _no_end_of_turns(end: ConvergenceError) -> ConvergenceError:
    what = f"the motion ends near t = {end.time:g}: {TOO_FAST}, and no run leads farther. End the "
    what += f"run before (duration=, until=); error.trajectory has {_nodes(end)} nodes before it"
    return _ended(end, what, TOO_FAST)


def _ended(end: ConvergenceError, what: str, why: str) -> ConvergenceError:
    """The same end, told of in other words."""
    at = {"step": end.step, "trajectory": end.trajectory}
    return ConvergenceError(what, **at, time=end.time, residual=end.residual, cause=why)


def _nodes(end: ConvergenceError) -> int:
    return 0 if end.trajectory is None else len(end.trajectory)


def jumping_cause(system: System | None) -> str:
    """What to say of a step that fails in a scene whose forces jump, and is not cut there."""
    s = system and system.structure
    beside = (
        "; contacts beside non-holonomic rows are not followed from switch to switch, either "
        "of them alone is"
        if s and s.contacts and s.nonholonomic
        else ""
    )
    return (
        "a force of the scene jumps, and where it holds a body, as dry friction does, there is no "
        "step that solves the equations: make it smooth, for instance tanh(v / small) for sign(v)"
        + beside
    )


def no_way_on(failures: Sequence[Failure], jumps: bool) -> ConvergenceError:
    """What to say of a motion that no run has followed to its end, with what was reached."""
    most, end = failures[-1]
    if jumps:
        end = max((error for _, error in failures), key=_reached)
    if jumps:
        why = jumping_cause(None if end.trajectory is None else end.trajectory.system)
    else:
        why = cause_at_rest(end.trajectory, most) or (
            "bodies collide, coordinates grow without bound or the scene is singular there: end "
            "the run before (duration=, until=), or describe the impact (contact=)"
        )
    what = f"the motion ends at t = {end.time:g}: no run of up to {most} steps leads farther. "
    what += f"Likely: {why}. Error.trajectory has the {_nodes(end)} nodes before it"
    return _ended(end, what, why)


def _reached(error: ConvergenceError) -> float:
    return 0.0 if error.trajectory is None else abs(error.trajectory.duration)
