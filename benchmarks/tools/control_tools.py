"""Ways to an optimal control at equal error of the cost: from nothing, and again.

A part of benchmarks/optimal_control.py; alone: python benchmarks/optimal_control.py tool … Results:
benchmarks/results/optimal_control.json and .png, all settings;
benchmarks/results/optimal_control_tools.json, the quickest for a wanted error.

Kelly's cart-pole by varint, by collocation written by hand in CasADi and by toolkits, each as its
manual has it (benchmarks/tools/control_peers.py): every setting runs in processes of its own, and
all settings take turns; times are processor times, compilers' among them. "Import" is the tool's;
"first" builds and solves; "again" is the median of three further ends, from the last solution. For
each wanted error of the cost the quickest first solve among a tool's settings counts, and the
quickest further one. With `--resume` settings that the record already holds are left as they are;
names of tools measure these anew. Tools that are not installed are left out with a message: pip
install rockit-meco mpopt dymos opty cyipopt, the last one built against Ipopt's and LAPACK's
headers (coinor-libipopt-dev, liblapack-dev).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import matplotlib.pyplot as plt

from tools.record import FOLDER, kept, save, table

WANTED = (1e-3, 1e-6, 1e-9)
SETTINGS: dict[str, list[tuple[str, int]]] = {
    "varint": [
        *(("gauss(1)", n) for n in (40, 160)),
        *(("gauss(2)", n) for n in (20, 40, 80)),
        *(("gauss(3)", n) for n in (10, 20, 40)),
        *(("gauss(4)", n) for n in (10, 16, 24, 32, 40)),
        *(("gauss(5)", n) for n in (16, 20, 24, 32)),
    ],
    "Hermite–Simpson": [("-", n) for n in (20, 30, 44, 80, 160, 240, 320)],
    "trapezoidal": [("-", n) for n in (20, 40, 80, 160)],
    "Legendre": [("2", 40), ("2", 80), ("3", 20), ("3", 40), ("4", 16), ("4", 40)],
    "mpopt": [("5", 20), ("8", 8), ("12", 8), ("15", 10)],
    "rockit": [("linear", 20), ("linear", 40), ("linear", 120), ("constant", 80)],
    "dymos": [("3", 20), ("7", 8)],
    "opty": [("midpoint", 80), ("midpoint", 320)],
}
NEEDS = {"rockit": "rockit-meco", "mpopt": "mpopt", "dymos": "dymos", "opty": "opty"}
# seconds: what takes longer runs in the first turn alone, or is given up
TURNS, QUICK, LIMIT = 5, 4.0, 600.0
NAMES = ("import", "first", "again")
WORKER = Path(__file__).with_name("control_peers.py")


def one_run(tool: str, setting: str, steps: int, cache: str) -> dict[str, float] | None:
    """What one process measures; None where it takes too long or fails."""
    # everything installed comes compiled to byte code; so does a checkout here
    environment = os.environ | {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, str(WORKER), tool, setting, str(steps)]
    try:
        run = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            env=environment | {"OMP_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired:
        print(f"{tool} {setting} × {steps}: more than {LIMIT:.0f} s")
        return None
    if run.returncode:
        said = run.stderr.strip() or f"ended by {run.returncode}"
        print(f"{tool} {setting} × {steps}: {said.splitlines()[-1]}")
        return None
    return json.loads(run.stdout.splitlines()[-1])


def installed(tools: list[str]) -> dict[str, str]:
    """The version of every tool that is a package of its own; what is missing is said."""
    found = {}
    for tool in tools:
        if tool in NEEDS and find_spec(tool) is None:
            print(f"{tool} is not installed; left out")
        elif tool in NEEDS:
            found[tool] = version(NEEDS[tool])
    return found


def measured(tools: list[str], known: list[dict], versions: dict[str, str]) -> list[dict]:
    """Rows of these tools besides those known, settings in turn; written as they come."""
    done = {(row["tool"], row["setting"], row["steps"]) for row in known}
    present = [tool for tool in tools if tool in versions or tool not in NEEDS]
    left = [(tool, *x) for tool in present for x in SETTINGS[tool] if (tool, *x) not in done]
    runs: dict[tuple[str, str, int], list[dict]] = {}
    rows = known
    with tempfile.TemporaryDirectory() as cache:
        for turn in range(TURNS + 1):  # the first one fills the caches
            for key in list(left):
                one = one_run(*key, cache)
                slow = one is not None and one["import s"] + one["first s"] > QUICK
                if turn or slow:
                    runs.setdefault(key, []).extend([one] if one else [])
                if one is None or slow:
                    left.remove(key)
                    rows = _recorded(known, runs, versions)
            rows = _recorded(known, runs, versions)
    return rows


def _recorded(
    known: list[dict], runs: dict[tuple[str, str, int], list[dict]], versions: dict[str, str]
) -> list[dict]:
    """All rows, written down: medians of what ran so far."""
    rows = list(known)
    for (tool, setting, steps), some in runs.items():
        if some:
            row = {"tool": tool, "setting": setting, "steps": steps, "error": some[0]["error"]}
            row |= {f"{x} ms": 1e3 * median(run[f"{x} s"] for run in some) for x in NAMES}
            rows.append(row)
    rows.sort(key=lambda row: (list(SETTINGS).index(row["tool"]), row["setting"], row["steps"]))
    save("optimal_control", rows, versions)
    return rows


def quickest(rows: list[dict]) -> list[dict]:
    """The quickest first and further solves of every tool that are as good as wanted."""
    found = []
    for wanted in WANTED:
        some = []
        for tool in SETTINGS:
            fit = [row for row in rows if row["tool"] == tool and row["error"] <= wanted]
            if not fit:
                continue
            best = min(fit, key=lambda row: row["first ms"])
            setting = f"{best['setting']} × {best['steps']}".removeprefix("- × ")
            one = {"wanted error": f"{wanted:.0e}", "tool": tool, "setting": setting}
            one |= {name: best[name] for name in ("error", "import ms", "first ms")}
            one["both ms"] = best["import ms"] + best["first ms"]
            some.append(one | {"again ms": min(row["again ms"] for row in fit)})
        found += sorted(some, key=lambda row: row["first ms"])
    return found


def draw(rows: list[dict]) -> None:
    """Error of the cost against the time of the first and of a further solve."""
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.8), sharey=True, layout="constrained")
    curves = list(dict.fromkeys((row["tool"], row["setting"]) for row in rows))
    colours = plt.get_cmap("tab20")
    for axes, name, what in zip(panels, NAMES[1:], ("first", "further"), strict=True):
        for i, curve in enumerate(curves):
            mine = [row for row in rows if (row["tool"], row["setting"]) == curve]
            axes.loglog(
                [row[f"{name} ms"] for row in mine],
                [row["error"] for row in mine],
                "o-" if curve[0] == "varint" else "s--",
                ms=4,
                label=" ".join(curve).removesuffix(" -"),
                color=colours(i % 20),
            )
        axes.set(xlabel=f"{what} solve, ms of the processor")
        axes.grid(alpha=0.3)
    panels[0].set(ylabel="relative error of the cost")
    figure.suptitle("Cart-pole swing-up: error of the cost against time")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right", fontsize="small")
    figure.savefig(FOLDER / "optimal_control.png", dpi=120)
    plt.close(figure)


def main(words: list[str]) -> None:
    """These tools, or all; with `--resume` those settings that are not in the record yet."""
    tools = [word for word in words if word in SETTINGS] or list(SETTINGS)
    anew = [] if "--resume" in words else tools
    versions = installed(list(SETTINGS))
    known = [row for row in kept("optimal_control") if row["tool"] not in anew]
    rows = measured(tools, known, versions)
    table(rows)
    best = quickest(rows)
    save("optimal_control_tools", best, versions)
    table(best)
    draw(rows)
