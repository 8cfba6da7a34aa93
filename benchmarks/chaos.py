"""A motion with a small displacement beside it: varint's run and MEGNO beside REBOUND's, and beside
heyoka's variational equations.

varint's time is that of `simulate` and `megno` together; REBOUND's that of a run with `init_megno`;
heyoka's that of the run alone, of the same graph of operations for one displacement (the system of
`tangent_lift`, as heyoka is handed it here), and of its own `var_ode_sys`, which carries all of
them (of scenes with few coordinates); against the latter varint runs and takes its
`transition_matrix`. Errors: of the positions and of the displacement at the end, whichever is
larger (REBOUND's: positions), each relative to the largest, against order 32 with many steps.
Processor time of the thread
that runs, best of fifteen turns, the tools taking turns. Run: python benchmarks/chaos.py
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import thread_time
from typing import Any

import heyoka as hy
import numpy as np
import rebound
from tools.heyoka_peer import expressions, taylor
from tools.record import save, table

import varint as vi
from varint.codegen.algebra import graph_of
from varint.codegen.mechanics import acceleration, force
from varint.discrete.legendre import mass_solve

TURNS = 15
WANTED = (1e-5, 1e-8, 1e-10)
TOLERANCES = (1e-9, 1e-12, 1e-15)
SEED = 7
MOST_FOR_ALL = 4  # coordinates: heyoka compiles all displacements of more for many minutes


@dataclass(frozen=True)
class Setting:
    """A tool with a setting: what runs, and the error of its end."""

    tool: str
    about: str
    run: Callable[[], Any]
    error: Callable[[Any], float]


@dataclass(frozen=True)
class Scene:
    """A motion and how long; steps of gauss(8) to try."""

    name: str
    system: vi.System
    q0: np.ndarray
    v0: np.ndarray
    duration: float
    steps: tuple[int, ...]
    bodies: tuple | None = None


def scenes() -> Iterator[Scene]:
    outer = vi.models.outer_solar_system()
    c = outer.system.defaults
    bodies = (c["m"], float(c["G"]))
    steps = (1900, 2700, 3600, 5000)
    yield Scene("outer Solar System", outer.system, outer.q0, outer.v0, 2e6, steps, bodies)
    model = vi.models.henon_heiles(q0=(0.0, 0.1))
    steps = (5100, 5500, 7500, 10_000, 14_000)
    yield Scene("Hénon–Heiles", model.system, model.q0, model.v0, 1e4, steps)
    model = vi.models.double_pendulum()
    start = np.array([0.4, 0.3]), np.zeros(2)
    yield Scene("double pendulum, small", model.system, *start, 1e3, (5000, 8000, 12_000, 16_000))


def displacement(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(δq, δv) at the start, of the size of the motion."""
    rng = np.random.default_rng(SEED)
    sizes = [max(np.abs(x).max(), 1e-2) for x in (scene.q0, scene.v0)]
    return tuple(s * rng.standard_normal(len(scene.q0)) for s in sizes)


def beside(scene: Scene, rule: vi.Rule, steps: int) -> np.ndarray:
    """(q, δq) at the end, by the lift."""
    dq, dv = displacement(scene)
    motion = vi.simulate(
        vi.orbits.tangent_lift(scene.system),
        rule,
        q0=np.append(scene.q0, dq),
        v0=np.append(scene.v0, dv),
        duration=scene.duration,
        steps=steps,
        save_every=steps,
        backend="compiled",
        progress=False,
    )
    return motion.q[-1]


def off(found: np.ndarray, exact: np.ndarray) -> float:
    """The larger error of both halves, or of the first where that is all there is."""
    n = len(exact) // 2
    halves = [(found[:n], exact[:n])] + ([(found[n:], exact[n:])] if len(found) > n else [])
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in halves)


def ours(scene: Scene, exact: np.ndarray) -> Iterator[Setting]:
    rules = [(vi.gauss(8), k) for k in scene.steps]
    if scene.system.structure.explicit:
        rules += [(vi.composition("sofroniou-spaletta10"), k * 2) for k in scene.steps]
        rules += [(vi.composition("blanes-moan6"), k * 4) for k in scene.steps]
    for rule, steps in rules:

        def motion(rule=rule, steps=steps):
            start = dict(q0=scene.q0, v0=scene.v0, duration=scene.duration)
            return vi.simulate(scene.system, rule, **start, steps=steps, progress=False)

        found = beside(scene, rule, steps)
        if not np.isfinite(found).all():
            continue
        yield Setting(
            "varint, run and MEGNO",
            f"{rule}, {steps} steps",
            lambda motion=motion: vi.orbits.megno(motion(), seed=SEED),
            lambda _, found=found: off(found, exact),
        )
        if len(scene.q0) > MOST_FOR_ALL:
            continue
        yield Setting(
            "varint, run and all displacements",
            f"{rule}, {steps} steps",
            lambda motion=motion: motion().transition_matrix(),
            lambda _, found=found: off(found, exact),
        )


def of_rebound(scene: Scene, exact: np.ndarray) -> Iterator[Setting]:
    masses, G = scene.bodies
    places, speeds = scene.q0.reshape(-1, 3), scene.v0.reshape(-1, 3)
    order = np.argsort(-masses)  # WHFast wants the star first

    def run(integrator: str, setting: float) -> np.ndarray:
        sim = rebound.Simulation()
        sim.G = G
        for i in order:
            (x, y, z), (vx, vy, vz) = places[i], speeds[i]
            sim.add(m=masses[i], x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
        sim.integrator = integrator
        if integrator == "ias15":
            sim.integrator.epsilon = setting
        else:
            sim.dt = scene.duration / setting
        sim.init_megno(seed=SEED)
        sim.integrate(scene.duration, exact_finish_time=1)
        sim.synchronize()
        found = np.empty_like(places)
        for place, i in enumerate(order):
            body = sim.particles[place]
            found[i] = body.x, body.y, body.z
        return found.ravel()

    for epsilon in (1e-3, 1e-6, 1e-9, 1e-11):
        yield Setting(
            "REBOUND, IAS15 with MEGNO",
            f"epsilon {epsilon:.0e}",
            lambda e=epsilon: run("ias15", e),
            lambda found: off(found, exact),
        )
    for steps in (10_000, 20_000, 40_000, 80_000, 160_000):
        yield Setting(
            "REBOUND, WHFast with MEGNO",
            f"{steps} steps",
            lambda s=steps: run("whfast", s),
            lambda found: off(found, exact),
        )


def of_heyoka(scene: Scene, exact: np.ndarray) -> Iterator[Setting]:
    lift, (dq, dv) = vi.orbits.tangent_lift(scene.system), displacement(scene)
    n = len(scene.q0)

    def ran(integrator: hy.taylor_adaptive, start: np.ndarray) -> np.ndarray:
        integrator.time, integrator.state[:] = 0.0, start
        integrator.propagate_until(scene.duration)
        return integrator.state

    def both(state: np.ndarray) -> np.ndarray:
        slopes = state[2 * n :].reshape(2 * n, 2 * n)
        return np.append(state[:n], (slopes @ np.append(dq, dv))[:n])

    for tol in TOLERANCES:
        one = taylor(lift, "velocities", tol)
        start = np.concatenate([scene.q0, dq, scene.v0, dv])

        yield Setting(
            "heyoka, one displacement",
            f"tol {tol:.0e}",
            lambda one=one, start=start: ran(one, start)[: 2 * n].copy(),
            lambda found: off(found, exact),
        )
        if n > MOST_FOR_ALL:
            continue
        every = variational(scene, tol)
        first = every.state.copy()
        yield Setting(
            "heyoka, all displacements",
            f"tol {tol:.0e}",
            lambda every=every, first=first: both(ran(every, first)),
            lambda found: off(found, exact),
        )


def variational(scene: Scene, tol: float) -> hy.taylor_adaptive:
    """heyoka's own variational equations of the same graph, by the start."""
    import casadi as ca

    s = scene.system
    right = (
        acceleration(s)
        if s.structure.separable
        else mass_solve(s.mass_matrix, force(s) - ca.jtimes(s.momentum, s.q, s.v))
    )
    f = ca.Function("f", [s.q, s.v, s.c], [s.v, ca.cse(right)])
    n = len(scene.q0)
    x = list(hy.make_vars(*(f"x{i}" for i in range(2 * n))))
    rows = expressions(graph_of(f), [x[:n], x[n:], s.default_vector.tolist()])
    rates = [y if isinstance(y, hy.expression) else hy.expression(y) for y in rows[0] + rows[1]]
    system = hy.var_ode_sys(list(zip(x, rates, strict=True)), hy.var_args.vars, order=1)
    start = np.append(scene.q0, scene.v0)
    return hy.taylor_adaptive(system, start, tol=tol)


def main() -> None:
    rows = []
    for scene in scenes():
        exact = beside(scene, vi.gauss(16), 3 * scene.steps[-1])
        settings = [*ours(scene, exact)]
        if scene.bodies is not None:
            settings += of_rebound(scene, exact)
        settings += of_heyoka(scene, exact)
        errors = []
        for setting in settings:
            errors.append(setting.error(setting.run()))
            print(f"{scene.name}: {setting.tool}, {setting.about}: {errors[-1]:.1e}", flush=True)
        times = np.full(len(settings), np.inf)
        for _ in range(TURNS):
            for i, setting in enumerate(settings):
                began = thread_time()
                setting.run()
                times[i] = min(times[i], thread_time() - began)
        for wanted in WANTED:
            row: dict[str, Any] = {"scene": scene.name, "error": wanted}
            for tool in dict.fromkeys(setting.tool for setting in settings):
                good = [
                    (times[i], setting.about)
                    for i, setting in enumerate(settings)
                    if setting.tool == tool and errors[i] <= wanted
                ]
                if good:
                    row[f"{tool}, s"], row[f"{tool}, setting"] = min(good)
            rows.append(row)
        for i, setting in enumerate(settings):
            print(
                f"{setting.tool:36} {setting.about:34} {times[i] * 1e3:9.2f} ms {errors[i]:8.1e}",
                flush=True,
            )
    shown = [{k: v for k, v in row.items() if not k.endswith("setting")} for row in rows]
    table(shown)
    save("chaos", rows)


if __name__ == "__main__":
    main()
