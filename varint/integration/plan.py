"""Which stepper runs for a scene and a rule, and why; what was left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from varint.discrete.composed import steps_by_gauss
from varint.discrete.constraints import ActiveSet
from varint.discrete.suitability import require_steppable
from varint.errors import InputError
from varint.integration.steppers.composed import COMPOSED
from varint.integration.steppers.constrained import CONSTRAINED
from varint.integration.steppers.explicit import EXPLICIT
from varint.integration.steppers.implicit import IMPLICIT
from varint.integration.steppers.linear import LINEAR
from varint.integration.steppers.rattle import RATTLE
from varint.integration.steppers.stepper import Stepper
from varint.integration.steppers.uniform_field import UNIFORM_FIELD
from varint.notation.html import table
from varint.rules.rule import Rule, composition, gauss, lobatto
from varint.scene.memory import per_scene
from varint.scene.system import System, require_system

# The first that applies runs: the cheapest correct one. A new stepper is one file and one entry.
METHODS = (UNIFORM_FIELD, EXPLICIT, COMPOSED, RATTLE, CONSTRAINED, LINEAR, IMPLICIT)


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

    def _repr_html_(self) -> str:
        """For notebooks: what runs and what is skipped, as a table."""
        rows = [("runs", text) for text in self.runs]
        rows += [("skipped", text) for text in self.skipped]
        return table(f"{self.rule}, order {self.rule.order}: {self.method}", rows)


def default_rule(system: System) -> Rule:
    """Separable with constant mass: an explicit composition; constraints: `lobatto(3)`; rolling
    scenes and degenerate ones with a one-form that is not linear: the rule of order 2 that they
    have; otherwise `gauss(2)`.
    """
    s = system.structure
    if s.explicit:
        return composition("blanes-moan4")
    if s.nonholonomic:
        return lobatto(2) if s.constraints or s.contacts else gauss(1)
    if s.degenerate and not steps_by_gauss(system):
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


@per_scene
def _plan(system: System, rule: Rule | None) -> Plan:
    rule = default_rule(system) if rule is None else rule
    require_steppable(system, rule)
    if system.structure.contacts:
        return _with_contacts(system, rule)
    method = next(method for method in METHODS if method.applies(system, rule))
    skipped = method.skips(system, rule)
    if system.structure.autonomous:
        skipped = (*skipped, "time: the scene is autonomous")
    runs = method.runs(system, rule)
    if system.kinetics is not None:
        runs = (*_of_machines(system, rule), *(f"interpreted: {text}" for text in runs))
    return Plan(rule, method.name, runs, skipped, method.build)


def _of_machines(system: System, rule: Rule) -> tuple[str, ...]:
    """What the loops in C do instead, for scenes that know their mass matrix."""
    # these take longer to import than a plan of any other scene to make
    from varint.codegen.frozen import freezes, no_whole_derivatives, stiff_tree
    from varint.codegen.native import MOST_CONTROLS, MOST_COORDINATES
    from varint.integration.gears import BY_STAGES, scheme_of

    s, large = system.structure, no_whole_derivatives(system)
    loop = []
    if scheme_of(system, rule) is BY_STAGES:
        loop.append(
            "in C: all stages at once, velocities improved by recursion over the tree, no matrix"
            + ("; Newton's method where that fails" if not large or stiff_tree(system) else "")
        )
    if freezes(system) or stiff_tree(system):
        loop.append(
            "Newton's matrix in C: inertia, rows, stiffness and damping in the middle of the step, "
            "factorised once"
        )
    if s.n > MOST_COORDINATES or s.controls > MOST_CONTROLS:
        loop.append(
            f"its operations are compiled: they are data up to {MOST_COORDINATES} coordinates and "
            f"{MOST_CONTROLS} motors"
        )
    else:
        loop.append("its operations as data, compiled beside the run where that repays")
    return tuple(loop)


def _with_contacts(system: System, rule: Rule) -> Plan:
    """The plan of the scene without its contacts, watched."""
    free = plan(ActiveSet(tuple(range(system.structure.constraints))).scene(system), rule)
    watch = (
        "a look at gaps and contact multipliers after every block of steps; sub-steps where one "
        "changes sign"
    )
    return replace(
        free,
        method=f"{free.method}, contacts watched",
        runs=(*free.runs, watch),
        build=_not_one_step,
    )


def _not_one_step(system: System, rule: Rule) -> Stepper:
    raise InputError(
        "a scene with contacts has no step of its own, for what holds changes; take the scene "
        "without contact=, or simulate()"
    )
