"""The spherical pendulum: an ellipse that turns.

Claim: p_φ is conserved, θ runs to and fro between two circles, and the figure turns by a fixed
angle per period; for small swings of semi-axes a, b the apsides advance by ⅜ π a b / ℓ² in half a
turn.
Source: Landau & Lifshitz, Mechanics, §14, problem 1; the small advance: Puiseux 1842.
Run: python examples/spherical_pendulum.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def to_next_turning(
    model: vi.models.Model, q: np.ndarray, p: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Time to the next circle θ̇ = 0, and q, p there."""
    away = vi.simulate(model.system, vi.gauss(4), q0=q, p0=p, h=0.005, steps=20)
    rest = vi.simulate(
        model.system,
        vi.gauss(4),
        q0=away.q[-1],
        p0=away.p[-1],
        h=0.005,
        steps=1000,
        until=model.system.v[0],
    )
    return away.duration + rest.duration, rest.q[-1], rest.p[-1]


def one_period(model: vi.models.Model) -> tuple[float, np.ndarray]:
    """Time from the largest θ to the next largest one, and q there."""
    start = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.01, steps=1)
    down, q, p = to_next_turning(model, start.q[0], start.p[0])
    up, q, p = to_next_turning(model, q, p)
    return down + up, q


def main(out: Path = Path("out")) -> None:
    model = vi.models.spherical_pendulum()
    period, q = one_period(model)
    exact = model.exact(period)[0][0]
    print(f"θ after {period:.6f} s           found {q[0]:.12f}   exact {exact[0]:.12f}")
    print(f"φ after {period:.6f} s           found {q[1]:.12f}   exact {exact[1]:.12f}")

    a, b = 0.1, 0.05
    small = vi.models.spherical_pendulum(theta0=a, phidot0=np.sqrt(9.81) * b / a)
    _, q = one_period(small)
    print(
        f"advance of a small ellipse   found {q[1] - np.pi:.6f}   theory "
        f"{3 / 8 * np.pi * a * b:.6f}"
    )

    motion = vi.simulate(model.system, vi.gauss(3), **model.start | {"duration": 40.0})
    theta, phi = motion.q.T
    figure, (above, series, kept) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    above.plot(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), lw=0.7)
    above.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Seen from above, 40 s")
    series.plot(motion.t[:500], theta[:500], label="θ")
    series.set(xlabel="t in s", ylabel="θ in rad", title="Between two circles")
    kept.plot(motion.t, motion.energy / motion.energy[0] - 1, lw=0.7, label="energy")
    kept.plot(motion.t, motion.p[:, 1] / motion.p[0, 1] - 1, lw=0.7, label="p_φ")
    kept.set(xlabel="t in s", ylabel="relative change", title=f"{motion.rule}, h = {motion.h:g} s")
    kept.set_ylim(top=3e-11)
    kept.legend(loc="upper right", ncols=2)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "spherical_pendulum.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
