"""Double and longer pendulums: regular, chaotic, and both without energy drift.

Claim: two starts 1e-8 rad apart stay together in small swings and part exponentially in large ones;
a symplectic rule keeps the energy in bounds in both. Small swings of N equal links have ω² = N g x
/ ℓ, x the zeros of Laguerre's L_N.
Source: Landau & Lifshitz, Mechanics, §5, problem 1; Braun, European Journal of Physics 24 (2003)
523.
Run: python examples/double_pendulum.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def small_frequencies(model: vi.models.Model) -> np.ndarray:
    """Frequencies about the hanging position, from the second derivatives of L."""
    s = model.system
    mass, stiffness = s.mass_matrix, -ca.hessian(s.lagrangian, s.q)[0]
    both = ca.Function("linear", [s.q, s.v, s.c], [mass, stiffness])(0, 0, s.default_vector)
    return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(*(x.full() for x in both))).real))


def main(out: Path = Path("out")) -> None:
    chain = vi.models.chain_pendulum(links=5)
    zeros = np.polynomial.laguerre.lagroots([0, 0, 0, 0, 0, 1])
    for found, x in zip(small_frequencies(chain), zeros, strict=True):
        print(
            f"frequency of five links, 1/s   found {found:.12f}   exact "
            f"{np.sqrt(5 * 9.81 * x):.12f}"
        )

    rule = vi.gauss(3)
    figure, (path, parting, energy) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for name, theta in (("regular", (0.4, -0.3)), ("chaotic", (2.2, 2.6))):
        model = vi.models.double_pendulum(theta=theta)
        a = vi.simulate(model.system, rule, **model.start | {"h": 0.005})
        b = vi.simulate(
            model.system, rule, **model.start | {"h": 0.005, "q0": np.add(model.q0, [1e-8, 0])}
        )
        parting.semilogy(a.t, np.abs(a.q - b.q).max(axis=1), label=name)
        energy.semilogy(
            a.t,
            np.abs(a.energy - a.energy[0]) / (3 * 9.81) + 1e-17,
            lw=0.5,
            label=f"{name}, {rule}",
        )
        if name == "chaotic":
            x = np.cumsum(np.sin(a.q), axis=1)
            y = -np.cumsum(np.cos(a.q), axis=1)
            path.plot(x[:3000, 1], y[:3000, 1], lw=0.6)
            path.plot([0, *x[3000]], [0, *y[3000]], "ko-", lw=1.5)
    five = vi.simulate(chain.system, rule, **chain.start)
    energy.semilogy(
        five.t,
        np.abs(five.energy - five.energy[0]) / 9.81 + 1e-17,
        lw=0.5,
        label=f"five links, {rule}",
    )
    path.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Path of the lower mass, 15 s")
    parting.set(
        xlabel="t in s", ylabel="distance of two starts in rad", title="1e-8 rad apart at first"
    )
    energy.set(
        xlabel="t in s", ylabel="|H − H₀| / weight of the masses at 1 m", title="Energy error"
    )
    parting.legend()
    energy.set_ylim(top=1e-5)
    energy.legend(loc="upper left", fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "double_pendulum.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
