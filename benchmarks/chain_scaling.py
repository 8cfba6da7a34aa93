"""Cost per step of a chain with N rods: linear in N? Ratios side by side; `python benchmarks/chain_scaling.py`.

The chain is released level. λ-only SHAKE and RATTLE (trapezoidal rule), then lobatto(3) with positions and multipliers.
The last column compares the cost per link with that of the first row: 1 is linear.
"""

from __future__ import annotations

from time import process_time

import varint as vi

LINKS, STEPS, REPEATS = (10, 20, 50, 100, 200), 2000, 5


def microseconds_per_step(links: int, rule: vi.Rule) -> float:
    """Best of several runs: the difference of a long and a short run, so that checks of the start do not count."""
    model = vi.models.chain_rods(links)
    start = dict(q0=model.q0, v0=model.v0, h=1e-3)
    best = []
    for steps in (STEPS // 10, STEPS):
        vi.simulate(model.system, rule, **start, steps=steps)
        times = []
        for _ in range(REPEATS):
            began = process_time()
            vi.simulate(model.system, rule, **start, steps=steps)
            times.append(process_time() - began)
        best.append(min(times))
    return (best[1] - best[0]) / (STEPS - STEPS // 10) * 1e6


def main() -> None:
    for rule in (vi.trapezoidal(), vi.lobatto(3)):
        print(f"{rule}: {vi.plan(vi.models.chain_rods(2).system, rule).method}")
        first = None
        for links in LINKS:
            cost = microseconds_per_step(links, rule)
            first = first or cost / links
            each = cost / links
            print(f"  N = {links:4d}  {cost:8.1f} µs a step  {each:6.2f} µs a link  ratio {each / first:5.2f}")


if __name__ == "__main__":
    main()
