"""Which stepper runs for a scene and a rule, and why; what was left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from varint.discrete import require_explicit
from varint.errors import InputError
from varint.rules import Rule, composition, gauss, lobatto
from varint.stepping.stepper import Stepper
from varint.system import System, per_system, require_system


@dataclass(frozen=True, eq=False)
class Plan:
    """What will run: `print(plan)` says it in words.

    Attributes
    ----------
    rule : Rule
        The rule, the scene's own where none was given.
    method : str
        Name of the stepper.
    runs, skipped : tuple of str
        What is done in a step, and what was left out because the scene does not have it.
    build : callable
        (system, rule) → Stepper.
    """

    rule: Rule
    method: str
    runs: tuple[str, ...]
    skipped: tuple[str, ...]
    build: Callable[[System, Rule], Stepper]

    def __str__(self) -> str:
        lines = [f"{self.rule}, order {self.rule.order}: {self.method}"]
        lines += [f"  runs     {text}" for text in self.runs]
        lines += [f"  skipped  {text}" for text in self.skipped]
        return "\n".join(lines)


def default_rule(system: System) -> Rule:
    """Separable with constant mass: an explicit composition; constraints: `lobatto(3)`; otherwise `gauss(2)`."""
    s = system.structure
    if s.explicit:
        return composition("blanes-moan4")
    if s.nonholonomic:
        return lobatto(2) if s.constraints else gauss(1)
    if s.degenerate:
        return gauss(1)
    return lobatto(3) if s.constraints or s.contacts else gauss(2)


def plan(system: System, rule: Rule | None = None) -> Plan:
    """The cheapest correct stepper for `system` by `rule`, with its reasons.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own, see `default_rule`.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If the rule cannot step the scene.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> print(vi.plan(vi.System(q, v, v**2 / 2 + ca.cos(q)), vi.trapezoidal()))
    trapezoidal(), order 2: kick and drift
      runs     1 force evaluation a step, kept from step to step
      skipped  root finding: L = ½ vᵀMv − V(q, t) with constant M
      skipped  matrix solves: M is diagonal
      skipped  time: the scene is autonomous
    """
    require_system(system)
    if rule is not None and not isinstance(rule, Rule):
        raise InputError(f"rule must be a varint Rule such as gauss(2), got {rule!r}")
    return _plan(system, rule)


@per_system
def _plan(system: System, rule: Rule | None) -> Plan:
    rule = default_rule(system) if rule is None else rule
    s = system.structure
    refuse_what_no_stepper_has(system, rule)
    if s.contacts:
        from varint.manifold import Phase

        free = plan(Phase(tuple(range(s.constraints))).scene(system), rule)
        watch = "a look at gaps and contact multipliers after every block of steps; sub-steps where one changes sign"
        return replace(free, method=f"{free.method}, contacts watched", runs=(*free.runs, watch), build=_not_one_step)
    skipped: list[str] = []
    runs: tuple[str, ...]
    if s.autonomous:
        skipped.append("time: the scene is autonomous")
    from varint.stepping.flight import flight_stepper, is_uniform

    if rule.points and is_uniform(system):
        skipped.insert(0, "root finding: the field is uniform, every rule gives the exact parabola")
        runs = ("q + h M⁻¹(p + ½ h F) and p + h F",)
        return Plan(rule, "flight in a uniform field", runs, tuple(skipped), flight_stepper)
    if rule.kicks and (s.explicit or not rule.points):
        from varint.stepping.explicit import explicit_stepper

        require_explicit(system, rule)
        if s.diagonal_mass:
            skipped.insert(0, "matrix solves: M is diagonal")
        skipped.insert(0, "root finding: L = ½ vᵀMv − V(q, t) with constant M")
        evaluations = len(rule.kicks) - (0 if s.controls else 1)
        kept = ": controls jump from step to step" if s.controls else ", kept from step to step"
        runs = (f"{evaluations} force evaluation{'s' * (evaluations > 1)} a step{kept}",)
        return Plan(rule, "kick and drift", runs, tuple(skipped), explicit_stepper)
    if s.constraints or s.nonholonomic:
        from varint.stepping.constrained import constrained_stepper
        from varint.stepping.rattle import eliminates_path, rattle_stepper

        if eliminates_path(system, rule):
            runs = (
                f"Newton's method for {s.constraints} multipliers, banded for chains (SHAKE)",
                "projection of the momentum onto the hidden constraint at the end of the step (RATTLE)",
                "1 force evaluation a step" + ("" if s.controls else ", kept from step to step"),
            )
            skipped.insert(0, "unknown positions: eliminated, L = ½ vᵀMv − V(q, t) with constant M")
            return Plan(rule, "SHAKE and RATTLE", runs, tuple(skipped), rattle_stepper)
        rows = s.constraints * rule.degree + s.nonholonomic
        runs = (
            f"Newton's method for {rule.degree} × {s.n} unknowns and {rows} multipliers, exact sparse Jacobian",
            "projection of the momentum onto the hidden constraint at the end of the step",
        )
        return Plan(rule, "Newton's method with multipliers", runs, tuple(skipped), constrained_stepper)
    from varint.stepping.implicit import implicit_stepper
    from varint.stepping.linear import is_linear, linear_stepper

    if is_linear(system, rule):
        runs = (f"one constant linear map for {rule.degree} × {s.n} unknowns, inverted once for the whole run",)
        skipped.insert(0, "root finding: L is quadratic and the forces are linear")
        return Plan(rule, "linear map", runs, tuple(skipped), linear_stepper)
    runs = (
        f"Newton's method for {rule.degree} × {s.n} unknowns, exact sparse Jacobian",
        "start values continued from the last step's polynomial",
    )
    if not s.forced:
        skipped.append("forces: there are none")
    return Plan(rule, "Newton's method", runs, tuple(skipped), implicit_stepper)


def _not_one_step(system: System, rule: Rule) -> Stepper:
    raise InputError(
        "a scene with contacts has no step of its own, for what holds changes; take the scene without contact=, or "
        "simulate()"
    )


def refuse_what_no_stepper_has(system: System, rule: Rule) -> None:
    """Combinations that no stepper can do, each with its reason and the way out."""
    s = system.structure
    if s.constraints and rule.points != rule.nodes:
        raise InputError(
            f"{rule} cannot carry constraints: its quadrature nodes are no control points, so multipliers would lose "
            "their order; use lobatto(3) or another lobatto(s)"
        )
    if s.nonholonomic and rule.degree != 1:
        raise InputError(
            f"{rule} cannot carry non-holonomic constraints: they need a symmetric step of one piece (order 2); "
            + ("use trapezoidal()" if s.constraints else "use midpoint() or trapezoidal()")
        )
    if s.contacts and rule.points != rule.nodes:
        raise InputError(
            f"{rule} cannot carry contacts: a contact that holds is a constraint, whose multiplier needs Lobatto "
            "points; use lobatto(3) or another lobatto(s)"
        )
    if s.contacts and not s.quadratic_kinetic:
        raise InputError(
            "contacts need a Lagrangian that is quadratic in the velocities: the law of impact is M Δv = Λ ∂gap/∂q"
        )
    if s.degenerate and rule != gauss(1):
        raise InputError(
            f"the Lagrangian is degenerate (its mass matrix ∂²L/∂v² is zero) and {rule} is unstable for it; "
            "use midpoint()"
        )
