"""Run time against trajectory error: varint beside heyoka, REBOUND, DOP853 (SciPy's and compiled) and CasADi's CVODES.

python3 tasks.py bench benchmarks/work_precision.py [scene ...]

For every scene each tool is tried over a grid of its options; for each wanted error its cheapest option that reaches it
is then timed again, all tools taking turns in one process, and the median counts. varint is timed through `simulate`,
whose call costs a tenth of a millisecond whatever the run: every scene comes with its usual duration, and long enough
that this does not show.
Errors are the largest component of q at the end, measured against the closed form or a run of order 20. Set-up
(building, compiling) is reported beside the run times. Results: benchmarks/results/work_precision.json and .png.
"""

import json
import os
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import fronts
import matplotlib.pyplot
import numpy as np
import peers
from heyoka_peer import taylor
from peers import Setting
from record import measured_with
from scenes import SCENES, Scene

import varint as vi
from varint.arrays import call
from varint.compiled import cache
from varint.discrete import point_function
from varint.errors import VarintError

matplotlib.use("Agg")

WANTED = (1e-3, 1e-6, 1e-9, 1e-12)
RULES = (*map(vi.gauss, (6, 8, 10)), *map(vi.composition, ("blanes-moan4", "blanes-moan6", "kahan-li8")))
FINER = {"composition": (8, 16, 32, 64, 128)}
GRID = 1.15 ** np.arange(-6, 17)
TURNS = 9
LONGEST = 0.5  # seconds of a run that is worth timing
RESULTS = Path(__file__).parent / "results"
GENERAL = ("heyoka", "compiled DOP853", "REBOUND IAS15", "SciPy DOP853", "CasADi cvodes", "CasADi idas")


def varint_settings(scene: Scene):
    """Rules, steps and stopping levels of `simulate`; with a time scale where the scene has one."""
    model = scene.model
    start = {"q0": model.q0, "v0": model.v0, "backend": "compiled", "progress": False}
    for rule in RULES:
        explicit = not rule.points
        if explicit and not model.system.structure.explicit:
            continue
        grid = 2.0 ** np.arange(1, 9) if explicit else GRID * 8 / len(rule.nodes)
        for steps in np.unique(np.round(scene.steps * grid).astype(int)):
            for tol in (None,) if explicit else (None, 1e-10, 1e-7, 1e-4):
                if explicit and steps > 40 * scene.steps and rule.order > 4:
                    continue

                def run(rule=rule, steps=int(steps), tol=tol):
                    motion = vi.simulate(
                        model.system, rule, duration=scene.duration, steps=steps, save_every=steps, tol=tol, **start
                    )
                    return motion.q[-1]

                yield Setting("varint", f"{rule}, {steps} steps, tol={tol}", run)
    if scene.scale is not None:
        around = 0.7 if model.name == "kepler" else 1.0
        for stages in (8, 10):
            for per_orbit in (8, 9, 10, 12, 14, 16, 20):
                rule, h = vi.gauss(stages), 2 * np.pi / per_orbit / around
                for tol in (None, 1e-10, 1e-7):

                    def run(rule=rule, h=h, tol=tol):
                        motion = vi.simulate(
                            model.system, rule, h=h, duration=scene.duration, time_scale=scene.scale, save_every=200,
                            tol=tol, **start,
                        )  # fmt: skip
                        return motion.q[-1]

                    yield Setting("varint", f"gauss({stages}), time_scale, h=2π/{per_orbit}/{around}, tol={tol}", run)


def settings(scene: Scene):
    """All settings of all tools."""
    model = scene.model
    system, q0, v0 = model.system, model.q0, model.v0
    p0 = call(point_function(system), q0, v0, np.zeros(0), np.zeros(1), system.default_vector)[1]
    start = system, q0, v0, p0, scene.duration
    yield from varint_settings(scene)
    if not scene.slow:
        yield from peers.heyoka(*start)
    yield from peers.compiled_dop853(*start)
    if not scene.long:
        yield from peers.scipy_dop853(*start)
    if not (scene.slow or scene.long):
        yield from peers.casadi_integrators(*start)
    if scene.bodies:
        yield from peers.rebound_bodies(*scene.bodies, scene.duration, q0, v0)


def reference(scene: Scene):
    """q at the end in closed form, or by order 20 with many steps; and how far heyoka's tightest run is from it."""
    model = scene.model
    if model.exact:
        exact = model.exact(scene.duration)[0][0]
    else:
        exact = vi.simulate(
            model.system, vi.gauss(10), q0=model.q0, v0=model.v0, duration=scene.duration, steps=4 * scene.steps,
            save_every=4 * scene.steps, backend="compiled", progress=False,
        ).q[-1]  # fmt: skip
    if scene.slow:
        return exact, float("nan")
    other = taylor(model.system, "velocities", 1e-18)
    other.state[:] = np.concatenate([model.q0, model.v0])
    other.propagate_until(scene.duration)
    return exact, float(np.abs(other.state[: len(exact)] - exact).max())


def tried(scene: Scene, exact):
    """(error, seconds, setting) of every setting that works; one quick look at the time."""
    patience: dict[str, float] = {}
    for setting in settings(scene):
        family = setting.tool + setting.about.split(",")[0]
        if patience.get(family, 0) > LONGEST:
            continue
        try:
            setting.run()
            seconds = np.inf
            for _ in range(3):
                began = perf_counter()
                found = setting.run()
                seconds = min(seconds, perf_counter() - began)
                if seconds > 0.1:
                    break
        except (VarintError, RuntimeError):
            continue
        patience[family] = seconds
        error = float(np.abs(found - exact).max())
        if np.isfinite(error):
            yield error, seconds, setting


def measured(scene: Scene, exact):
    """For every wanted error and tool the median time of its cheapest setting, taken in turns."""
    everything = list(tried(scene, exact))
    tools = sorted({setting.tool for _, _, setting in everything})
    chosen = {}
    for wanted in WANTED:
        for tool in tools:
            good = [x for x in everything if x[2].tool == tool and x[0] <= wanted]
            if good:
                chosen[wanted, tool] = min(good, key=lambda x: x[1])
    times: dict[tuple, list[float]] = {key: [] for key in chosen}
    for _ in range(TURNS):
        for key, (_, seconds, setting) in chosen.items():
            if seconds > 0.2 and times[key]:
                continue
            began = perf_counter()
            setting.run()
            times[key].append(perf_counter() - began)
    rows = [
        {
            "wanted": wanted, "tool": tool, "seconds": float(np.median(times[wanted, tool])), "error": error,
            "setting": setting.about, "setup": setting.setup,
        }
        for (wanted, tool), (error, _, setting) in chosen.items()
    ]  # fmt: skip
    cloud = [{"tool": s.tool, "error": e, "seconds": t, "setting": s.about} for e, t, s in everything]
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
                model.system.q, model.system.v, model.system.lagrangian, params=model.system.params, t=model.system.t
            )
            began = perf_counter()
            vi.simulate(
                fresh, vi.gauss(8), q0=model.q0, v0=model.v0, h=1e-3, steps=1, backend="compiled", progress=False
            )
            found[what] = perf_counter() - began
    if kept is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = kept
    return found


def main(names):
    results = {"measured_with": measured_with(), "turns": TURNS, "scenes": {}}
    ratios = []
    for name in names or SCENES:
        scene = SCENES[name]()
        exact, apart = reference(scene)
        rows, cloud = measured(scene, exact)
        setup = setup_of_varint(scene)
        results["scenes"][name] = {"apart": apart, "rows": rows, "all": cloud, "setup": setup}
        print(f"\n{name}   reference and heyoka's tightest run: {apart:.1e} apart", end="")
        print(f"   varint's first run: {setup['cold']:.2f} s, compiled earlier {setup['cached']:.2f} s")
        for wanted in WANTED:
            here = {row["tool"]: row for row in rows if row["wanted"] == wanted}
            for tool, row in sorted(here.items(), key=lambda x: x[1]["seconds"]):
                about = f"{row['setting']}; error {row['error']:.0e}; set-up {row['setup']:.2f} s"
                print(f"  {wanted:g}  {tool:16} {1e6 * row['seconds']:12.1f} µs   {about}")
            rivals = [row["seconds"] for tool, row in here.items() if tool in GENERAL]
            if "varint" in here and rivals:
                ratio = here["varint"]["seconds"] / min(rivals)
                ratios.append((ratio, name, wanted))
                print(f"  {wanted:g}  varint takes {ratio:.2f} of the best general-purpose peer's time")
            elif "varint" in here:
                print(f"  {wanted:g}  no general-purpose peer reaches this error")
        sys.stdout.flush()
        keep(results, ratios, names)
    if ratios:
        print(f"\ngeometric mean {results['geometric mean']:.3f}; above 2/3:")
        for ratio, name, wanted in sorted(ratios, reverse=True):
            if ratio > 2 / 3:
                print(f"  {ratio:.2f}  {name} at {wanted:g}")


def keep(results, ratios, names):
    """Write what is known so far."""
    if ratios:
        results["geometric mean"] = float(np.exp(np.mean([np.log(r) for r, _, _ in ratios])))
        results["ratios"] = [{"ratio": r, "scene": s, "wanted": w} for r, s, w in ratios]
    RESULTS.mkdir(exist_ok=True)
    suffix = "".join("_" + name.replace(" ", "-") for name in names)
    (RESULTS / f"work_precision{suffix}.json").write_text(json.dumps(results, indent=1, ensure_ascii=False))
    fronts.figure(results).savefig(RESULTS / f"work_precision{suffix}.png", dpi=110)
    matplotlib.pyplot.close("all")


if __name__ == "__main__":
    main(sys.argv[1:])
