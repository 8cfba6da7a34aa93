"""The scene of a motion and a motion beside it, infinitely near: its equations are the variational
ones, and its Lagrangian is the first variation of the scene's own.
"""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.scene.memory import per_system
from varint.scene.system import System, require_system


def tangent_lift(system: System) -> System:
    """The scene of q and a small displacement δ from it, L₁ = ∂L/∂q · δ + ∂L/∂v · δ'.

    Varied by δ it gives the equations of q, varied by q the linear ones of δ. Variation and
    quadrature commute, so a rule's run of the lift is the rule's own run of q beside its exact
    tangent map: nothing is discretised twice. ∂L₁/∂δ' = p, and ∂L₁/∂v = δp. Forces (F, δF) act as
    ``(∂F/∂q δ + ∂F/∂v δ', F)`` on (q, δ), constraints become (∂g/∂q δ, g).

    Parameters
    ----------
    system : System
        Without contacts and non-holonomic constraints.

    Returns
    -------
    System
        Coordinates (q, δ), the same parameters, controls and time. Its mass matrix is indefinite,
        and its energy is the change of the scene's.

    Raises
    ------
    InputError
        If the scene has contacts, non-holonomic constraints, or a Lagrangian of first order.

    References
    ----------
    Yano & Ishihara, Tangent and Cotangent Bundles, 1973, I.3 (complete lifts); Marsden & West, Acta
    Numerica 2001, §1.5 (the variation of a discrete motion is a discrete motion).

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> spring = vi.System(q, v, v**2 / 2 - q**2 / 2)
    >>> beside = vi.orbits.tangent_lift(spring)
    >>> both = vi.simulate(beside, vi.gauss(6), q0=[1.0, 0.5], v0=[0.0, 0.0], h=0.1, steps=10)
    >>> bool(np.allclose(both.q[-1], [np.cos(1.0), 0.5 * np.cos(1.0)]))
    True
    """
    require_system(system)
    return _tangent_lift(system)


@per_system
def _tangent_lift(system: System) -> System:
    s = system
    has = s.structure
    for there, what in (
        (has.contacts, "contacts, at which motions jump"),
        (has.nonholonomic, "non-holonomic constraints, whose motions follow from no Lagrangian"),
        (has.degenerate, "a Lagrangian of first order, whose momenta cannot be varied"),
    ):
        if there:
            raise InputError(f"the tangent lift takes no scene with {what}")
    names = [f"delta_{name}" for name in s.names]
    moved = ca.vertcat(*(ca.SX.sym(name) for name in names))
    rate = ca.vertcat(*(ca.SX.sym(f"{name}_dot") for name in names))

    def change(x: ca.SX) -> ca.SX:
        return ca.jtimes(x, s.q, moved) + ca.jtimes(x, s.v, rate)

    return System(
        ca.vertcat(s.q, moved),
        ca.vertcat(s.v, rate),
        change(s.lagrangian),
        constraint=ca.vertcat(change(s.constraint), s.constraint) if has.constraints else None,
        force=ca.vertcat(change(s.force), s.force) if has.forced else None,
        control=s.control if has.controls else None,
        params=s.params,
        t=s.t,
    )
