"""Least time: bang-bang controls by phases, the brachistochrone, a crane that stops its load.

Claim: phases of constant thrust with free durations give the switching time of the double
integrator to round-off; the wire of fastest descent pushes with a constant factor across the
velocity and its time is that of the cycloid. The switches lie on the parabola x = −v|v|/2, from
which a last push of full strength leads to rest at the origin. A bead on a straight wire, uniformly
accelerated, is half a second later. The crane's load hangs still at the end.
Source: Pontryagin et al., The Mathematical Theory of Optimal Processes, §5; Bernoulli 1696; Sakawa
& Shindo 1982.
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
        x, v = legs[-1].q[0, 0], legs[-1].v[0, 0]
        print(f"  x at the switch          found {x:.12f}   exact {-v * abs(v) / 2:.12f}")
        for leg, style in zip(legs, ("C0", "C1"), strict=True):
            fine = leg.at(np.linspace(leg.t[0], leg.t[-1], 60))
            plane.plot(fine.q, fine.v, style)
    speed = np.linspace(-2, 2.2, 200)
    plane.plot(-speed * np.abs(speed) / 2, speed, "k:", lw=1, label="x = −v|v|/2")
    model = vi.models.fastest_wire()
    fall = model.solve()[0]
    print(f"time on the fastest wire   found {fall.duration:.10f}   exact {model.cost:.10f}")
    s, sdot = vi.coordinates(
        "s"
    )  # the way along the straight wire of length √125, steeper by 5 m on 10 m
    bead = vi.System(s, sdot, sdot**2 / 2 + 9.81 * s / np.sqrt(5))
    straight = vi.simulate(bead, q0=0.0, v0=0.0, h=0.01, steps=400, until=s - np.sqrt(125)).t[-1]
    print(f"time on a straight wire    found {straight:.10f}   exact {np.sqrt(50 / 9.81):.10f}")
    points = fall.solution.q(np.linspace(0, 1, 200))
    wire.plot(*points.T, label=f"fastest wire, {fall.duration:.4f} s")
    wire.plot([0, 10], [0, -5], "--", label=f"straight wire, {straight:.4f} s")
    load = vi.models.overhead_crane().solve()[0]
    print(
        f"load and its rate at the end of the crane's way: {load.q[-1, 1]:.1e} rad, "
        f"{load.v[-1, 1]:.1e} rad/s"
    )
    t = np.linspace(0, load.duration, 300)
    crane.plot(load.t, load.q[:, 0], label="trolley, m")
    crane.plot(load.t, load.q[:, 1], label="load, rad")
    crane.plot(t, load.u_at(t) / 6, lw=0.8, label="push / 6 N")
    plane.set(xlabel="x", ylabel="v", title="To rest with |u| ≤ 1: one switch")
    wire.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Brachistochrone")
    crane.set(xlabel="t in s", title=f"Crane, {load.duration:.3f} s")
    plane.legend(fontsize="small")
    wire.legend(fontsize="small")
    crane.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_fastest.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
