"""The chain of Fermi, Pasta, Ulam and Tsingou with stiff springs: three time scales in one motion.

Claim: the stiff springs (ω = 50) exchange energy on the slow scale ω, while the sum of their
energies, an adiabatic invariant, and the total energy stay in bounds.
Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, I.5.1, Fig. 5.2; reference state
by a Taylor series integration in extended precision.
Run: python examples/fpu_chain.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
PUBLISHED = (
    0.9560651195736717,
    0.025680529673988005,
    0.00019833351514083212,
)  # I₁, I₂, I₃ at t = 10


def main(out: Path = Path("out")) -> None:
    model = vi.models.fpu_chain()
    stiff = vi.models.fpu_stiff_energies(model)
    fine = vi.simulate(
        model.system, vi.composition("kahan-li8"), q0=model.q0, v0=model.v0, h=0.002, duration=10.0
    )
    for j, (found, exact) in enumerate(zip(fine.value(stiff)[-1], PUBLISHED, strict=True)):
        print(f"I_{j + 1} at t = 10                 found {found:.12f}   exact {exact:.12f}")

    figure, (energies, total, steps) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    rule = vi.composition("blanes-moan4")
    motion = vi.simulate(model.system, rule, q0=model.q0, v0=model.v0, h=0.01, duration=200.0)
    each = motion.value(stiff)
    energies.plot(motion.t, each, lw=0.6, label=["I₁", "I₂", "I₃"])
    energies.plot(motion.t, each.sum(axis=1), "k", lw=0.6, label="I₁ + I₂ + I₃")
    energies.set(xlabel="t", ylabel="energy of a stiff spring", title=f"{rule}, h = {motion.h:g}")
    energies.set_ylim(top=1.35)
    energies.legend(
        fontsize="small", loc="upper center", ncols=4, columnspacing=0.8, handlelength=1.2
    )
    mean = each.sum(axis=1)
    print(f"mean of I over 200           found {mean.mean():.4f}   theory {mean[0]:.4f}")

    for h in (0.02, 0.01, 0.005):
        motion = vi.simulate(
            model.system, vi.composition("verlet"), q0=model.q0, v0=model.v0, h=h, duration=200.0
        )
        error = motion.energy / motion.energy[0] - 1
        total.plot(motion.t, error, lw=0.3, label=f"h = {h}, hω = {50 * h:g}")
    total.set(xlabel="t", ylabel="H/H₀ − 1", title="Störmer–Verlet: bounded up to hω = 2")
    total.set_ylim(top=0.125)
    total.legend(fontsize="small", loc="upper right")

    for rule in (
        vi.composition("verlet"),
        vi.midpoint(),
        vi.gauss(2),
        vi.composition("blanes-moan4"),
    ):
        sizes, errors = np.array([0.02, 0.01, 0.005, 0.0025]), []
        for h in sizes:
            run = vi.simulate(model.system, rule, q0=model.q0, v0=model.v0, h=h, duration=10.0)
            errors.append(np.abs(run.q[-1] - fine.q[-1]).max())
        steps.loglog(sizes * 50, errors, "o-", label=f"{rule}")
    steps.set_xscale("log", base=2)
    steps.set(xlabel="hω", ylabel="error of q at t = 10", title="Error against the stiff frequency")
    steps.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "fpu_chain.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
