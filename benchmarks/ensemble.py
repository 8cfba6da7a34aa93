"""Ten thousand pendulums of different lengths: one call of `ensemble` beside a loop of `simulate`,
side by side.

`python benchmarks/ensemble.py` prints the ratio for each rule, backend and run length, and how far
they are apart. The loop is timed on every 100th member and scaled; both have run once before, so no
set-up is counted.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import casadi as ca
import numpy as np
from tools.record import save

import varint as vi

MEMBERS, EVERY = 10_000, 100
PROMISED = 20.0  # times faster than the loop


def pendulum() -> vi.System:
    c = vi.Parameters(length=1.0, g=9.81)
    q, v = vi.coordinates("theta")
    return vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)


def compared(
    rule: vi.Rule | None, steps: int, backend: str, save_every: int
) -> tuple[float, float, float]:
    """Seconds of the ensemble, seconds of the loop, largest difference."""
    system = pendulum()
    angles, lengths = np.linspace(-3, 3, MEMBERS), np.linspace(0.5, 2, MEMBERS)
    grid = dict(v0=0.0, h=0.01, steps=steps, save_every=save_every)
    times = []
    for _ in range(2):
        began = perf_counter()
        motions = vi.ensemble(
            system, rule, q0=angles, params=dict(length=lengths), backend=backend, **grid
        )
        times.append(perf_counter() - began)
    some, seconds, apart = range(0, MEMBERS, EVERY), [], 0.0
    for choice in {"auto", backend}:
        vi.simulate(system, rule, q0=1.0, backend=choice, **grid)
        began = perf_counter()
        loop = [
            vi.simulate(
                system, rule, q0=angles[i], params=dict(length=lengths[i]), backend=choice, **grid
            )
            for i in some
        ]
        seconds.append((perf_counter() - began) * EVERY)
    for i, motion in zip(some, loop, strict=True):
        apart = max(apart, float(np.abs(motion.q - motions.q[i]).max()))
    return min(times), min(seconds), apart


def main() -> None:
    print(
        f"{MEMBERS} pendulums; ensemble beside a loop of simulate (the faster of its own choice "
        "and that backend)"
    )
    least, rows = np.inf, []
    for rule in (None, vi.midpoint(), vi.gauss(2), vi.gauss(4), vi.gauss(8)):
        for steps, save_every in ((100, 1), (1000, 10))[: 2 if rule is None else 1]:
            for backend in ("interpreted", "compiled"):
                once, loop, apart = compared(rule, steps, backend, save_every)
                name = "default rule" if rule is None else str(rule)
                print(
                    f"  {name:12} {steps:5} steps, every {save_every:4} kept, {backend:11}  "
                    f"{once:7.3f} s beside {loop:7.2f} s: {loop / once:6.1f} times faster, apart "
                    f"by {apart:.0e}",
                    flush=True,
                )
                rows.append(
                    {
                        "rule": name,
                        "steps": steps,
                        "backend": backend,
                        "ensemble, s": once,
                        "loop of simulate, s": loop,
                        "times faster": loop / once,
                        "apart by": apart,
                    }
                )
                least = min(least, loop / once) if backend == "compiled" and steps == 100 else least
    save("ensemble", rows)
    processes()
    if least < PROMISED:
        sys.exit(
            f"the ensemble is {least:.1f} times faster than the loop; {PROMISED:g} were promised"
        )


def processes() -> None:
    """The same chunks in processes and on disk."""
    system, angles = pendulum(), np.linspace(-3, 3, MEMBERS)
    start = dict(q0=angles, v0=0.0, h=0.01, steps=200, save_every=10, backend="interpreted")
    began = perf_counter()
    plain = vi.ensemble(system, vi.gauss(2), **start)
    alone = perf_counter() - began
    with (
        ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool,
        TemporaryDirectory() as folder,
    ):
        began = perf_counter()
        kept = vi.ensemble(system, vi.gauss(2), executor=pool, store=Path(folder) / "kept", **start)
        together = perf_counter() - began
        same = kept.q.tobytes() == plain.q.tobytes()
        largest = max(len(chunk) for chunk in kept.chunks)
    print(
        f"  two processes, on disk: {together:.2f} s beside {alone:.2f} s in one; same bits: "
        f"{same}; chunks of at most {largest}"
    )


if __name__ == "__main__":
    main()
