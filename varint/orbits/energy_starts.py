"""Starts of a given energy, one velocity of each solved for."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.numerics.arrays import over_columns
from varint.scene.inputs import number
from varint.scene.memory import per_system
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values, require_system

CORRECTIONS = 12  # of Newton's method; where H is quadratic in a velocity the first is exact
HALVINGS = 100  # of steps beyond what H is defined for, such as the speed of light
TINY = 1e-300
ROUNDED = 4e-16  # of the velocity, and of the energy by its slope: round-off
SHOWN = 5  # starts that a message names


def starts_at_energy(
    system: System,
    energy: float,
    *,
    q0: Any,
    v0: Any,
    free: ca.SX,
    direction: int = 1,
    params: ParameterValues | None = None,
    t0: float = 0.0,
) -> dict[str, np.ndarray]:
    """Starts on the energy surface H(q, v) = E, one velocity of each solved for.

    H is convex along the velocity w: from its least value at w*, where ∂H/∂w = 0, the root on the
    wanted side is w* ± √(2 (E − H(w*))/(∂²H/∂w²)), exact for kinetic energies quadratic in w and
    corrected by Newton's method otherwise.

    Parameters
    ----------
    system : System
        Without constraints.
    energy : float
        E.
    q0, v0 : array (n,) or (K, n)
        The starts; what `v0` has for the free velocity does not matter.
    free : SX
        The velocity that is solved for, an entry of ``system.v``.
    direction : {1, -1}
        Which of both solutions.
    params, t0
        As for `simulate`.

    Returns
    -------
    dict
        ``q0`` and ``v0``, (K, n) each: ``vi.ensemble(system, rule, **starts, h=..., steps=...)``.

    Raises
    ------
    InputError
        If the energy is below what a start has at least, or the energy does not depend on the
        velocity.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> model = vi.models.henon_heiles()
    >>> y = np.linspace(-0.2, 0.4, 4)
    >>> starts = vi.orbits.starts_at_energy(
    ...     model.system, 1 / 8, q0=np.column_stack([0 * y, y]), v0=[0, 0], free=model.system.v[0]
    ... )
    >>> bool(np.allclose(starts["v0"][:, 0] ** 2 / 2 + y**2 / 2 - y**3 / 3, 1 / 8, atol=1e-15))
    True
    """
    require_system(system)
    s = system
    if s.structure.constraints or s.structure.nonholonomic:
        raise InputError(
            "the scene has constraints, which tie its velocities together: give v0 that keeps to "
            "them (vi.project), or write the scene in coordinates without them"
        )
    which = _index(system, free)
    if direction not in (1, -1):
        raise InputError(f"direction must be +1 or -1, got {direction!r}")
    wanted, c = number("energy", energy), parameter_values(system, params)
    q, v = _starts(system, q0, v0)
    t = np.full((len(q), 1), number("t0", t0))
    function = _along(system, which)
    w = np.zeros(len(q))

    def at(w: np.ndarray) -> list[np.ndarray]:
        v[:, which] = w
        return [x[:, 0] for x in over_columns(function, q, v, t, c)]

    for _ in range(CORRECTIONS):
        _, slope, bend = at(w)
        if not (bend > 0).all():
            raise InputError(
                f"the energy is not convex along {free}: it has no two solutions to choose from"
            )
        w = w - slope / bend
        if (np.abs(slope / bend) <= ROUNDED * np.abs(w)).all():
            break
    least, _, bend = at(w)
    below = np.flatnonzero(least > wanted)
    if len(below):
        raise InputError(
            f"the energy {wanted:g} is not reached at {len(below)} of {len(q)} starts "
            f"(indices {below[:SHOWN].tolist()}{' …' if len(below) > SHOWN else ''}): they have at "
            f"least {least[below].max():.6g}; leave them out or raise the energy"
        )
    inner, w = w, w + direction * np.sqrt(2 * (wanted - least) / bend)
    for _ in range(HALVINGS):
        value, slope, _ = at(w)
        beyond = ~np.isfinite(value)
        if not beyond.any():
            change = np.where(slope == 0, 0.0, (value - wanted) / np.where(slope == 0, 1.0, slope))
            inner, w = w, w - change
            size = np.abs(value) / np.maximum(np.abs(slope), TINY)
            if (np.abs(change) <= ROUNDED * (np.abs(w) + size)).all():
                break
        w = np.where(beyond, (inner + w) / 2, w)  # H has no value there: less far
    at(w)
    return {"q0": q, "v0": v}


def _index(system: System, free: Any) -> int:
    """Which entry of v is free."""
    names = [x.name() for x in ca.vertsplit(system.v)]
    name = parsed_or_refused(
        lambda: free if isinstance(free, str) else ca.SX(free).name(),
        lambda: f"free must be one velocity of {names}, got {free!r}",
    )
    if name not in names:
        raise InputError(f"free must be one velocity of {names}, got {name!r}")
    return names.index(name)


def _starts(system: System, q0: Any, v0: Any) -> tuple[np.ndarray, np.ndarray]:
    n = system.structure.n
    wanted = f"(n,) or (K, n) numbers with n = {n} ({list(system.names)})"

    def rows(what: str, x: Any) -> np.ndarray:
        found = parsed_or_refused(
            lambda: np.array(x, dtype=float), lambda: f"{what} must be {wanted}, got {x!r}"
        )
        found = found.reshape(-1, 1) if n == 1 and found.ndim < 2 else np.atleast_2d(found)
        if found.ndim != 2 or found.shape[1] != n or not np.isfinite(found).all():
            raise InputError(f"{what} must be {wanted}, all finite; got shape {np.shape(x)}")
        return found

    q, v = rows("q0", q0), rows("v0", v0)
    if len(q) != len(v) and 1 not in (len(q), len(v)):
        raise InputError(f"q0 has {len(q)} starts and v0 {len(v)}: give as many, or one for all")
    count = max(len(q), len(v))
    return np.broadcast_to(q, (count, n)).copy(), np.broadcast_to(v, (count, n)).copy()


@per_system
def _along(system: System, which: int) -> ca.Function:
    """(q, v, t, c) → H, ∂H/∂w, ∂²H/∂w²."""
    s = system
    slope = ca.jacobian(s.energy, s.v[which])
    out = [ca.densify(x) for x in (s.energy, slope, ca.jacobian(slope, s.v[which]))]
    return ca.Function("along", [s.q, s.v, s.t, s.c], out, {"cse": True})
