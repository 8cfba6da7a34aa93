"""One knob: every tool with its own tolerance and nothing else, beside varint's `tol`.

python benchmarks/one_knob.py [scene ...]     needs `pip install varint-mechanics[bench]`

For every scene and wanted error the tolerance of each tool is set to that number, as one does who
knows nothing of the tool. What counts is the time, the error at the end relative to the largest
coordinate of the motion, and whether that error keeps what the tolerance seems to promise. Beside
them heyoka tuned in hindsight: its cheapest tolerance whose true error is below the wanted one.
Calls are warm, tools take turns in one process, and the median counts; varint's is the default
call, with everything compiled that it wants compiled: it is called for `WARM` seconds before, or
until its loop is a compiled one. What it takes until then stands beside it.
"""

from __future__ import annotations

import re
import sys
import time
import warnings
from collections.abc import Iterator
from itertools import chain
from statistics import median
from time import perf_counter

import numpy as np
from tools import peers
from tools.peers import Setting
from tools.record import save, table
from tools.reference import reference
from tools.scenes import SCENES, Scene

import varint as vi
from varint.discrete.lagrangian import point_function
from varint.errors import VarintError
from varint.numerics.arrays import call

WANTED = (1e-3, 1e-6, 1e-9)
TURNS, ENOUGH = 5, 0.2  # at least, and more of what takes less than so many seconds together
MOST_TURNS = 25
SLOW = 2.0  # seconds of a run that is not repeated
WARM, PAUSE, ONCE = 6.0, 0.5, 0.1  # seconds of calls at most, of waiting for the compiler, of calls
NOT_THESE = ("chain of 30", "chain of 50")  # heyoka compiles for minutes
KNOB = re.compile(r"(?:tol|epsilon)=([0-9.e+-]+)")


def varint_settings(scene: Scene) -> Iterator[tuple[float, Setting]]:
    def run(tol: float) -> np.ndarray:
        motion = _motion(scene, tol)
        return np.concatenate([motion.q[-1], motion.p[-1]])

    for tol in WANTED:
        yield tol, Setting("varint", f"tol={tol:g}", lambda tol=tol: run(tol))


def settings(scene: Scene) -> Iterator[tuple[float, Setting]]:
    """(tolerance, setting) of all tools that have a tolerance."""
    model = scene.model
    system, q0, v0 = model.system, model.q0, model.v0
    p0 = call(point_function(system), q0, v0, np.zeros(0), np.zeros(1), system.default_vector)[1]
    start = system, q0, v0, p0, scene.duration
    yield from varint_settings(scene)
    tools = [peers.compiled_dop853(*start)]
    if not scene.slow:
        tools.append(x for x in peers.heyoka(*start) if x.about.startswith("velocities"))
    if not (scene.slow or scene.long):
        tools.append(peers.scipy_dop853(*start, WANTED))
        tools.append(peers.casadi_integrators(*start, WANTED[1:]))  # IDAS hangs at 1e-3
    if scene.bodies:
        tools.append(peers.rebound_bodies(*scene.bodies, scene.duration, q0, v0, WANTED))
    for setting in chain(*tools):
        knob = KNOB.search(setting.about)
        if knob:
            yield float(knob[1]), setting


def size_of(scene: Scene) -> float:
    """The largest coordinate of the motion."""
    return float(np.abs(_motion(scene, WANTED[1]).q).max())


def _motion(scene: Scene, tol: float) -> vi.Trajectory:
    model = scene.model
    start = {"q0": model.q0, "v0": model.v0, "duration": scene.duration}
    return vi.simulate(model.system, **start, tol=tol, progress=False)


def warmed(scene: Scene) -> dict[float, float]:
    """Median seconds of a call by its tolerance before anything of it is compiled, where nothing is
    yet; it then is.
    """
    before = {}
    for tol in WANTED:
        taken = []
        for _ in range(TURNS):
            motion = _motion(scene, tol)
            if motion.stats["backend"].startswith("compiled"):
                break
            taken.append(motion.stats["seconds"])
            if taken[-1] > SLOW:
                break
        if taken:
            before[tol] = median(taken)
    for tol in WANTED:
        began = perf_counter()
        while perf_counter() - began < WARM:
            until = perf_counter() + ONCE
            while perf_counter() < until:
                motion = _motion(scene, tol)
            if motion.stats["backend"].startswith("compiled"):
                break
            time.sleep(PAUSE)
    return before


def tried(setting: Setting, exact: np.ndarray, size: float) -> tuple[float, float]:
    """Seconds and error of a setting, warm; infinite where it fails."""
    try:
        setting.run()
        began = perf_counter()
        found = setting.run()
        took = perf_counter() - began
    except (VarintError, RuntimeError):
        return float("inf"), float("inf")
    return took, float(np.abs(found[: len(exact)] - exact).max() / size)


def again(chosen: list[Setting], seconds: dict[Setting, float]) -> dict[Setting, float]:
    """Median seconds of the settings, taken in turns."""
    times: dict[Setting, list[float]] = {setting: [] for setting in chosen}
    for turn in range(MOST_TURNS):
        for setting, known in times.items():
            if not np.isfinite(seconds[setting]) or (known and known[0] > SLOW):
                continue
            if turn >= TURNS and sum(known) > ENOUGH:
                continue
            setting.run()
            began = perf_counter()
            setting.run()
            known.append(perf_counter() - began)
    return {setting: median(known or [float("inf")]) for setting, known in times.items()}


def measured(name: str, scene: Scene) -> list[dict]:
    """A row a wanted error."""
    exact, size, before = reference(scene)[0], size_of(scene), warmed(scene)
    knobs: dict[str, dict[float, Setting]] = {}
    for tol, setting in settings(scene):
        knobs.setdefault(setting.tool, {})[tol] = setting
    found = {x: tried(x, exact, size) for known in knobs.values() for x in known.values()}
    chosen: dict[tuple[str, float], Setting] = {}
    for wanted in WANTED:
        for tool, known in knobs.items():
            nearest = min(known, key=lambda tol: abs(np.log(tol / wanted)))
            if np.isclose(nearest, wanted, rtol=0.1):
                chosen[tool, wanted] = known[nearest]
            if tool == "heyoka":
                good = [x for x in known.values() if found[x][1] <= wanted]
                if good:
                    chosen["heyoka, tuned", wanted] = min(good, key=lambda x: found[x][0])
    times = again(list(dict.fromkeys(chosen.values())), {x: y[0] for x, y in found.items()})
    rows = []
    for wanted in WANTED:
        row: dict = {"scene": name, "tolerance": wanted}
        here = {tool: x for (tool, tol), x in chosen.items() if tol == wanted}
        if "heyoka, tuned" in here:
            row["varint / heyoka tuned"] = times[here["varint"]] / times[here["heyoka, tuned"]]
        for tool, setting in here.items():
            if np.isfinite(times[setting]):
                row |= {f"{tool}, ms": 1e3 * times[setting], f"{tool}, error": found[setting][1]}
        if wanted in before:
            row["varint before it is compiled, ms"] = 1e3 * before[wanted]
        row["kept by varint"] = bool(found[here["varint"]][1] <= wanted)
        rows.append(row)
    return rows


def main(names: list[str]) -> None:
    warnings.simplefilter("ignore")
    rows: list[dict] = []
    for name in names or [x for x in SCENES if x not in NOT_THESE]:
        rows += measured(name, SCENES[name]())
        table(rows[-len(WANTED) :])
        sys.stdout.flush()
    ratios = [row["varint / heyoka tuned"] for row in rows if "varint / heyoka tuned" in row]
    print(f"geometric mean of varint / heyoka tuned: {np.exp(np.mean(np.log(ratios))):.2f}")
    print(f"promise kept in {sum(row['kept by varint'] for row in rows)} of {len(rows)}")
    if not names:
        save("one_knob", rows)


if __name__ == "__main__":
    main(sys.argv[1:])
