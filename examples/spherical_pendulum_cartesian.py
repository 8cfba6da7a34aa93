"""The spherical pendulum in x, y, z: on a rod, without angles, through the poles.

Claim: with |r|² = ℓ² as constraint no point of the sphere is singular: its azimuth is the angle's,
its height runs between the roots of 2 (E − g z)(1 − z²) = L_z², the rod carries 2E − 3 g z, and a
bob that goes through the lowest and the highest point, where the azimuth jumps, is as accurate as
any other. Energy and L_z are kept.
Source: Landau & Lifshitz, Mechanics, §14, problem 1 (ℓ = m = 1).
Run: python examples/spherical_pendulum_cartesian.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
G, RULE = 9.81, vi.lobatto(5)


def main(out: Path = Path("out")) -> None:
    model = vi.models.spherical_pendulum_cartesian(theta0=1.0, phidot0=2.5)
    motion = vi.simulate(model.system, RULE, **model.start)
    theta, phi = vi.models.spherical_pendulum(theta0=1.0, phidot0=2.5).exact(10.0)[0][0]
    x, y, z = motion.q[-1]
    print(f"height after 10 s, m         found {z:.12f}   exact {-np.cos(theta):.12f}")
    print(f"x after 10 s, m              found {x:.12f}   exact {np.sin(theta) * np.cos(phi):.12f}")
    print(f"y after 10 s, m              found {y:.12f}   exact {np.sin(theta) * np.sin(phi):.12f}")

    energy, spin = motion.energy[0], np.sin(1.0) ** 2 * 2.5
    # (2E − 2gz)(1 − z²) − L² = 2g z³ − 2E z² − 2g z + 2E − L²
    roots = np.sort(np.roots([2 * G, -2 * energy, -2 * G, 2 * energy - spin**2]).real)
    away = vi.simulate(model.system, RULE, q0=model.q0, v0=model.v0, h=0.01, steps=10)
    turn = vi.simulate(
        model.system, RULE, q0=away.q[-1], v0=away.v[-1], h=0.01, steps=500, until=model.system.v[2]
    )
    print(f"other turning height, m      found {turn.q[-1, 2]:.12f}   exact {roots[0]:.12f}")
    tension = -2 * motion.multipliers[:, 0]
    print(
        f"tension after 10 s, N        found {tension[-1]:.10f}   exact "
        f"{2 * energy - 3 * G * z:.10f}"
    )
    for name, expression in model.invariants.items():
        values = motion.value(expression)
        print(f"{name}: changes by {np.abs(values - values[0]).max():.1e}")

    # straight over both poles, in the plane of azimuth 0.3: the plane pendulum that turns over
    heading = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    over = vi.simulate(model.system, RULE, q0=[0, 0, -1], v0=6.6 * heading, h=0.01, duration=10.0)
    plane = vi.models.pendulum_cartesian(theta0=0.0, thetadot0=6.6).exact(over.t)[0]
    exact = plane[:, :1] * heading + plane[:, 1:] * [0, 0, 1]
    print(f"over the poles, x at 10 s, m found {over.q[-1, 0]:.10f}   exact {exact[-1, 0]:.10f}")
    print(f"over the poles, z at 10 s, m found {over.q[-1, 2]:.10f}   exact {exact[-1, 2]:.10f}")

    figure, (above, series, error) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    above.plot(motion.q[:, 0], motion.q[:, 1], lw=0.8)
    above.plot(over.q[:, 0], over.q[:, 1], lw=0.8, label="over the poles")
    above.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Seen from above, 10 s")
    above.set_ylim(top=1.2)
    above.legend(loc="upper right")
    series.plot(motion.t, motion.q[:, 2], label="z in m")
    for root in roots[:2]:
        series.axhline(root, color="0.6", lw=1, ls="--")
    series.plot(motion.t, tension / 50, label="tension in 50 N")
    series.set(xlabel="t in s", title="Height between two circles, and tension")
    series.legend()
    error.semilogy(
        over.t[1:], np.abs(over.q - exact).max(axis=1)[1:] + 1e-17, label="place, over the poles, m"
    )
    error.semilogy(
        motion.t[1:],
        np.abs(motion.energy / energy - 1)[1:] + 1e-17,
        lw=0.7,
        label="energy, relative",
    )
    error.set(xlabel="t in s", title=f"Errors of {RULE}, h = {motion.h:g} s")
    error.set_ylim(top=1e-12)
    error.legend(loc="upper right")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "spherical_pendulum_cartesian.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
