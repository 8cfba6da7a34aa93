"""Least time: bang-bang controls by phases, the brachistochrone, a crane that stops its load.

Claim: phases of constant thrust with free durations give the switching time of the double integrator to round-off;
the wire of fastest descent pushes with a constant factor across the velocity and its time is that of the cycloid.
Source: Pontryagin et al., The Mathematical Theory of Optimal Processes, §5; Bernoulli 1696; Sakawa & Shindo 1982.
Run: python examples/control_fastest.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (plane, wire, crane) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    for x0, v0 in ((2.0, 1.0), (-1.0, 0.0), (-0.5, 2.0), (0.3, -0.4)):
        model = vi.models.fastest_transfer(x0, v0)
        legs = model.solve()
        time = legs[-1].t[-1]
        print(f"least time from ({x0:g}, {v0:g})   found {time:.12f}   exact {model.cost:.12f}")
        for leg, style in zip(legs, ("C0", "C1"), strict=True):
            fine = leg.at(np.linspace(leg.t[0], leg.t[-1], 60))
            plane.plot(fine.q, fine.v, style)
    model = vi.models.fastest_wire()
    fall = model.solve()[0]
    print(f"time on the fastest wire   found {fall.duration:.10f}   exact {model.cost:.10f}")
    points = fall.solution.q(np.linspace(0, 1, 200))
    wire.plot(*points.T, label=f"fastest wire, {fall.duration:.4f} s")
    wire.plot([0, 10], [0, -5], "--", label="straight wire, 2.2580 s")
    load = vi.models.overhead_crane().solve()[0]
    t = np.linspace(0, load.duration, 300)
    crane.plot(load.t, load.q[:, 0], label="trolley, m")
    crane.plot(load.t, load.q[:, 1], label="load, rad")
    crane.plot(t, load.u_at(t) / 6, lw=0.8, label="push / 6 N")
    plane.set(xlabel="x", ylabel="v", title="To rest with |u| ≤ 1: one switch")
    wire.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Brachistochrone")
    crane.set(xlabel="t in s", title=f"Crane, {load.duration:.3f} s")
    wire.legend(fontsize="small")
    crane.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_fastest.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
