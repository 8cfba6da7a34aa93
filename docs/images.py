"""Draw the pictures of the README and write its table of run times: `python docs/images.py [name
...]`.

The table and the picture `work_precision` come from the numbers that `python3 tasks.py bench`
stored.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import varint as vi
from varint.drawing.style import COLOURS

IMAGES = Path(__file__).resolve().parent / "images"
BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
SHOWN = {
    "kepler 0.6 ×10": "Kepler, e = 0.6, 1,000 orbits",
    "double pendulum ×100": "double pendulum, 1,000 s",
    "solar system ×10": "outer Solar System, 2 million days",
}
WANTED = 1e-9  # error of the table
BETWEEN = re.compile(r"(<!-- measured -->\n).*?(\n<!-- end of measured -->)", re.S)
BLUE, RED = COLOURS[:2]


def pendulum() -> Figure:
    """The README's six lines."""
    q, v = vi.coordinates("theta")
    scene = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    return vi.simulate(scene, q0=1.0, v0=0.0, duration=10.0).plot()


def swing_up() -> Figure:
    """A cart swings its pole up in two seconds with least ∫ u² dt (Kelly 2017)."""
    (motion,) = vi.models.swing_up_cart_pole().solve()
    c, q = motion.system.params, motion.system.q
    bob = motion.value(ca.vertcat(q[0] + c.length * ca.sin(q[1]), -c.length * ca.cos(q[1])))
    figure, (scene, force) = plt.subplots(
        1, 2, figsize=(11, 3.4), layout="constrained", width_ratios=[3, 2]
    )
    for k in range(0, len(motion), 2):
        shade = plt.cm.viridis(k / len(motion))
        scene.plot([motion.q[k, 0], bob[k, 0]], [0, bob[k, 1]], "-o", ms=3, lw=1.2, color=shade)
    scene.set(
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
        title="Swing-up, every 0.1 s from dark to light",
    )
    times = np.linspace(0, motion.t[-1], 400)
    force.plot(times, [motion.u_at(t)[0] for t in times], color=RED)
    force.set(
        xlabel="time in s", ylabel="force in N", title=f"The push, ∫ u² dt = {motion.cost:.8f}"
    )
    force.grid(alpha=0.3)
    return figure


def ladder() -> Figure:
    """Reactions of wall and floor on a falling ladder, and where the wall lets go."""
    model = vi.models.falling_ladder()
    motion = vi.simulate(model.system, **model.start)
    leaves, lies = (event.time for event in motion.events)
    figure, (scene, force) = plt.subplots(
        1, 2, figsize=(11, 3.4), layout="constrained", width_ratios=[2, 3]
    )
    ends = motion.at(np.append(np.linspace(0, lies, 13)[:-1], lies - 1e-9))
    for x, y, theta, t in np.column_stack([ends.q, ends.t]):
        arm = np.array([np.cos(theta), -np.sin(theta)])  # half of the ladder, whose length is 2
        scene.plot(
            [x - arm[0], x + arm[0]],
            [y - arm[1], y + arm[1]],
            color=BLUE if t < leaves else RED,
            lw=1,
        )
    scene.set(
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
        title="On the wall (blue), off the wall (red)",
    )
    during = motion.t < lies - 1e-9
    for i, (name, colour) in enumerate((("wall", BLUE), ("floor", RED))):
        force.plot(motion.t[during], motion.multipliers[during, i], color=colour, label=name)
    force.axvline(leaves, color="0.4", ls=":", label=f"the wall lets go, t = {leaves:.6f} s")
    force.set(xlabel="time in s", ylabel="reaction in N", title="Multipliers are reactions")
    force.legend(fontsize="small")
    force.grid(alpha=0.3)
    return figure


def measured(result: dict) -> str:
    """Run times of all tools over varint's at equal error, as a table, with date and processor."""
    times = {
        words: {
            row["tool"]: row["seconds"]
            for row in result["scenes"][name]["rows"]
            if row["wanted"] == WANTED
        }
        for name, words in SHOWN.items()
        if name in result["scenes"]
    }
    times = {words: row for words, row in times.items() if "varint" in row}
    others = sorted({tool for row in times.values() for tool in row} - {"varint"})
    lines = [
        f"| run time for an error of {WANTED:g}, varint = 1 | {' | '.join(times)} |".replace(
            "e-0", "e-"
        ),
        "|---|" + "---|" * len(times),
        "| varint | "
        + " | ".join(f"{1e3 * row['varint']:.2g} ms" for row in times.values())
        + " |",
    ]
    for tool in others:
        ratios = [
            float(f"{row[tool] / row['varint']:.2g}") if tool in row else None
            for row in times.values()
        ]
        cells = ["–" if ratio is None else f"{ratio:g}" for ratio in ratios]
        lines.append(f"| {tool} | {' | '.join(cells)} |")
    about = result["measured_with"]
    note = (
        f"Measured side by side on {about['processor']}, {about['date']}; a dash: not reached, or "
        "not tried."
    )
    return "\n".join([*lines, "", note])


def work_precision() -> Figure:
    """Run time against error beside other tools, as the benchmark stored it; of the rules alone
    if it has not run.
    """
    sys.path.insert(0, str(BENCHMARKS))
    from tools import fronts

    if fronts.RESULT.exists():
        result = fronts.read()
        readme = BENCHMARKS.parent / "README.md"
        text = readme.read_text(encoding="utf-8")
        readme.write_text(
            BETWEEN.sub(lambda found: found[1] + measured(result) + found[2], text),
            encoding="utf-8",
        )
        return fronts.figure(result, [name for name in SHOWN if name in result["scenes"]])
    model = vi.models.henon_heiles()
    rules = [
        vi.composition(name) for name in ("verlet", "blanes-moan4", "blanes-moan6", "kahan-li8")
    ]
    rules += [vi.gauss(2), vi.gauss(4)]
    start = dict(
        q0=model.q0, v0=model.v0, duration=100.0, steps=(200, 400, 800, 1600, 3200), repeats=15
    )
    return vi.diagnostics.work_precision(model.system, rules, **start).plot()


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    pictures = (pendulum, swing_up, ladder, work_precision)
    for draw in (draw for draw in pictures if not sys.argv[1:] or draw.__name__ in sys.argv[1:]):
        draw().savefig(IMAGES / f"{draw.__name__}.png", dpi=100)
