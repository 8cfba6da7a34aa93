"""Bodies that slide without friction: a pendulum on a free support, and a block on a free wedge.

Claim: nothing pushes sideways, so p_X stays what it was, exactly and with any variational rule; it
reduces the pendulum to one quadrature, which gives its period, and the block to uniform
acceleration. Small swings on the free support are faster than on a fixed one, by √(1 + m/M): ω² = g
(M + m)/(M ℓ), as the support gives way.
Source: Landau & Lifshitz, Mechanics, §5, problem 2 and §14, problem 3.
Run: python examples/sliding_bodies.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    model = vi.models.sliding_support(theta0=2.6, Xdot0=0.0, M=0.5, m=1.5)
    motion = vi.simulate(model.system, vi.gauss(4), **model.start | {"h": 0.005})
    X, theta = motion.q.T
    bob = np.stack([X + np.sin(theta), -np.cos(theta)])

    fall = vi.simulate(
        model.system,
        vi.gauss(4),
        q0=model.q0,
        v0=model.v0,
        h=0.01,
        steps=1000,
        until=model.system.q[1],
    )
    exact = vi.models.sliding_support_period(2.6, M=0.5, m=1.5, length=1.0, g=9.81)
    print(f"period of the pendulum       found {4 * fall.t[-1]:.12f}   exact {exact:.12f}")
    print(f"largest |p_X|, exactly zero  {np.abs(motion.p[:, 0]).max():.1e}")

    for mass in (0.5, 5.0):  # a quarter of a small swing, for a light and a heavy support
        small = vi.simulate(
            model.system,
            vi.gauss(4),
            q0=[0.0, 1e-4],
            v0=[0.0, 0.0],
            h=0.01,
            steps=200,
            until=model.system.q[1],
            params={"M": mass},
        )
        theory = np.pi / 2 / np.sqrt(9.81 * (mass + 1.5) / mass)
        print(
            f"quarter of a small swing, M = {mass:g}  found {small.t[-1]:.9f}   exact {theory:.9f}"
        )

    wedge = vi.models.block_on_wedge()
    slide = vi.simulate(wedge.system, vi.midpoint(), **wedge.start)
    q, _ = wedge.exact(slide.t)
    for name, found, want in zip(
        ("wedge", "block down the wedge"), slide.q[-1], q[-1], strict=True
    ):
        print(f"way of the {name:20} found {found:.12f}   exact {want:.12f}")

    figure, (scene, series, rates) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    scene.plot(*bob, lw=0.8)
    for k in range(0, 240, 24):
        scene.plot([X[k], bob[0, k]], [0, bob[1, k]], "-", color="0.6", lw=0.8)
    scene.plot(X[:240:24], np.zeros(10), "s", ms=6)
    scene.set(
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
        title="Path of the bob on its light support",
    )
    series.plot(motion.t[:1600], X[:1600], label="support X")
    series.plot(motion.t[:1600], bob[0, :1600], label="bob x")
    series.plot(motion.t[:1600], (0.5 * X + 1.5 * bob[0])[:1600] / 2, "k--", label="centre of mass")
    series.set(xlabel="t in s", ylabel="m", title="The centre of mass stays above one point")
    series.legend()
    found = np.abs(motion.q - model.exact(motion.t)[0])
    rates.semilogy(motion.t[1:], found[1:] + 1e-17, label=["X", "θ"])
    rates.set(
        xlabel="t in s",
        ylabel="|simulated − quadrature|",
        title=f"{motion.rule}, h = {motion.h:g} s",
    )
    rates.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "sliding_bodies.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
