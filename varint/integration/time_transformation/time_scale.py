"""Structure-preserving variable steps: fixed steps in a fictitious time τ with dt = σ dτ, by a
time scale of the user's or the scene's own.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from varint.errors import InputError
from varint.integration.time_transformation.flight_rate import (
    TWICE_KINETIC,
    flight_rate,
    kinetic_at,
)
from varint.integration.time_transformation.local_rate import SLOWEST_RATE, LocalRate, local_rate
from varint.integration.time_transformation.transformed_scene import TransformedScene, in_time_scale
from varint.scene.expressions import in_own_symbols
from varint.scene.memory import lately, per_system
from varint.scene.system import System

AUTO = "auto"  # the time scale that the scene itself has
FLIGHT = "auto, in flight"  # the one that it has where its motion comes from afar
MOST_SCALES = 32  # rescaled scenes remembered for one system


def close_encounters(distances: Any, power: float = 1.5) -> ca.SX:
    """A time scale for close encounters, ``σ = (Σ_k r_k⁻²)^(−power/2)``: with one distance σ =
    r^power.

    The closest pair sets the pace, smoothly. With the power 3/2 a fixed step in fictitious time is
    the same fraction of the local time of free fall in a 1/r potential everywhere, however close
    the encounter.

    Parameters
    ----------
    distances : SX (k,) or list of SX
        Distances that may become small, as expressions of q.
    power : float

    Returns
    -------
    SX
        For ``simulate(..., time_scale=...)``.

    Raises
    ------
    InputError
        If there is no distance, or the power is not positive.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> model = vi.models.kepler(e=0.9)
    >>> scale = vi.close_encounters(ca.norm_2(model.system.q))
    >>> start = dict(q0=model.q0, v0=model.v0, h=0.55, duration=20 * 3.14159)
    >>> orbit = vi.simulate(model.system, vi.gauss(8), time_scale=scale, **start)
    >>> q, v = model.exact(orbit.t)
    >>> bool(abs(orbit.q - q).max() < 1e-10)
    True
    """
    if not isinstance(distances, (ca.SX, list, tuple)):
        raise InputError(f"distances must be SX expressions of q, got {type(distances).__name__}")
    r = ca.vertcat(*distances) if isinstance(distances, (list, tuple)) else ca.vec(distances)
    if not r.numel() or not power > 0:
        raise InputError(
            f"close_encounters needs one distance or more and a positive power, got {r.shape} and "
            f"{power}"
        )
    return ca.sum1(ca.densify(r) ** -2.0) ** (-power / 2) if r.numel() > 1 else r**power


def rate_of(system: System, word: str) -> LocalRate:
    """The rate behind AUTO, or behind FLIGHT, which is of `TWICE_KINETIC`, too."""
    return local_rate(system) if word == AUTO else flight_rate(system)


def own_scale(system: System, word: str) -> str:
    """Which rate a scene's own time scale is of: that in flight where inertia varies, since ∂a/∂q
    then depends on velocities.
    """
    return FLIGHT if word == AUTO and not system.structure.constant_mass else word


def natural_time_scale(system: System, word: str = AUTO) -> ca.SX:
    """σ(q) = (ω(q)² + ω₀²)^(−1/2), the inverse of the scene's local rate; ω₀ is `SLOWEST_RATE`.
    In FLIGHT it is of `INITIAL_ENERGY`, too.

    Raises
    ------
    InputError
        If the scene has no such rate.
    """
    rate = rate_of(system, word)
    if rate.square is None:
        raise InputError(
            f"time_scale='auto' takes the rate of the scene from ∂a/∂q as a function of q, but "
            f"{rate.reason}; give a time scale of your own, or leave it out and choose a smaller h"
        )
    square = rate.square
    if word == FLIGHT:
        square = ca.substitute(square, TWICE_KINETIC, kinetic_at(system))
    return 1 / ca.sqrt(square + SLOWEST_RATE**2)


def transformed_scene(system: System, sigma: Any) -> TransformedScene:
    """The scene with the time scale σ(q), or its own where that is "auto"; scenes already seen are
    remembered, by the expression and by its meaning.
    """
    if isinstance(sigma, str):
        return _natural(system, sigma)
    known = system.__dict__.setdefault("_rescaled", {})
    seen = known.get(id(sigma))
    if seen and seen[0] is sigma and ca.is_equal(seen[1], sigma):
        return seen[2]
    scene = _by_meaning(system, _check_scale(system, sigma))
    if len(known) >= MOST_SCALES:
        known.clear()
    known[id(sigma)] = sigma, ca.SX(sigma), scene  # entries of an expression may change
    return scene


@per_system
def _natural(system: System, word: str) -> TransformedScene:
    if word not in (AUTO, FLIGHT):
        raise InputError(f"time_scale must be an SX expression of q or {AUTO!r}, got {word!r}")
    _require_energy(system)
    return in_time_scale(system, natural_time_scale(system, word))


def _by_meaning(system: System, sigma: ca.SX) -> TransformedScene:
    known = system.__dict__.setdefault("_rescaled_by_meaning", {})
    key = ca.Function("sigma", [system.q, system.t, system.c], [sigma]).serialize()
    return lately(known, key, lambda: in_time_scale(system, sigma), MOST_SCALES)


def _require_energy(system: System) -> None:
    """What changes the energy must be known: forces and explicit time, no more."""
    s = system.structure
    moved = not s.autonomous and bool(s.constraints or s.nonholonomic)
    reasons = {
        "contacts interrupt the motion": bool(s.contacts),
        "the Lagrangian is degenerate": s.degenerate,
        "controls act from outside": bool(s.controls),
        "constraints beside explicit time may do work": moved,
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(
                f"time_scale needs the energy all along, but {reason}; leave time_scale out and "
                "choose a smaller h"
            )


def _check_scale(system: System, sigma: Any) -> ca.SX:
    _require_energy(system)
    sigma = in_own_symbols(sigma, system, "time_scale")
    if sigma.numel() != 1:
        raise InputError(
            "time_scale must be a scalar expression of q and the parameters, it has shape "
            f"{sigma.shape}"
        )
    others = system.v if not system.structure.autonomous else ca.vertcat(system.v, system.t)
    strange = [x.name() for x in ca.symvar(others) if ca.depends_on(sigma, x)]
    if strange:
        own = (
            "q and the parameters alone"
            if others.numel() > system.v.numel()
            else "q, t and the parameters"
        )
        raise InputError(f"time_scale may depend on {own}, not on {strange}")
    return sigma
