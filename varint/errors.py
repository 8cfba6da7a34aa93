"""The project's exceptions: what was given, what is wrong, what to do."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class VarintError(Exception):
    """Base of every error that varint raises on purpose."""

    def __reduce__(self) -> tuple:
        """To another process it travels with all that is attached, trajectories included."""
        return _restored, (type(self), self.args), self.__dict__


def _restored(kind: type[VarintError], args: tuple) -> VarintError:
    return kind.__new__(kind, *args)


class InputError(VarintError, ValueError):
    """The input cannot describe the problem: wrong shape, name, value or combination."""


class StepRefused(InputError):
    """What makes a step impossible; at the start it is the input's fault, later
    `ConvergenceError` takes its place. `step` is its index, where it is known.
    """

    def __init__(self, message: str, step: int | None = None) -> None:
        super().__init__(message)
        self.step = step


class ConvergenceError(VarintError, RuntimeError):
    """A step could not be solved; what was computed before it is attached.

    Attributes
    ----------
    step : int
        Index k of the step from node k to node k + 1 that failed.
    time : float
        Time of node k.
    residual : float
        Size of the step's equations relative to the momenta where the iteration ended.
    trajectory : Trajectory or None
        Everything up to node k.
    cause : str
        The likely cause in words, and what to try.
    refused : bool
        Whether the step was refused, as shorter ones at that time would be.
    """

    def __init__(
        self,
        message: str | Callable[[str], str],
        *,
        step: int,
        time: float,
        residual: float,
        trajectory: Any = None,
        cause: str | Callable[[], str] = "",
        refused: bool = False,
    ):
        """A message and a cause, or what makes them when somebody reads them: to find the cause
        takes longer than many a run, and a search for the right steps has many that fail.
        """
        super().__init__(message if isinstance(message, str) else "")
        self.step, self.time, self.residual, self.trajectory = step, time, residual, trajectory
        self._told, self.refused = (message, cause), refused

    @property
    def cause(self) -> str:
        self._tell()
        return self._told[1]  # type: ignore[return-value]

    def __str__(self) -> str:
        self._tell()
        return super().__str__()

    def __repr__(self) -> str:
        self._tell()
        return super().__repr__()

    def __reduce__(self) -> tuple:
        self._tell()
        return super().__reduce__()

    def _tell(self) -> None:
        message, cause = self._told
        if callable(cause):
            cause = cause()
        if callable(message):
            message = message(cause)
            self.args = (message,)
        self._told = message, cause


class SolverError(VarintError, RuntimeError):
    """An optimisation or boundary value solver did not succeed; its last iterate is attached.

    Attributes
    ----------
    status : str
        The solver's own word for how it ended.
    iterate : Trajectory or None
        The last iterate.
    contradiction : Contradiction or None
        Of an optimal control that no motion can keep: which conditions the motion nearest to all of
        them breaks (``broken``), and which stand in the way (``opposed``), with the times.
    """

    def __init__(
        self, message: str, *, status: str, iterate: Any = None, contradiction: Any = None
    ):
        super().__init__(message)
        self.status, self.iterate, self.contradiction = status, iterate, contradiction


def parsed_or_refused(make: Callable[[], T], complaint: Callable[[], str]) -> T:
    """What `make` makes of a user's input; where NumPy, CasADi or Python cannot, the complaint
    takes their place.
    """
    try:
        return make()
    except (TypeError, ValueError, RuntimeError, NotImplementedError, OverflowError):
        raise InputError(complaint()) from None


def renamed_attribute(old: str, new: str) -> property:
    """The old name of an attribute, which works for one more release."""

    def value(self: Any) -> Any:
        warnings.warn(
            f"{type(self).__name__}.{old} is called {new} now; the old name goes with the next "
            "release",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(self, new)

    return property(value, doc=f"Old name of `{new}`.")
