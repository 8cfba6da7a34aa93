"""From guesses to the best fit: starts that the data suggest beside the user's own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.errors import ConvergenceError, SolverError
from varint.estimation.first_part import SHARES, with_first_part, with_values
from varint.estimation.gauss_newton import Solved, loss_of, solve, values_at
from varint.estimation.problem import Estimation
from varint.estimation.regressor import from_the_data
from varint.estimation.residuals import Shooter, first_guess, residuals
from varint.estimation.segments import guessed_states

TINY = 1e-3  # of a guess, or of the largest coordinate: smaller sizes are taken for this much
PLAUSIBLE = 2.0  # χ² by its degrees of freedom: beyond, another start may end in a better minimum


class Minimum(NamedTuple):
    """A fit as the solver left it.

    Attributes
    ----------
    shoot : Shooter
    huber : float or None
    solved : Solved
    """

    shoot: Shooter
    huber: float | None
    solved: Solved

    @property
    def chi_squared(self) -> float:
        """Σ ((ψ − y)/σ)², by Huber's loss where that is asked for."""
        return 2 * loss_of(self.solved.found.r, self.huber)


def best_fit(shoot: Shooter, huber: float | None) -> Minimum:
    """The best of what the starts lead to, the next one tried where one leads to nothing plausible.

    Raises
    ------
    ConvergenceError
        If no start can be run.
    SolverError
        If none leads to a solution.
    """
    p, ended = shoot.problem, list[Minimum]()
    for z in _starts(shoot, huber):
        ended.append(fitted(shoot, z, *bounds(p), huber))
        freedom = max(len(ended[-1].solved.found.r) - p.many, 1)
        if ended[-1].solved.converged and ended[-1].chi_squared <= PLAUSIBLE * freedom:
            break
    best = min(ended, key=lambda x: (not x.solved.converged, x.chi_squared))
    if not best.solved.converged:
        gap = np.abs(best.solved.found.d).max(initial=0.0)
        raise SolverError(
            f"the fit did not converge in {best.solved.steps} steps (χ² {best.chi_squared:.3g}, "
            f"gaps between segments {gap:.2g}): take other guesses, bounds, or more segments",
            status="not converged",
        )
    return best


def fitted(
    shoot: Shooter, z: np.ndarray, lower: np.ndarray, upper: np.ndarray, huber: float | None
) -> Minimum:
    """Gauss–Newton from one start."""
    p = shoot.problem
    solved = solve(lambda x: residuals(shoot, x), z, lambda x: sizes(p, x), lower, upper, huber)
    return Minimum(shoot, huber, solved)


def _starts(shoot: Shooter, huber: float | None) -> Iterator[np.ndarray]:
    """Guesses of all unknowns: the user's, and those that the data show; the better ones first,
    where single runs can tell. Where none leads anywhere, what the first data lead to.
    """
    yield from _guesses(shoot)
    yield _from_first_data(shoot, huber)


def _from_first_data(shoot: Shooter, huber: float | None) -> np.ndarray:
    """Fits of the first data, then of more of them, each from what the one before found: long runs
    amplify wrong guesses, and with another number of impacts they meet other minima; short ones
    do not.
    """
    found = shoot.problem
    for share in SHARES:
        part = _near(with_first_part(found, share))
        with suppress(ConvergenceError):
            one = replace(shoot, problem=part)
            found = with_values(
                found, fitted(one, first_guess(part), *bounds(part), huber).solved.z
            )
    return guessed_states(found, first_guess(found))


def _near(p: Estimation) -> Estimation:
    """With what is told of every unknown: its guess, give or take its size. Few data leave open
    what more will tell.
    """
    z = first_guess(p)[: p.many]
    rows = np.column_stack([np.arange(p.many), z, sizes(p, z)])
    rows = rows[(z != 0) | (rows[:, 0] >= len(p.theta))]  # a parameter of zero has no size
    return p._replace(prior=np.concatenate([p.prior, rows]))


def _guesses(shoot: Shooter) -> list[np.ndarray]:
    """The user's, and those that all data show."""
    p = shoot.problem
    problems = [x for x in (from_the_data(p), p) if x is not None]
    guesses = [guessed_states(x, first_guess(x)) for x in problems]
    if len(guesses) < 2:
        return guesses
    losses = np.array([_loss(shoot, z) for z in guesses])
    order = np.argsort(losses, kind="stable") if p.size == p.many else np.arange(2)
    return [guesses[i] for i in order if np.isfinite(losses[i])] or guesses[-1:]


def _loss(shoot: Shooter, z: np.ndarray) -> float:
    found = values_at(lambda x: residuals(shoot, x), z)
    return np.inf if found is None else loss_of(found.r, None)


def bounds(p: Estimation) -> tuple[np.ndarray, np.ndarray]:
    """Of all unknowns; states between segments have none."""
    many, wide = len(p.theta), np.full(p.size, np.inf)
    lower, upper = -wide, wide
    for bound, given in ((lower, p.lower), (upper, p.upper)):
        bound[:many] = given[:many]
        bound[many : p.many] = np.tile(given[many:], len(p.motions))
    return lower, upper


def sizes(p: Estimation, z: np.ndarray) -> np.ndarray:
    """Typical sizes of the unknowns: of parameters their own, of states those of all of them; not
    far below the guesses, for what is zero has no size of its own.
    """
    size, many = np.ones(p.size), len(p.theta)
    size[:many] = np.maximum(np.abs(z[:many]), TINY * _or_one(np.abs(p.c[p.theta])))
    n = p.system.structure.n
    given = float(_or_one(np.array(max(np.abs(m.start).max() for m in p.motions))))
    for first, last, width in ((many, p.many, len(p.free)), (p.many, p.size, 2 * n)):
        if last > first:
            rows = np.abs(z[first:last]).reshape(-1, width)
            least = TINY * max(rows.max(), given)
            size[first:last] = np.tile(np.maximum(rows.max(axis=0), least), len(rows))
    return size


def _or_one(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)
