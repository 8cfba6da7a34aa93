"""A soliton on Toda's chain of 200 sites.

Claim: exponential springs carry a hump that keeps its shape at the speed sinh κ / κ sites per unit
of time, the faster the narrower; the chain has as many conserved quantities as particles, three of
which are shown.
Source: Toda, Journal of the Physical Society of Japan 22 (1967) 431; Flaschka, Physical Review B 9
(1974) 1924.
Run: python examples/toda_chain.py [folder of the picture]
"""

import sys
from pathlib import Path
from time import perf_counter

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RULE = vi.composition("blanes-moan6")


def place(motion: vi.Trajectory) -> np.ndarray:
    """Site of the hump at every node: the springs' compression has its centre there."""
    squeeze = -np.diff(motion.q, axis=1)
    return squeeze @ np.arange(squeeze.shape[1]) / squeeze.sum(axis=1)


def main(out: Path = Path("out")) -> None:
    began = perf_counter()
    model = vi.models.toda_chain(sites=200, kappa=0.6)
    vi.simulate(model.system, RULE, q0=model.q0, v0=model.v0, h=0.1, steps=1)
    print(f"200 sites: system built and first step made in {perf_counter() - began:.2f} s")

    figure, (humps, path, kept) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for kappa in (0.3, 0.6, 1.0):
        model = vi.models.toda_chain(sites=200, kappa=kappa)
        motion = vi.simulate(model.system, RULE, q0=model.q0, v0=model.v0, h=0.1, duration=50.0)
        q, _ = model.exact(motion.t)
        speed = np.polyfit(motion.t, place(motion), 1)[0]
        print(
            f"speed of the soliton κ = {kappa:3.1f}  found {speed:.9f}   exact "
            f"{np.sinh(kappa) / kappa:.9f}"
        )
        print(f"largest distance from the closed form {np.abs(motion.q - q).max():.1e}")
        path.plot(motion.t, place(motion), label=f"κ = {kappa}")
        if kappa == 0.6:
            for k in range(0, len(motion), 100):
                humps.plot(
                    np.arange(199), -np.diff(motion.q[k]), lw=1, label=f"t = {motion.t[k]:g}"
                )
    humps.set(xlabel="site", ylabel="compression of the spring", title="κ = 0.6 keeps its shape")
    humps.legend(fontsize="small")
    path.set(xlabel="t", ylabel="site of the hump", title="The higher the faster")
    path.legend()

    # two solitons of different height: the overtaking, which the invariants survive
    fast, slow = (
        vi.models.toda_chain(sites=200, kappa=1.0),
        vi.models.toda_chain(sites=200, kappa=0.6),
    )
    start = {
        "q0": fast.q0 + np.roll(slow.q0, 30) + 1.2 * (np.arange(200) < 30),
        "v0": fast.v0 + np.roll(slow.v0, 30),
    }
    both = vi.simulate(
        fast.system,
        RULE,
        **start,
        h=0.05,
        duration=100.0,
        save_every=10,
        params={"shift": -2 * 1.0 - 2 * 0.6},
    )
    for name, expression in fast.invariants.items():
        value = both.value(expression)
        kept.semilogy(both.t[1:], np.abs(value / value[0] - 1)[1:] + 1e-17, lw=0.8, label=name)
        print(f"two solitons: drift of the {name:14} {np.abs(value / value[0] - 1).max():.1e}")
    kept.set(xlabel="t", ylabel="relative change", title="Two solitons pass: invariants")
    kept.set_ylim(top=1e-12)
    kept.legend(fontsize="small", loc="upper right")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "toda_chain.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
