"""Normal modes and what becomes of them: double pendulum, Duffing's backbone, a weight on a spring.

Claim: two equal pendulums hung one from the other have ω² = (2 ∓ √2) g/ℓ; the period of a spring
that hardens falls along its backbone as an elliptic integral does; a bouncing weight begins to
swing where its period is doubled.
Source: Landau & Lifshitz, Mechanics, §23; Nayfeh & Mook, Nonlinear Oscillations, §2.1 and §6.5.
Run: python examples/normal_modes.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def duffing_period(energy: np.ndarray) -> np.ndarray:
    """2π over the arithmetic-geometric mean of √(1 + A²) and √(1 + ½ A²), A the amplitude."""
    square = np.sqrt(1 + 4 * energy) - 1
    a, b = np.sqrt(1 + square), np.sqrt(1 + square / 2)
    for _ in range(8):
        a, b = (a + b) / 2, np.sqrt(a * b)
    return 2 * np.pi / a


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")

    double = vi.models.double_pendulum().system
    modes = vi.orbits.normal_modes(double, [0.0, 0.0])
    print(modes)
    for k, exact in enumerate((2 - np.sqrt(2), 2 + np.sqrt(2))):
        print(f"ω² ℓ/g   found {modes.frequencies[k] ** 2 / 9.81:.12f}   exact {exact:.12f}")
        tree = vi.orbits.family(modes.orbit(k, 0.05), most=12, longest=0.4, bifurcations=False)
        axes[0].plot(tree.energies - tree.energies[0], 2 * np.pi / tree.periods, ".-")
    axes[0].set(xlabel="energy above rest", ylabel="2π / T", title="Modes of the double pendulum")

    duffing = vi.models.duffing().system
    first = vi.orbits.normal_modes(duffing, [0.0]).orbit(0)
    backbone = vi.orbits.family(first, to=3.0)
    exact = duffing_period(backbone.energies)
    print(f"T at E = 3   found {backbone.periods[-1]:.12f}   exact {exact[-1]:.12f}")
    print(f"largest error along the backbone {np.abs(backbone.periods / exact - 1).max():.1e}")
    tops = [np.abs(one.motion.q).max() for one in backbone]
    axes[1].plot(2 * np.pi / backbone.periods, tops, ".-", label="family")
    axes[1].plot(2 * np.pi / exact, tops, lw=0.8, label="elliptic integral")
    axes[1].set(xlabel="2π / T", ylabel="amplitude", title="Duffing's backbone")
    axes[1].legend(fontsize="small")

    spring, stiff = vi.models.spring_pendulum().system, dict(k=36.0)
    [rest] = vi.orbits.equilibria(spring, [0.0, -1.3], params=stiff)
    start = [0.0, rest.q[1] - 0.12]
    bounce = vi.orbits.periodic(spring, (start, [0.0, 0.0]), period=2 * np.pi / 6, params=stiff)
    bouncing = vi.orbits.family(bounce, "k", hold="energy", to=30.0)
    [doubling] = bouncing.bifurcations
    swinging = doubling.branch(0.5)
    ratio = swinging.period / doubling.orbit.period
    print(f"{doubling.kind} at k = {doubling.value:.6f}: longer by   found {ratio:.4f}   theory 2")
    for name, one in (("bouncing", doubling.orbit), ("swinging", swinging)):
        axes[2].plot(*one.motion.q.T, label=name)
    axes[2].set(xlabel="x", ylabel="y", title="A weight on a spring, 1 : 2")
    axes[2].legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "normal_modes.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
