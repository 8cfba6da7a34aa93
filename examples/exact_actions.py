"""Actions of paths between fixed end points, beside their closed forms, and how fast they converge.

Claim: the discrete action of free fall, of the oscillator and of a Kepler arc is exact to 12 digits
by `gauss(4)`, and its error falls with order 2s for `gauss(s)`.
Source: Feynman & Hibbs, Quantum Mechanics and Path Integrals, §2.1; Marsden & West, Acta Numerica
2001, §1.3.
Run: python examples/exact_actions.py [folder of the picture]
"""

import sys
import warnings
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
# (1, 0) to (0, 1.5) in T = 2, μ = 1: Lambert's problem in extended precision
KEPLER_ACTION = 2.6071228687379926


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("x")
    fall = vi.System(q, v, v**2 / 2 - 9.81 * q)
    path = vi.least_action(fall, vi.gauss(4), q_start=1.0, q_end=3.0, duration=1.25, steps=10)
    exact = 2**2 / (2 * 1.25) - 9.81 * 1.25 * 4 / 2 - 9.81**2 * 1.25**3 / 24
    print(f"action of free fall         found {path.action:.12f}   exact {exact:.12f}")
    oscillator = vi.System(q, v, (v**2 - q**2) / 2)
    for duration in (1.0, 4.0, 7.0):
        path = vi.least_action(
            oscillator, vi.gauss(4), q_start=0.4, q_end=-0.9, duration=duration, steps=40
        )
        exact = ((0.4**2 + 0.9**2) * np.cos(duration) + 2 * 0.4 * 0.9) / (2 * np.sin(duration))
        print(
            f"oscillator, ωT = {duration:g}          found {path.action:.12f}   exact {exact:.12f}"
        )
    x, w = vi.coordinates("x", "y")
    kepler = vi.System(x, w, ca.sumsqr(w) / 2 + 1 / ca.norm_2(x))
    ends = dict(q_start=[1, 0], q_end=[0, 1.5], duration=2.0)
    arc = vi.least_action(kepler, vi.gauss(4), steps=60, **ends)
    print(f"Kepler arc                  found {arc.action:.12f}   exact {KEPLER_ACTION:.12f}")

    figure, (paths, errors) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for duration in (1.0, 4.0, 7.0):
        path = vi.least_action(
            oscillator, vi.gauss(4), q_start=0.4, q_end=-0.9, duration=duration, steps=200
        )
        paths.plot(path.t, path.q[:, 0], label=f"ωT = {duration:g}, index {path.morse_index}")
    paths.set(xlabel="ωt", ylabel="x", title="Oscillator: one path for each duration")
    paths.legend()
    steps = np.array([4, 6, 8, 12, 16, 24, 32, 48, 64])
    for stages in (1, 2, 3, 4):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # few steps on purpose
            arcs = [vi.least_action(kepler, vi.gauss(stages), steps=int(n), **ends) for n in steps]
        found = [arc.action for arc in arcs]
        error = np.abs(np.array(found) - KEPLER_ACTION)
        errors.loglog(steps, error + 1e-17, "o-", ms=3, label=f"gauss({stages})")
        good = error > 1e-13
        if good[-3:].all():
            order = -np.polyfit(np.log(steps[-3:]), np.log(error[-3:]), 1)[0]
            print(f"order of gauss({stages})           found {order:.2f}   theory {2 * stages}")
    errors.set(
        xlabel="steps", ylabel="error of the action", title="Kepler arc: order 2s", ylim=(1e-16, 1)
    )
    errors.set_xticks([4, 8, 16, 32, 64], ["4", "8", "16", "32", "64"])
    errors.minorticks_off()
    errors.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "exact_actions.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
