"""Machines side by side with MuJoCo: energy drift, and run time against error.

python benchmarks/machines_beside_mujoco.py, with `mujoco` installed

The same MJCF file is read by both: no contacts, limits or damping, so that energy is kept and the
motion is the Lagrangian's. MuJoCo steps natively (`rollout`) by its RK4 and its default, the semi-
implicit Euler method; varint by compiled kernels, to which long runs shift by themselves: beside
each other native and compiled runs would mix (2 to 5 times). Errors are those of all coordinates at
the end against varint's gauss(8) at a small step, which MuJoCo's RK4 approaches at its own order
(`gap`: how near at its smallest step). Times are processor time, the best of several runs in turn;
`ratio` is MuJoCo's over varint's, at equal error: above 1 varint is faster. What varint needs to
build and compile is reported apart. Every row is printed as it comes, and the file is written scene
by scene: a run that is cut off leaves what it has measured.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import casadi as ca
import mujoco
import numpy as np
from mujoco import rollout
from tools.record import save, table

import varint as vi
import varint.multibody as mb

REPEATS = 5
LINK = (
    '<body name="{name}" pos="{pos}"><joint name="{name}" axis="{axis}"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 {length}" size="0.04" contype="0"/>{inner}</body>'
)
OPTION = '<option gravity="0 0 -9.81"/><default><geom conaffinity="0"/></default>'


def chain(axes: list[str], length: float) -> str:
    """A chain of capsules, each turning about an axis in the one before."""
    inner = ""
    for k, axis in reversed(list(enumerate(axes))):
        pos = "0 0 0" if k == 0 else f"0 0 {length}"
        inner = LINK.format(name=f"j{k + 1}", pos=pos, axis=axis, length=length, inner=inner)
    return f"<mujoco>{OPTION}<worldbody>{inner}</worldbody></mujoco>"


X, Y, Z = "1 0 0", "0 1 0", "0 0 1"
SCENES = {
    "double pendulum": (chain([Y, Y], -1.0), 5.0),
    "7-axis arm": (chain([Z, Y, Z, Y, Z, Y, Z], 0.3), 2.0),
    "chain of 12 links": (chain([Y, X] * 6, -0.2), 1.0),
}
STEPS = {"MuJoCo RK4": 2.0 ** -np.arange(6, 15), "MuJoCo Euler": 2.0 ** -np.arange(6, 15)}
RULES = {f"varint gauss({r})": (vi.gauss(r), 2.0 ** -np.arange(4, 11)) for r in (2, 3, 4, 6)}
WANTED = (1e-3, 1e-6, 1e-9)
EQUAL_STEP = 2.0**-9


def best_of(run: Callable[[], Any]) -> tuple[float, Any]:
    """Least processor time of several runs, and what the last returned."""
    run()
    times = []
    for _ in range(REPEATS):
        began = process_time()
        found = run()
        times.append(process_time() - began)
    return min(times), found


def of_mujoco(text: str, rk4: bool, h: float, duration: float, start: tuple) -> Callable:
    """A native run that returns (q, v) at every step."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = h
    kinds = mujoco.mjtIntegrator
    model.opt.integrator = kinds.mjINT_RK4 if rk4 else kinds.mjINT_EULER
    data, n = mujoco.MjData(model), model.nq
    state = np.concatenate([[0.0], *start])[None]

    def run() -> tuple[np.ndarray, np.ndarray]:
        found = rollout.rollout(model, data, state, nstep=round(duration / h))[0][0]
        return found[:, 1 : 1 + n], found[:, 1 + n :]

    return run


def measured(name: str) -> list[dict[str, Any]]:
    """All runs of a scene, then both tools at equal step and at equal error."""
    text, duration = SCENES[name]
    scene = mb.from_mjcf(text).system()
    n = scene.q.numel()
    q0, v0 = 0.5 + 0.1 * np.arange(n), np.zeros(n)
    energy = ca.Function("energy", [scene.q, scene.v], [scene.energy], {"cse": True})
    exact = vi.simulate(scene, vi.gauss(8), q0=q0, v0=v0, h=2.0**-9, duration=duration).q[-1]
    runs = []

    def add(tool: str, h: float, seconds: float, q: np.ndarray, v: np.ndarray) -> None:
        levels = np.array(energy(q.T, v.T)).ravel()
        size = abs(levels - float(energy(q0, v0))).max()
        runs.append(
            {
                "scene": name,
                "tool": tool,
                "h": h,
                "µs a step": 1e6 * seconds * h / duration,
                "ms": 1e3 * seconds,
                "error": float(abs(q[-1] - exact).max()),
                "energy drift in J": float(size),
            }
        )
        print(f"{name}, {tool}, h = {h:.3g}: {runs[-1]['µs a step']:.3g} µs a step", flush=True)

    for tool, steps in STEPS.items():
        for h in steps:
            run = of_mujoco(text, "RK4" in tool, h, duration, (q0, v0))
            seconds, (q, v) = best_of(run)
            add(tool, h, seconds, q, v)
    built = {}
    for tool, (rule, steps) in RULES.items():
        for h in steps:
            given = dict(q0=q0, v0=v0, h=h, steps=round(duration / h), backend="compiled")
            began = perf_counter()
            try:
                vi.simulate(scene, rule, **given)
            except vi.ConvergenceError:
                continue  # too large a step for this scene
            built.setdefault(tool, perf_counter() - began)
            seconds, motion = best_of(
                lambda given=given, rule=rule: vi.simulate(scene, rule, **given)
            )
            add(tool, h, seconds, motion.q, motion.v)
            if runs[-1]["error"] < 1e-12:
                break
    rows = [run for run in runs if run["h"] == EQUAL_STEP]
    gap = min(run["error"] for run in runs if run["tool"] == "MuJoCo RK4")
    for wanted in WANTED:
        cheapest = {}
        for kind in ("MuJoCo", "varint"):
            good = [x for x in runs if x["tool"].startswith(kind) and x["error"] <= wanted]
            if good:
                cheapest[kind] = min(good, key=lambda run: run["ms"])
        for kind, run in cheapest.items():
            row = run | {"wanted": wanted, "gap": gap}
            if kind == "varint":
                row["built in s"] = built[run["tool"]]
                row["ratio"] = (
                    cheapest["MuJoCo"]["ms"] / run["ms"] if "MuJoCo" in cheapest else None
                )
            rows.append(row)
    return rows


if __name__ == "__main__":
    rows: list[dict[str, Any]] = []
    for name in SCENES:
        rows += (found := measured(name))
        table(found)
        save("machines_beside_mujoco", rows, {"mujoco": mujoco.__version__})
