"""Compositions of a symmetric step of order 2: of steps of sizes γ_i h of the midpoint or the
trapezoidal rule, for scenes that no other rule of higher order steps.

Non-holonomic rows and degenerate Lagrangians have discretisations of order 2 alone. As a map of
(q, p) with A(q) v = 0, or with p = ϑ(q), that step is symmetric in time, so the order conditions
are those of Störmer–Verlet (Yoshida, Phys. Lett. A 150 (1990) 262; Hairer, Lubich & Wanner,
Geometric Numerical Integration, V.3): the same γ_i raise its order, and the whole stays symmetric.
"""

from __future__ import annotations

import math
from itertools import pairwise

import casadi as ca

from varint.discrete.legendre import first_order_velocity
from varint.rules.rule import Rule, gauss, lobatto
from varint.scene.memory import per_scene
from varint.scene.system import System

ROUNDED = 1e-14  # of kicks that are rounded sums of two


def base_of(system: System, rule: Rule) -> Rule | None:
    """The rule whose steps of sizes `rule.drifts`·h are a step of the composition; None where the
    rule has a step of its own.
    """
    s = system.structure
    if rule.points or not (s.nonholonomic or s.degenerate) or s.contacts:
        return None
    if not of_verlet(rule):
        return None
    return lobatto(2) if s.constraints else gauss(1)


def of_verlet(rule: Rule) -> bool:
    """Whether each kick is half of the drift before it and half of the one behind: a composition of
    Störmer–Verlet steps, of sizes `rule.drifts`·h.
    """
    ends = pairwise((0.0, *rule.drifts, 0.0))
    halves = [(a + b) / 2 for a, b in ends]
    return len(halves) == len(rule.kicks) and all(
        abs(a - b) < ROUNDED for a, b in zip(halves, rule.kicks, strict=True)
    )


def shares(system: System, rule: Rule) -> list[tuple[float, float]]:
    """γ_i, and Σ_{j<i} γ_j where the i-th of the steps begins."""
    drifts = rule.drifts
    if system.structure.degenerate and not _keeps_to_its_momentum(system):
        drifts = tuple(a / 2 for a in drifts for _ in range(2))
    return [(a, math.fsum(drifts[:i])) for i, a in enumerate(drifts)]


@per_scene
def steps_by_gauss(system: System) -> bool:
    """Whether all Gauss rules step a degenerate scene, not `gauss(1)` alone: where ϑ = A q + b.

    Their stages have momenta ϑ(Q_i) = p0 + h Σ a_ij ∂L/∂q(Q_j, V_j), which from p0 = ϑ(q0) on says
    A V_j = ∂L/∂q(Q_j, V_j): each V_j is the velocity of the equations of first order at Q_j, and
    the step is the collocation q̇ = v(q), of order 2s and symplectic with respect to the constant
    form Aᵀ − A. Momenta stay ϑ(q): p − ϑ(q) is linear, and is multiplied by (−1)^s elsewhere.
    """
    s = system.structure
    if not s.degenerate or s.constraints or s.nonholonomic or s.contacts or s.controls:
        return False
    if not _keeps_to_its_momentum(system) or ca.depends_on(system.momentum, system.t):
        return False
    return first_order_velocity(system) is not None


@per_scene
def _keeps_to_its_momentum(system: System) -> bool:
    """Whether ϑ of L = ϑ·v − H is linear in q, so that a step of the midpoint rule leads from p =
    ϑ(q) to p = ϑ(q).

    Elsewhere its step Φ_h is not near the identity: Φ_0 is an involution, for F(q0, q1) = ϑ((q0 +
    q1)/2)·(q1 − q0), which generates it, changes sign with q0 and q1 exchanged, and p − ϑ(q) swings
    from step to step. Two steps, Φ_{h/2} Φ_{h/2}, are near it, and symmetric as one is: those are
    composed.
    """
    form = ca.jacobian(system.momentum, system.q)
    return not ca.depends_on(ca.densify(form), ca.vertcat(system.q, system.t))
