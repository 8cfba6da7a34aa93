"""A free rigid body: steady about two axes, tumbling about the third.

Claim: the angular velocity follows Jacobi's elliptic functions; rotation about the middle axis is
unstable and the body flips over and back at regular intervals (Dzhanibekov's wing nut). Euler
angles about the fixed angular momentum.
Source: Landau & Lifshitz, Mechanics, §37.
Run: python examples/free_body.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
INERTIA = np.array([1.0, 2.0, 3.0])


def main(out: Path = Path("out")) -> None:
    figure = plt.figure(figsize=(13, 4), layout="constrained")
    flips, ball, error = (
        figure.add_subplot(131),
        figure.add_subplot(132, projection="3d"),
        figure.add_subplot(133),
    )
    model = vi.models.free_rigid_body(INERTIA, (0.01, 1.0, 0.01))
    motion = vi.simulate(model.system, vi.gauss(4), **model.start | {"duration": 80.0})
    rates = motion.value(vi.models.body_rates(model.system.q, model.system.v))
    flips.plot(motion.t, rates, lw=1, label=["ω₁", "ω₂", "ω₃"])
    flips.set(
        xlabel="t",
        ylabel="rad per unit of time",
        title="Started about the middle axis",
        ylim=(-1.1, 1.4),
    )
    flips.legend(loc="upper right", fontsize="small", ncols=3)
    q, _ = model.exact(motion.t)
    for k, name in enumerate(("φ", "θ", "ψ")):
        print(
            f"{name} after 80                   found {motion.q[-1, k]:.9f}   exact {q[-1, k]:.9f}"
        )
        error.semilogy(motion.t[1:], np.abs(motion.q - q)[1:, k] + 1e-17, lw=0.8, label=name)
    error.set(xlabel="t", ylabel="|simulated − Jacobi|", title=f"{motion.rule}, h = {motion.h:g}")
    error.legend()
    turn = np.flatnonzero((rates[:-1, 1] > 0) & (rates[1:, 1] <= 0))
    part = rates[turn, 1] / (rates[turn, 1] - rates[turn + 1, 1])
    crossings = motion.t[turn] + part * motion.h
    print(f"time between two flips       found {np.diff(crossings)[0]:.5f}   exact {39.105734:.5f}")

    # the tip of the angular momentum in the body, on the sphere of its length: intersections with
    # energy ellipsoids
    for tilt in np.linspace(0.2, np.pi / 2, 5):
        for axis, side in ((0, 1), (0, -1), (2, 1), (2, -1)):
            spin = np.full(3, 1e-3)
            spin[axis], spin[1] = side * np.sin(tilt), np.cos(tilt)
            start = vi.models.free_rigid_body(INERTIA, spin / np.linalg.norm(spin) / INERTIA)
            path = vi.simulate(
                model.system, vi.gauss(3), q0=start.q0, v0=start.v0, h=0.05, duration=40.0
            )
            tip = path.value(vi.models.body_rates(model.system.q, model.system.v)) * INERTIA
            ball.plot(*tip.T, lw=0.6, color="C0")
    unit = {
        f"{name}{part}": x
        for name in "xyz"
        for part, x in (("lim", (-1, 1)), ("ticks", (-1, 0, 1)))
    }
    ball.set(
        xlabel="L₁", ylabel="L₂", zlabel="L₃", title="Angular momentum seen from the body", **unit
    )
    ball.set_box_aspect((1, 1, 1), zoom=0.9)
    energy, total = motion.energy, motion.value(model.invariants["L²"])
    print(
        f"drift of the energy {np.ptp(energy):.1e}, of L² {np.ptp(total):.1e}, of p_φ "
        f"{np.ptp(motion.p[:, 0]):.1e}"
    )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "free_body.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
