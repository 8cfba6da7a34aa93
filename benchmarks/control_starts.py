"""Starts of optimal control: how often, and in how many iterations, problems are solved from
identical random paths, beside Hermite–Simpson collocation written by hand in CasADi's Opti; and
from varint's default start.

Run: python benchmarks/control_starts.py [starts]. Results: benchmarks/results/control_starts.json.

Both get the same coordinates (the straight line with four sine waves of random heights); varint
finds controls to them by inverse dynamics, the other starts from their velocities and no control.
Iterations are those of Ipopt with the rule that was asked for, of all attempts together, and of
solved starts; those of rough solutions by the trapezoidal rule show in the time only.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np
from tools.record import save, table
from tools.start_problems import PROBLEMS, by_hermite_simpson, by_varint, random_path

STARTS = 10


def main(starts: int) -> None:
    """All problems, one row each."""
    rows = []
    for name, make in PROBLEMS.items():
        phase, random = make(), np.random.default_rng(0)
        duration = float(getattr(phase.duration, "guess", phase.duration))
        paths = [random_path(phase, random, duration) for _ in range(starts)]
        ours = [by_varint(phase, path) for path in paths]
        theirs = [by_hermite_simpson(phase, path) for path in paths]
        default = by_varint(phase, None)
        row: dict = {"problem": name, "starts": starts}
        for label, found in (("varint", ours), ("Hermite–Simpson", theirs)):
            solved = [x for x in found if x.solved]
            row[f"{label} solved"] = len(solved)
            row[f"{label} iterations"] = _median([x.iterations for x in solved])
            row[f"{label} s"] = _median([x.seconds for x in solved])
            row[f"{label} least cost"] = min((x.cost for x in solved), default=np.nan)
        row["default solved"] = default.solved
        row["default iterations"], row["default cost"] = default.iterations, default.cost
        rows.append(row)
        table([row])
    table(rows)
    save("control_starts", rows)


def _median(values: list) -> float:
    return float(np.median(values)) if values else float("nan")


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # coarse solutions: starts are judged here, not meshes
    main(int(sys.argv[1]) if len(sys.argv) > 1 else STARTS)
