"""The force that holds a motion on the switches between whose branches it is pushed back and forth.

Where both branches of a switch that depends on velocities push the motion back, as dry friction
does at rest, it stays on the switch: the force is then the mean of both with which the switch does
not change (Filippov, Differential Equations with Discontinuous Righthand Sides, 1988, §4).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from varint.discrete.constraints import velocity_rows
from varint.integration.switches.accelerations import acceleration, push_without_force, rate_of
from varint.integration.switches.frozen import FrozenScene
from varint.scene.system import System


def held_force(frozen: FrozenScene, sliding: Sequence[int]) -> tuple[ca.SX, ca.SX] | None:
    """The force that holds the motion on these switches, and the share of their upper branches."""
    s, held = frozen.system, ca.vertcat(*(frozen.s[j] for j in sliding))
    count = len(sliding)

    def force(*on: int) -> ca.SX:
        return ca.substitute(s.force, held, ca.DM([1.0 if i in on else -1.0 for i in range(count)]))

    low = force()
    steps = [force(i) - low for i in range(count)]
    if (
        ca.depends_on(ca.jtimes(s.force, held, ca.SX.sym("d", count)), held) and count > 1
    ):  # the shares of two switches would multiply each other
        return None
    at_rest = acceleration(s, low)
    if at_rest is None:
        return None
    drift = ca.vertcat(*(rate_of(s, frozen.sigma[j], at_rest) for j in sliding))
    slopes = []
    for step in steps:
        pushed = acceleration(s, low + step)
        assert pushed is not None
        slopes.append(ca.vertcat(*(rate_of(s, frozen.sigma[j], pushed) for j in sliding)) - drift)
    share = ca.solve(ca.horzcat(*slopes), -drift) if count > 1 else -drift / slopes[0]
    total = low + ca.horzcat(*steps) @ share
    # what is held alone, or all that moves: nothing is left of other forces, not even round-off
    rows = velocity_rows(s)
    if count == s.structure.n - rows.numel():
        held_all = ca.vertcat(*(frozen.sigma[j] for j in sliding), rows)
        rate = ca.jtimes(held_all, s.q, s.v) + ca.jacobian(held_all, s.t)
        total = -push_without_force(s) - s.mass_matrix @ ca.solve(ca.jacobian(held_all, s.v), rate)
    elif s.structure.diagonal_mass and not rows.numel():
        for j, step in zip(sliding, steps, strict=True):
            i = _held_alone(s, frozen.sigma[j], step)
            if i is not None:
                rate = ca.jacobian(frozen.sigma[j], ca.vertcat(s.t, s.v[i]))
                total[i] = -push_without_force(s)[i] - s.mass_matrix[i, i] * rate[0] / rate[1]
    return total, share


def _held_alone(system: System, sigma: ca.SX, step: ca.SX) -> int | None:
    """The one coordinate whose velocity a switch is of, and on which alone it acts."""
    by = [i for i in range(system.structure.n) if ca.depends_on(sigma, system.v[i])]
    acts = ca.sparsify(step).sparsity().row()
    alone = len(by) == 1 and by == acts and not ca.depends_on(sigma, system.q)
    return by[0] if alone else None


def affine_rates(
    frozen: FrozenScene, may_hold: Sequence[int]
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX] | None:
    """F₀, F₁, d and B: with numbers x behind these switches the force is F₀ + F₁ x, and what
    switches changes at the rates d + B x; None where they are not affine.
    """
    s, numbers = frozen.system, ca.vertcat(*(frozen.s[j] for j in may_hold))
    count = len(may_hold)
    slope = ca.jacobian(s.force, numbers)
    if ca.depends_on(slope, numbers):
        return None
    rest = ca.substitute(s.force, numbers, ca.SX.zeros(count))
    sigma, x = ca.vertcat(*(frozen.sigma[j] for j in may_hold)), ca.SX.sym("x", count)
    free, pushed = (acceleration(s, force) for force in (rest, rest + slope @ x))
    if free is None or pushed is None:
        return None
    effect = ca.jacobian(ca.jtimes(sigma, s.v, pushed), x)
    return rest, slope, rate_of(s, sigma, free), ca.substitute(effect, x, ca.SX.zeros(count))


def force_by_numbers(frozen: FrozenScene, may_hold: Sequence[int]) -> tuple[ca.SX, ca.SX] | None:
    """The force, and the share of the upper branch of each switch that may hold, where zero is the
    number behind a switch that does: one expression for all of them, whichever hold.

    With f = 1 − s² the numbers x solve f (d + B x) + (1 − f) (x − s) = 0.
    """
    found = affine_rates(frozen, may_hold)
    if found is None:
        return None
    rest, slope, drift, effect = found
    numbers = ca.vertcat(*(frozen.s[j] for j in may_hold))
    holds = 1 - numbers**2
    matrix = ca.diag(holds) @ effect + ca.diag(1 - holds)
    x = ca.solve(ca.densify(matrix), (1 - holds) * numbers - holds * drift)
    return rest + slope @ x, (1 + x) / 2
