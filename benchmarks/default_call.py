"""The default call against the better backend in hindsight: the first run of a new scene, from 1 to
a million steps, with nothing compiled before and with everything.

python benchmarks/default_call.py [scene ...]

Every number is of a process of its own that has imported varint and built nothing: it makes the
scene, then the call is timed, all that it builds and compiles included. Times are the processor's,
the compiler's with them, so that what else runs on the machine hardly counts. Interpreted runs that
would take longer than `LONGEST` are not made; they are taken to be proportional to the shorter
ones. Ratios are what to look at: the default call's time over that of the faster backend.
"""

from __future__ import annotations

import os
import pickle
import resource
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from tools.record import save, table

import varint as vi
from varint.models.model import Model

STEPS = tuple(10**k for k in range(7))
LONGEST = 2.0  # seconds of a run that is made
MOST = 2.5  # times the better backend: what the default call may take
TURNS = 2  # of short runs the fastest counts
SHORT = 0.3  # seconds
KEPT = {"save_every": 10}  # a million nodes are not for the memory


def spring_pendulum() -> Model:
    """A mass on a spring, in polar coordinates."""
    q, v = vi.coordinates("r", "theta")
    c = vi.Parameters(g=9.81, k=40.0)
    kinetic = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    L = kinetic + c.g * q[0] * ca.cos(q[1]) - c.k * (q[0] - 1) ** 2 / 2
    return Model(
        name="spring_pendulum",
        system=vi.System(q, v, L, params=c),
        q0=np.array([1.2, 0.4]),
        v0=np.zeros(2),
        duration=10.0,
        h=0.01,
        claim="A mass on a spring.",
        source="",
    )


SCENES: dict[str, Callable[[], Model]] = {
    "pendulum": vi.models.pendulum,
    "kepler": lambda: vi.models.kepler(e=0.6),
    "double pendulum": vi.models.double_pendulum,
    "henon-heiles": vi.models.henon_heiles,
    "spherical pendulum": vi.models.spherical_pendulum,
    "chain of 5 rods": lambda: vi.models.chain_rods(5),
    "charged particle": vi.models.inverse_distance_field,
    "solar system": vi.models.outer_solar_system,
    "toda chain of 20": lambda: vi.models.toda_chain(20),
    "heavy top": vi.models.heavy_top,
    "pendulum on a cart": vi.models.sliding_support,
    "spring pendulum": spring_pendulum,
}


def processor_seconds() -> float:
    """Of this process and of the compilers that it has started."""
    both = (resource.getrusage(x) for x in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(x.ru_utime + x.ru_stime for x in both)


def seconds(make: Callable[[], Model], steps: int, backend: str, cache: Path) -> float:
    """Of the first call in a process that has built nothing."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.environ["XDG_CACHE_HOME"] = str(cache)
        model = make()
        start = {"q0": model.q0, "v0": model.v0, "h": model.h, "steps": steps}
        began = processor_seconds()
        vi.simulate(model.system, **start, **KEPT, backend=backend, progress=False)
        with os.fdopen(write, "wb") as file:
            pickle.dump(processor_seconds() - began, file)
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as file:
        answer = file.read()
    os.waitpid(child, 0)
    if not answer:
        raise SystemExit(f"{steps} steps of {make} by {backend} failed")
    return pickle.loads(answer)


def measured(make: Callable[[], Model], backend: str, warm: Path | None) -> list[float]:
    """Seconds of the first call for every number of steps, everything compiled before in the folder
    `warm`, or nothing in one of its own.
    """
    found: list[float] = []
    for steps in STEPS:
        if backend == "interpreted" and found and 10 * (found[-1] - found[0]) > LONGEST:
            found.append(found[0] + 10 * (found[-1] - found[0]))
            continue
        best = float("inf")
        for _ in range(TURNS):
            with tempfile.TemporaryDirectory() as folder:
                best = min(best, seconds(make, steps, backend, warm or Path(folder)))
            if best > SHORT:
                break
        found.append(best)
    return found


def row_of(name: str, cache: str, times: dict[str, list[float]]) -> dict:
    """Ratios of the default call, and all times, of one scene."""
    both = zip(times["interpreted"], times["compiled"], strict=True)
    ratios = [x / min(pair) for x, pair in zip(times["auto"], both, strict=True)]
    row: dict = {"scene": name, "cache": cache, "worst": max(ratios)}
    row |= {f"{n:,} steps": ratio for n, ratio in zip(STEPS, ratios, strict=True)}
    return row | {f"{backend}, ms": [1e3 * x for x in found] for backend, found in times.items()}


def main(names: list[str]) -> None:
    rows = []
    for name in names or SCENES:
        make = SCENES[name]
        with tempfile.TemporaryDirectory() as folder:
            warm = Path(folder)
            interpreted = measured(make, "interpreted", warm)
            seconds(make, 1, "compiled", warm)
            for cache, place in (("empty", None), ("warm", warm)):
                times = {x: measured(make, x, place) for x in ("compiled", "auto")}
                rows.append(row_of(name, cache, {"interpreted": interpreted, **times}))
        for row in rows[-2:]:
            table([{k: x for k, x in row.items() if not isinstance(x, list)}])
        sys.stdout.flush()
    for cache in ("empty", "warm"):
        found = [row["worst"] for row in rows if row["cache"] == cache]
        many = sum(x > MOST for x in found)
        print(f"{cache} cache: {max(found):.2f} at most, above {MOST} in {many} of {len(found)}")
    if not names:
        save("default_call", rows)


if __name__ == "__main__":
    main(sys.argv[1:])
