"""Time against trajectory error: compiled Gauss and composition kernels against heyoka, side by
side.

python benchmarks/kernels.py [scene ...]     needs `pip install varint-mechanics[bench]`

For every scene and every wanted error the cheapest setting of each tool that reaches it, and the
ratio of the times. Tools take turns in one process, so that a busy machine slows them alike; the
best of several runs counts.
"""

import sys
from time import perf_counter

import casadi as ca
import numpy as np
from tools.heyoka_peer import taylor

import varint as vi
from varint.codegen.arguments import DONE
from varint.codegen.gauss import gauss_kernel
from varint.codegen.kernel import run_loop

WANTED = (1e-3, 1e-6, 1e-9, 1e-12)
LEVELS = (0.0, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5)
STAGES = (6, 8, 10)
TOLERANCES = 10.0 ** np.arange(-3, -18, -1.0)
REPEATS = 7


def pendulum():
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + ca.cos(q)), [2.0], [0.0], 100.0, 70


def kepler():
    q, v = vi.coordinates("x", "y")
    return (
        vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q)),
        [0.4, 0],
        [0, 2.0],
        200 * np.pi,
        2000,
    )


def henon_heiles():
    q, v = vi.coordinates("x", "y")
    potential = ca.sumsqr(q) / 2 + q[0] ** 2 * q[1] - q[1] ** 3 / 3
    return (
        vi.System(q, v, ca.sumsqr(v) / 2 - potential),
        [0, 0.1],
        [0.39665266081716044, 0],
        1000.0,
        350,
    )


def double_pendulum():
    q, v = vi.coordinates("a", "b")
    x = ca.vertcat(ca.sin(q[0]), -ca.cos(q[0]))
    y = x + ca.vertcat(ca.sin(q[1]), -ca.cos(q[1]))
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, kinetic - 9.81 * (x[1] + y[1])), [0.4, -0.3], [0, 0], 10.0, 40


def solar_system():
    g = 2.95912208286e-4
    m = np.array(
        [
            0.000954786104043,
            0.000285583733151,
            4.37273164546e-05,
            5.17759138449e-05,
            1 / 1.3e8,
            1.00000597682,
        ]
    )
    x = [
        -3.5023653,
        -3.8169847,
        -1.5507963,
        9.0755314,
        -3.0458353,
        -1.6483708,
        8.310142,
        -16.2901086,
        -7.2521278,
    ]
    x += [11.4707666, -25.7294829, -10.8169456, -15.5387357, -25.2225594, -3.1902382, 0, 0, 0]
    s = [
        0.00565429,
        -0.0041249,
        -0.00190589,
        0.00168318,
        0.00483525,
        0.00192462,
        0.00354178,
        0.00137102,
        0.00055029,
    ]
    s += [0.0028893, 0.00114527, 0.00039677, 0.00276725, -0.00170702, -0.00136504, 0, 0, 0]
    q, v = vi.coordinates(*(f"{a}{i}" for i in range(6) for a in "xyz"))
    at = [q[3 * i : 3 * i + 3] for i in range(6)]
    kinetic = ca.dot(ca.DM(np.repeat(m, 3)), v**2) / 2
    potential = sum(-g * m[i] * m[j] / ca.norm_2(at[i] - at[j]) for i in range(6) for j in range(i))
    return vi.System(q, v, kinetic - potential), x, np.repeat(m, 3) * s, 2e5, 150


SCENES = {f.__name__: f for f in (pendulum, kepler, henon_heiles, double_pendulum, solar_system)}


def timed(call, repeats=REPEATS):
    """Best time of several calls in µs; short calls are repeated more often."""
    best, start = np.inf, perf_counter()
    while repeats > 0 or perf_counter() - start < 0.003:
        begin = perf_counter()
        call()
        best, repeats = min(best, perf_counter() - begin), repeats - 1
    return 1e6 * best


def ours(system, q0, p0, duration, steps, exact):
    c = system.default_vector
    for stages in STAGES:
        kernel = gauss_kernel(system, vi.gauss(stages))
        for n in np.unique(np.round(steps * 1.15 ** np.arange(-6, 16) * 8 / stages).astype(int)):
            for level in LEVELS:

                def call(kernel=kernel, n=int(n), level=level):
                    return run_loop(
                        kernel,
                        q0,
                        p0,
                        c,
                        t0=0.0,
                        h=duration / n,
                        steps=n,
                        save_every=n,
                        level=level,
                    )

                done = call()
                if done.status == DONE:
                    error = np.abs(done.rows[-1, 0] - exact).max()
                    about = f"gauss({stages}) n={n} level={level:g} its={done.iterations / n:.1f}"
                    yield error, timed(call), about


def heyoka(system, q0, p0, duration, exact):
    for form in ("velocities", "momenta"):
        if form == "momenta" and system.structure.explicit:
            continue
        start = np.concatenate([q0, p0 if form == "momenta" else speeds(system, q0, p0)])
        for tol in TOLERANCES:
            integrator = taylor(system, form, tol)

            def call(integrator=integrator, start=start):
                integrator.time = 0.0
                integrator.state[:] = start
                integrator.propagate_until(duration)

            call()
            error = np.abs(integrator.state[: len(q0)] - exact).max()
            yield error, timed(call), f"{form} tol={tol:g} order={integrator.order}"


def speeds(system, q0, p0):
    kernel = gauss_kernel(system, vi.gauss(8))
    return run_loop(kernel, q0, p0, system.default_vector, t0=0.0, h=1e-3, steps=1).rows[0, 2]


def reference(system, q0, p0, duration, steps):
    """Gauss of order 20 with many steps, and the distance to heyoka at its tightest tolerance."""
    kernel = gauss_kernel(system, vi.gauss(10))
    n = 6 * steps
    found = run_loop(
        kernel, q0, p0, system.default_vector, t0=0.0, h=duration / n, steps=n, save_every=n
    ).rows[-1, 0]
    other = taylor(system, "velocities", 1e-18)
    other.state[:] = np.concatenate([q0, speeds(system, q0, p0)])
    other.propagate_until(duration)
    return found, np.abs(other.state[: len(q0)] - found).max()


def front(results):
    """The cheapest result for each wanted error."""
    chosen = {}
    for wanted in WANTED:
        good = [r for r in results if r[0] <= wanted]
        chosen[wanted] = min(good, key=lambda r: r[1]) if good else None
    return chosen


def main(names):
    ratios = []
    for name in names or SCENES:
        system, q0, p0, duration, steps = SCENES[name]()
        q0, p0 = np.array(q0, float), np.array(p0, float)
        exact, apart = reference(system, q0, p0, duration, steps)
        print(f"\n{name}   reference and heyoka's tightest run are {apart:.1e} apart")
        mine, theirs = (
            front(list(ours(system, q0, p0, duration, steps, exact))),
            front(list(heyoka(system, q0, p0, duration, exact))),
        )
        for wanted in WANTED:
            a, b = mine[wanted], theirs[wanted]
            line = f"  {wanted:g}: " + (
                f"varint {a[1]:8.1f} µs ({a[0]:.0e}; {a[2]})" if a else "varint –"
            )
            line += f"   heyoka {b[1]:8.1f} µs ({b[0]:.0e}; {b[2]})" if b else "   heyoka –"
            if a and b:
                ratios.append(a[1] / b[1])
                line += f"   ratio {ratios[-1]:.2f}"
            print(line)
    if ratios:
        print(
            f"\ngeometric mean of the ratios {np.exp(np.mean(np.log(ratios))):.3f}, largest "
            f"{max(ratios):.2f}"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
