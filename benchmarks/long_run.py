"""1e8 compiled steps: bounded memory, energy without slope, and how round-off grows.

python benchmarks/long_run.py [steps]

Harmonic oscillator by Störmer–Verlet: its discrete motion is known exactly, q_k = cos(k ω̃ h) with
2 sin(ω̃ h/2) = ω h, so what differs from it (in 40 digits) is round-off and nothing else. Unbiased
round-off makes the energy a random walk (√N) and the position, its integral, grow like N^1.5 at
most; biased round-off would give N and N². Pendulums: the slope of windowed means of the energy
within its own noise.
"""

from __future__ import annotations

import resource
import sys
from time import process_time

import casadi as ca
import mpmath
import numpy as np
from tools.record import save, table

import varint as vi

SAVED = 1000
H = 0.01


def oscillator() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, (v**2 - q**2) / 2)


def pendulum() -> vi.System:
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + ca.cos(q))


def double_pendulum() -> vi.System:
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, kinetic + 9.81 * (2 * ca.cos(q[0]) + ca.cos(q[1])))


def exact_oscillator(steps: np.ndarray) -> np.ndarray:
    """q at these steps for the very step size that the program uses."""
    with mpmath.workdps(40):
        h = mpmath.mpf(H)
        angle = 2 * mpmath.asin(h / 2)
        return np.array([float(mpmath.cos(int(k) * angle)) for k in steps])


def measured(
    system: vi.System, rule: vi.Rule, q0, steps: int
) -> tuple[vi.Trajectory, float, float]:
    """The run, its nanoseconds a step and by how many MB the process grew."""
    q0, v0 = np.atleast_1d(q0).astype(float), np.zeros(len(np.atleast_1d(q0)))
    vi.simulate(system, rule, q0=q0, v0=v0, h=H, steps=1000, save_every=1000, backend="compiled")
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, process_time()
    motion = vi.simulate(
        system,
        rule,
        q0=q0,
        v0=v0,
        h=H,
        steps=steps,
        save_every=max(steps // SAVED, 1),
        backend="compiled",
    )
    took = process_time() - began
    return (
        motion,
        took / steps * 1e9,
        (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024,
    )


def growth(steps: np.ndarray, error: np.ndarray) -> float:
    """Exponent of the largest error so far over the last two decades."""
    largest = np.maximum.accumulate(error)
    late = (steps > steps[-1] / 100) & (largest > 0)
    return float(np.polyfit(np.log(steps[late]), np.log(largest[late]), 1)[0])


def drift(energy: np.ndarray, windows: int = 20) -> tuple[float, float]:
    """Change of windowed means over the whole run, relative, and its standard error."""
    means = energy[1:].reshape(windows, -1).mean(axis=1) / abs(energy[0])
    x = np.linspace(0, 1, windows)
    slope, offset = np.polyfit(x, means, 1)
    noise = np.std(means - offset - slope * x, ddof=2) / np.sqrt(((x - x.mean()) ** 2).sum())
    return float(slope), float(noise)


def main(steps: int) -> None:
    rows = []
    system = oscillator()
    motion, cost, grown = measured(system, vi.trapezoidal(), 1.0, steps)
    k = motion.k[1:]
    error = np.abs(motion.q[1:, 0] - exact_oscillator(k))
    angle = 2 * np.arcsin(H / 2)
    # kept exactly by the method
    invariant = motion.p[:, 0] ** 2 + motion.q[:, 0] ** 2 * np.cos(angle / 2) ** 2
    walk = np.abs(invariant[1:] - invariant[0])
    rows.append(
        {
            "scene": "oscillator",
            "rule": "verlet",
            "steps": steps,
            "ns a step": cost,
            "MB grown": grown,
            "round-off in q": float(error.max()),
            "grows like N^": growth(k, error),
            "in the invariant": float(walk.max()),
            "walks like N^": growth(k, walk),
        }
    )
    for name, scene, rule, q0, part in (
        ("pendulum", pendulum(), vi.trapezoidal(), [2.0], 1),
        ("pendulum", pendulum(), vi.midpoint(), [2.0], 1),
        ("pendulum", pendulum(), vi.gauss(8), [2.0], 10),
        ("double pendulum, small", double_pendulum(), vi.midpoint(), [0.4, -0.3], 10),
    ):
        motion, cost, grown = measured(scene, rule, q0, steps // part)
        slope, noise = drift(motion.energy)
        rows.append(
            {
                "scene": name,
                "rule": rule.name,
                "steps": steps // part,
                "ns a step": cost,
                "MB grown": grown,
                "energy error": float(np.abs(motion.energy / motion.energy[0] - 1).max()),
                "energy drift": slope,
                "its noise": noise,
            }
        )
    table(rows)
    save("long_run", rows)


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 100_000_000)
