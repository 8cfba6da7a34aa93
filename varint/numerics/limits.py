"""What steps and counts double precision and memory can hold: refused at once, not found out
after a run.
"""

from __future__ import annotations

import os
from functools import lru_cache

import numpy as np

from varint.errors import InputError

CLOSED = 3  # so many unknowns are solved for by the adjugate matrix, which is straight-line code
MOST_STEPS = 10**15  # years of the cheapest steps
MOST_AGAIN = 10**8  # of a run that are taken once more: minutes
SHORTEST, LONGEST = 1e-150, 1e150  # of a step: its square must be a number, too
TICK = 2 * float(np.finfo(float).eps)  # of the time: steps this long come to different times
BYTES = 8  # of a number

# Iterations after which a method gives up. Newton's methods that converge at all need some ten; the
# rest is for starts that are far off. What is linear or bisects needs more.
# damped Newton for p = ∂L/∂v: unrolled in the function, so no more than relativity needs
LEGENDRE_ITERATIONS = 50
TANGENT_ITERATIONS = 30  # Newton for velocity and multipliers on the hidden constraint
PROJECTION_ITERATIONS = 100  # Gauss–Newton onto g = 0, linear where the constraints are curved
STEP_ITERATIONS = 30  # Newton for the equations of a step
# a scene that needs more contracts so poorly that Newton's method is cheaper
FIXED_POINT_ITERATIONS = 60
# of a step of its own, in whose place none that is shorter is taken: beyond, it is interpreted
ALONE_ITERATIONS = 300
SHOOTING_ITERATIONS = 30  # Newton for the momentum that leads from q0 to q1
RECOVERY_ITERATIONS = 30  # Newton for the inner points of a step between two known nodes
PATH_ITERATIONS = 60  # damped Newton for a whole path
# bracketed root of a watched expression: bisection alone would need 60 a factor of 1e-18
ROOT_ITERATIONS = 200
GAP_ITERATIONS = 100  # safeguarded cubic search for the instant at which a gap closes
# safeguarded Newton for the fictitious time of a physical one: bisection would be done by then
CLOCK_ITERATIONS = 60


def check_steps(t0: float, h: float, steps: int) -> None:
    """Refuse steps whose squares vanish or overflow, and those that do not move a clock at t0 or
    at their end.
    """
    size = abs(h)
    if not SHORTEST < size < LONGEST:
        raise InputError(
            f"steps of h={h:g} cannot be computed with: the square of h is no number of double "
            "precision; measure time in another unit, so that h is nearer to 1"
        )
    late, first = abs(t0 + steps * h), abs(t0)
    if size < TICK * late or size < TICK * first:
        late = max(late, first)
        raise InputError(
            f"steps of h={h:g} do not move a clock at t={late:g}: numbers of double precision are "
            f"{np.spacing(late):.2g} apart there; begin nearer to t0=0 or take longer steps"
        )


def check_steps_again(between: int, what: str) -> None:
    """Refuse to take so many steps between the nodes of a run once more."""
    if between > MOST_AGAIN:
        raise InputError(
            f"{between:,} steps of this run were not kept, and {what} would take all of them once "
            "more; run a shorter duration, or h and steps by which there are fewer"
        )


def check_memory(what: str, numbers: float, remedy: str) -> None:
    """Refuse arrays of so many numbers that this machine's memory cannot hold them."""
    if BYTES * numbers > _memory():
        raise InputError(
            f"{what} would take {BYTES * numbers / 1e9:.3g} GB, more than this machine's memory of "
            f"{_memory() / 1e9:.3g} GB; {remedy}"
        )


@lru_cache(maxsize=1)
def _memory() -> int:
    """Bytes of memory; where the system does not say, more than any machine has."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 2**48
