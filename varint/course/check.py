"""The verdict on an answer to an exercise of the course."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from varint.course.table import exercises
from varint.errors import InputError


@dataclass(frozen=True)
class Verdict:
    """Whether an answer is right, and if not, where it parts from what was computed.

    Attributes
    ----------
    right : bool
    words : str
    """

    right: bool
    words: str

    def __str__(self) -> str:
        return self.words

    def __bool__(self) -> bool:
        return self.right

    def __repr__(self) -> str:
        return self.words


def check(number: str, answer: Any) -> Verdict:
    """Judge an answer to an exercise by computing: ``|answer − computed| ≤ tolerance``, equal
    accelerations at random states, a rate of change that vanishes, and the like.

    Parameters
    ----------
    number : str
        Lesson and exercise, such as ``"1.2"``.
    answer : float, sequence of float, System or callable
        What the exercise asks for; None where there is none yet.

    Returns
    -------
    Verdict
        True where the answer is right; printed, it says what is not.

    Raises
    ------
    InputError
        If there is no such exercise, or the answer is not the kind of thing that it asks for.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> x, xdot = vi.coordinates("x")
    >>> print(vi.course.check("1.1", vi.System(x, xdot, xdot**2 / 4 - 20 * x**2)))
    1.1 not yet: at x = 0.615, ẋ = -1.31 the acceleration is -49.2, not -39.4
    """
    if number not in exercises:
        raise InputError(f"there is no exercise {number!r}; there are {', '.join(exercises)}")
    if answer is None:
        return Verdict(False, f"{number} awaits your answer")
    complaint = exercises[number].complaint(answer)
    return Verdict(not complaint, f"{number} {f'not yet: {complaint}' if complaint else 'right'}")
