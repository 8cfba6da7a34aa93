"""Which rules can discretise and step a scene: every refusal, with its reason and the way out."""

from __future__ import annotations

from varint.discrete.composed import base_of, steps_by_gauss
from varint.errors import InputError
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.system import System

STAGES = range(1, MOST_STAGES + 1)


def require_discretisable(system: System, rule: Rule) -> None:
    """Refuse a rule that has no discrete Lagrangian of the scene, or not one of its order.

    Raises
    ------
    InputError
        If a composition meets a scene without kick and drift, or constraints a rule whose
        quadrature nodes are no control points.
    """
    s = system.structure
    if s.constraints and rule.points != rule.nodes:
        raise InputError(
            f"{rule} cannot carry constraints: its quadrature nodes are no control points, so "
            "multipliers would lose their order; use lobatto(3) or another lobatto(s)"
        )
    if rule.points or s.explicit:
        return
    reasons = {
        "it has constraints or contacts": bool(s.constraints or s.nonholonomic or s.contacts),
        "its Lagrangian is not of the form T(v) − V(q, t)": not s.separable,
        "its mass matrix is not constant": not s.constant_mass,
        "its mass matrix is zero": s.degenerate,
        "its force depends on the velocities": s.force_on_velocity,
    }
    because = "; ".join(text for text, holds in reasons.items() if holds)
    raise InputError(
        f"{rule} cannot step this scene explicitly: {because}; use for example gauss(2)"
    )


def require_steppable(system: System, rule: Rule) -> None:
    """Refuse a rule that no stepper has for the scene.

    Raises
    ------
    InputError
        As `require_discretisable` does, and for rules that cannot carry the scene's non-holonomic
        rows or contacts, or are unstable for a degenerate Lagrangian.
    """
    s = system.structure
    if base_of(system, rule):
        return
    if s.nonholonomic and rule.degree != 1:
        raise InputError(
            f"{rule} cannot carry non-holonomic constraints: they need a symmetric step of one "
            "piece (order 2), or without contacts and controls a composition of such steps; "
            + (
                "use trapezoidal()"
                if s.constraints or s.contacts
                else "use midpoint() or trapezoidal()"
            )
        )
    if s.contacts and rule.points != rule.nodes:
        raise InputError(
            f"{rule} cannot carry contacts: a contact that holds is a constraint, whose multiplier "
            "needs Lobatto points; use "
            + ("trapezoidal()" if s.nonholonomic else "lobatto(3) or another lobatto(s)")
        )
    if s.contacts and not s.quadratic_kinetic:
        raise InputError(
            "contacts need a Lagrangian that is quadratic in the velocities: the law of impact is "
            "M Δv = Λ ∂gap/∂q"
        )
    by_gauss = s.degenerate and steps_by_gauss(system)
    if s.degenerate and rule not in ([gauss(k) for k in STAGES] if by_gauss else [gauss(1)]):
        raise InputError(
            f"the Lagrangian is degenerate (its mass matrix ∂²L/∂v² is zero) and {rule} is "
            "unstable for it; use midpoint(), or without controls a composition of its steps"
            + (" or another gauss(s)" if by_gauss else "")
        )
    require_discretisable(system, rule)
