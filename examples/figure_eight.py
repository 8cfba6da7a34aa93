"""The figure-eight choreography of three bodies, found as a closed path from three sines.

Claim: given its energy the period comes out to 12 digits, given its period the energy; among the
choreographies (a third of the period, then each body takes the next one's place) its action is
least, among all closed paths it is not.
Source: Chenciner & Montgomery, Annals of Mathematics 152 (2000) 881; Simó's initial data, refined
to 24 digits.
Run: python examples/figure_eight.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
ENERGY, PERIOD, ACTION = -1.2871419956318577, 6.325913982926211, 24.427048644537354


def guess(s: np.ndarray) -> np.ndarray:
    """A crude eight: each body a third of the period behind the next."""
    phases = (s + k / 3 for k in range(3))
    return np.stack(
        [x for p in phases for x in (np.sin(2 * np.pi * p), 0.4 * np.sin(4 * np.pi * p))], axis=1
    )


def main(out: Path = Path("out")) -> None:
    bodies, rule = vi.models.figure_eight().system, vi.gauss(6)
    first = guess(np.linspace(0, 1, 60))
    whole = vi.least_action(bodies, rule, energy=ENERGY, steps=60, periodic=True, guess=first)
    print(f"period from the energy      found {whole.duration:.12f}   exact {PERIOD:.12f}")
    turn = np.kron(
        np.roll(np.eye(3), 1, axis=1), np.eye(2)
    )  # each body takes the place of the next
    third = vi.least_action(
        bodies,
        rule,
        duration=PERIOD / 3,
        steps=20,
        periodic=True,
        symmetry=turn,
        guess=guess(np.linspace(0, 1 / 3, 20)),
    )
    print(f"energy from the period      found {third.energy[0]:.12f}   exact {ENERGY:.12f}")
    print(f"action of a period          found {3 * third.action:.12f}   exact {ACTION:.12f}")
    print(
        f"Morse index: {third.morse_index} among choreographies, {whole.morse_index} among closed "
        "paths"
    )
    again = vi.simulate(bodies, rule, q0=whole.q[0], p0=whole.p[0], h=whole.h, steps=60)
    print(f"simulated for a period it closes to {np.abs(again.q[-1] - whole.q[0]).max():.1e}")

    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    axes.plot(*first[:, :2].T, ":", color="gray", label="first guess")
    fine = whole.at(np.linspace(0, whole.duration, 400)).q
    axes.plot(*fine[:, :2].T, label="the orbit of all three")
    for k in range(3):
        axes.plot(*whole.q[0, 2 * k : 2 * k + 2], "o", ms=9)
        axes.quiver(*whole.q[0, 2 * k : 2 * k + 2], *whole.v[0, 2 * k : 2 * k + 2], width=0.004)
    axes.set(aspect="equal", xlabel="x", ylabel="y", title="Figure-eight choreography")
    axes.legend(fontsize="small", loc="upper center")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "figure_eight.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
