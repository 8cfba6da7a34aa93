"""Cost per step of a chain with N rods: linear in N? Ratios side by side.  python
benchmarks/chain_scaling.py

The chain is released level. λ-only SHAKE and RATTLE (trapezoidal rule), then lobatto(3) with
positions and multipliers, interpreted and compiled. `ratio` compares the cost per link with that of
the first row: 1 is linear.
"""

from __future__ import annotations

import sys
from time import perf_counter, process_time

import numpy as np
from tools.record import save, table

import varint as vi
from varint.codegen.arguments import DONE
from varint.codegen.kernel import run_loop
from varint.codegen.newton import newton_kernel
from varint.integration.interpreted_loop import interpreted_blocks as interpreted_run
from varint.integration.problem import RunOptions, Start, initial_value_problem

LINKS, STEPS, REPEATS = (10, 20, 50, 100, 200), {"compiled": 2000, "interpreted": 200}, 7


def cost(model: vi.models.Model, rule: vi.Rule, backend: str) -> tuple[float, float]:
    """Microseconds a step, best of several runs in turn with none of the checks of a start;
    seconds to build.
    """
    steps = STEPS[backend]
    task = initial_value_problem(
        model.system,
        rule,
        Start(model.q0, model.v0),
        RunOptions(h=1e-3, steps=steps, save_every=steps),
    )
    began = perf_counter()
    if backend == "compiled":
        kernel = newton_kernel(model.system, rule)
        built = perf_counter() - began

        def call() -> None:
            part = run_loop(
                kernel, task.q0, task.p0, task.c, t0=0.0, h=task.h, steps=steps, save_every=steps
            )
            assert part.status == DONE
    else:

        def call() -> None:
            assert all(
                block.good == len(block.k) for block in interpreted_run(model.system, rule, task)
            )

        call()
        built = perf_counter() - began
    times = []
    for _ in range(REPEATS):
        began = process_time()
        call()
        times.append(process_time() - began)
    return min(times) / steps * 1e6, built


def main(links: tuple[int, ...], backends: tuple[str, ...]) -> None:
    rows = []
    for rule in (vi.trapezoidal(), vi.lobatto(3)):
        for backend in backends:
            first = None
            for n in links:
                microseconds, built = cost(vi.models.chain_rods(n), rule, backend)
                first = first or microseconds / n
                rows.append(
                    {
                        "rule": rule.name,
                        "backend": backend,
                        "links": n,
                        "µs a step": microseconds,
                        "ns a link": 1e3 * microseconds / n,
                        "ratio": microseconds / n / first,
                        "built in s": built,
                    }
                )
                print(rows[-1], flush=True)
            save("chain_scaling", rows)
    table(rows)
    for rule in (vi.trapezoidal(), vi.lobatto(3)):
        for backend in backends:
            found = [row for row in rows if row["rule"] == rule.name and row["backend"] == backend]
            if len(found) > 1:
                fit = np.polyfit(
                    np.log([r["links"] for r in found]), np.log([r["µs a step"] for r in found]), 1
                )[0]
                print(f"{rule}: {backend} cost grows like N^{fit:.2f}")


if __name__ == "__main__":
    main(tuple(map(int, sys.argv[1:])) or LINKS, ("compiled", "interpreted"))
