"""What comes before the first step: import, building, compiling, and the overhead of a call.

python benchmarks/startup.py

Imports are timed in fresh processes, varint and casadi in turn; ratios are what to look at. The overhead of `simulate`
is the time of a call of one step, everything built.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

from record import save, table

ROOT = Path(__file__).parent.parent
IMPORTS = 7
CALLS = 300
SCENE = """
import numpy as np, casadi as ca
from time import perf_counter
import varint as vi
began = perf_counter()
q, v = vi.coordinates("theta")
pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
vi.simulate(pendulum, q0=1.0, v0=0.0, h=0.01, steps=1000, backend=BACKEND)
print(perf_counter() - began)
"""

TODA = """
from time import perf_counter
import varint as vi
began = perf_counter()
ring = vi.models.toda_chain(200)
vi.simulate(ring.system, q0=ring.q0, v0=ring.v0, h=0.01, steps=1, backend="interpreted")
print(perf_counter() - began)
"""
VERLET = """
import casadi as ca
from time import perf_counter
import varint as vi
q, v = vi.coordinates("theta")
pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
began = perf_counter()
vi.simulate(pendulum, vi.trapezoidal(), q0=1.0, v0=0.0, h=0.01, steps=1_000_000, backend="interpreted")
print(perf_counter() - began)
"""


def process(code: str, cache: str) -> tuple[float, str]:
    """Seconds and output of a fresh interpreter."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": cache}
    began = perf_counter()
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return perf_counter() - began, done.stdout


def imports(cache: str) -> dict[str, float]:
    """Median seconds of `import casadi` and `import varint`, without what the interpreter itself takes."""
    times: dict[str, list[float]] = {"pass": [], "import casadi": [], "import varint": []}
    for _ in range(IMPORTS):
        for code, taken in times.items():
            taken.append(process(code, cache)[0])
    bare, *others = (median(taken) for taken in times.values())
    return dict(zip(("casadi", "varint"), (x - bare for x in others), strict=True))


def overhead() -> list[dict]:
    """Microseconds of a `simulate` call of one step."""
    import casadi as ca

    import varint as vi

    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    chain = vi.models.chain_rods(5)
    rows = []
    for name, system, rule, q0, v0 in (
        ("pendulum", pendulum, vi.trapezoidal(), 1.0, 0.0),
        ("pendulum", pendulum, vi.gauss(8), 1.0, 0.0),
        ("pendulum", pendulum, vi.midpoint(), 1.0, 0.0),
        ("chain of 5 rods", chain.system, vi.trapezoidal(), chain.q0, chain.v0),
    ):
        for backend in ("compiled", "interpreted"):
            best = []
            for _ in range(CALLS):
                began = perf_counter()
                vi.simulate(system, rule, q0=q0, v0=v0, h=0.001, steps=1, backend=backend, progress=False)
                best.append(perf_counter() - began)
            rows.append({"what": f"simulate, {name}, {rule}, {backend}", "microseconds": 1e6 * min(best)})
    return rows


def main() -> None:
    with tempfile.TemporaryDirectory() as cache:
        os.chmod(cache, 0o700)
        taken = imports(cache)
        rows = [{"what": f"import {name}", "seconds": x} for name, x in taken.items()]
        rows.append({"what": "import varint / import casadi", "ratio": taken["varint"] / taken["casadi"]})
        for what, backend in (
            ("first run of a pendulum, interpreted", "interpreted"),
            ("first run of a pendulum, compiled, cold", "compiled"),
            ("first run of a pendulum, compiled, cached", "compiled"),
        ):
            seconds = float(process(SCENE.replace("BACKEND", repr(backend)), cache)[1])
            rows.append({"what": what, "seconds": seconds})
        for what, code in (
            ("200-site Toda chain: system built and first step made", TODA),
            ("1e6 Verlet steps of the pendulum, interpreted, no compiler, every node kept", VERLET),
        ):
            rows.append({"what": what, "seconds": float(process(code, cache)[1])})
    rows += overhead()
    table(rows)
    save("startup", rows)


if __name__ == "__main__":
    main()
