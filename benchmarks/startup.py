"""What comes before the first step and beside the loop: import, building, compiling, and the
overhead of a call.

python benchmarks/startup.py

Imports are timed in fresh processes, varint and casadi in turn, by the processor's time and by the
clock; ratios are what to look at. Calls are timed in one process: the processor's time, the
smallest of many repetitions. The overhead of `simulate` is what a call takes beyond its compiled
loop, everything built.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, process_time

from tools.byte_code import make_byte_code
from tools.record import save, table

ROOT = Path(__file__).parent.parent
IMPORTS = 15
FEWEST, SECONDS = 20, 1.0  # repetitions, and how long to go on with them
SCENE = """
import numpy as np, casadi as ca
from time import perf_counter, process_time
import varint as vi
began, spent = perf_counter(), process_time()
q, v = vi.coordinates("theta")
pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
vi.simulate(pendulum, q0=1.0, v0=0.0, h=0.01, steps=1000, backend=BACKEND)
print(process_time() - spent, perf_counter() - began)
"""

TODA = """
from time import perf_counter, process_time
import varint as vi
began, spent = perf_counter(), process_time()
ring = vi.models.toda_chain(200)
vi.simulate(ring.system, q0=ring.q0, v0=ring.v0, h=0.01, steps=1, backend="interpreted")
print(process_time() - spent, perf_counter() - began)
"""
VERLET = """
import casadi as ca
from time import perf_counter, process_time
import varint as vi
q, v = vi.coordinates("theta")
pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
began, spent = perf_counter(), process_time()
start = dict(q0=1.0, v0=0.0, h=0.01, steps=1_000_000)
vi.simulate(pendulum, vi.trapezoidal(), backend="interpreted", **start)
print(process_time() - spent, perf_counter() - began)
"""


def process(code: str, cache: str) -> tuple[float, float, str]:
    """Processor seconds, seconds and output of a fresh interpreter."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": cache}
    spent, began = os.times(), perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    took, now = perf_counter() - began, os.times()
    processor = (
        now.children_user - spent.children_user + now.children_system - spent.children_system
    )
    return processor, took, done.stdout


def imports(cache: str) -> list[dict]:
    """Median seconds of `import casadi` and `import varint`, without what the interpreter itself
    takes.
    """
    taken: dict[str, list[tuple[float, float, str]]] = {
        "pass": [],
        "import casadi": [],
        "import varint": [],
    }
    for _ in range(IMPORTS):
        for code, times in taken.items():
            times.append(process(code, cache))
    rows = []
    for i, unit in enumerate(("processor seconds", "seconds")):
        bare, casadi, varint = (median(x[i] for x in times) for times in taken.values())
        rows += [
            {"what": name, unit: x - bare}
            for name, x in (("import casadi", casadi), ("import varint", varint))
        ]
        ratio = (varint - bare) / (casadi - bare)
        rows.append({"what": f"import varint / import casadi, {unit}", "ratio": ratio})
    return rows


def smallest(call: Callable[[], object]) -> float:
    """Microseconds of the fastest of many calls, of the processor: what else runs on the machine
    does not count.
    """
    call()
    began, best, count = perf_counter(), float("inf"), 0
    while count < FEWEST or perf_counter() - began < SECONDS:
        start = process_time()
        call()
        best, count = min(best, process_time() - start), count + 1
    return 1e6 * best


def single_steps() -> list[dict]:
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
            run = dict(q0=q0, v0=v0, h=0.001, steps=1, backend=backend, progress=False)
            taken = smallest(
                lambda system=system, rule=rule, run=run: vi.simulate(system, rule, **run)
            )
            rows.append({"what": f"one step, {name}, {rule}, {backend}", "microseconds": taken})
    return rows


def loop_alone(motion, save_every: int) -> float:
    """Microseconds of the compiled loop of a run, called with nothing around it."""
    from varint.codegen.kernel import run_loop
    from varint.integration.compiled_loop import kernel_of

    kernel = kernel_of(motion.system, motion.rule)
    q0, p0 = motion.q[0].copy(), motion.p[0].copy()
    arguments = dict(
        t0=float(motion.t[0]), h=motion.h, steps=int(motion.k[-1]), save_every=save_every
    )
    return smallest(lambda: run_loop(kernel, q0, p0, motion.c, **arguments))


def whole_runs() -> list[dict]:
    """Whole runs as the user calls them, beside their compiled loop alone."""
    import casadi as ca
    import numpy as np

    import varint as vi

    pendulum, kepler, rosette = (
        vi.models.pendulum(2.0, g=1.0),
        vi.models.kepler(e=0.9),
        vi.models.kepler(e=0.6),
    )
    scale = vi.close_encounters(ca.norm_2(kepler.system.q))
    every = 200
    cases = [
        (
            "70 steps, pendulum, gauss(8)",
            pendulum,
            dict(duration=100.0, steps=70, save_every=70),
            70,
        ),
        (
            "2000 steps, pendulum, gauss(8)",
            pendulum,
            dict(duration=1000.0, steps=2000, save_every=every),
            every,
        ),
    ] + [
        (
            f"time_scale, Kepler e = 0.9, {orbits} orbits, gauss(8), save_every={kept}",
            kepler,
            dict(
                duration=2 * np.pi * orbits,
                h=2 * np.pi / 14 / 0.7,
                time_scale=scale,
                save_every=kept,
            ),
            kept,
        )
        for orbits, kept in ((100, 1), (100, every), (1000, every))
    ]
    rows = []
    for name, model, how, kept in cases:

        def run(model=model, how=how):
            return vi.simulate(
                model.system, vi.gauss(8), q0=model.q0, v0=model.v0, backend="compiled", **how
            )

        motion = run()
        whole, loop = smallest(run), loop_alone(motion.fictitious or motion, kept)
        rows.append(
            {"what": name, "microseconds": whole, "loop alone": loop, "overhead": whole - loop}
        )
    for name, model, duration in (
        ("pendulum", pendulum, 100.0),
        ("Kepler e = 0.6", rosette, 200 * np.pi),
    ):
        for tol in (1e-6, 1e-9):

            def run(model=model, duration=duration, tol=tol):
                start = dict(q0=model.q0, v0=model.v0, duration=duration, backend="compiled")
                return vi.simulate(model.system, tol=tol, **start)

            motion = run()
            whole, loop = smallest(run), loop_alone(motion, 1)
            row = {"what": f"tol={tol:g}, {name}, {motion.k[-1]} steps of {motion.rule}"}
            rows.append({**row, "microseconds": whole, "loop alone": loop, "ratio": whole / loop})
    return rows


def main() -> None:
    make_byte_code()
    with tempfile.TemporaryDirectory() as cache:
        os.chmod(cache, 0o700)
        rows = imports(cache)
        for what, backend in (
            ("first run of a pendulum, interpreted", "interpreted"),
            ("first run of a pendulum, compiled, cold", "compiled"),
            ("first run of a pendulum, compiled, cached", "compiled"),
        ):
            processor, seconds = process(SCENE.replace("BACKEND", repr(backend)), cache)[2].split()
            rows.append(
                {"what": what, "processor seconds": float(processor), "seconds": float(seconds)}
            )
        for what, code in (
            ("200-site Toda chain: system built and first step made", TODA),
            ("1e6 Verlet steps of the pendulum, interpreted, no compiler, every node kept", VERLET),
        ):
            processor, seconds = process(code, cache)[2].split()
            rows.append(
                {"what": what, "processor seconds": float(processor), "seconds": float(seconds)}
            )
    rows += single_steps() + whole_runs()
    table(rows)
    save("startup", rows)


if __name__ == "__main__":
    main()
