"""A step of machines made by varint.multibody: linear in the links? And a seven-axis arm beside
MuJoCo.  python benchmarks/machines.py

Trees and chains of equal links; `ratio` compares the cost of an evaluation and link with that of
the first row. The arm: gauss(2) and gauss(4) beside MuJoCo's RK4 at equal steps, errors of the
joint angles at the end against gauss(8) of a tenth of the step; MuJoCo where it is installed.
"""

from __future__ import annotations

import importlib.util
from time import process_time

import numpy as np
from tools.record import save, table

import varint as vi
import varint.multibody as mb

AXES, REPEATS = ((0, 1, 0), (1, 0, 0), (0, 0, 1)), 5
STEPS = 2000  # of what is timed: what a call costs besides its steps is not seen
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


def scaling() -> list[dict]:
    rows = []
    shapes = {
        "tree": ((10, 30, 100), lambda i: (i - 1) // 2 + 1 if i else 0),
        "chain": ((10, 20, 30), lambda i: i),
    }
    for shape, (sizes, parent_of) in shapes.items():
        first = 0.0
        for links in sizes:
            began = process_time()
            system = machine(links, parent_of).system()
            start = {"q0": 0.3 * np.cos(np.arange(links)), "v0": 0.05 * np.sin(np.arange(links))}
            found, timed = {}, 10 * STEPS // links

            def run(steps: int = timed, system=system, start=start, found=found) -> None:
                found["motion"] = vi.simulate(
                    system, vi.gauss(2), **start, h=2e-3, steps=steps, save_every=steps
                )

            run(5)
            built = process_time() - began
            step = best(run, timed)
            evaluations = found["motion"].stats["iterations"] / timed
            each = step / evaluations / links
            first = first or each
            rows.append(
                {
                    "machine": f"{shape} of {links}",
                    "set-up (s)": round(built, 2),
                    "step (µs)": round(step, 2),
                    "evaluations": round(evaluations, 1),
                    "evaluation and link (µs)": round(each, 3),
                    "ratio": round(each / first, 2),
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
                    system, rule, q0=q0, v0=v0, h=h, steps=steps, save_every=steps
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
    for name, measure in (("machines", scaling), ("arm", arm)):
        measured = measure()
        table(measured)
        save(name, measured)
