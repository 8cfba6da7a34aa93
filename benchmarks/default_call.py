"""The default call against the best backend in hindsight: the first run of a new scene, from 1 to
ten million steps, with nothing compiled before and with everything.

python benchmarks/default_call.py [scene ...]     other scenes' rows stay as they were recorded

Every number is of a process of its own that has imported varint and built nothing: it makes the
scene, then the call is timed, all that it imports (as byte code, as it is once installed), builds
and compiles included. Times are the processor's, the compiler's with them, also of one that the end
of the process stops, so that what else runs on the machine hardly counts. Runs that would take
longer than `LONGEST` are not made; they are taken to be proportional to the shorter ones. Ratios
are what to look at: the default call's time over that of the fastest backend.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import resource
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from tools.byte_code import make_byte_code
from tools.record import kept, save, table

import varint as vi
from varint.codegen.cache import _end_work
from varint.models.model import Model

STEPS = tuple(10**k for k in range(8))
# seconds of a run that is made: slow backends need not show what they do in the longest runs
LONGEST = {"interpreted": 2.0, "native": 2.0, "compiled": 20.0, "auto": 20.0}
MOST = 2.5  # times the best backend: what the default call may take
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
    "duffing": vi.models.duffing,
    "fpu chain": vi.models.fpu_chain,
    "magnetic mirror": vi.models.magnetic_mirror,
    "chain pendulum": vi.models.chain_pendulum,
    "rotating hoop": vi.models.rotating_hoop,
    "driven pendulum": vi.models.driven_pendulum,
    "kapitza pendulum": vi.models.kapitza_pendulum,
    "cart and pole, control table": vi.models.cart_pole,
    "cartesian pendulum": vi.models.pendulum_cartesian,
    "four-bar linkage": vi.models.four_bar,
    "slider crank": vi.models.slider_crank,
    "heavy top, quaternion": vi.models.heavy_top_quaternion,
    "knife edge": vi.models.knife_edge,
    "chaplygin sleigh": vi.models.chaplygin_sleigh,
    "rolling disc": vi.models.rolling_disc,
    "bouncing ball": vi.models.bouncing_ball,
    "falling ladder": vi.models.falling_ladder,
    "slack string": vi.models.slack_string,
}


def controls_of(model: Model, steps: int) -> dict[str, Any]:
    """A force in every step, where the scene has controls."""
    k = np.arange(steps)[:, None] + np.arange(model.system.structure.controls)
    return {"u": 0.1 * np.sin(0.03 * k)} if k.size else {}


def processor_seconds() -> float:
    """Of this process and of the compilers that it has started."""
    both = (resource.getrusage(x) for x in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(x.ru_utime + x.ru_stime for x in both)


def end_compilers() -> None:
    """As the end of the process does, so that their time can be read; those that they have started
    themselves become this one's.
    """
    _end_work()
    with suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)


def seconds(make: Callable[[], Model], steps: int, backend: str, cache: Path) -> float:
    """Of the first call in a process that has built nothing."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        with suppress(AttributeError):  # Linux alone has it
            ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER
        os.environ["XDG_CACHE_HOME"] = str(cache)
        model = make()
        start = {"q0": model.q0, "v0": model.v0, "h": model.h, "steps": steps}
        start |= controls_of(model, steps)
        began = processor_seconds()
        vi.simulate(model.system, **start, **KEPT, backend=backend, progress=False)
        end_compilers()
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


def measured(
    make: Callable[[], Model], backend: str, warm: Path | None, like: Sequence[float] = ()
) -> list[float]:
    """Seconds of the first call for every number of steps, everything compiled before in the folder
    `warm`, or nothing in one of its own. How long a run takes is told by shorter ones, or by the
    times `like` where these are of another kind: a compiler that a shorter run ended is no part of
    longer ones.
    """
    found: list[float] = []
    for k, steps in enumerate(STEPS):
        told = like[:k] or found
        if k > 1 and 10 * (told[-1] - told[0]) > LONGEST[backend]:
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
    others = zip(*(times[x] for x in ("interpreted", "native", "compiled")), strict=True)
    ratios = [x / min(best) for x, best in zip(times["auto"], others, strict=True)]
    row: dict = {"scene": name, "cache": cache, "worst": max(ratios)}
    row |= {f"{n:,} steps": ratio for n, ratio in zip(STEPS, ratios, strict=True)}
    return row | {f"{backend}, ms": [1e3 * x for x in found] for backend, found in times.items()}


def main(names: list[str]) -> None:
    make_byte_code()
    rows = []
    for name in names or SCENES:
        make = SCENES[name]
        with tempfile.TemporaryDirectory() as folder:
            warm = Path(folder)
            interpreted = {"interpreted": measured(make, "interpreted", warm)}
            for backend in ("native", "compiled"):
                seconds(make, 1, backend, warm)
            for cache, place in (("empty", None), ("warm", warm)):
                times = {x: measured(make, x, place) for x in ("native", "compiled")}
                times["auto"] = measured(make, "auto", place, times["compiled"])
                rows.append(row_of(name, cache, interpreted | times))
        for row in rows[-2:]:
            table([{k: x for k, x in row.items() if not isinstance(x, list)}])
        sys.stdout.flush()
    for cache in ("empty", "warm"):
        found = [row["worst"] for row in rows if row["cache"] == cache]
        many = sum(x > MOST for x in found)
        print(f"{cache} cache: {max(found):.2f} at most, above {MOST} in {many} of {len(found)}")
    new = {(row["scene"], row["cache"]): row for row in rows}
    known = {(row["scene"], row["cache"]): row for row in kept("default_call")} | new
    order = [(name, cache) for name in SCENES for cache in ("empty", "warm")]
    save("default_call", [known[x] for x in order if x in known])


if __name__ == "__main__":
    main(sys.argv[1:])
