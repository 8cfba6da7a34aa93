"""What each specialisation saves: the special and the general stepper on one scene, side by side.

python benchmarks/specialisations.py. Nanoseconds a step, best of several runs that take turns; both
give the same discrete motion to round-off (tests).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from tools.record import save, table

import varint as vi
from varint.codegen.arguments import DONE
from varint.codegen.explicit import explicit_kernel
from varint.codegen.gauss import gauss_kernel
from varint.codegen.kernel import Kernel, run_loop
from varint.codegen.newton import newton_kernel
from varint.discrete.scales import scale_function
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.steppers.constrained import constrained_stepper
from varint.integration.steppers.explicit import explicit_stepper
from varint.integration.steppers.implicit import implicit_stepper
from varint.integration.steppers.linear import linear_stepper
from varint.integration.steppers.rattle import rattle_stepper
from varint.integration.steppers.stepper import Stepper
from varint.numerics.arrays import call

REPEATS, STEPS = 9, 2000


@dataclass(frozen=True)
class Scene:
    """What is stepped, and from where."""

    system: vi.System
    q0: ArrayLike
    v0: ArrayLike


def interpreted(
    stepper: Stepper, scene: Scene | vi.models.Model, rule: vi.Rule, h: float, steps: int = STEPS
) -> Callable[[], None]:
    task = task_of(scene, rule, h, steps)
    t, size = np.zeros(1), np.array([h])
    scale = call(scale_function(scene.system), task.q0, task.p0, np.zeros(0), t, size, task.c)[0]
    x = call(stepper.start, task.q0, task.p0, np.zeros(0), t, size, task.c)[0]
    rolled = stepper.step.mapaccum(steps)
    many = [np.tile(a, steps) for a in (t, size, task.c, scale)]
    return lambda: call(rolled, x, np.zeros(0), *many) and None


def compiled(
    kernel: Kernel, scene: Scene | vi.models.Model, rule: vi.Rule, h: float, steps: int = STEPS
) -> Callable[[], None]:
    task = task_of(scene, rule, h, steps)

    def once() -> None:
        assert (
            run_loop(
                kernel, task.q0, task.p0, task.c, t0=0.0, h=h, steps=steps, save_every=steps
            ).status
            == DONE
        )

    return once


def task_of(scene: Scene | vi.models.Model, rule: vi.Rule, h: float, steps: int):
    return initial_value_problem(
        scene.system, rule, Start(scene.q0, scene.v0), RunOptions(h=h, steps=steps, save_every=1)
    )


def gyroscope() -> Scene:
    """Two coupled oscillators in a magnetic field: linear, not separable."""
    q, v = vi.coordinates("x", "y")
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 + 0.7 * (q[0] * v[1] - q[1] * v[0]) - q[0] ** 2 - 2 * q[1] ** 2
    )
    return Scene(system, [1.0, 0.0], [0.0, 1.0])


def pendulums(count: int = 8) -> Scene:
    """Pendulums that nothing couples, with a mass that depends on the place: independent blocks."""
    q, v = vi.coordinates(*(f"a{i}" for i in range(count)))
    system = vi.System(q, v, ca.dot(1 + ca.sin(q) ** 2 / 3, v**2) / 2 + ca.sum1(ca.cos(q)))
    return Scene(system, np.linspace(0.1, 1, count), np.zeros(count))


def coupled(count: int = 8) -> Scene:
    """The same with every one coupled to every other: one block."""
    scene = pendulums(count)
    system = scene.system
    lagrangian = system.lagrangian + 1e-3 * ca.sin(ca.sum1(system.q)) * ca.sum1(system.v) ** 2
    return Scene(vi.System(system.q, system.v, lagrangian), scene.q0, scene.v0)


def pairs():
    """(what is left out, scene, special, general)."""
    linear, chain, henon = gyroscope(), vi.models.chain_rods(10), vi.models.henon_heiles()
    double, blocks, one = vi.models.double_pendulum(), pendulums(), coupled()
    two, verlet = vi.gauss(2), vi.trapezoidal()
    yield (
        "root finding: kick and drift",
        "Hénon–Heiles, trapezoidal, interpreted",
        interpreted(explicit_stepper(henon.system, verlet), henon, verlet, 0.05),
        interpreted(implicit_stepper(henon.system, verlet), henon, verlet, 0.05),
    )
    yield (
        "root finding: kick and drift",
        "Hénon–Heiles, trapezoidal, compiled",
        compiled(explicit_kernel(henon.system, verlet), henon, verlet, 0.05),
        compiled(newton_kernel(henon.system, verlet), henon, verlet, 0.05),
    )
    yield (
        "iteration: constant linear map",
        "oscillators in a field, gauss(2), interpreted",
        interpreted(linear_stepper(linear.system, two), linear, two, 0.05),
        interpreted(implicit_stepper(linear.system, two), linear, two, 0.05),
    )
    yield (
        "iteration: factorised once",
        "oscillators in a field, gauss(2), compiled",
        compiled(newton_kernel(linear.system, two), linear, two, 0.05),
        compiled(gauss_kernel(linear.system, two), linear, two, 0.05),
    )
    yield (
        "path: multipliers alone",
        "10 rods, trapezoidal, interpreted",
        interpreted(rattle_stepper(chain.system, verlet), chain, verlet, 1e-3),
        interpreted(constrained_stepper(chain.system, verlet), chain, verlet, 1e-3),
    )
    yield (
        "fixed-point iteration: Newton in closed form",
        "double pendulum, midpoint, compiled",
        compiled(newton_kernel(double.system, vi.midpoint()), double, vi.midpoint(), 0.01),
        compiled(gauss_kernel(double.system, vi.midpoint()), double, vi.midpoint(), 0.01),
    )
    yield (
        "couplings: 8 independent blocks",
        "8 pendulums, lobatto(3), compiled",
        compiled(newton_kernel(blocks.system, vi.lobatto(3)), blocks, vi.lobatto(3), 0.01),
        compiled(newton_kernel(one.system, vi.lobatto(3)), one, vi.lobatto(3), 0.01),
    )
    fixed = gauss_kernel(double.system, vi.gauss(8))
    yield (
        "Newton's method: stages iterated at once",
        "double pendulum, gauss(8), compiled",
        compiled(fixed, double, vi.gauss(8), 0.05),
        compiled(newton_kernel(double.system, vi.gauss(8)), double, vi.gauss(8), 0.05),
    )


def main() -> None:
    rows = []
    for what, scene, special, general in pairs():
        times: list[list[float]] = [[], []]
        for _ in range(REPEATS):
            for taken, once in zip(times, (special, general), strict=True):
                began, count = process_time(), 0
                while process_time() - began < 0.003:
                    once()
                    count += 1
                taken.append((process_time() - began) / count / STEPS * 1e9)
        a, b = map(min, times)
        rows.append(
            {"left out": what, "scene": scene, "ns a step": a, "general": b, "factor": b / a}
        )
        print(rows[-1], flush=True)
    table(rows)
    save("specialisations", rows)


if __name__ == "__main__":
    main()
