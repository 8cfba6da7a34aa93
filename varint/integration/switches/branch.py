"""One branch of a scene with switches: the smooth scene that moves there, how far each switch is,
and what it does next.

Where both branches of a switch that depends on velocities push the motion back, as dry friction
does at rest, it stays on the switch: the force is then the mean of both with which the switch does
not change (Filippov, Differential Equations with Discontinuous Righthand Sides, 1988, §4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from varint.discrete.constraints import velocity_rows
from varint.integration.switches.accelerations import acceleration, push_without_force, rate_of
from varint.integration.switches.frozen import FrozenScene, frozen_scene, with_force
from varint.integration.switches.timetable import timed
from varint.scene.memory import per_system
from varint.scene.system import System

DERIVATIVES = 3  # in time of what switches, that tell on which side the motion goes on
SEEN = 30_000  # operations of an acceleration at most


class Branch(NamedTuple):
    """The numbers behind all switches, those that hold the motion, and the controls."""

    values: tuple[float, ...]
    sliding: tuple[int, ...] = ()
    controls: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class BranchScene:
    """What moves while the same switches hold the motion.

    Attributes
    ----------
    system : System
        Its parameters are those of the scene and the numbers behind the switches.
    watched : tuple of (int, float)
        Switch and what its number is beyond (a change of ±1 where it counts), of each margin.
    margins : Function
        (q, v, t, c) → margins, positive in the branch, and their rates.
    ahead : Function
        (q, v, t, c) → what switches, (m,), and its rate.
    shares : Function
        (q, v, t, c) → how much of the upper branch each switch that holds has.
    """

    system: System
    watched: tuple[tuple[int, float], ...]
    margins: ca.Function
    ahead: ca.Function
    shares: ca.Function


@per_system
def slidable(system: System) -> tuple[int, ...]:
    """Switches that may hold the motion: of velocities, by forces alone, and by none of the other
    switches.
    """
    frozen = _frozen(system)
    found = []
    for j in range(frozen.s.numel()):
        s = frozen.s[j]
        if frozen.counts[j] or not ca.depends_on(frozen.sigma[j], system.v):
            continue
        if not ca.depends_on(ca.vertcat(frozen.system.lagrangian, frozen.sigma), s):
            found.append(j)
    return tuple(found)


@per_system
def passed_straight(system: System) -> tuple[int, ...]:
    """Switches of coordinates and time that none of the others knows of: the motion comes out on
    the other side, whatever the forces.
    """
    frozen, found = _frozen(system), []
    for j in range(frozen.s.numel()):
        alone = not ca.depends_on(frozen.sigma, frozen.s[j])
        if alone and not frozen.counts[j] and not ca.depends_on(frozen.sigma[j], system.v):
            found.append(j)
    return tuple(found)


@per_system
def branch_scene(system: System, sliding: tuple[int, ...] = ()) -> BranchScene | None:
    """The scene that moves while these switches hold the motion; None where it is not known."""
    frozen = _frozen(system)
    moving, share = frozen.system, ca.SX(0, 1)
    if sliding:
        found = _sliding(frozen, sliding)
        if found is None:
            return None
        force, share = found
        s = frozen.system
        moving = with_force(s, force)
    a = acceleration(moving, moving.force)
    if a is None or ca.Function("a", ca.symvar(a), [a]).n_instructions() > SEEN:
        return None
    inputs, clocks = [moving.q, moving.v, moving.t, moving.c], set(timed(system).places)
    watched: list[tuple[int, float]] = []
    margins = []
    for j in range(frozen.s.numel()):
        s, sigma = frozen.s[j], frozen.sigma[j]
        if j in clocks or j in sliding:
            continue
        if frozen.counts[j]:
            margins += [sigma - s, s + 1 - sigma]
            watched += [(j, -1.0), (j, 1.0)]
        else:
            margins.append(s * sigma)
            watched.append((j, 0.0))
    for j, x in zip(sliding, ca.vertsplit(share) if sliding else (), strict=True):
        margins += [x, 1 - x]
        watched += [(j, -1.0), (j, 1.0)]
    margin = ca.vertcat(ca.SX(0, 1), *margins)
    rate = rate_of(moving, frozen.sigma, a)
    functions = (
        _function(name, inputs, outputs)
        for name, outputs in (
            ("margins", [margin, rate_of(moving, margin, a)]),
            ("ahead", [frozen.sigma, rate]),
            ("shares", [share]),
        )
    )
    return BranchScene(moving, tuple(watched), *functions)


@per_system
def slope_size(system: System, switch: int) -> int:
    """Operations of the slopes ∂F/∂(q, v) while this switch holds the motion."""
    scene = branch_scene(system, (switch,))
    if scene is None:
        return 0
    s = scene.system
    slopes = ca.jacobian(s.force, ca.vertcat(s.q, s.v))
    return int(
        ca.Function("slopes", [s.q, s.v, s.t, s.c], [slopes], {"cse": True}).n_instructions()
    )


@per_system
def later_rates(system: System, sliding: tuple[int, ...], order: int) -> ca.Function:
    """(q, v, t, c) → a derivative in time of what switches, of this order."""
    frozen, scene = _frozen(system), branch_scene(system, sliding)
    assert scene is not None
    moving, rate = scene.system, frozen.sigma
    a = acceleration(moving, moving.force)
    assert a is not None
    for _ in range(order):
        rate = rate_of(moving, rate, a)
    return _function("later", [moving.q, moving.v, moving.t, moving.c], [rate])


def _function(name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ca.Function:
    return ca.Function(name, list(inputs), [ca.densify(x) for x in outputs], {"cse": True})


def _frozen(system: System) -> FrozenScene:
    found = frozen_scene(system)
    assert found is not None
    return found


def _sliding(frozen: FrozenScene, sliding: Sequence[int]) -> tuple[ca.SX, ca.SX] | None:
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
    return by[0] if by == acts and not ca.depends_on(sigma, system.q) else None
