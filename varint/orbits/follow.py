"""Families of periodic orbits by pseudo-arclength continuation."""

from __future__ import annotations

from typing import Any

from varint.errors import InputError
from varint.numerics.progress import progress_bar, told_beside
from varint.orbits.advance import FIRST, exactly, in_new_segments, next_point
from varint.orbits.continuation import quantity
from varint.orbits.curve import Curve
from varint.orbits.drive import drive_of
from varint.orbits.ends import is_at_rest, is_back
from varint.orbits.family import Family, parameter_index
from varint.orbits.orbit import Orbit
from varint.orbits.passages import Point, located, point_of
from varint.scene.inputs import number, positive_integer

LONGEST = 0.15  # arclength of a step, in ranges of the orbit
MOST_STEPS = 30_000  # of an orbit: more mean a collision ahead, and seconds an orbit


def family(
    orbit: Orbit,
    along: str = "energy",
    *,
    to: float | None = None,
    increasing: bool = True,
    hold: str = "period",
    most: int = 100,
    step: float = FIRST,
    longest: float = LONGEST,
    bifurcations: bool = True,
    progress: bool | None = None,
) -> Family:
    """The family of an orbit by pseudo-arclength continuation: ⟨ẏ, y − y_k⟩ = Δs with y = (states,
    period, parameter).

    Energy and momenta are kept by unfolding, so the equations are regular at folds, too. Steps
    adapt to Newton's method and to the bends of the curve; folds, branch points, period doublings
    and collisions of multipliers are located on it.

    Parameters
    ----------
    orbit : Orbit
        From `periodic`, `Bifurcation.branch`, or a mode by `NormalModes.orbit`: small amplitudes
        make a family of nonlinear normal modes.
    along : str
        "energy" or "period" (the same curve), or a parameter, ``"mu"``, ``"mass[0]"``. Of a scene
        that is driven the period goes with the parameter, where that is the frequency or the
        period of the drive.
    to : float, optional
        Value at which it ends, with an orbit right there.
    increasing : bool
        Which way it sets out, where `to` does not say.
    hold : {"period", "energy"}
        What is held while a parameter is varied, in scenes that conserve their energy.
    most : int
        Orbits at most.
    step, longest : float
        First and longest arclength of a step, in ranges of the orbit.
    bifurcations : bool
        Whether to look for them.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for what takes longer than a second; elsewhere
        a line on standard error after two seconds, and again at most every ten.

    Returns
    -------
    Family

    Raises
    ------
    InputError
        If there is no such quantity, or the scene conserves no energy to vary.

    References
    ----------
    Keller, Lectures on Numerical Methods in Bifurcation Problems, 1987; Muñoz Almaraz et al.,
    Physica D 181 (2003) 1; Kerschen et al., Mechanical Systems and Signal Processing 23 (2009) 170
    (nonlinear normal modes).

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> duffing = vi.System(q, v, (v**2 - q**2 - q**4 / 2) / 2)
    >>> first = vi.orbits.normal_modes(duffing, [0.0]).orbit(0)
    >>> backbone = vi.orbits.family(first, to=0.75)  # amplitude 1
    >>> round(backbone[-1].period, 10)
    4.7680220291
    """
    if not isinstance(orbit, Orbit):
        raise InputError(f"family takes an Orbit, from periodic(), got {type(orbit).__name__}")
    most, curve = positive_integer("most", most, 2), _curve(orbit, along, hold)
    step, longest = number("step", step), number("longest", longest)
    if not 0 < step <= longest:
        raise InputError(f"step={step} must be positive and at most longest={longest}")
    value = quantity(orbit, curve)
    ahead = increasing if to is None else number("to", to) > value
    here = point_of(orbit, curve, None, 1.0 if ahead else -1.0)
    orbits, found, ended = [orbit], [], f"after {most} orbits"
    before: Point | None = None
    bar, told = progress_bar(most, "orbit", progress), told_beside("family of orbits", progress)
    with bar as move, told as say:
        while len(orbits) < most:
            if here.orbit.steps > MOST_STEPS:
                ended = f"where an orbit takes more than {MOST_STEPS} steps: near a collision"
                break
            made = next_point(here, before, step, curve)
            if made is None:
                ended = "where steps of any length fail: near a collision, or where orbits end"
                break
            following, length, step = made
            step = min(step, longest)
            reached = (
                to is not None
                and (quantity(following.orbit, curve) - to) * (quantity(here.orbit, curve) - to)
                <= 0
            )
            if reached:
                following, length = exactly(here, following, length, float(to), curve)  # type: ignore[arg-type]
                ended = f"at {along}={to:.10g}"
            if bifurcations:
                found += located(here, following, length, curve)
            orbits.append(following.orbit)
            move(1, lambda: f"{along}={quantity(orbits[-1], curve):.6g}")
            say(lambda: f"{len(orbits)} orbits, {along}={quantity(orbits[-1], curve):.6g}")
            if reached:
                break
            if is_back(orbits, following, length, curve):
                ended = "where it began: the family is closed"
                break
            if is_at_rest(orbits):
                ended = "where its orbits shrink to an equilibrium"
                break
            before, here = here, in_new_segments(following, curve)
    return Family(tuple(orbits), along, tuple(found), ended)


def _curve(orbit: Orbit, along: Any, hold: str) -> Curve:
    known = orbit.shooting.integrals.energy
    if along in ("energy", "period"):
        if not known:
            raise InputError(
                f"the scene does not conserve its energy: its orbits form no family along {along}; "
                "vary a parameter"
            )
        return Curve(along, None, None, 0.0)
    if hold not in ("period", "energy"):
        raise InputError(f"hold must be 'period' or 'energy', got {hold!r}")
    index = parameter_index(orbit, along)
    held = hold if known else None
    drive = 0 if orbit.shooting.autonomous else drive_of(orbit, along, index)
    value = orbit.period if hold == "period" else orbit.energy
    return Curve(along, index, held, value, drive)
