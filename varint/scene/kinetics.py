"""Cheaper ways to what follows from a Lagrangian, for scenes that know them."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError

SEED, TRIALS = 20, 2  # random states at which what is given is compared with the Lagrangian
AGREES = 1e-8  # relative to the largest momentum: far above round-off, far below any mistake


class Kinetics(NamedTuple):
    """What a scene knows of its Lagrangian besides the expression, for `System`.

    Attributes
    ----------
    mass_matrix : SX (n, n)
        M(q, t) = ∂²L/∂v² of a Lagrangian quadratic in the velocities.
    momentum : SX (n,)
        Symbols p of its own for `velocity`; empty where there is none.
    velocity : SX (n,)
        v(q, p, t) with ∂L/∂v = p, as by articulated bodies for a tree of links; empty where M⁻¹ is
        to be taken.
    stiffness, damping : SX (n, n)
        Roughly −∂F/∂q and −∂F/∂v of springs and dampers, for a matrix near the derivative of a
        step's equations; empty where there are none.
    slopes : SX (2 n,)
        ∂L/∂q, then ∂L/∂v, as by recursion over a tree of links; empty where L is to be
        differentiated.
    """

    mass_matrix: ca.SX
    momentum: ca.SX = ca.SX(0, 1)
    velocity: ca.SX = ca.SX(0, 1)
    stiffness: ca.SX = ca.SX(0, 0)
    damping: ca.SX = ca.SX(0, 0)
    slopes: ca.SX = ca.SX(0, 1)

    def of_other_potential(self) -> Kinetics:
        """The same without slopes, for a Lagrangian with another potential."""
        return self._replace(slopes=ca.SX(0, 1))

    @property
    def resists(self) -> bool:
        """Are there springs or dampers?"""
        return bool(self.stiffness.nnz() or self.damping.nnz())


def check_kinetics(system: Any) -> None:
    """Compare what is given with the Lagrangian, by its symbols and at random states.

    Raises
    ------
    InputError
        If it is not that of this Lagrangian.
    """
    s, given = system, system.kinetics
    n = s.q.numel()
    if given.mass_matrix.shape != (n, n) or given.velocity.numel() not in (0, n):
        raise InputError(f"kinetics has the wrong shape for {n} coordinates")
    if not {given.stiffness.shape, given.damping.shape} <= {(0, 0), (n, n)}:
        raise InputError(f"stiffness and damping of kinetics must be ({n}, {n}) or empty")
    if given.slopes.numel() not in (0, 2 * n):
        raise InputError(f"slopes of kinetics must be ({2 * n},) or empty")
    if given.momentum.numel() != given.velocity.numel():
        raise InputError("kinetics needs a symbol of momentum for every velocity")
    known = {x.element_hash() for x in ca.symvar(ca.vertcat(s.q, s.t, s.c))}
    own = known | {x.element_hash() for x in ca.symvar(given.momentum)}
    moving = known | {x.element_hash() for x in ca.symvar(s.v)}
    for what, expression, may in (
        ("mass matrix", given.mass_matrix, known),
        ("velocity", given.velocity, own),
        ("stiffness", given.stiffness, moving),
        ("damping", given.damping, moving),
        ("slopes", given.slopes, moving),
    ):
        strange = sorted(x.name() for x in ca.symvar(expression) if x.element_hash() not in may)
        if strange:
            raise InputError(f"the {what} of kinetics may not depend on {strange}")
    inputs = [s.q, s.v, s.t, s.c]
    momentum = ca.gradient(s.lagrangian, s.v)
    product = [ca.jtimes(momentum, s.v, s.v), ca.mtimes(given.mass_matrix, s.v)]
    truth = ca.Function("momentum", inputs, [momentum, *map(ca.densify, product)])
    state = ca.vertcat(s.q, s.v)
    slopes = ca.Function("slopes", inputs, [ca.gradient(s.lagrangian, state), given.slopes])
    back = ca.Function("velocity", [s.q, given.momentum, s.t, s.c], [ca.densify(given.velocity)])
    random = np.random.default_rng(SEED)
    for _ in range(TRIALS):
        q, v, t = random.normal(size=n), random.normal(size=n), random.normal()
        p, *products = (np.array(x).ravel() for x in truth(q, v, t, s.default_vector))
        pairs = {"mass matrix": products}
        if given.velocity.numel():
            speed = np.array(back(q, p, t, s.default_vector)).ravel()
            pairs["velocity"] = [p, np.array(truth(q, speed, t, s.default_vector)[0]).ravel()]
        if given.slopes.numel():
            pairs["slopes"] = [np.array(x).ravel() for x in slopes(q, v, t, s.default_vector)]
        for what, (true, other) in pairs.items():
            if abs(true - other).max() > AGREES * abs(true).max():  # not if anything is NaN
                way = "; with another potential give kinetics.of_other_potential()"
                raise InputError(
                    f"the {what} of kinetics is not that of the Lagrangian"
                    + way * (what == "slopes")
                )
