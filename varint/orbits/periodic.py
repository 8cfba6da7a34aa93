"""Periodic orbits by Newton's method on the discrete flow."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.numerics.progress import told
from varint.orbits.correct import (
    Corrected,
    Wanted,
    bordered,
    correct,
    corrections,
    energy_row,
    no_row,
    period_row,
)
from varint.orbits.drive import with_repeats
from varint.orbits.guess import Guess, guess_of, prepared
from varint.orbits.nearer import nearer
from varint.orbits.orbit import Orbit
from varint.orbits.phase import integrals
from varint.orbits.settle import answered, answers, settled, settles
from varint.orbits.shooting import (
    Iterate,
    Shooting,
    gaps,
    orbit_rule,
    refuse_scene,
    runs,
)
from varint.rules.rule import Rule
from varint.scene.inputs import number
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, require_system
from varint.symmetry.symmetry import Symmetry

WITHIN_REACH = {8: 1e-14, 4: 1e-9, 1: 1e-5}  # errors by the order of the rule
ROUNDS = 3  # of refining the steps
NEARLY = 1e-3  # in units: gaps that shorter steps may close
CLOSED = 1e-12  # in units: what round-off may leave of x(T) − x(0)
HELPS = 0.25  # of the error before: what more steps leave of it, unless it is round-off
FAR = 1.0  # of its ranges: an orbit that begins this far from the guess
MUCH = 1.5  # times the guessed period, or less by as much
STILL = 1e-6  # of the guess's ranges: an orbit this small is an equilibrium


def periodic(
    system: System,
    guess: Any,
    rule: Rule | None = None,
    *,
    period: float | None = None,
    energy: float | None = None,
    params: ParameterValues | None = None,
    turns: Mapping[str, int] | None = None,
    steps: int | None = None,
    segments: int | None = None,
    t0: float = 0.0,
    tol: float | None = None,
    symmetries: Sequence[Symmetry] | None = None,
) -> Orbit:
    """A periodic orbit x(T) = x(0) of the discrete motion, by Newton's method with multiple
    shooting.

    The tangent maps are those of the run's own steps. What the scene conserves (energy, momenta of
    its symmetries) makes Φ − 1 singular; its right null vectors are made phase conditions, its left
    ones, ∇J, unfolding terms whose factors vanish at the solution. What remains undetermined, as in
    degenerate scenes, stays as near to the guess as it can.

    Parameters
    ----------
    system : System
        Without contacts and controls. Forces, constraints and a periodic dependence on time are
        allowed; then what is found are limit cycles, orbits on the manifold, and responses.
    guess : (q0, v0), State, Trajectory or Orbit
        A start near the orbit, or a motion of about one period; of a `Trajectory` every segment
        begins with its own state.
    rule : Rule, optional
        Default: `gauss(6)`, with constraints `lobatto(5)`: orders whose errors reach round-off in
        some hundred steps a period.
    period : float, optional
        The period, which is held. With `energy`, or where nothing is conserved, it is the first
        guess. Default: the duration of a guess that is a motion. In scenes that depend on time a
        period of theirs, or a multiple of it, to a thousandth at least.
    energy : float, optional
        The energy, which is held.
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.
    turns : dict of str and int, optional
        Whole turns, of 2π, that angles make in a period: ``{"theta": 1}``.
    steps : int, optional
        Steps of a period. Default: chosen for `tol`.
    segments : int, optional
        Segments of multiple shooting. Default: so many that none grows more than a
        thousandfold.
    t0 : float
        Time of the start, in scenes that depend on time.
    tol : float, optional
        Wanted error of the steps, in ranges of the coordinates. Default: 1e-14, with rules of order
        6 or 4 1e-9, of order 2 1e-5.
    symmetries : sequence of Symmetry, optional
        Default: those that `varint.symmetries` finds.

    Returns
    -------
    Orbit

    Warns
    -----
    UserWarning
        If a scene that depends on time is the same not after the period, but after one that agrees
        with it to a thousandth: that one is taken.

    Raises
    ------
    InputError
        If the guess or what is held makes no sense, or a scene that depends on time is not the
        same after the period.
    ConvergenceError
        If Newton's method does not come to an orbit, or only to an equilibrium.

    Notes
    -----
    Nothing being held (a motion as the guess, without `period` and `energy`), the orbit of a family
    that is nearest to the guess is found. Where nothing is conserved and Newton's method finds no
    cycle near a state, the motion from there is followed for up to 32 guessed periods: the cycle
    that it runs into is what is looked for.

    References
    ----------
    Muñoz Almaraz, Freire, Galán, Doedel & Vanderbauwhede, Physica D 181 (2003) 1 (unfolding);
    Stoer & Bulirsch, Introduction to Numerical Analysis, 7.3.5 (multiple shooting).

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    >>> orbit = vi.orbits.periodic(pendulum, ([2.0], [0.0]), period=8.0, energy=0.0)
    >>> round(orbit.period, 12)  # 4 K(sin 45°): released from the height of the pivot
    7.416298709205
    """
    sought = Sought(period, energy, steps, segments, tol, symmetries)
    first = _checked(system, guess, period, params, t0, turns)
    found, at = orbit_near(system, first, rule, sought)
    _warn_if_far(found, at)
    return found


class Sought(NamedTuple):
    """What is held, and how it is looked for; see `periodic`."""

    period: float | None
    energy: float | None
    steps: int | None = None
    segments: int | None = None
    tol: float | None = None
    symmetries: Sequence[Symmetry] | None = None


def _checked(
    system: System,
    guess: Any,
    period: float | None,
    params: ParameterValues | None,
    t0: float,
    turns: Mapping[str, int] | None,
) -> Guess:
    """The guess, of a scene that has orbits."""
    require_system(system)
    refuse_scene(system)
    first = guess_of(system, guess, period, params, number("t0", t0), turns)
    return with_repeats(system, first)


def orbit_near(
    system: System, first: Guess, rule: Rule | None, sought: Sought
) -> tuple[Orbit, Iterate]:
    """The orbit, and the guess in its segments, wherever the orbit is."""
    period, energy, steps, segments, tol, symmetries = sought
    rule = orbit_rule(system, rule)
    if tol is None:
        tol = next(x for order, x in WITHIN_REACH.items() if rule.order >= order)
    if not number("tol", tol) > 0:
        raise InputError(f"tol must be a positive number, got {tol!r}")
    known = integrals(system, first.c, first.x[: system.structure.n], symmetries)
    if energy is not None and not known.energy:
        raise InputError("energy= is held, but the scene does not conserve it (time or forces)")
    shooting = Shooting(system, rule, 1, 1, first.t0, first.shift, known)
    held = None if energy is None else number("energy", energy)

    def begun(shooting: Shooting, near: Guess) -> tuple[Wanted, Iterate]:
        shooting, at, units = prepared(shooting, near, steps, segments, tol)
        if held is not None:
            rows = energy_row(held, shooting, units.action / at.period, None, 1.0)
        elif period is not None and known.energy:
            rows = period_row(at.period, at.period)
        else:
            rows = no_row
        return Wanted(shooting, units, at.period, 1.0, None, rows), at

    with told("looking for a periodic orbit"):
        if settles(shooting, first):
            try:
                wanted, at = begun(shooting, first)
                return refined(wanted, orbit_of(wanted, correct(wanted, at)).at, steps, tol), at
            except ConvergenceError:
                cycle = settled(shooting, first)
            if cycle is not None:
                wanted, at = begun(replace(shooting, t0=cycle.t0), cycle)
                return refined(wanted, at, steps, tol), at._replace(period=first.period)
        wanted, at = begun(shooting, first)
        try:
            found = refined(wanted, at, steps, tol)
        except ConvergenceError:
            answer = answered(shooting, first) if answers(shooting, first) else None
            if answer is None:
                raise
            wanted, at = begun(shooting, answer)
            found = refined(wanted, at, steps, tol)
    return found, at


def _warn_if_far(found: Orbit, guess: Iterate) -> None:
    """Say so where the orbit is another one than the guess may have meant; what answers a drive
    begins where it must.
    """
    if not found.shooting.autonomous:
        return
    scale = found.units.scale
    away = float((np.abs(found.at.x[0] - guess.x[0]) / scale).max())
    longer = found.period / guess.period
    if away > FAR or not 1 / MUCH < longer < MUCH:
        warnings.warn(
            f"the orbit that was found begins {away:.2g} of its ranges from the guess, and its "
            f"period is {longer:.3g} of the guessed one ({found.period:.6g} beside "
            f"{guess.period:.6g}): Newton's method may have come to another orbit than was meant; "
            "look at it, or start nearer, as from a motion that nearly closes",
            stacklevel=3,
        )


def refined(wanted: Wanted, at: Iterate, steps: int | None, tol: float) -> Orbit:
    """The corrected orbit; with more steps where they were too long for it, while they help."""
    searched, before = False, np.inf
    for trial in range(-1, ROUNDS + 1):
        try:
            orbit = orbit_of(wanted, correct(wanted, at))
        except ConvergenceError as error:
            if not (searched or error.residual < NEARLY):
                at, searched = nearer(wanted, at), True
                continue
            if steps is not None or trial == ROUNDS or not error.residual < NEARLY:
                raise
            more = 2.0  # with these steps it may not close, as where they turn a perihelion
        else:
            fine = orbit.error_estimate <= 10 * tol and orbit.residual <= CLOSED
            if steps is not None or fine or trial == ROUNDS:
                return orbit
            if orbit.error_estimate > HELPS * before and orbit.residual <= CLOSED:
                return orbit  # what is left is round-off
            before = orbit.error_estimate
            at, wide = orbit.at, max(orbit.error_estimate / tol, 1.0)
            more = min(max(wide ** (1 / wanted.shooting.rule.order), 1.25), 2.0)
        each = int(np.ceil(wanted.shooting.each * more))
        wanted = replace(wanted, shooting=replace(wanted.shooting, each=each))
    raise AssertionError("the last trial returns or raises")


def orbit_of(wanted: Wanted, found: Corrected) -> Orbit:
    """What was found, with the error of its steps and its motion's own units."""
    shooting = wanted.shooting
    twice = replace(shooting, each=2 * shooting.each)
    finer = runs(twice, found.at)
    left = gaps(twice, found.at, finer, wanted.units) * wanted.units.scale
    frames = found.linear.frames
    onto = [frames[(i + 1) % len(frames)].onto for i in range(len(frames))]
    apart = np.array([a @ b for a, b in zip(onto, left, strict=True)])
    equations = bordered(wanted, found.at, found.linear._replace(gaps=apart))
    change = corrections(equations)[-1]
    many = found.linear.by_period.size
    still = np.abs(np.ptp(np.concatenate([x.x for x in finer]), axis=0) / wanted.units.scale)
    if shooting.autonomous and still.max() < STILL:
        raise ConvergenceError(
            "Newton's method came to an equilibrium: the motion there is as good as none; give a "
            "guess further from it, or hold an energy above its own",
            step=found.iterations,
            time=found.at.period,
            residual=found.residual,
            cause="every equilibrium is periodic with any period",
        )
    made = Orbit(
        shooting,
        found.at,
        wanted.units,
        found.residual,
        float(np.abs(change[:many]).max()),
        float(abs(change[many]) * wanted.period),
        found.iterations,
    )
    made.__dict__["linear"] = found.linear
    return made
