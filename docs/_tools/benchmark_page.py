"""The benchmark page: what `python3 tasks.py bench` left in benchmarks/results, with machine and
date.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from state import write_if_changed

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
RESULTS = BENCHMARKS / "results"
MEASURES = {"q": "error of the coordinates at the end", "energy": "error of the energy"}
LONGEST = 70  # rows: longer tables are measured clouds, which the figure shows
PLAIN = (1e-3, 1e5)  # numbers between these are written without a power of ten
sys.path.insert(0, str(BENCHMARKS))


@dataclass(frozen=True)
class Benchmark:
    """What a result file is about."""

    title: str
    words: str


KNOWN = {
    "work_precision": Benchmark(
        "Run time against error",
        "Each tool is tried over a grid of its options; the cheapest setting that reaches an "
        "error is timed again, all tools taking turns in one process. Set-up (building, "
        "compiling) is not in the times.",
    ),
    "optimal_control": Benchmark(
        "Optimal control",
        "Kelly's cart-pole: error of the cost against the processor time of the first and of a "
        "further solve, beside collocations written by hand in CasADi and the toolkits that pip "
        "installs, every setting in processes of its own (compilers' time included).",
    ),
    "optimal_control_tools": Benchmark(
        "Ways to an optimal control at equal error",
        "Of the same runs, for each wanted error of the cost, the quickest first solve among the "
        "settings of each tool, and the quickest further one: import, first solve (building "
        "counted, byte code and kernels cached), both together, and the median of three further "
        "ends, from the last solution, in processor time; a tool that is missing reached the error "
        "with none of its settings in ten minutes.",
    ),
    "gradients": Benchmark(
        "Gradients of runs",
        "The gradient of |q|² at the end of five seconds of a double pendulum, by start and "
        "parameters: `gradient` of a run, CasADi's derivatives of the same steps unrolled and of "
        "its integrator cvodes, and diffrax's of its own steps, all taking turns, compiling not "
        "counted. Below, the processor time of a gradient alone over that of its run.",
    ),
    "control_starts": Benchmark(
        "Starts of control problems",
        "Problems from ten random paths each, the same for varint and for Hermite–Simpson "
        "collocation written by hand: how many are solved from the path (by varint also by a rough "
        "solution near it), how many of these are true, their controls leading along their path "
        "within 1 % of its range when replayed finely, and how many varint solved only by leaving "
        "the path for a default start. Iterations are medians, of all attempts together.",
    ),
    "optimal_control_again": Benchmark(
        "Optimal control solved again",
        "The second solve of seven problems, with another end, beside Hermite–Simpson collocation "
        'written by hand in CasADi\'s Opti, which starts from its last solution ("warm": and its '
        "multipliers). CPU times, the methods taking turns; the error is that of the cost, relative. "
        '"Refined" are meshes that `refine` made before the first solve.',
    ),
    "optimal_control_assembly": Benchmark(
        "Assembly of large control problems",
        "Cart with 4 links, 2000 steps, 12,015 unknowns: one interval differentiated, interpreted "
        "and compiled (from the cache), beside CasADi's derivatives of a `map` over the "
        "intervals.",
    ),
    "optimal_control_solvers": Benchmark(
        "Solvers of control problems", "Ipopt on the plain program, Fatrop on the chain of stages."
    ),
    "least_action": Benchmark(
        "Paths between fixed end points",
        "`least_action` beside SciPy's `solve_bvp`, from the same straight line.",
    ),
    "ensemble": Benchmark(
        "Ensembles",
        "Ten thousand pendulums in one call of `ensemble`, and in a loop of `simulate`.",
    ),
    "chain_scaling": Benchmark("Length of a chain", "Cost of a step over the number of rods."),
    "machines": Benchmark(
        "Links of a machine",
        "A step of `gauss(2)` of trees and chains of hinges in space, over the number of links. Links "
        "next to the ground and the tips cost less, which ten feel more than a hundred: `a link "
        "more` is what a further one costs, from one size to the next.",
    ),
    "humanoid": Benchmark(
        "A humanoid",
        "A base that floats and turns freely, with forty hinges: set-up and steps, native and "
        "compiled.",
    ),
    "arm": Benchmark(
        "An arm of seven axes",
        "Steps of `gauss(2)` and `gauss(4)` beside MuJoCo's RK4, and the error after a second.",
    ),
    "specialisations": Benchmark(
        "What is skipped",
        "A scene beside the same scene with one property hidden from the plan, so that it runs in "
        "full.",
    ),
    "by_hand": Benchmark(
        "Loops written by hand",
        "Whole calls of `simulate` beside loops of the same methods in C that were written by hand "
        "for the one scene and stop iterating at the same level: processor time of a step, the least "
        "of many turns, ratios of the least and of the medians, and how far the ends differ, relative "
        "to the largest coordinate.",
    ),
    "one_knob": Benchmark(
        "One knob",
        "Every tool with its own tolerance and nothing else: time, and the error at the end "
        "relative to the largest coordinate. Beside them heyoka tuned in hindsight, twice: its "
        "cheapest run whose error is below the wanted one, and its cheapest run whose error is no "
        "larger than varint's, which is often far smaller than was wanted (the most accurate one "
        "where none comes so near). The first two columns are varint's time over that of each.",
    ),
    "scripts": Benchmark(
        "Whole scripts",
        "A process from its start to its end: import, scene, run for a time and a tolerance; with "
        "nothing cached, and with other values of a parameter later.",
    ),
    "default_call": Benchmark(
        "The default call",
        "The first call in a process that has built nothing, as it comes, over the faster backend "
        "in hindsight, compiling counted: 1 is perfect foresight.",
    ),
    "machines_beside_mujoco": Benchmark(
        "Machines beside MuJoCo",
        "MuJoCo's files stepped by MuJoCo and by varint: energy drift and error at an equal step, then "
        "the cheapest run of each for a wanted error; `ratio` is MuJoCo's time over varint's. `gap`: "
        "how near MuJoCo's RK4 comes to the reference at its smallest step.",
    ),
    "startup": Benchmark(
        "Start-up", "What comes before the first step, and what a call costs besides its steps."
    ),
    "chaos": Benchmark(
        "Displacements beside a motion",
        "A run with MEGNO beside REBOUND's, and beside heyoka's variational equations, of one "
        "displacement and of all: the cheapest setting that reaches an error of the end, of the "
        "motion and the displacement, best of fifteen turns.",
    ),
    "long_run": Benchmark(
        "Long runs",
        "Round-off and drift over very many steps. Drift is the relative change of windowed means "
        "over the run, beside its standard error.",
    ),
    "stress": Benchmark("Stress", "Scenes that break integrators, and what of each survives."),
}
HEAD = """# Benchmarks

Speed is a ratio, measured side by side on one machine, at equal error. `python3 tasks.py bench` measures again and
writes `benchmarks/results/*.json`, from which this page is made. Your own scene: `vi.diagnostics.work_precision`, or
`python -m varint bench pendulum`.
"""


def write(path: Path, results: Path = RESULTS) -> None:
    """One section per result file, known ones first in reading order; what was not measured is
    said.
    """
    found = {file.stem: file for file in sorted(results.glob("*.json"))}
    names = [name for name in KNOWN if name in found] + [
        name for name in found if name not in KNOWN
    ]
    (path.parent / "_build").mkdir(exist_ok=True, parents=True)
    parts = [HEAD, *(_file(found[name], path.parent) for name in names)]
    missing = [f"`{name}`" for name in KNOWN if name not in found]
    if missing:
        parts.append(f"## Not measured for this version\n\n{', '.join(missing)}.\n")
    write_if_changed(path, "\n".join(parts))


def _file(file: Path, source: Path) -> str:
    result = json.loads(file.read_text(encoding="utf-8"))
    about = KNOWN.get(file.stem, Benchmark(_words(file.stem).capitalize(), ""))
    lines = [
        f"## {about.title}\n",
        about.words,
        f"\n{_measured(result)} (`benchmarks/results/{file.name}`)\n",
    ]
    if "scenes" in result:
        return "\n".join([*lines, *_scenes(result, file.stem, source)])
    if file.with_suffix(".png").exists():
        shutil.copy(file.with_suffix(".png"), source / "_build" / f"{file.stem}.png")
        lines += _picture(file.stem, f"{about.title}: the numbers of the table as a figure")
    return "\n".join([*lines, *_means(result), *_table(result["rows"])])


def _measured(result: dict[str, Any]) -> str:
    """When, on what and with which versions."""
    about = result.get("measured_with", {})
    cores = f"{about['cores']} cores" if "cores" in about else None
    place = [
        about.get("processor"),
        about.get("machine"),
        cores,
        about.get("date", "date not recorded"),
    ]
    rest = set(about) - {"processor", "machine", "cores", "date"}
    versions = [f"{name} {about[name]}" for name in about if name in rest]
    return f"Measured on {', '.join(str(x) for x in [*place, *versions] if x)}."


def _when(measured: dict[str, Any]) -> str:
    """When a scene was measured, where that was not with the others."""
    about = measured.get("measured_with")
    return f", measured {about['date']}, varint {about['varint']}" if about else ""


def _scenes(result: dict[str, Any], name: str, source: Path) -> list[str]:
    """Work and precision of several scenes: the figure, the ratios, and every scene's times."""
    import matplotlib.pyplot as plt
    from tools import fronts

    scenes = result["scenes"]
    fronts.figure(result).savefig(source / "_build" / f"{name}.png", dpi=110)
    plt.close("all")
    words = (
        "Run time over error of varint and other tools, one panel a scene: of each tool the "
        "cheapest settings"
    )
    lines = _picture(name, words)
    for measure, what in MEASURES.items():
        rows = [row for row in result.get("ratios", []) if row.get("measure", "q") == measure]
        if rows:
            ratios = {(row["scene"], row["wanted"]): row["ratio"] for row in rows}
            wanted = sorted({error for _, error in ratios}, reverse=True)
            lines.append(
                f"\nvarint's run time over that of the best general-purpose tool at equal {what}:\n"
            )
            lines += _table(
                [
                    {"scene": s} | {f"{e:.0e}": ratios.get((s, e), "–") for e in wanted}
                    for s in scenes
                ]
            )
    lines += _means(result)
    lines.append("\nTimes of every tool in ms:\n")
    for scene, measured in scenes.items():
        lines += [
            f"<details><summary>{scene}{_when(measured)}</summary>\n",
            *_table(_by_tool(measured["rows"])),
            "\n</details>\n",
        ]
    return lines


def _means(result: dict[str, Any]) -> list[str]:
    """Geometric means of the ratios, if the record has some."""
    means = result.get("geometric means", {})
    if not means:
        return []
    words = "Below 1 varint is faster. A dash: one of the two does not reach the error. Geometric "
    return [f"{words}means:\n", *(f"- {about}: {mean:.2f}" for about, mean in means.items()), ""]


def _by_tool(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Milliseconds, a line a wanted error, a column a tool."""
    tools = sorted({row["tool"] for row in rows}, key=lambda tool: (tool != "varint", tool))
    times = {(row["wanted"], row["tool"]): 1e3 * row["seconds"] for row in rows}
    wanted = sorted({row["wanted"] for row in rows}, reverse=True)
    return [
        {"error": f"{e:.0e}"} | {tool: times.get((e, tool), "–") for tool in tools} for e in wanted
    ]


def _picture(name: str, words: str) -> list[str]:
    return [f"```{{figure}} _build/{name}.png\n:alt: {words}\n:class: gallery\n\n{words}.\n```\n"]


def _table(rows: list[dict[str, Any]]) -> list[str]:
    """Records as a table; a cloud of measurements is left to the figure."""
    if not rows or len(rows) > LONGEST:
        return []
    columns = list(
        dict.fromkeys(
            key for row in rows for key, value in row.items() if not isinstance(value, (dict, list))
        )
    )
    head = ["| " + " | ".join(_words(c) for c in columns) + " |", "|" + "---|" * len(columns)]
    return (
        head
        + ["| " + " | ".join(_cell(row.get(c, "–")) for c in columns) + " |" for row in rows]
        + [""]
    )


def _words(name: str) -> str:
    return str(name).replace("_", " ")


def _cell(value: Any) -> str:
    """Numbers with three digits; a minus sign, for browsers break lines at hyphens."""
    if isinstance(value, bool) or value is None:
        return "–" if value is None else str(value)
    if isinstance(value, int):
        return f"{value:,}"
    if not isinstance(value, float):
        return str(value).replace("|", "\\|").replace("\n", " ")
    if value == 0 or PLAIN[0] <= abs(value) < PLAIN[1]:
        text = f"{float(f'{value:.3g}'):.10g}"
    else:
        mantissa, _, power = f"{value:.1e}".partition("e")
        text = f"{mantissa}e{int(power)}"
    return text.replace("-", "−")
