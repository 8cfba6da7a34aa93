"""A magnetic mirror: the whole orbit, and its guiding centre with steps as long as a gyration.

Claim: the magnetic moment μ = m v⊥²/2B is adiabatically conserved, so the particle turns back where
B = v²/v⊥² B₀; the guiding centre, a degenerate Lagrangian (e A + m w b)·ṙ − H, follows it to first
order in the gyroradius.
Source: Northrop, The Adiabatic Motion of Charged Particles, 1963; Littlejohn, Journal of Plasma
Physics 29 (1983) 111.
Run: python examples/magnetic_mirror.py [folder of the picture]
"""

import sys
import warnings
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
B0, ACROSS, ALONG = 40.0, 0.6, 0.5


def main(out: Path = Path("out")) -> None:
    radius = ACROSS / B0
    model = vi.models.magnetic_mirror(q0=(0.1 - radius, 0, 0), v0=(0, ACROSS, ALONG), B0=B0)
    motion = vi.simulate(
        model.system, vi.gauss(4), q0=model.q0, v0=model.v0, h=0.002, duration=16.0
    )
    s, c = model.system, model.system.params
    x, y, z = ca.vertsplit(s.q)
    field = c.B0 * ca.vertcat(-z * x / c.L**2, -z * y / c.L**2, 1 + (z / c.L) ** 2)
    size = ca.norm_2(field)
    moment = motion.value(c.m * (ca.sumsqr(s.v) - (ca.dot(s.v, field) / size) ** 2) / (2 * size))

    turning = motion.q[:, 2].max()
    print(f"turns back at z              found {turning:.4f}   theory {ALONG / ACROSS:.4f}")
    print(
        f"mean magnetic moment         found {moment.mean():.6f}   theory {ACROSS**2 / 2 / B0:.6f}"
    )
    p_phi = motion.value(model.invariants["p_phi"])
    print(f"drift of p_φ {np.ptp(p_phi):.1e}, of the kinetic energy {np.ptp(motion.energy):.1e}")

    centre = vi.models.guiding_centre(parallel=ALONG, moment=ACROSS**2 / 2 / B0, B0=B0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it says that the Lagrangian is degenerate: it is
        slow = vi.simulate(centre.system, vi.midpoint(), q0=centre.q0, h=0.2, duration=16.0)
    gyration = 2 * np.pi / B0
    print(
        f"a gyration takes {gyration / slow.h:.1f} steps of the centre, {gyration / motion.h:.0f} "
        "of the particle"
    )

    figure, (path, bounce, kept) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    path.plot(motion.q[:, 2], motion.q[:, 0], lw=0.4, label="particle")
    path.plot(slow.q[:, 2], slow.q[:, 0], lw=1.2, label="guiding centre")
    path.set(xlabel="z", ylabel="x", title="From the side")
    path.legend()
    bounce.plot(motion.t, motion.q[:, 2], label="particle")
    bounce.plot(slow.t, slow.q[:, 2], "o", ms=3, label="guiding centre, every step")
    bounce.axhline(ALONG / ACROSS, color="k", ls=":", lw=0.8)
    bounce.set(xlabel="t", ylabel="z", title="Bounce", ylim=(-1, 1.4))
    bounce.legend(fontsize="small", loc="upper right")
    kept.plot(motion.t, moment / moment.mean(), lw=0.4)
    kept.set(xlabel="t", ylabel="μ / mean", title="Magnetic moment: adiabatic invariant")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "magnetic_mirror.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
