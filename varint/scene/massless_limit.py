"""Test particles: the limit of masses that vanish, moved by the others and moving none of them."""

from __future__ import annotations

from typing import Any

import casadi as ca

from varint.errors import InputError
from varint.scene.system import System
from varint.scene.validation import symbols


def massless_limit(system: System, masses: ca.SX) -> System:
    """The scene in the limit of some masses that vanish: the restricted problem.

    With ``L = L₀ + Σ_k m_k ℓ_k + O(m²)`` the bodies of L₀ move as if the others were not there, and
    the coordinates y of body k by the Euler–Lagrange equations of ``ℓ_k = ½ ẏᵀM ẏ + b·ẏ + R``, its
    Lagrangian per unit of mass: R acts on y as a force ∂R/∂y and on nothing else. What depends on
    two of these masses, the attraction of test particles among themselves, vanishes and costs
    nothing. Every rule integrates ∂R/∂y at its nodes as it does a potential, so the discrete motion
    is the limit of small masses, too.

    Parameters
    ----------
    system : System
        Its masses are parameters.
    masses : SX
        Those that vanish: parameters of the system, or entries of them. They stay parameters,
        without effect.

    Returns
    -------
    System
        Energy and momenta of the test particles are those of unit masses.

    Raises
    ------
    InputError
        If these are no parameters; if nothing moves in the limit, or without bounds; if a mass
        moves what has other inertia, too, or constraints tie it to that.

    References
    ----------
    Szebehely, Theory of Orbits, 1967, §§1.1–1.5.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y", "a", "b")
    >>> c = vi.Parameters(planet=1.0, moon=0.0)
    >>> places, speeds = (q[:2], q[2:]), (v[:2], v[2:])
    >>> kinetic = c.planet * ca.sumsqr(v[:2]) / 2 + c.moon * ca.sumsqr(v[2:]) / 2
    >>> pair = vi.System(q, v, kinetic + c.planet * c.moon / ca.norm_2(q[:2] - q[2:]), params=c)
    >>> limit = vi.massless_limit(pair, c.moon)
    >>> orbit = vi.simulate(limit, q0=[0, 0, 1, 0], v0=[0, 0, 0, 1], h=0.1, steps=100)
    >>> orbit.q[-1, :2], round(float(ca.norm_2(orbit.q[-1, 2:])), 3)
    (array([0., 0.]), 1.0)
    """
    s, masses = system, symbols("masses", masses)
    known = {x.element_hash() for x in ca.vertsplit(s.c)}
    unknown = [x.name() for x in ca.vertsplit(masses) if x.element_hash() not in known]
    if unknown or not masses.numel():
        raise InputError(
            f"masses {unknown} are no parameters of this system, which has {list(s.defaults)}: "
            "take them from its own Parameters"
        )

    def limit(x: ca.SX) -> ca.SX:
        return ca.substitute(x, masses, ca.SX.zeros(masses.shape))

    rest = limit(s.lagrangian)
    each = [limit(ca.gradient(s.lagrangian, m)) for m in ca.vertsplit(masses)]
    light = _coordinates_of(s, rest, each)
    y, w = s.q[light], s.v[light]
    others = [i for i in range(s.q.numel()) if i not in light]
    apart = ca.vertcat(s.q[others], s.v[others])
    push, lagrangian, still = limit(s.force), rest, ca.SX.zeros(w.shape)
    _require_free(push[light], "a force that does not vanish with the mass acts on", s, light)
    field = ca.SX.zeros(len(light), 1)
    for k, (one, m) in enumerate(zip(each, ca.vertsplit(masses), strict=True)):
        slope = ca.gradient(one, w)
        mass, momentum = ca.jacobian(slope, w), ca.substitute(slope, w, still)
        if ca.depends_on(mass, ca.vertcat(w, apart)) or ca.depends_on(momentum, apart):
            raise InputError(
                f"the kinetic energy of what has the mass {masses[k].name()} is not quadratic in "
                "its own velocities, or depends on how the others move: give it coordinates of its "
                "own place"
            )
        lagrangian += ca.bilin(mass, w, w) / 2 + ca.dot(momentum, w)
        field += ca.gradient(ca.substitute(one, w, still), y)
        field += limit(ca.jacobian(s.force, m))[light]
    push = ca.densify(push)
    push[light] = field
    parts: dict[str, Any] = {
        name: limit(getattr(s, name)) for name in ("constraint", "nonholonomic", "contact")
    }
    for row in ca.vertsplit(ca.vertcat(parts["constraint"], parts["contact"])) + [
        ca.mtimes(x, s.v) for x in ca.vertsplit(parts["nonholonomic"])
    ]:
        if ca.depends_on(row, ca.vertcat(y, w)) and ca.depends_on(row, apart):
            raise InputError(
                f"a constraint or contact ties {_named(s, light)} to bodies with mass, which a "
                "body without cannot hold: leave it out, or prescribe it in time"
            )
    return System(
        s.q,
        s.v,
        lagrangian,
        force=push,
        restitution=s.bounce if s.contact.numel() else 0.0,
        control=s.control if s.control.numel() else None,
        params=s.params,
        t=s.t,
        rays=s.rays,
        **parts,
    )


def _coordinates_of(system: System, rest: ca.SX, each: list[ca.SX]) -> list[int]:
    """Indices of the coordinates that have no inertia but that of one of the masses."""
    s = system
    inertia = ca.jacobian(ca.gradient(rest, s.v), s.v)
    count, bare = s.q.numel(), [not inertia[i, :].nnz() for i in range(s.q.numel())]
    kinetic = [ca.gradient(one, s.v) for one in each]
    moved = [[ca.depends_on(x[i], s.v) for x in kinetic] for i in range(count)]
    light = [i for i in range(count) if bare[i] and any(moved[i])]
    if not light:
        raise InputError(
            "no coordinate loses its inertia with these masses: all have inertia without them"
        )
    shared = [i for i in light if sum(moved[i]) > 1]
    if shared:
        raise InputError(
            f"{_named(s, shared)} have inertia of more than one of these masses, and move as their "
            "ratio says: write them as multiples of one"
        )
    _require_free(
        ca.gradient(rest, s.q)[light], "what does not vanish with the mass acts on", s, light
    )
    return light


def _require_free(acting: ca.SX, what: str, system: System, light: list[int]) -> None:
    """Refuse terms of the coordinates without mass that would accelerate them without bound."""
    if not ca.densify(acting).is_zero() and any(not x.is_zero() for x in ca.vertsplit(acting)):
        raise InputError(
            f"{what} {_named(system, light)}, which would accelerate a body without mass without "
            "bound: write it as a multiple of the mass"
        )


def _named(system: System, which: list[int]) -> str:
    return str([system.names[i] for i in which])
