"""The many ways to swing up a pendulum: local minima by multi-start, and orders of the double
integrator's cost.

Claim: from 24 random starts the swing-up in 3 s has several local minima, the cheapest
36.6402890624; Fatrop on the chain of stages finds what Ipopt finds; constant controls of the double
integrator cost 12 N²/(N² − 1) exactly.
Source: Ober-Blöbaum, Junge, Marsden, ESAIM: COCV 17 (2011) 322; Bryson & Ho, Applied Optimal
Control, §2.3.
Run: python examples/control_minima.py [folder of the picture and the film]
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
CHEAPEST = 36.6402890624


def main(out: Path = Path("out")) -> None:
    model = vi.models.swing_up_pendulum()
    [phase] = model.phases
    found = vi.multistart(phase, 24, spread=2.0)
    print(f"cheapest swing-up   found {found[0].cost:.9f}   exact {CHEAPEST:.9f}")
    for motion in found:
        print(
            f"  J = {motion.cost:12.6f} from {motion.stats['found']} starts, "
            f"{np.ptp(motion.q) / np.pi:.3f} half turns"
        )
    [staged] = vi.optimal_phases([phase], solver="fatrop")
    print(f"the same by Fatrop   found {staged.cost:.9f}   exact {CHEAPEST:.9f}")
    [rest] = vi.models.rest_to_rest().phases
    errors = []
    for n in (5, 10, 20, 40, 80):
        [held] = vi.optimal_phases([replace(rest, rule=vi.midpoint(), steps=n)])
        errors.append(held.cost / 12 - 1)
        print(
            f"J_{n} with constant controls   found {held.cost:.12f}   exact "
            f"{12 * n**2 / (n**2 - 1):.12f}"
        )
    figure, (swing, torque, cost) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    t = np.linspace(0, phase.duration, 400)
    for motion in found[:5]:
        swing.plot(motion.t, motion.q, label=f"J = {motion.cost:.2f}")
        torque.plot(t, motion.u_at(t), lw=1)
    for turn in (-1, 1):
        swing.axhline(turn * np.pi, color="k", lw=0.5)
    cost.loglog([5, 10, 20, 40, 80], errors, "o-", label="J_N / 12 − 1")
    cost.loglog([5, 80], [1 / 24, 1 / 6399], "k--", lw=0.8, label="1 / (N² − 1)")
    swing.set(xlabel="t in s", ylabel="θ in rad", title="Local minima of the swing-up")
    torque.set(xlabel="t in s", ylabel="torque in N m", title="Their controls")
    cost.set_xscale("log", base=2)
    cost.set(xlabel="steps N", title="Double integrator, constant controls")
    for axes in (swing, cost):
        axes.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_minima.png", dpi=120)
    dearest = found[min(len(found), 4) - 1]
    dearest.animate(out / "control_minima.gif", sketch=vi.models.sketch(model), fps=20)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
