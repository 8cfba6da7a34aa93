"""The step that is composed of steps of order 2 of sizes γ_i h: see `varint.discrete.composed`."""

from __future__ import annotations

import casadi as ca

from varint.discrete.composed import base_of, shares
from varint.integration.steppers.constrained import CONSTRAINED, constrained_stepper
from varint.integration.steppers.implicit import IMPLICIT, implicit_stepper
from varint.integration.steppers.stepper import Method, Stepper, state_parts
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def composed_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper of a composition: each of its steps begins with the mean velocity of the one before.

    `path` and `reactions` are those of the end alone: what pushes within belongs to its steps.
    """
    base = base_of(system, rule)
    assert base is not None
    held = system.structure.constraints or system.structure.nonholonomic
    build, n = constrained_stepper if held else implicit_stepper, system.structure.n
    one = build(system, base)
    sizes = [one.step.numel_in(i) for i in range(one.step.n_in())]
    same, sizes[1] = sizes[1], system.structure.controls * len(rule.nodes)
    x, u, t, h, c, scale = (ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes))
    after = x
    for part, begun in shares(system, rule):  # a step has the same controls all along
        after = one.step(after, u[:same], t + begun * h, part * h, c, scale)
    inputs = [x, u, t, h, c, scale]
    step = ca.Function("composed", inputs, [after])
    moved = state_parts(after, n).q - state_parts(x, n).q
    q, p = (ca.MX.sym(name, n) for name in "qp")
    start = ca.Function("start", [q, p, u, t, h, c], [one.start(q, p, u[:same], t, h, c)])
    return Stepper(step, start, ca.Function("path", inputs, [moved]))


def _runs(system: System, rule: Rule) -> tuple[str, ...]:
    base = base_of(system, rule)
    assert base is not None
    method = IMPLICIT if system.structure.degenerate else CONSTRAINED
    return (f"{len(shares(system, rule))} steps of {base}, each:", *method.runs(system, base))


COMPOSED = Method(
    name="composed of steps of order 2",
    applies=lambda system, rule: base_of(system, rule) is not None,
    runs=_runs,
    skips=lambda system, rule: (),
    build=composed_stepper,
)
