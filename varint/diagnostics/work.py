"""Accuracy against run time: the cheapest rule for a wanted error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.diagnostics.accuracy import Reference, counts_of, end_of, error_at_end
from varint.diagnostics.runs import Scene, march, scene
from varint.errors import InputError
from varint.integration.problem import Start
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class WorkPrecision:
    """Run time against error of several rules.

    Attributes
    ----------
    methods : tuple of str
    steps : ndarray (k,)
    seconds, error : ndarray (methods, k)
        Best run time, and largest relative error of q and p at the end; NaN where a run failed.
    floor : float
        Accuracy of the reference.
    """

    methods: tuple[str, ...]
    steps: np.ndarray
    seconds: np.ndarray
    error: np.ndarray
    floor: float

    def cost(self, method: int, error: float) -> float:
        """Run time at which the method reaches the error, interpolated; infinite if it does not."""
        good = np.isfinite(self.error[method]) & (self.error[method] > 0)
        e, s = self.error[method][good], self.seconds[method][good]
        reached = np.flatnonzero(e <= error)
        if not len(reached):
            return float("inf")
        first = int(reached[0])
        if first == 0 or e[first - 1] <= e[first]:
            return float(s[first])
        part = np.log(e[first - 1] / error) / np.log(e[first - 1] / e[first])
        return float(np.exp(np.log(s[first - 1]) + part * np.log(s[first] / s[first - 1])))

    def cheapest(self, error: float) -> str:
        """The method that reaches the error in the least time.

        Raises
        ------
        InputError
            If none does.
        """
        costs = [self.cost(i, error) for i in range(len(self.methods))]
        if not np.isfinite(costs).any():
            raise InputError(
                f"no method reached an error of {error:g}; the smallest is "
                f"{np.nanmin(self.error):.1e}"
            )
        return self.methods[int(np.argmin(costs))]

    def __str__(self) -> str:
        width = max(len(m) for m in self.methods)
        lines = [f"{'method'.ljust(width)}  steps      error    seconds"]
        for name, seconds, errors in zip(self.methods, self.seconds, self.error, strict=True):
            for k, t, e in zip(self.steps, seconds, errors, strict=True):
                lines.append(f"{name.ljust(width)}  {k:5d}  {e:9.1e}  {t:9.2e}")
        smallest = np.nanmin(self.error)
        for wanted in 10.0 ** np.arange(-3, -15, -3):
            if smallest <= wanted:
                lines.append(f"cheapest for an error of {wanted:.0e}: {self.cheapest(wanted)}")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Run time over error, one line a method."""
        from varint.drawing.diagnostic_figures import work_precision_figure

        return work_precision_figure(self.methods, self.error, self.seconds)


def work_precision(
    system: System,
    methods: Sequence[Rule | ca.Function],
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    duration: float,
    steps: Sequence[int] = (32, 64, 128, 256, 512, 1024),
    repeats: int = 3,
    reference: Reference = None,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    u: Any = None,
) -> WorkPrecision:
    """Run time against error at the end, for several rules and step numbers on the same scene.

    Parameters
    ----------
    system, q0, v0, p0, duration, reference, params, t0, u
        As in `convergence`.
    methods : sequence of Rule or Function
    steps : sequence of int
    repeats : int
        Timed runs, after one that builds the functions; the fastest counts.

    Returns
    -------
    WorkPrecision
        Prints a table and the cheapest rule for round errors; ``.plot()``, ``.cheapest(error)``.
    """
    if isinstance(methods, (Rule, ca.Function)) or not methods:
        raise InputError(
            "methods must be a list of rules, such as [gauss(2), composition('blanes-moan4')]"
        )
    given = Start(q0, v0, p0, t0, params, u)
    starts = [scene(system, m, given) for m in methods]
    q, p, floor = end_of(starts[0], duration, reference)
    counts = counts_of(steps)
    seconds, errors = np.empty((len(starts), len(counts))), np.empty((len(starts), len(counts)))
    for i, start in enumerate(starts):
        for j, count in enumerate(counts):
            errors[i, j] = max(error_at_end(start, duration, int(count), q, p))
            seconds[i, j] = (
                _fastest(start, duration, int(count), repeats)
                if np.isfinite(errors[i, j])
                else np.nan
            )
    return WorkPrecision(tuple(s.name for s in starts), counts, seconds, errors, floor)


def _fastest(start: Scene, duration: float, steps: int, repeats: int) -> float:
    times = []
    for _ in range(max(repeats, 1)):
        began = perf_counter()
        march(start, duration / steps, steps)
        times.append(perf_counter() - began)
    return min(times)
