"""What is asked of members whose steps are chosen: an accuracy, and times at which all of them are
looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.integration.asked_times import until_last
from varint.integration.problem import check_tolerance
from varint.integration.tolerance import DEFAULT_TOL, check_reach
from varint.numerics.limits import check_steps
from varint.scene.inputs import number, positive_integer, times_of

NODES = 101  # where no times are given: from the start to the end, equally far apart


@dataclass(frozen=True, eq=False)
class Asked:
    """Nodes of all members, how long each is run, how accurately, and by which loop; see
    `varint.simulate`.
    """

    times: np.ndarray
    duration: float
    tol: float
    backend: str


def asked_of(
    h: Any,
    steps: Any,
    duration: Any,
    t0: Any,
    save_every: Any,
    at: Any,
    tol: Any,
    backend: str,
) -> Asked | None:
    """What is asked of every member; None where steps are given.

    Raises
    ------
    InputError
        If steps are given and chosen at once, or nothing says how long the motions last.
    """
    if h is not None or steps is not None:
        given = [name for name, x in (("at", at), ("tol", tol)) if x is not None]
        if given:
            raise InputError(
                f"{' and '.join(given)} of an ensemble goes with steps that are chosen for each "
                "member: leave h and steps out, or give the nodes by save_every"
            )
        return None
    if at is None and duration is None:
        raise InputError(
            "give duration or at (alone, or with tol: steps are chosen for each member), or two of "
            "h, steps, duration"
        )
    if positive_integer("save_every", save_every) != 1:
        raise InputError(
            "save_every goes with h or steps; where steps are chosen, at gives the nodes of all "
            "members"
        )
    tol = DEFAULT_TOL if tol is None else tol
    check_tolerance("tol", tol)
    check_reach(tol)
    start = number("t0", t0)
    if at is not None:
        times = times_of(at)
        duration = until_last(times, start, 1, (None, None, duration), False)[2]
    lasts = number("duration", duration)
    if lasts == 0:
        raise InputError("duration must not be zero")
    check_steps(start, lasts, 1)
    if at is None:
        times = np.linspace(start, start + lasts, NODES)
    return Asked(times.copy(), lasts, float(tol), backend)
