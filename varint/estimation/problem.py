"""From what the user wrote to a well-posed estimation problem, or a clear refusal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.estimation.begin import begin_function, begun
from varint.estimation.inertias import grows_with
from varint.estimation.measurement import Experiment, Measurement
from varint.integration.problem import controls
from varint.rules.rule import Rule
from varint.scene.free import Free
from varint.scene.inputs import finite_array, number, positive_integer
from varint.scene.parameters import values_by_name
from varint.scene.system import System, parameter_entries, parameter_values, parameters_by_name

START = ("q0", "v0")
ON_NODE = 1e-9  # of a step: a time this close to a node is the node
MOST_UNKNOWNS = 3000  # of a dense least-squares problem that takes seconds


class Motion(NamedTuple):
    """One experiment on its grid.

    Attributes
    ----------
    data : tuple of Measurement
    start : ndarray (2n,)
        (q0, v0), or guesses of them.
    begin : Function or None
        c → (q0, v0), where they depend on parameters.
    t0 : float
    steps : int
    u : ndarray (steps, r, k)
    cuts : ndarray of int
        Steps at which segments begin, the end of the last one included.
    times : ndarray (T,)
        When something was measured, in order.
    rows : tuple of ndarray
        For each measurement the places of its times among them.
    """

    data: tuple[Measurement, ...]
    start: np.ndarray
    begin: ca.Function | None
    t0: float
    steps: int
    u: np.ndarray
    cuts: np.ndarray
    times: np.ndarray
    rows: tuple[np.ndarray, ...]


class Estimation(NamedTuple):
    """What is to be found.

    Attributes
    ----------
    system, rule : System, Rule
    h : float
    c : ndarray
        Parameter values, guesses where they are unknown.
    theta : ndarray of int
        Places in c of the unknown ones.
    free : ndarray of int
        Places in (q0, v0) of the unknown ones, alike in all experiments.
    lower, upper : ndarray
        Bounds of the unknown parameters, then of the unknown start.
    prior : ndarray (P, 3)
        Which of the unknown parameters, mean, spread.
    motions : tuple of Motion
    names : tuple of str
        Of the unknown parameters, then of every experiment's unknown start.
    """

    system: System
    rule: Rule
    h: float
    c: np.ndarray
    theta: np.ndarray
    free: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    prior: np.ndarray
    motions: tuple[Motion, ...]
    names: tuple[str, ...]

    @property
    def many(self) -> int:
        """Unknowns that have names."""
        return len(self.theta) + len(self.free) * len(self.motions)

    @property
    def size(self) -> int:
        """Unknowns with the states at which segments begin."""
        n = self.system.structure.n
        return self.many + sum(2 * n * (len(m.cuts) - 2) for m in self.motions)


def estimation(
    system: System,
    rule: Rule,
    experiments: Sequence[Experiment],
    unknown: Any,
    h: Any,
    params: Any,
    segments: Any,
    priors: Any,
) -> Estimation:
    """Checked and completed input of one fit."""
    s, n = system.structure, system.structure.n
    if s.degenerate:
        raise InputError("fit takes scenes whose Lagrangian is regular in the velocities")
    if number("h", h) <= 0:
        raise InputError(f"h must be positive, got {h!r}")
    segments = positive_integer("segments", segments)
    wanted = unknowns(system, unknown)
    if s.contacts and segments > 1:
        raise InputError(
            "the scene has contacts: its motions are single runs, whose impacts come as they do "
            "from the start; take segments=1"
        )
    held = bool(s.constraints or s.nonholonomic)
    if held and (segments > 1 or {"q0", "v0"} & set(wanted)):
        raise InputError(
            "the scene has constraints: its start cannot vary freely; give q0 and v0 on the "
            "constraints, leave them out of unknown, and take segments=1"
        )
    c, theta, low, high = parameters_to_find(system, wanted, params)
    free: list[int] = []
    starts: dict[str, Any] = {}
    for i, name in enumerate(START):
        if name in wanted:
            free += range(i * n, (i + 1) * n)
            starts[name] = wanted[name]
            _, lower, upper = _bounds(name, wanted[name], np.zeros(n))
            low, high = [*low, *lower], [*high, *upper]
    motions = tuple(_motion(system, rule, x, float(h), segments, starts, c) for x in experiments)
    low = positive_inertias(system, theta, low, c, motions[0].start)
    low, high = bounded_restitution(system, theta, low, high)
    entries = parameter_entries(system)
    of_start = [*(f"{x}(0)" for x in system.names), *(f"d{x}/dt(0)" for x in system.names)]
    names = [entries[i] for i in theta]
    for e in range(len(motions)):
        where = f" of experiment {e}" if len(motions) > 1 else ""
        names += [of_start[i] + where for i in free]
    made = Estimation(
        system,
        rule,
        float(h),
        c,
        np.array(theta, dtype=int),
        np.array(free, dtype=int),
        np.array(low),
        np.array(high),
        prior_rows(system, priors, theta),
        motions,
        tuple(names),
    )
    if made.size > MOST_UNKNOWNS:
        raise InputError(
            f"{made.size} unknowns are more than the {MOST_UNKNOWNS} that a fit can take: take "
            "fewer segments"
        )
    return made


def positive_inertias(
    system: System, theta: list[int], low: list[float], c: np.ndarray, start: np.ndarray
) -> list[float]:
    """Lower bounds with zero for masses and moments of inertia that were given none."""
    places = np.array(theta, dtype=int)
    if not len(places):
        return low
    grown = grows_with(system, c, places, start)
    free = np.isneginf(low[: len(theta)])
    zero = np.where(grown & free & (c[places] > 0), 0.0, low[: len(theta)])
    return [*zero.tolist(), *low[len(theta) :]]


def bounded_restitution(
    system: System, theta: list[int], low: list[float], high: list[float]
) -> tuple[list[float], list[float]]:
    """Bounds within 0 and 1 for parameters that are coefficients of restitution themselves."""
    own = {x.element_hash() for x in ca.vertsplit(system.bounce) if x.is_symbolic()}
    at = [j for j, i in enumerate(theta) if system.c[i].element_hash() in own]
    low = [max(x, 0.0) if j in at else x for j, x in enumerate(low)]
    return low, [min(x, 1.0) if j in at else x for j, x in enumerate(high)]


def parameters_to_find(
    system: System, wanted: dict[str, Any], params: Any
) -> tuple[np.ndarray, list[int], list[float], list[float]]:
    """Parameter values with the guesses put in, places of the unknown ones, and their bounds."""
    given = parameter_values(system, params)
    c, places = given.copy(), parameters_by_name(system, np.arange(given.size))
    theta: list[int] = []
    low: list[float] = []
    high: list[float] = []
    for name, x in wanted.items():
        if name not in START:
            at = places[name].ravel(order="F")
            c[at], lower, upper = _bounds(name, x, given[at])
            theta += at.tolist()
            low, high = [*low, *lower], [*high, *upper]
    return c, theta, low, high


def unknowns(system: System, unknown: Any) -> dict[str, Any]:
    """What is unknown by name, with what is given of each: bounds and guess, or nothing."""
    if isinstance(unknown, Mapping):
        wanted = values_by_name(unknown)
    else:
        listed = [unknown] if isinstance(unknown, str) or hasattr(unknown, "numel") else unknown
        wanted = {next(iter(values_by_name([(x, None)]))): None for x in listed}
    known = [*START, *system.defaults]
    if wrong := [x for x in wanted if x not in known]:
        raise InputError(f"unknown has {wrong}, which the scene has not; known: {known}")
    if not wanted:
        raise InputError(f"unknown names nothing to be found; known: {known}")
    return wanted


def _bounds(name: str, x: Any, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Guess, lower and upper bound of an unknown."""
    infinite = np.full(value.shape, np.inf)
    if x is None:
        return value, -infinite, infinite
    if not isinstance(x, Free):
        guess = finite_array(f"unknown {name!r}", x).ravel(order="F")
        if guess.size not in (1, value.size):
            raise InputError(f"unknown {name!r} has {guess.size} numbers, not {value.size}")
        return np.broadcast_to(guess, value.shape), -infinite, infinite
    parts = (np.ravel(y, order="F") for y in (x.guess, x.lower, x.upper))
    guess, lower, upper = (np.broadcast_to(y, value.shape) for y in parts)
    return guess, lower, upper


def prior_rows(system: System, priors: Any, theta: list[int]) -> np.ndarray:
    """Which of the unknown parameters, mean and spread, (P, 3)."""
    places, rows = parameters_by_name(system, np.arange(system.c.numel())), []
    for name, given in values_by_name(priors or {}).items():
        mean_and_sigma = finite_array(f"the prior of {name!r}", given)
        if name not in places or mean_and_sigma.shape != (2,) or mean_and_sigma[1] <= 0:
            raise InputError(
                f"priors takes parameters with (mean, sigma), sigma positive; got {name!r}: "
                f"{given!r}"
            )
        rows += [(theta.index(i), *mean_and_sigma) for i in places[name].ravel() if i in theta]
    return np.array(rows).reshape(-1, 3)


def _motion(
    system: System,
    rule: Rule,
    x: Experiment,
    h: float,
    segments: int,
    starts: dict[str, Any],
    c: np.ndarray,
) -> Motion:
    data = tuple([x.data] if isinstance(x.data, Measurement) else x.data)
    if not data or not all(isinstance(m, Measurement) for m in data):
        raise InputError("data must be Measurements, or Experiments that have some")
    t0 = number("t0", x.t0)
    times = np.unique(np.concatenate([m.t for m in data]))
    if times[0] < t0 - ON_NODE * h:
        raise InputError(f"something was measured at t={times[0]:g}, before the start at t0={t0:g}")
    steps = max(math.ceil((times[-1] - t0) / h - ON_NODE), 1)
    function = begin_function(system, x.q0, x.v0, starts)
    symbolic = isinstance(x.q0, ca.SX) or isinstance(x.v0, ca.SX)
    start = list(np.split(finite_array("the start at the guess", begun(function, c)[0]), 2))
    for i, name in enumerate(START):
        if isinstance(starts.get(name), Free):
            start[i] = np.clip(start[i], starts[name].lower, starts[name].upper)
    cuts = np.unique(np.linspace(0, steps, min(segments, steps) + 1).round().astype(int))
    rows = tuple(np.searchsorted(times, m.t) for m in data)
    u = controls(system, rule, x.u, steps)
    begin = function if symbolic else None
    return Motion(data, np.concatenate(start), begin, t0, steps, u, cuts, times, rows)
