"""Starts of optimal control: how often, and in how many iterations, problems are solved from
identical random paths, beside Hermite–Simpson collocation written by hand in CasADi's Opti; and
from varint's default start.

Run: python benchmarks/control_starts.py [starts]. Results: benchmarks/results/control_starts.json.

Both get the same coordinates (the straight line with four sine waves of random heights); varint
finds controls to them by inverse dynamics, the other starts from their velocities and no control.
Iterations are those of Ipopt, those of its restorations among them, of all attempts together. "From
the path" are solves by the path itself or by a rough solution near it; "by default" those where
varint had to leave the path; "of all solved" counts both. "True" are solutions whose controls,
replayed in fine steps, keep to their path within 1 % of its range: solvers also converge on meshes
that are too coarse for where they ended.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np
from tools.record import save, table
from tools.start_problems import PROBLEMS, Outcome, by_hermite_simpson, by_varint, random_path

STARTS = 10
ELSEWHERE = "from a default start"
TRUE = 1e-2  # of the range of a coordinate


def main(starts: int) -> None:
    """All problems, one row each."""
    rows = []
    for name in PROBLEMS:
        rows.append(measured(name, starts))
        table(rows[-1:])
        save("control_starts", rows)
    table(rows)


def measured(name: str, starts: int) -> dict:
    """One problem from so many paths, and from none."""
    phase, random = PROBLEMS[name](), np.random.default_rng(0)
    duration = float(getattr(phase.duration, "guess", phase.duration))
    paths = [random_path(phase, random, duration) for _ in range(starts)]
    ours = [by_varint(phase, path) for path in paths]
    theirs = [by_hermite_simpson(phase, path) for path in paths]
    default = by_varint(phase, None)
    on_path = [x for x in ours if x.solved and not x.attempt.startswith(ELSEWHERE)]
    return {
        "problem": name,
        "starts": starts,
        **_summary("varint, from the path", on_path),
        "varint, by default: solved": sum(x.solved for x in ours) - len(on_path),
        "varint, of all solved: iterations": _median([x.iterations for x in ours if x.solved]),
        **_summary("Hermite–Simpson", [x for x in theirs if x.solved]),
        "no path: iterations of the last attempt": default.iterations if default.solved else None,
        "no path: cost": default.cost if default.solved else None,
    }


def _summary(label: str, solved: list[Outcome]) -> dict[str, float | int | None]:
    true = [x for x in solved if x.error <= TRUE]
    return {
        f"{label}: solved": len(solved),
        f"{label}: true": len(true),
        f"{label}: iterations": _median([x.iterations for x in solved]),
        f"{label}: s": _median([x.seconds for x in solved]),
        f"{label}: least true cost": min((x.cost for x in true), default=None),
    }


def _median(values: list) -> float | None:
    return float(np.median(values)) if values else None


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # coarse solutions: starts are judged here, not meshes
    main(int(sys.argv[1]) if len(sys.argv) > 1 else STARTS)
