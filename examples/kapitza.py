"""Kapitza's pendulum stands on its head while its pivot vibrates.

Claim: upside down it is stable where a² Ω² > 2 g ℓ, and swings about the top with the slow
frequency √(a² Ω²/2ℓ² − g/ℓ), to second order in a/ℓ.
Source: Landau & Lifshitz, Mechanics, §30, problem 1; Kapitza 1951.
Run: python examples/kapitza.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
G, LENGTH, AMPLITUDE = 9.81, 1.0, 0.1


def main(out: Path = Path("out")) -> None:
    figure, (rescue, frequency, error) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    limit = np.sqrt(2 * G * LENGTH) / AMPLITUDE
    for factor in (0.9, 1.1, 1.5):
        model = vi.models.kapitza_pendulum(theta0=np.pi - 0.1, Omega=factor * limit)
        motion = vi.simulate(model.system, vi.gauss(3), **model.start | {"duration": 6.0})
        rescue.plot(motion.t, motion.q - np.pi, lw=0.8, label=f"Ω = {factor} √(2gℓ)/a")
    rescue.set(
        xlabel="t in s", ylabel="angle from the top in rad", title="Falls, or stands", ylim=(-1, 1)
    )
    rescue.legend(fontsize="small")

    # the slow frequency from the zeros of a small swing about the top, for smaller and faster
    # vibrations
    gaps = []
    amplitudes = np.array([0.2, 0.1, 0.05, 0.025])
    for amplitude in amplitudes:
        Omega = 6.0 / amplitude
        model = vi.models.kapitza_pendulum(theta0=np.pi - 1e-3, amplitude=amplitude, Omega=Omega)
        period = 2 * np.pi / Omega
        # one node per period of the drive: a pure rotation in (θ, p), whose angle is the slow phase
        strobe = vi.simulate(
            model.system,
            vi.gauss(6),
            q0=model.q0,
            v0=0.0,
            h=period / 30,
            steps=30 * 40,
            save_every=30,
        )
        x = strobe.q[:, 0] - np.pi
        cosine = np.sum((x[2:] + x[:-2]) * x[1:-1]) / (2 * np.sum(x[1:-1] ** 2))
        found = np.arccos(cosine) / period
        theory = vi.models.kapitza_frequency(LENGTH, G, amplitude, Omega)
        gaps.append(abs(found / theory - 1))
        if amplitude <= 0.1:
            print(
                f"slow frequency, a = {amplitude:5.3f} m   found {found:.5f}   theory {theory:.5f}"
            )
        if amplitude == 0.1:
            frequency.plot(strobe.t, x, "o", ms=4, label="once per vibration")
            whole = vi.simulate(
                model.system, vi.gauss(4), q0=model.q0, v0=0.0, h=period / 30, duration=strobe.t[-1]
            )
            frequency.plot(whole.t, whole.q - np.pi, lw=0.6, label="the motion")
    frequency.set(
        xlabel="t in s", ylabel="angle from the top in rad", title="Slow swing and fast ripple"
    )
    frequency.set_ylim(-1.15e-3, 1.6e-3)
    frequency.legend(fontsize="small", loc="upper right")
    error.loglog(amplitudes, gaps, "o-", label="simulated")
    error.loglog(
        amplitudes, gaps[0] * (amplitudes / amplitudes[0]) ** 2, "k--", label="second order"
    )
    error.set_xscale("log", base=2)
    error.set(
        xlabel="amplitude a / ℓ at fixed a Ω",
        ylabel="relative error of the averaged frequency",
        title="Averaging",
    )
    error.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "kapitza.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
