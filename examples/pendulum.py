"""The pendulum at every amplitude: swings, near the top, and full turns.

Claim: the angle is Jacobi's amplitude function of time; the period grows from 2π √(ℓ/g) to infinity
at the separatrix. A rigid body about a fixed axis inclined by α from the vertical is the same
motion with ω² = m g d sin α / I.
Source: Landau & Lifshitz, Mechanics, §11 (period), §32, problem 3 (inclined axis).
Run: python examples/pendulum.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
OMEGA = np.sqrt(9.81)


def measured_period(model: vi.models.Model, rule: vi.Rule) -> float:
    """Period of a pendulum released at rest: four times the time to the lowest point, located on
    the trajectory.
    """
    fall = vi.simulate(
        model.system, rule, q0=model.q0, v0=0.0, h=0.01, steps=2000, until=model.system.q
    )
    return 4 * fall.t[-1]


def main(out: Path = Path("out")) -> None:
    rule = vi.gauss(4)
    amplitudes = np.array([0.1, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.1])
    periods = [measured_period(vi.models.pendulum(theta0=a), rule) for a in amplitudes]
    for amplitude, period in zip(amplitudes, periods, strict=True):
        exact = vi.models.pendulum_period(amplitude, OMEGA)
        print(
            f"period at {amplitude:3.1f} rad              found {period:.12f}   exact {exact:.12f}"
        )

    figure, (curve, phase, error) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    fine = np.linspace(0.01, 3.13, 300)
    curve.plot(fine, [vi.models.pendulum_period(a, OMEGA) for a in fine], label="elliptic integral")
    curve.plot(amplitudes, periods, "o", label=f"simulated, {rule}")
    curve.set(xlabel="amplitude in rad", ylabel="period in s", title="Period")
    curve.legend()

    # swings and full turns of the body on an inclined axis, beside its closed form
    separatrix = 2 * np.sqrt(1.5 * 9.81 * 0.4 * 0.5 / 0.35)
    starts = [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (0.0, 1.01 * separatrix), (0.0, 1.3 * separatrix)]
    for theta0, rate in starts:
        model = vi.models.inclined_axis(theta0=theta0, thetadot0=rate)
        motion = vi.simulate(model.system, rule, **model.start)
        q, _ = model.exact(motion.t)
        folded = np.mod(motion.q[:, 0] + np.pi, 2 * np.pi) - np.pi
        phase.plot(folded, motion.v[:, 0], ".", ms=2)
        error.semilogy(
            motion.t[1:],
            np.abs(motion.q - q)[1:, 0] + 1e-17,
            label=f"θ₀ = {theta0:g}, ω₀ = {rate:.2f}",
        )
    phase.set(xlabel="θ in rad", ylabel="dθ/dt in rad/s", title="Body on an axis inclined by 30°")
    error.set(
        xlabel="t in s", ylabel="|θ − closed form|", title=f"Error of {rule}, h = {model.h:g} s"
    )
    error.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "pendulum.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
