"""A step of machines made by varint.multibody: linear in the links? And a seven-axis arm beside
MuJoCo.  python benchmarks/machines.py

Trees and chains of equal links by the native loop, whatever their size: all sizes in turn in one
process, processor time, the least of many turns. `ratio` compares the cost of a step and link with
that of the first row; `operations` are those of a step, for a link; `a link more` is what a further
link costs, from one size to the next: the steps cost a·links − b, where b is what the links next to
the ground and the tips save (nothing moves before them, nothing hangs on them), two or three links'
worth, which ten links feel more than a hundred. A humanoid: a floating base with forty hinges in
five limbs. The arm: gauss(2) and gauss(4), compiled, beside MuJoCo's RK4
at equal steps, errors of its angles at the end against gauss(8) of a tenth of the step; MuJoCo
where it is installed.
"""

from __future__ import annotations

import importlib.util
from time import process_time

import numpy as np
from tools.record import save, table

import varint as vi
import varint.multibody as mb
from varint.codegen.dependence import operations
from varint.codegen.gauss import gauss_scheme

AXES, REPEATS = ((0, 1, 0), (1, 0, 0), (0, 0, 1)), 5
EACH = ("kick", "drift")  # what every evaluation calls; "inertia" is called once a step
RULE, H = vi.gauss(2), 2e-4  # so small that a chain of a hundred converges as one of ten
STEPS = 8000  # of what is timed: what a call costs besides its steps is not seen
SIZES, TURNS, WORK = (10, 30, 100), 70, 100_000  # links; turns of all sizes; steps × links of one
MASS, COM, INERTIA = 1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05)


def machine(links: int, parent_of, gravity: float = 0.0) -> mb.Model:
    """Equal links that turn about y, x and z by turns, each on the tip of its parent."""
    world = mb.Model(gravity=(0, 0, -gravity))
    names = ["world"]
    for i in range(links):
        names.append(world.body(MASS, COM, INERTIA, f"link{i}").name)
        parent = parent_of(i)
        world.revolute(names[parent], names[-1], AXES[i % 3], (0, 0, -1 if parent else 0))
    return world


def best(run, steps: int) -> float:
    """Microseconds a step, best of several runs."""
    times = []
    for _ in range(REPEATS):
        began = process_time()
        run()
        times.append(process_time() - began)
    return min(times) / steps * 1e6


def step_size(system: vi.System, evaluations: float) -> float:
    """Operations of a step at a stage."""
    sizes = {k: operations(*f)[0] for k, f in gauss_scheme(system, 2).functions.items()}
    return sizes["inertia"] + evaluations * sum(sizes[k] for k in EACH)


def scaling() -> list[dict]:
    shapes = {"tree": lambda i: (i - 1) // 2 + 1 if i else 0, "chain": lambda i: i}
    found, runs = {}, {}
    for shape, parent_of in shapes.items():
        for links in SIZES:
            began = process_time()
            system = machine(links, parent_of).system()
            start = {"q0": 0.3 * np.cos(np.arange(links)), "v0": 0.05 * np.sin(np.arange(links))}
            steps = WORK // links

            def run(steps: int = steps, system=system, start=start) -> vi.Motion:
                return vi.simulate(
                    system, RULE, **start, h=H, steps=steps, save_every=steps, backend="native"
                )

            run(5)
            built = process_time() - began
            evaluations = run().stats["iterations"] / steps
            runs[shape, links] = run, steps
            found[shape, links] = {
                "machine": f"{shape} of {links}",
                "set-up (s)": round(built, 2),
                "step (µs)": np.inf,
                "evaluations": round(evaluations, 1),
                "operations": round(step_size(system, evaluations) / links),
            }
    for _ in range(TURNS):
        for key, (run, steps) in runs.items():
            began = process_time()
            run()
            each = (process_time() - began) / steps * 1e6
            found[key]["step (µs)"] = min(found[key]["step (µs)"], each)
    for (shape, links), row in found.items():
        step, first = row["step (µs)"], found[shape, SIZES[0]]["step (µs)"]
        row["step and link (µs)"] = round(step / links, 3)
        row["ratio"] = round(step / links / (first / SIZES[0]), 2)
        if links > SIZES[0]:
            fewer = SIZES[SIZES.index(links) - 1]
            more = (step - found[shape, fewer]["step (µs)"]) / (links - fewer)
            row["a link more (µs)"] = round(more, 3)
    return [row | {"step (µs)": round(row["step (µs)"], 2)} for row in found.values()]


def humanoid() -> list[dict]:
    """A base that floats and turns freely, five limbs of eight hinges; every rule at one step."""
    began = process_time()
    world = mb.Model(gravity=(0, 0, -9.81))
    world.free(world, world.body(10.0, (0, 0, 0.1), (1, 1, 0.5), "trunk"))
    last = "trunk"
    for i in range(40):
        parent, at = ("trunk", (0, 0.1 * (i // 8), 0)) if i % 8 == 0 else (last, (0, 0, -0.15))
        last = world.body(1.0, (0.02, 0.01, -0.08), (0.01, 0.012, 0.005), f"link{i}").name
        world.revolute(parent, last, AXES[i % 3], at)
    system, built = world.system(), process_time() - began
    q0, v0 = mb.start_values(
        world,
        {f"link{i}": 0.3 * np.cos(i) for i in range(40)},
        {"trunk": [0.1, 0.2, 0.3, 1, 2, 3]} | {f"link{i}": 0.5 * np.sin(i) for i in range(40)},
    )
    rows = []
    for backend in ("native", "compiled"):
        for rule in (vi.gauss(2), vi.gauss(4)):
            found = {}

            def run(steps: int = 500, rule=rule, backend=backend, found=found) -> None:
                found["motion"] = vi.simulate(
                    system, rule, q0=q0, v0=v0, h=2e-3, steps=steps, backend=backend
                )

            began = process_time()
            run(5)
            first = built + process_time() - began
            step, motion = best(run, 500), found["motion"]
            drift = np.ptp(motion.energy) / abs(motion.energy[0])
            rows.append(
                {
                    "machine": f"humanoid of 40 hinges, {rule}, {backend}",
                    "set-up (s)": round(first, 2),
                    "step (µs)": round(step, 2),
                    "evaluations": round(motion.stats["iterations"] / 500, 1),
                    "energy drift": float(f"{drift:.1e}"),
                }
            )
    return rows


def arm_in_mujoco(h: float) -> str:
    """The same seven links as MJCF."""
    text = ""
    for i in reversed(range(7)):
        inertial = (
            f'<inertial mass="{MASS}" pos="{" ".join(map(str, COM))}" '
            f'diaginertia="{" ".join(map(str, INERTIA))}"/>'
        )
        axis = " ".join(map(str, AXES[i % 3]))
        text = (
            f'<body name="link{i}" pos="0 0 {-1 if i else 0}"><joint type="hinge" axis="{axis}"/>'
            f"{inertial}{text}</body>"
        )
    return (
        f'<mujoco><option timestep="{h}" integrator="RK4" gravity="0 0 -9.81"/>'
        f"<worldbody>{text}</worldbody></mujoco>"
    )


def arm() -> list[dict]:
    system = machine(7, lambda i: i, 9.81).system()
    q0, v0, duration = 0.3 * np.cos(np.arange(7)), 0.5 * np.sin(np.arange(7)), 1.0
    exact = vi.simulate(system, vi.gauss(8), q0=q0, v0=v0, h=1e-3, duration=duration).q[-1]
    rows = []
    for h in (1e-2, 5e-3, 2e-3, 1e-3):
        steps = round(duration / h)
        for rule in (vi.gauss(2), vi.gauss(4)):
            found = {}

            def run(steps: int = STEPS, rule=rule, h=h, found=found) -> None:
                found["motion"] = vi.simulate(
                    system,
                    rule,
                    q0=q0,
                    v0=v0,
                    h=h,
                    steps=steps,
                    save_every=steps,
                    backend="compiled",
                )

            step = best(run, STEPS)
            run(steps)
            rows.append(_row(f"varint {rule}", h, step, found["motion"].q[-1] - exact))
        if importlib.util.find_spec("mujoco"):
            import mujoco

            model = mujoco.MjModel.from_xml_string(arm_in_mujoco(h))
            data = mujoco.MjData(model)

            def run_peer(steps: int = STEPS, model=model, data=data) -> None:
                mujoco.mj_resetData(model, data)
                data.qpos[:], data.qvel[:] = q0, v0
                mujoco.mj_step(model, data, steps)

            step = best(run_peer, STEPS)
            run_peer(steps)
            rows.append(_row("MuJoCo RK4", h, step, data.qpos - exact))
    return rows


def _row(tool: str, h: float, step: float, error: np.ndarray) -> dict:
    return {
        "tool": tool,
        "h (s)": h,
        "step (µs)": round(step, 2),
        "error (rad)": float(f"{abs(error).max():.1e}"),
    }


if __name__ == "__main__":
    for name, measure in (("machines", scaling), ("humanoid", humanoid), ("arm", arm)):
        measured = measure()
        table(measured)
        save(name, measured)
