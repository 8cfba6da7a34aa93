"""Particles with pair forces: the figure-eight, two bodies, a small crystal, masses on springs.

Claim: homogeneity of space, isotropy and homogeneity of time keep momentum, angular momentum and
energy, whatever the pair potential; a variational rule keeps the first two to round-off and the
third in bounds.
Source: Landau & Lifshitz, Mechanics, §6–9, §13; Chenciner & Montgomery, Annals of Mathematics 152
(2000) 881.
Run: python examples/many_bodies.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (eight, pair, atoms, kept) = plt.subplots(1, 4, figsize=(16, 4), layout="constrained")
    fine = vi.composition("kahan-li8")

    model = vi.models.figure_eight()
    motion = vi.simulate(model.system, fine, **model.start)
    x, y = motion[200].q[:2], model.q0[2:4]
    print(f"figure-eight after a third   found {x[0]:.12f}   exact {y[0]:.12f}")
    places = motion.q.reshape(len(motion), 3, 2)
    eight.plot(*places[:, 0].T, lw=1)
    eight.plot(*places[0].T, "o")
    eight.set(aspect="equal", xlabel="x", ylabel="y", title="Three bodies on one curve")

    model = vi.models.two_body()
    motion = vi.simulate(model.system, fine, **model.start)
    q, _ = model.exact(motion.t)
    print(f"two bodies, x₁(40)           found {motion.q[-1, 0]:.12f}   exact {q[-1, 0]:.12f}")
    for i, mass in enumerate((3, 1)):
        pair.plot(*motion.q[:, 2 * i : 2 * i + 2].T, lw=0.8, label=f"mass {mass}")
    centre = (3 * motion.q[:, :2] + motion.q[:, 2:]) / 4
    pair.plot(*centre.T, "k--", lw=0.8, label="centre of mass")
    pair.set(aspect="equal", xlabel="x", ylabel="y", title="Kepler ellipses that travel")
    pair.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1, 1))

    crystal = vi.models.lennard_jones(side=4, heat=0.5)
    springs = vi.models.spring_cluster()
    for model, label in ((crystal, "16 atoms"), (springs, "4 masses on springs")):
        motion = vi.simulate(model.system, vi.composition("verlet"), **model.start)
        kept.semilogy(
            motion.t,
            np.abs(motion.energy / motion.energy[0] - 1) + 1e-17,
            lw=0.6,
            label=f"energy, {label}",
        )
        for name in ("momentum", "angular momentum"):
            value = motion.value(model.invariants[name]).reshape(len(motion), -1)
            drift = np.abs(value - value[0]).max()
            print(f"{label:20} drift of the {name:17} {drift:.1e}")
            kept.semilogy(
                motion.t,
                np.abs(value - value[0]).max(axis=1) + 1e-17,
                lw=0.6,
                label=f"{name}, {label}",
            )
        if model is crystal:
            places = motion.q.reshape(len(motion), -1, 2)
            atoms.plot(places[..., 0], places[..., 1], lw=0.5)
            atoms.plot(*places[-1].T, "ko", ms=4)
    atoms.set(aspect="equal", xlabel="x / σ", ylabel="y / σ", title="A crystal that shakes")
    kept.set(xlabel="t", ylabel="change", title="Störmer–Verlet")
    kept.legend(fontsize="x-small", loc="center right")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "many_bodies.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
