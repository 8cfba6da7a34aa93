"""Paths between fixed end points, side by side with scipy's solve_bvp: run time against error, and
growth with size.

Both get the same straight first path. The error is that of the start velocity, against a path of
`gauss(8)` with many steps. Run: python benchmarks/least_action_peer.py
"""

from __future__ import annotations

from time import perf_counter

import casadi as ca
import numpy as np
from scipy.integrate import solve_bvp
from tools.record import save

import varint as vi


def scenes() -> dict[str, tuple]:
    """Name → system, start, end, duration."""
    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    double = vi.System(q, v, kinetic + 9.81 * (2 * ca.cos(q[0]) + ca.cos(q[1])))
    return {
        "pendulum": (pendulum, [0.0], [2.0], 3.0),
        "Kepler arc": (kepler, [1.0, 0.0], [0.0, 1.5], 2.0),
        "double pendulum": (double, [0.1, 0.2], [0.9, -0.4], 0.6),
    }


def best(work, repeats: int = 5) -> tuple[float, object]:
    """Shortest of several run times, and the result."""
    times = []
    for _ in range(repeats):
        began = perf_counter()
        result = work()
        times.append(perf_counter() - began)
    return min(times), result


def _row(scene: str, method: str, seconds: float, error: float) -> dict:
    """What is kept of one measurement, which is printed."""
    print(f"{scene:16} {method:22} {1e3 * seconds:9.2f} {error:14.1e}")
    return {"scene": scene, "method": method, "ms": 1e3 * seconds, "error of v(0)": float(error)}


def main() -> None:
    rows = []
    print(f"{'scene':16} {'method':22} {'time, ms':>9} {'error of v(0)':>14}")
    for name, (system, start, end, duration) in scenes().items():
        ends = dict(q_start=start, q_end=end, duration=duration)
        exact = vi.least_action(system, vi.gauss(8), steps=100, **ends).v[0]
        n = len(start)
        forces = ca.gradient(system.lagrangian, system.q) - ca.jtimes(
            system.momentum, system.q, system.v
        )
        acceleration = ca.Function(
            "a", [system.q, system.v], [ca.densify(ca.solve(system.mass_matrix, forces))]
        )

        def right(t, y, f=acceleration, n=n):
            return np.vstack([y[n:], np.array(f.map(y.shape[1])(y[:n], y[n:]))])

        def at_ends(a, b, start=start, end=end, n=n):
            return np.concatenate([a[:n] - start, b[:n] - end])

        t = np.linspace(0, duration, 11)
        line = np.outer(start, 1 - t / duration) + np.outer(end, t / duration)
        first = np.vstack([line, np.outer(np.subtract(end, start) / duration, np.ones(11))])
        for rule, steps in ((vi.gauss(2), 40), (vi.gauss(4), 20), (vi.gauss(6), 20)):
            vi.least_action(system, rule, steps=steps, **ends)  # functions are built once
            time, path = best(
                lambda s=system, r=rule, k=steps, e=ends: vi.least_action(s, r, steps=k, **e)
            )
            rows.append(_row(name, f"{rule}, {steps} steps", time, np.abs(path.v[0] - exact).max()))
        for tolerance in (1e-6, 1e-10):
            time, found = best(
                lambda t=t, y=first, x=tolerance: solve_bvp(
                    right, at_ends, t, y, tol=x, max_nodes=50_000
                )
            )
            error = np.abs(found.y[n:, 0] - exact).max()
            rows.append(_row(name, f"solve_bvp, tol {tolerance:g}", time, error))
    save("least_action", rows)
    print(f"\n{'unknowns':>9} {'build and solve, s':>19}   n = 4, gauss(1)")
    q, v = vi.coordinates(*"abcd")
    chain = ca.sumsqr(v) / 2 + ca.sum1(ca.cos(q)) + 0.3 * ca.cos(q[0] - q[1]) * v[2] * v[3]
    for steps in (500, 5000, 50_000):
        system = vi.System(q, v, chain)
        began = perf_counter()
        vi.least_action(
            system,
            vi.gauss(1),
            q_start=np.zeros(4),
            q_end=[1, 2, 0.5, -1],
            duration=2.0,
            steps=steps,
        )
        print(f"{4 * steps:9,} {perf_counter() - began:19.2f}")


if __name__ == "__main__":
    main()
