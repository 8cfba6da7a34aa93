"""Motion seen from a frame that moves along a symmetry: relative equilibria, relative orbits."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.orbits.equilibria import Equilibria
from varint.orbits.rest import Equilibrium, Held, rest
from varint.scene.inputs import number, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values, require_system
from varint.symmetry.symmetry import Symmetry

RATE = "rate"
FAR = 0.5  # of the guess or of what was found: one that lies this far off may be another


def corotating(system: System, symmetry: Symmetry, rate: float = 0.0) -> System:
    """The scene in the frame that moves along a symmetry, L'(q, v) = L(q, v + Ω ξ(q)) − Ω K(q), H'
    = H − Ω J.

    Its equilibria are the relative equilibria of the scene, q(t) = exp(Ω t ξ) q, its periodic
    orbits the relative periodic ones; −L'(q, 0) is the augmented potential.

    Parameters
    ----------
    system : System
        Without forces.
    symmetry : Symmetry
        From `symmetries` or `noether`, conserved, with ξ and K free of time.
    rate : float
        Default value of the new parameter ``rate``, Ω.

    Returns
    -------
    System
        With one more parameter, ``rate``.

    Raises
    ------
    InputError
        If it is no such symmetry of this scene.

    References
    ----------
    Marsden, Lectures on Mechanics, 1992, §5.3 (augmented Hamiltonian).

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> planet = vi.System(q, v, v.T @ v / 2 + 1 / (q.T @ q) ** 0.5)
    >>> turning = vi.orbits.corotating(planet, vi.symmetries(planet)["rotation about z"], 1.0)
    >>> vi.orbits.equilibria(turning, [1.1, 0.0])[0]  # circular orbit
    Equilibrium(x=1, y=0)
    """
    require_system(system)
    if not isinstance(symmetry, Symmetry) or symmetry.system is not system:
        raise InputError("symmetry must be one of this system, from symmetries() or noether()")
    fields = ca.vertcat(symmetry.xi, symmetry.gauge, symmetry.tau)
    if not symmetry.conserved or system.structure.forced or ca.depends_on(fields, system.t):
        raise InputError(
            f"{symmetry.name} makes no frame in which the scene is autonomous: it is broken, "
            "depends on time, or forces act"
        )
    if symmetry.xi.is_zero() or not symmetry.tau.is_zero():
        raise InputError(f"{symmetry.name} moves nothing in space: take one with τ = 0, ξ ≠ 0")
    if RATE in system.defaults:
        raise InputError("the scene has a parameter 'rate' already: rename it")
    s, turn = system, ca.SX.sym(RATE)
    moved = ca.substitute(s.lagrangian, s.v, s.v + turn * symmetry.xi)
    known = s.params._symbols if s.params is not None else {}
    params: list[tuple[Any, Any]] = [(x, s.defaults[name]) for name, x in known.items()]
    return System(
        s.q,
        s.v,
        moved - turn * symmetry.gauge,
        constraint=s.constraint if s.structure.constraints else None,
        nonholonomic=s.nonholonomic if s.structure.nonholonomic else None,
        params=[*params, (turn, number("rate", rate))],
        t=s.t,
    )


def relative_equilibria(
    system: System,
    symmetry: Symmetry,
    guess: Any,
    *,
    rate: float | None = None,
    momentum: float | None = None,
    params: ParameterValues | None = None,
) -> Equilibria:
    """Motions along a symmetry, q(t) = exp(Ω t ξ) q: critical points of the augmented potential
    −L(q, Ω ξ) + Ω K.

    Parameters
    ----------
    system : System
    symmetry : Symmetry
        From `symmetries` or `noether`.
    guess : array (n,) or (k, n)
        Configurations near them.
    rate : float, optional
        Ω, held; with `momentum` the first guess of it.
    momentum : float, optional
        The value of J = p·ξ − K, held; then the rate follows (the amended potential's critical
        points).
    params : dict, optional

    Returns
    -------
    Equilibria
        Of the scene `corotating` with the symmetry: stability and modes are those in the turning
        frame, without the neutral ones of the symmetry.

    Raises
    ------
    InputError
        If neither rate nor momentum is given, or the symmetry does not suit.
    ConvergenceError
        If there is none near the guess.

    References
    ----------
    Marsden, Lectures on Mechanics, 1992, chapters 4 and 5.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> planet = vi.System(q, v, v.T @ v / 2 + 1 / (q.T @ q) ** 0.5)
    >>> turn = vi.symmetries(planet)["rotation about z"]
    >>> [circle] = vi.orbits.relative_equilibria(planet, turn, [3.0, 0.0], momentum=2.0)
    >>> round(float(circle.q[0]), 12), round(float(circle.parameters["rate"]), 12)  # r = J², 1/J³
    (4.0, 0.125)
    """
    if rate is None and momentum is None:
        raise InputError("give rate=, the speed along the symmetry, or momentum=, its integral")
    turning = corotating(system, symmetry, 0.0)
    c = np.append(parameter_values(system, params), 1.0 if rate is None else number("rate", rate))
    held = None
    if momentum is not None:
        turn = turning.c[-1]
        speed = ca.substitute(symmetry.quantity, system.v, system.v + turn * symmetry.xi)
        held = Held(speed, number("momentum", momentum), len(c) - 1)
    given = np.asarray(guess, dtype=float)
    given = given.reshape(1, -1) if given.ndim < 2 else given
    n = system.structure.n
    rows = [vector("guess", row, n, system.names) for row in given]
    found = [rest(turning, row, c, held) for row in rows]
    for one, row in zip(found, rows, strict=True):
        _warn_if_far(one, row)
    return Equilibria(tuple(sorted(found, key=lambda x: x.energy)))


def _warn_if_far(found: Equilibrium, guess: np.ndarray) -> None:
    """Say so where it is another one than the guess may have meant."""
    away = float(np.linalg.norm(found.q - guess))
    if away > FAR * float(max(np.linalg.norm(found.q), np.linalg.norm(guess))):
        warnings.warn(
            f"the relative equilibrium that was found, {found!r}, lies {away:.2g} from the guess "
            f"{guess}: Newton's method may have come to another one than was meant; look at it, or "
            "start nearer, as from one of a rate or momentum that differs a little",
            stacklevel=3,
        )
