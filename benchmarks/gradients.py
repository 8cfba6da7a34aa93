"""The gradient of a run by start and parameters: `gradient` beside CasADi's own ways and, where it
is installed, diffrax.

The loss is |q|² at the end of a run of the double pendulum with its parameters. CasADi
differentiates a `mapaccum` of the same steps backwards, and integrates the adjoint of cvodes at
three tolerances; diffrax (Dopri8) differentiates its own steps backwards. All take turns, and the
shortest time of each counts. The error is relative to a run of `gauss(8)` in ten times as many
steps. Then the processor time of a gradient alone over that of the run, from 1e3 to 1e6 steps, with
all nodes kept, with every √N-th, and with the ends alone. Run: python benchmarks/gradients.py
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import casadi as ca
import numpy as np
from tools.record import save, table

import varint as vi

DURATION, START = 5.0, ([0.4, 0.3], [0.0, 0.1])
TURNS = 15
LONG_TURNS = 3


def scene() -> vi.System:
    q, v = vi.coordinates("a", "b")
    c = vi.Parameters(m=1.0, length=1.0, g=9.81)
    kinetic = (1 + c.m) * v[0] ** 2 / 2 + c.m * c.length**2 * v[1] ** 2 / 2
    kinetic += c.m * c.length * v[0] * v[1] * ca.cos(q[0] - q[1])
    potential = -(1 + c.m) * c.g * ca.cos(q[0]) - c.m * c.g * c.length * ca.cos(q[1])
    return vi.System(q, v, kinetic - potential, params=c)


def shortest(
    works: list[Callable[[], Any]], turns: int, clock: Callable[[], float] = perf_counter
) -> list[float]:
    """Shortest time of each in several turns, after one that does not count."""
    times = np.full(len(works), np.inf)
    for turn in range(turns + 1):
        for i, work in enumerate(works):
            began = clock()
            work()
            if turn:
                times[i] = min(times[i], clock() - began)
    return times.tolist()


def flat(of: vi.Gradient) -> np.ndarray:
    return np.concatenate([of.q0, of.v0, [float(x) for x in of.params.values()]])


def ours(system: vi.System, rule: vi.Rule, steps: int) -> Callable[[], np.ndarray]:
    """A run and its gradient, both in the time."""

    def work() -> np.ndarray:
        motion = vi.simulate(
            system,
            rule,
            q0=START[0],
            v0=START[1],
            duration=DURATION,
            steps=steps,
            backend="compiled",
        )
        return flat(vi.gradient(motion, terminal_loss=ca.sumsqr(system.q), backend="compiled"))

    return work


def by_casadi(
    q: ca.MX, p: ca.MX, c: ca.MX, loss: ca.MX, momentum: ca.Function, system: vi.System
) -> Callable[[], np.ndarray]:
    """A gradient by (q0, p0, c) as one by (q0, v0, c)."""
    v = ca.MX.sym("v", q.numel())
    f = ca.Function("loss", [q, p, c], [loss])
    whole = f(q, momentum(q, v, 0.0, c), c)
    slopes = ca.Function("slopes", [q, v, c], [ca.gradient(whole, x) for x in (q, v, c)])
    given = *START, system.default_vector
    return lambda: np.concatenate([np.array(x).ravel() for x in slopes(*given)])


def steps_of_casadi(system: vi.System, rule: vi.Rule, steps: int) -> Callable[[], np.ndarray]:
    step = vi.step_function(system, rule)
    x, c = ca.MX.sym("x", 4), ca.MX.sym("c", 3)
    after = step(x[:2], x[2:], ca.MX(*step.size_in(2)), c, 0.0, DURATION / steps)
    once = ca.Function("once", [x, c], [ca.vertcat(*after[:2])])
    q, p = ca.MX.sym("q", 2), ca.MX.sym("p", 2)
    end = once.mapaccum("run", steps)(ca.vertcat(q, p), ca.repmat(c, 1, steps))[:, -1]
    return by_casadi(q, p, c, ca.sumsqr(end[:2]), _momentum(system), system)


def _momentum(system: vi.System) -> ca.Function:
    return ca.Function("momentum", [system.q, system.v, system.t, system.c], [system.momentum])


def _rates(system: vi.System) -> ca.SX:
    """(v, dv/dt)."""
    gyroscopic = ca.jtimes(system.momentum, system.q, system.v)
    forces = ca.gradient(system.lagrangian, system.q) - gyroscopic
    return ca.vertcat(system.v, ca.solve(system.mass_matrix, forces))


def cvodes(system: vi.System, tolerance: float) -> Callable[[], np.ndarray]:
    ode = {"x": ca.vertcat(system.q, system.v), "p": system.c, "ode": _rates(system)}
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 10**6}
    run = ca.integrator("run", "cvodes", ode, 0.0, DURATION, options)
    x, c = ca.MX.sym("x", 4), ca.MX.sym("c", 3)
    loss = ca.sumsqr(run(x0=x, p=c)["xf"][:2])
    slopes = ca.Function("slopes", [x, c], [ca.gradient(loss, y) for y in (x, c)])
    given = np.concatenate(START), system.default_vector
    return lambda: np.concatenate([np.array(y).ravel() for y in slopes(*given)])


def by_diffrax(system: vi.System, tolerance: float) -> Callable[[], np.ndarray]:
    """Written by hand: diffrax knows no Lagrangians."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def rates(t, y, c):
        a, b, va, vb = y
        m, length, g = c
        cos, sin = jnp.cos(a - b), jnp.sin(a - b)
        mass = jnp.array([[1 + m, m * length * cos], [m * length * cos, m * length**2]])
        forces = jnp.array(
            [
                -m * length * vb**2 * sin - (1 + m) * g * jnp.sin(a),
                m * length * va**2 * sin - m * g * length * jnp.sin(b),
            ]
        )
        return jnp.concatenate([y[2:], jnp.linalg.solve(mass, forces)])

    def loss(y0, c):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rates),
            diffrax.Dopri8(),
            0.0,
            DURATION,
            0.01,
            y0,
            args=c,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            max_steps=4096,
        )
        return jnp.sum(found.ys[-1, :2] ** 2)

    slopes = jax.jit(jax.grad(loss, argnums=(0, 1)))
    given = jnp.concatenate([jnp.array(x) for x in START]), jnp.array(system.default_vector)
    return lambda: np.concatenate([np.asarray(x) for x in slopes(*given)])


def main() -> None:
    system = scene()
    exact = ours(system, vi.gauss(8), 2000)()
    ways: list[tuple[str, Callable[[], np.ndarray]]] = []
    for rule, steps in ((vi.gauss(4), 200), (vi.gauss(8), 100), (vi.gauss(8), 200)):
        ways.append((f"gradient, {rule}, {steps} steps", ours(system, rule, steps)))
    ways.append(("CasADi mapaccum, gauss(4), 200 steps", steps_of_casadi(system, vi.gauss(4), 200)))
    ways += [(f"CasADi cvodes, {x:g}", cvodes(system, x)) for x in (1e-6, 1e-9, 1e-12)]
    if importlib.util.find_spec("diffrax"):
        ways += [(f"diffrax Dopri8, {x:g}", by_diffrax(system, x)) for x in (1e-6, 1e-9, 1e-12)]
    rows: list[dict[str, Any]] = []
    works = [work for _, work in ways]
    for (name, work), seconds in zip(ways, shortest(works, TURNS), strict=True):
        error = float(np.abs(work() - exact).max() / np.abs(exact).max())
        rows.append({"way": name, "run and gradient, ms": 1e3 * seconds, "relative error": error})
    for steps in (10**3, 10**4, 10**5, 10**6):
        rows += over_the_run(system, vi.gauss(4), steps)
    table(rows)
    save("gradients", rows)


def over_the_run(system: vi.System, rule: vi.Rule, steps: int) -> list[dict[str, Any]]:
    """The time of a gradient over that of the run: all nodes kept, every √N-th, the ends."""
    thin, turns = round(steps**0.5), LONG_TURNS if steps > 10**4 else TURNS

    def run(save_every: int = 1) -> vi.Trajectory:
        given = dict(q0=START[0], v0=START[1], h=0.01, steps=steps, save_every=save_every)
        return vi.simulate(system, rule, **given, backend="compiled")

    loss, motions = ca.sumsqr(system.q), (run(), run(thin), run(steps))

    def gradient(motion: vi.Trajectory) -> Callable[[], Any]:
        return lambda: vi.gradient(motion, terminal_loss=loss, backend="compiled")

    once, *times = shortest([run, *map(gradient, motions)], turns, process_time)
    return [
        {"way": f"gradient alone, {rule}, {steps:.0e} steps, {kept}", "over the run": t / once}
        for kept, t in zip(("all nodes kept", "every √N-th", "ends"), times, strict=True)
    ]


if __name__ == "__main__":
    main()
