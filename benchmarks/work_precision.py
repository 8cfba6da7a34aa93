"""Run time against error: varint beside heyoka, REBOUND, DOP853 (SciPy's and compiled), CasADi's
CVODES and IDAS.

python3 tasks.py bench benchmarks/work_precision.py [--record] [scene ...]

For every scene each tool is tried over a grid of its options; for each wanted error its cheapest
option that reaches it is then timed again, all tools taking turns in one process, a run that is not
timed before each, and the median counts. varint is timed through `simulate` as a user calls it. A
call costs 0.1 ms whatever the run, so that every scene is also run for so long ("×") that runs take
milliseconds. The summary is of runs that take the best peer 1 ms or more; of the shorter ones
apart. Errors are those of the end: the largest component of q, against the closed form or a run of
order 32, and the energy, relative to the largest kinetic energy |p·v|/2 at both ends and the
energy. Set-up (building, compiling) is reported beside the run times. Results:
benchmarks/results/work_precision.json and .png; of chosen scenes out/ in their place, or with
--record their rows in the record, each with when it was measured.
"""

import json
import os
import re
import sys
import tempfile
from collections import Counter
from itertools import product
from pathlib import Path
from time import perf_counter

import casadi as ca
import matplotlib.pyplot
import numpy as np
from tools import fronts, own, peers
from tools.peers import Setting
from tools.record import measured_with
from tools.reference import reference
from tools.scenes import SCENES, Scene

import varint as vi
from varint.codegen import cache
from varint.codegen.mechanics import velocity
from varint.discrete.lagrangian import point_function
from varint.errors import VarintError
from varint.numerics.arrays import call

matplotlib.use("Agg")

MEASURES = ("q", "energy")
WANTED = (1e-3, 1e-6, 1e-9, 1e-12)
TURNS = 9
# seconds of the best peer: a run of milliseconds, in which a call's cost does not count
LONG = 1e-3
LONGEST = 0.2  # seconds of a run that is worth timing
PATIENCE = 1
RESULTS = Path(__file__).parent / "results"
PART = Path("out")  # for some scenes only
GENERAL = (
    "heyoka",
    "compiled DOP853",
    "REBOUND IAS15",
    "SciPy DOP853",
    "CasADi cvodes",
    "CasADi idas",
)


def settings(scene: Scene):
    """All settings of all tools."""
    model = scene.model
    system, q0, v0 = model.system, model.q0, model.v0
    p0 = call(point_function(system), q0, v0, np.zeros(0), np.zeros(1), system.default_vector)[1]
    start = system, q0, v0, p0, scene.duration
    yield from own.settings(scene)
    if not scene.slow:
        yield from peers.heyoka(*start)
    yield from peers.compiled_dop853(*start)
    if not scene.long:
        yield from peers.scipy_dop853(*start)
    if not (scene.slow or scene.long):
        yield from peers.casadi_integrators(*start)
    if scene.bodies:
        yield from peers.rebound_bodies(*scene.bodies, scene.duration, q0, v0)


def energy_error(scene: Scene):
    """(state at the end, is it of q and p?) → relative error of the energy."""
    system, c = scene.model.system, scene.model.system.default_vector
    p = ca.SX.sym("p", system.q.numel())
    q, v, constants = system.q, system.v, system.c
    size = ca.fabs(ca.dot(system.momentum, v)) / 2
    speeds = ca.Function("energy", [q, v, constants], [system.energy, size])
    momenta = ca.Function("energy", [q, p, constants], speeds(q, velocity(system, p), constants))
    first, moving = map(float, speeds(scene.model.q0, scene.model.v0, c))

    def relative(end: np.ndarray, of_momenta: bool) -> float:
        last, still = map(float, (momenta if of_momenta else speeds)(*np.split(end, 2), c))
        return abs(last - first) / max(abs(first), moving, still)

    return relative


def tried(scene: Scene, exact):
    """(error, error of the energy, seconds, setting) of every setting that works; one quick look
    at the time.
    """
    # settings of a family that took long; steps too large for it may do so, too
    slow: Counter[str] = Counter()
    impossible = set()
    off = energy_error(scene)
    for setting in settings(scene):
        family = setting.tool + setting.about.split(",")[0]
        steps = re.split(", (?:iteration_)?tol", setting.about)[0]
        if slow[family] > PATIENCE or steps in impossible:
            continue
        try:
            setting.run()
            seconds = np.inf
            for _ in range(3):
                began = perf_counter()
                found = setting.run()
                seconds = min(seconds, perf_counter() - began)
                if seconds > 0.05:
                    break
        except (VarintError, RuntimeError):
            impossible.add(steps)
            continue
        if seconds > LONGEST:
            slow[family] += 1
            impossible.add(steps)
        error = float(np.abs(found[: len(exact)] - exact).max())
        if np.isfinite(error):
            yield error, off(found, setting.momenta), seconds, setting


def measured(scene: Scene, exact):
    """For every wanted error and tool the median time of its cheapest setting, taken in turns."""
    everything = list(tried(scene, exact))
    tools = sorted({setting.tool for *_, setting in everything})
    chosen = {}
    for measure in range(2):
        for wanted in WANTED:
            for tool in tools:
                good = [x for x in everything if x[3].tool == tool and x[measure] <= wanted]
                if good:
                    chosen[MEASURES[measure], wanted, tool] = min(good, key=lambda x: x[2])
    times: dict[Setting, list[float]] = {setting: [] for *_, setting in chosen.values()}
    for _ in range(TURNS):
        for setting, known in times.items():
            if known and known[0] > 0.1:
                continue
            setting.run()  # the other tools have been here since
            began = perf_counter()
            setting.run()
            known.append(perf_counter() - began)
    rows = [
        {
            "measure": measure,
            "wanted": wanted,
            "tool": tool,
            "seconds": float(np.median(times[setting])),
            "error": error,
            "energy error": energy,
            "setting": setting.about,
            "setup": setting.setup,
        }
        for (measure, wanted, tool), (error, energy, _, setting) in chosen.items()
    ]
    cloud = [
        {"tool": s.tool, "error": e, "energy error": d, "seconds": t, "setting": s.about}
        for e, d, t, s in everything
        if not any(o.tool == s.tool and f < e and c < d and u < t for f, c, u, o in everything)
    ]
    return rows, cloud


def setup_of_varint(scene: Scene):
    """Seconds of the first run: nothing compiled, and compiled earlier."""
    found = {}
    kept = os.environ.get("XDG_CACHE_HOME")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for what in ("cold", "cached"):
            cache.library.cache_clear()
            model = scene.model
            fresh = vi.System(
                model.system.q,
                model.system.v,
                model.system.lagrangian,
                params=model.system.params,
                t=model.system.t,
            )
            began = perf_counter()
            vi.simulate(
                fresh,
                vi.gauss(8),
                q0=model.q0,
                v0=model.v0,
                h=1e-3,
                steps=1,
                backend="compiled",
                progress=False,
            )
            found[what] = perf_counter() - began
    if kept is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = kept
    return found


def main(arguments):
    names = [name for name in arguments if name != "--record"]
    merged = bool(names) and "--record" in arguments
    results = {"measured_with": measured_with(), "turns": TURNS, "scenes": {}}
    ratios = []
    if merged:
        results = json.loads((RESULTS / "work_precision.json").read_text())
        ratios = [row for row in results["ratios"] if row["scene"] not in names]
    for name in names or SCENES:
        scene = SCENES[name]()
        exact, apart = reference(scene)
        rows, cloud = measured(scene, exact)
        setup = setup_of_varint(scene)
        by_measure = {
            measure: [row for row in rows if row["measure"] == measure] for measure in MEASURES
        }
        results["scenes"][name] = {
            "apart": apart,
            "rows": by_measure["q"],
            "energy rows": by_measure["energy"],
            "all": cloud,
            "setup": setup,
        }
        if merged:
            results["scenes"][name]["measured_with"] = measured_with()
        print(f"\n{name}   reference and heyoka's tightest run: {apart:.1e} apart", end="")
        print(
            f"   varint's first run: {setup['cold']:.2f} s, compiled earlier {setup['cached']:.2f} "
            "s"
        )
        for measure, wanted in product(MEASURES, WANTED):
            here = {row["tool"]: row for row in by_measure[measure] if row["wanted"] == wanted}
            ratio, peer = told(measure, wanted, here)
            if ratio:
                row = {
                    "ratio": ratio,
                    "scene": name,
                    "wanted": wanted,
                    "measure": measure,
                    "long": peer >= LONG,
                }
                ratios.append(row)
        sys.stdout.flush()
        keep(results, ratios, RESULTS if merged or not names else PART)
    for about, mean in results["geometric means"].items():
        print(f"geometric mean, {about}: {mean:.3f}")
    print("above 2/3:")
    for row in sorted(ratios, key=lambda row: -row["ratio"]):
        if row["ratio"] > 2 / 3:
            print("  {ratio:.2f}  {scene}, {measure} at {wanted:g}".format(**row))


def told(measure: str, wanted: float, here: dict) -> tuple[float, float]:
    """Print who needs how long; varint's time over that of the best general-purpose peer (0:
    none), and the latter.
    """
    for tool, row in sorted(here.items(), key=lambda x: x[1]["seconds"]):
        about = f"{row['setting']}; error {row['error']:.0e}, energy {row['energy error']:.0e}"
        print(
            f"  {measure} {wanted:g}  {tool:20} {1e6 * row['seconds']:12.1f} µs   {about}; "
            f"{row['setup']:.2f} s set-up"
        )
    rivals = [row["seconds"] for tool, row in here.items() if tool in GENERAL]
    if "varint" not in here or not rivals:
        print(
            f"  {measure} {wanted:g}  "
            + ("no general-purpose peer gets there" if "varint" in here else "not reached")
        )
        return 0.0, 0.0
    ratio = here["varint"]["seconds"] / min(rivals)
    print(
        f"  {measure} {wanted:g}  varint takes {ratio:.2f} of the best general-purpose peer's time"
    )
    return ratio, min(rivals)


def keep(results, ratios, folder: Path):
    """Write what is known so far."""
    # "×" comes after the name alone
    longest = {name.split(" ×")[0]: name for name in sorted(results["scenes"])}
    of_q = [r for r in ratios if r["measure"] == "q"]
    groups = {
        "error of q, runs of milliseconds, every scene at its longest": [
            r["ratio"] for r in of_q if r["long"] and r["scene"] in longest.values()
        ],
        "error of q, runs of milliseconds": [r["ratio"] for r in of_q if r["long"]],
        "error of q, short runs": [r["ratio"] for r in of_q if not r["long"]],
        "error of the energy, runs of milliseconds": [
            r["ratio"] for r in ratios if r["measure"] == "energy" and r["long"]
        ],
    }
    results["geometric means"] = {
        k: float(np.exp(np.mean(np.log(r)))) for k, r in groups.items() if r
    }
    results["ratios"] = ratios
    folder.mkdir(exist_ok=True)
    (folder / "work_precision.json").write_text(json.dumps(results, indent=1, ensure_ascii=False))
    fronts.figure(results).savefig(folder / "work_precision.png", dpi=110)
    matplotlib.pyplot.close("all")


if __name__ == "__main__":
    main(sys.argv[1:])
