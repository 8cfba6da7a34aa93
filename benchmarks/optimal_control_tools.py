"""Toolkits for optimal control at equal error of the cost: from nothing, and again.

Run: python benchmarks/optimal_control_tools.py [tool …]. Result:
benchmarks/results/optimal_control_tools.json.

Kelly's cart-pole in each tool, as its manual has it (benchmarks/tools/control_peers.py): every
setting runs in processes of its own, one after the other; times are processor times, compilers'
among them. "Import" is the tool's; "first" builds and solves; "again" is the median of three
further ends, from the last solution. For each wanted error of the cost the quickest first solve
among a tool's settings counts, and the quickest further one. Tools that are not installed are left
out with a message: pip install rockit-meco mpopt dymos opty (opty needs cyipopt, which builds
against CasADi's own Ipopt: a file ipopt.pc that names casadi/include/coin-or and
casadi/libipopt.so.3).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from tools.record import kept, save, table

WANTED = (1e-3, 1e-6, 1e-9)
SETTINGS: dict[str, list[tuple[str, int]]] = {
    "varint": [
        *(("gauss(3)", n) for n in (10, 20)),
        *(("gauss(4)", n) for n in (10, 16, 24, 32, 40)),
        *(("gauss(5)", n) for n in (16, 24, 32)),
    ],
    "Hermite–Simpson": [("-", n) for n in (20, 30, 44, 80, 160, 240, 320)],
    "mpopt": [("5", 20), ("8", 8), ("12", 8), ("15", 10)],
    "rockit": [("linear", 20), ("linear", 40), ("constant", 120)],
    "dymos": [("3", 20), ("3", 30)],
    "opty": [("midpoint", 80), ("midpoint", 320)],
}
NEEDS = {"rockit": "rockit", "mpopt": "mpopt", "dymos": "dymos", "opty": "opty"}
REPEATS, QUICK, LIMIT = 2, 8.0, 300.0  # seconds: what takes longer runs once, or is given up
WORKER = Path(__file__).parent / "tools" / "control_peers.py"


def measured(tool: str, setting: str, steps: int, cache: str) -> dict[str, float] | None:
    """Medians of some processes; None where it takes too long or fails."""
    found: list[dict] = []
    # everything installed comes compiled to byte code; so does a checkout here
    environment = os.environ | {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
    environment |= {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(WORKER), tool, setting, str(steps)]
    for _ in range(REPEATS + 1):  # the first one fills the caches
        try:
            run = subprocess.run(
                command, capture_output=True, text=True, timeout=LIMIT, env=environment
            )
        except subprocess.TimeoutExpired:
            print(f"{tool} {setting} × {steps}: more than {LIMIT:.0f} s")
            return None
        if run.returncode:
            print(f"{tool} {setting} × {steps}: {run.stderr.strip().splitlines()[-1]}")
            return None
        found.append(json.loads(run.stdout.splitlines()[-1]))
        if sum(found[-1][name] for name in ("import s", "first s")) > QUICK:
            break
    found = found[1:] or found
    names = ("import s", "first s", "again s", "error")
    return {name: float(np.median([x[name] for x in found])) for name in names}


def main(tools: list[str]) -> None:
    """These tools, and what is quickest at each wanted error, written as it comes; others keep
    their rows.
    """
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as cache:
        for tool in tools:
            settings = SETTINGS[tool]
            if tool in NEEDS and find_spec(NEEDS[tool]) is None:
                print(f"{tool} is not installed; left out")
                continue
            runs = []
            for setting, steps in settings:
                one = measured(tool, setting, steps, cache)
                if one is not None:
                    runs.append({"setting": f"{setting} × {steps}".removeprefix("- × ")} | one)
                    rows = [x for x in kept("optimal_control_tools") if x["tool"] != tool]
                    rows += _quickest(tool, runs)
                    rows.sort(key=lambda row: (-float(row["wanted error"]), row["first ms"]))
                    save("optimal_control_tools", rows)
            table(runs)
    table(rows)


def _quickest(tool: str, runs: list[dict]) -> list[dict]:
    """The quickest first and further solves of a tool that are as good as wanted."""
    rows = []
    for wanted in WANTED:
        fit = [run for run in runs if run["error"] <= wanted]
        if not fit:
            continue
        best = min(fit, key=lambda run: run["first s"])
        rows.append(
            {
                "wanted error": f"{wanted:.0e}",
                "tool": tool,
                "setting": best["setting"],
                "error": best["error"],
                "import ms": 1e3 * best["import s"],
                "first ms": 1e3 * best["first s"],
                "again ms": 1e3 * min(run["again s"] for run in fit),
            }
        )
    return rows


if __name__ == "__main__":
    main(sys.argv[1:] or list(SETTINGS))
