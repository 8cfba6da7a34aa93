"""One knob: every tool with its own tolerance and nothing else, beside varint's `tol`.

python benchmarks/one_knob.py [scene ...]     needs `pip install varint-mechanics[bench]`

For every scene and wanted error the tolerance of each tool is set to that number, as one does who
knows nothing of the tool. What counts is the time, the error at the end relative to the largest
coordinate of the motion, and whether that error keeps what the tolerance seems to promise. Beside
them heyoka tuned in hindsight over three tolerances a decade, twice, which no user could:

- to the wanted error: its cheapest tolerance whose true error is below the wanted one. This is what
  an answer of that accuracy costs; that varint's are often far more accurate counts for nothing.
- to varint's error: its cheapest tolerance whose true error is no larger than that of varint's run.
  This is what the same answer costs. Where no tolerance of heyoka comes so near, the most accurate
  one stands for it, and the row says so.

Calls are warm: every turn begins with a call that is not timed, and then times as many as take
`PIECE` seconds of the processor together, of every tool alike; tools take turns in one process, and
the quickest turn counts. varint's is the default call, with everything compiled that it wants
compiled: it is called for `WARM` seconds before, or until its loop is a compiled one. What it takes
until then stands beside it.

A call of more than `LONG` seconds is its own piece, and is not made once before: nothing of it is
still to get warm. What a setting is tried for ends after `TRIED` seconds, and its turns after
`SPENT`. heyoka's tolerances stand for its orders, each of which is tried once; where a low one
stalls it is given up after `STALLED` times the steps of gauss(8) for 1e-9. The record is written
after every scene; scenes by name replace their rows in it.
"""

from __future__ import annotations

import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from datetime import datetime, timezone
from itertools import chain
from statistics import median
from time import perf_counter, thread_time

import numpy as np
from tools import peers
from tools.peers import Setting
from tools.record import kept, save, table, with_scene, write
from tools.reference import reference
from tools.scenes import FORCED, SCENES, Scene

import varint as vi
from varint.discrete.lagrangian import point_function
from varint.errors import VarintError
from varint.numerics.arrays import call

WANTED = (1e-3, 1e-6, 1e-9)
TURNS, ENOUGH = 5, 0.2  # at least, and more of what takes less than so many seconds together
MOST_TURNS, TRIES = 25, 3
PIECE = 2e-3  # seconds of calls that are timed together
SLOW = 2.0  # seconds of a run that is not repeated
LONG, TRIED, SPENT = 0.05, 0.3, 2.0  # seconds of a call, of all trials, of all turns
STALLED = 100
WARM, PAUSE, ONCE = 6.0, 0.2, 0.5  # seconds of calls at most, of waiting for the compiler, of calls
NOT_THESE = ("chain of 30", "chain of 50")  # heyoka compiles for minutes
THESE = {name: make for name, make in (SCENES | FORCED).items() if name not in NOT_THESE}
SWEEP = 10.0 ** (np.arange(-3, -53, -1) / 3)  # tolerances of heyoka, from 0.1 on
TUNED = "heyoka, tuned"
TO_OURS = "heyoka, tuned to varint's error"
RATIOS = {TUNED: "varint / heyoka tuned", TO_OURS: "varint / heyoka tuned to varint's error"}
MEANS = {
    RATIOS[TUNED]: "heyoka tuned in hindsight to the wanted error",
    RATIOS[TO_OURS]: "heyoka tuned in hindsight to the error that varint's run has",
}
KNOB = re.compile(r"(?:tol|epsilon)=([0-9.e+-]+)")


def varint_settings(scene: Scene) -> Iterator[tuple[float, Setting]]:
    """With a start that is there, and the places at the end, as heyoka's runs have it."""
    model = scene.model
    start = {"q0": model.q0, "v0": model.v0, "duration": scene.duration, "progress": False}

    def run(tol: float) -> np.ndarray:
        return vi.simulate(model.system, **start, tol=tol).q[-1]

    for tol in WANTED:
        yield tol, Setting("varint", f"tol={tol:g}", lambda tol=tol: run(tol))


def settings(scene: Scene) -> Iterator[tuple[float, Setting]]:
    """(tolerance, setting) of all tools that have a tolerance."""
    model = scene.model
    system, q0, v0 = model.system, model.q0, model.v0
    p0 = call(point_function(system), q0, v0, np.zeros(0), np.zeros(1), system.default_vector)[1]
    start = system, q0, v0, p0, scene.duration
    yield from varint_settings(scene)
    tools = [] if scene.forced else [peers.compiled_dop853(*start)]
    if not scene.slow:
        most = STALLED * scene.steps
        tools.append(peers.heyoka(*start, SWEEP, ("velocities",), most))
    if not (scene.slow or scene.long or scene.forced):
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


def seconds_of(setting: Setting) -> float:
    """Mean seconds of the processor in warm calls."""
    began = thread_time()
    setting.run()
    if (took := thread_time() - began) > LONG:
        return took
    count, took, began = 0, 0.0, thread_time()
    while took < PIECE:
        setting.run()
        count, took = count + 1, thread_time() - began
    return took / count


def tried(setting: Setting, exact: np.ndarray, size: float) -> tuple[float, float]:
    """Seconds and error of a setting, warm; infinite where it fails."""
    try:
        began = thread_time()
        found = setting.run()
        took = thread_time() - began
        for _ in range(TRIES):
            if thread_time() - began < TRIED:
                took = min(took, seconds_of(setting))
    except (VarintError, RuntimeError):
        return float("inf"), float("inf")
    return took, float(np.abs(found[: len(exact)] - exact).max() / size)


def again(chosen: list[Setting], seconds: dict[Setting, float]) -> dict[Setting, float]:
    """Least seconds of the settings, taken in turns."""
    times: dict[Setting, list[float]] = {setting: [] for setting in chosen}
    for turn in range(MOST_TURNS):
        for setting, known in times.items():
            if not np.isfinite(seconds[setting]) or (known and known[0] > SLOW):
                continue
            if sum(known) > SPENT:
                continue
            if turn >= TURNS and sum(known) > ENOUGH:
                continue
            known.append(seconds_of(setting))
    return {setting: min(known, default=float("inf")) for setting, known in times.items()}


def cheapest(
    known: dict[float, Setting], found: dict[Setting, tuple[float, float]], most: float
) -> Setting | None:
    """The setting of least time whose error is at most so large."""
    good = [x for x in known.values() if found[x][1] <= most]
    return min(good, key=lambda x: found[x][0], default=None)


def measured(name: str, scene: Scene) -> list[dict]:
    """A row a wanted error."""
    exact, size, before = reference(scene)[0], size_of(scene), warmed(scene)
    knobs: dict[str, dict[float, Setting]] = {}
    for tol, setting in settings(scene):
        knobs.setdefault(setting.tool, {})[tol] = setting
    by_run: dict[Callable[[], np.ndarray], tuple[float, float]] = {}
    found: dict[Setting, tuple[float, float]] = {}
    for x in chain(*(known.values() for known in knobs.values())):
        if x.run not in by_run:
            by_run[x.run] = tried(x, exact, size)
        found[x] = by_run[x.run]
    chosen: dict[tuple[str, float], Setting] = {}
    for wanted in WANTED:
        for tool, known in knobs.items():
            nearest = min(known, key=lambda tol: abs(np.log(tol / wanted)))
            if np.isclose(nearest, wanted, rtol=0.1):
                chosen[tool, wanted] = known[nearest]
            if tool == "heyoka":
                ours = found[knobs["varint"][wanted]][1]
                if tuned := cheapest(known, found, wanted):
                    chosen[TUNED, wanted] = tuned
                best = min(known.values(), key=lambda x: found[x][1])
                chosen[TO_OURS, wanted] = cheapest(known, found, ours) or best
    times = again(list(dict.fromkeys(chosen.values())), {x: y[0] for x, y in found.items()})
    rows = []
    for wanted in WANTED:
        row: dict = {"scene": name, "tolerance": wanted}
        here = {tool: x for (tool, tol), x in chosen.items() if tol == wanted}
        for tool, ratio in RATIOS.items():
            if tool in here:
                row[ratio] = times[here["varint"]] / times[here[tool]]
        for tool, setting in here.items():
            if np.isfinite(times[setting]):
                row |= {f"{tool}, ms": 1e3 * times[setting], f"{tool}, error": found[setting][1]}
        if TO_OURS in here:
            reached = found[here[TO_OURS]][1] <= found[here["varint"]][1]
            row["heyoka comes as near as varint"] = bool(reached)
        if wanted in before:
            row["varint before it is compiled, ms"] = 1e3 * before[wanted]
        row["kept by varint"] = bool(found[here["varint"]][1] <= wanted)
        row["measured"] = datetime.now(timezone.utc).date().isoformat()
        rows.append(row)
    return rows


def mean_of(rows: list[dict], ratio: str) -> float:
    """Geometric mean of a column."""
    return float(np.exp(np.mean([np.log(row[ratio]) for row in rows if ratio in row])))


def means_of(rows: list[dict]) -> dict[str, float]:
    """Geometric means of the ratios that there are."""
    some = {ratio for row in rows for ratio in row}
    return {f"over {about}": mean_of(rows, x) for x, about in MEANS.items() if x in some}


def main(names: list[str]) -> None:
    warnings.simplefilter("ignore")
    rows = [row for row in kept("one_knob") if row["scene"] in THESE]
    for name in names or THESE:
        new = measured(name, THESE[name]())
        rows = with_scene(rows, new, list(THESE))
        table(new)
        write("one_knob", rows, means=means_of(rows))
        sys.stdout.flush()
    for about, mean in means_of(rows).items():
        print(f"geometric mean of varint's time {about}: {mean:.2f}")
    print(f"promise kept in {sum(row['kept by varint'] for row in rows)} of {len(rows)}")
    save("one_knob", rows, means=means_of(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
