"""The heavy symmetric top: its axis nods with loops, cusps or waves.

Claim: φ and ψ are cyclic; cos θ runs between two roots of a cubic, and the sign of φ̇ at the upper
one decides between loops, cusps and waves; the slow precession is w/(I₃ ω₃) for a fast top. With u
= cos θ, energy and momenta give I₁² u̇² = (2 I₁ (E − p_ψ²/2I₃ − w u))(1 − u²) − (p_φ − p_ψ u)²,
which must not be negative: the cubic.
Source: Landau & Lifshitz, Mechanics, §35 and its problems.
Run: python examples/heavy_top.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 4, figsize=(16, 4), layout="constrained")
    starts = (("loops", -0.5), ("cusps", 0.0), ("waves", 0.15))
    for axis, (name, phidot) in zip(axes, starts, strict=False):
        model = vi.models.heavy_top(angles0=(0.0, 0.7, 0.0), rates0=(phidot, 0.0, 12.0))
        motion = vi.simulate(
            model.system, vi.gauss(4), **model.start, events={"turn": model.system.v[1]}
        )
        q, _ = model.exact(motion.t)
        print(f"φ after 10, {name:16} found {motion.q[-1, 0]:.10f}   exact {q[-1, 0]:.10f}")
        p_phi, _, p_psi = motion.p[0]
        inner = motion.energy[0] - p_psi**2 / (2 * 0.5)
        u = np.polynomial.Polynomial([0, 1])
        cubic = 2 * (inner - 2.0 * u) * (1 - u**2) - (p_phi - p_psi * u) ** 2
        edges = np.arccos([root for root in cubic.roots().real if abs(root) < 1])
        turns = [motion.at(event.time).q[1] for event in motion.events]
        for side, found, exact in (
            ("highest", min(turns), edges.min()),
            ("lowest", max(turns), edges.max()),
        ):
            print(f"{side:7} θ of the {name:10}  found {found:.10f}   exact {exact:.10f}")
        phi, theta, _ = motion.q.T
        axis.plot(np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi), lw=0.9)
        turn = np.linspace(0, 2 * np.pi, 200)
        for edge in (theta.min(), theta.max()):
            axis.plot(np.sin(edge) * np.cos(turn), np.sin(edge) * np.sin(turn), "k:", lw=0.7)
        axis.set(
            aspect="equal", xlabel="x", ylabel="y", title=f"Tip of the axis from above: {name}"
        )
        drift = np.abs(motion.p - motion.p[0])[:, [0, 2]].max()
        print(f"drift of p_φ and p_ψ {drift:.1e}")

    # a sleeping top stays upright where I₃² ω₃² > 4 I₁ w: start it close by and see how far it
    # leans
    speeds = np.linspace(2.0, 9.0, 22)
    lean, system = [], vi.models.heavy_top().system  # built once, started many times
    for spin in speeds:
        motion = vi.simulate(
            system, vi.gauss(4), q0=[0.0, 0.02, 0.0], v0=[0.0, 0.0, spin], h=0.02, duration=10.0
        )
        lean.append(motion.q[:, 1].max())
    limit = np.sqrt(4 * 1.0 * 2.0) / 0.5
    axes[3].plot(speeds, lean, "o-", ms=3)
    axes[3].axvline(limit, color="k", ls="--", lw=0.8, label="I₃² ω₃² = 4 I₁ w")
    axes[3].set(xlabel="spin in rad/s", ylabel="largest θ in rad", title="Sleeping top")
    axes[3].legend()

    motion = vi.simulate(
        system, vi.gauss(4), q0=[0.0, 0.7, 0.0], v0=[0.0, 0.0, 200.0], h=0.004, duration=10.0
    )
    rate = motion.q[-1, 0] / motion.t[-1]
    print(f"precession of a fast top     found {rate:.5f}   theory {2.0 / (0.5 * 200.0):.5f}")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "heavy_top.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
