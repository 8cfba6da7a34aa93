"""A ladder slides down a smooth wall: when does the wall let go, and what do wall and floor carry
until then?

Claim: wall and floor are unilateral contacts; their multipliers are the reactions, the wall's
changes its sign where sin θ = ⅔ sin θ₀ and the contact opens there, located to round-off;
afterwards the centre moves on with constant speed until the ladder lies on the floor.

Source: Goldstein, Classical Mechanics, 3rd ed., ch. 2; Scholten & Herman, Eur. J. Phys. 33 (2012).

Run: python examples/falling_ladder.py. Writes out/falling_ladder.png.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

OUT = Path("out")


def main() -> None:
    model = vi.models.falling_ladder()
    motion = vi.simulate(model.system, vi.lobatto(4), **model.start)
    c = {name: float(value) for name, value in motion.parameters.items()}
    lets_go, lies = motion.events
    theta0 = model.q0[2]
    whole = c["inertia"] + c["mass"] * c["length"] ** 2 / 4
    speed = c["length"] / 3 * np.sin(theta0)
    speed *= np.sqrt(c["mass"] * c["gravity"] * c["length"] / whole * np.sin(theta0) / 3)
    there = motion.at(lets_go.time)
    print(model.claim)
    print(
        f"sin θ where the wall lets go   found {np.sin(there.q[2]):.12f}   exact "
        f"{2 / 3 * np.sin(theta0):.12f}"
    )
    print(
        f"ẋ after that, m/s              found {motion.at(lies.time - 1e-3).v[0]:.12f}   exact "
        f"{speed:.12f}"
    )
    print(f"the wall lets go at {lets_go.time:.12f} s; it lies at {lies.time:.12f} s")
    print(f"the impact takes {lies.energy_before - lies.energy_after:.4f} J")
    OUT.mkdir(exist_ok=True)
    picture(motion, lets_go.time, lies.time).savefig(OUT / "falling_ladder.png", dpi=150)
    print(f"wrote {OUT / 'falling_ladder.png'}")


def picture(motion: vi.Trajectory, lets_go: float, lies: float) -> plt.Figure:
    """The ladder at equal times, and the reactions."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    half = float(motion.parameters["length"]) / 2
    for time in np.linspace(0, lies, 13):
        x, y, theta = motion.at(time).q
        arm = half * np.array([np.cos(theta), np.sin(theta)])
        left.plot(
            [x - arm[0], x + arm[0]],
            [y + arm[1], y - arm[1]],
            color="C0" if time <= lets_go else "C1",
            lw=1.5,
        )
    left.set(
        aspect="equal",
        xlabel="x / m",
        ylabel="y / m",
        title="On the wall (blue), off the wall (orange)",
    )
    left.axhline(0, color="0.3", lw=1)
    left.axvline(0, color="0.3", lw=1)
    before = motion.t < lies
    for i, name in enumerate(("wall", "floor")):
        right.plot(motion.t[before], motion.multipliers[before, i], label=name)
    right.axvline(lets_go, color="0.6", lw=1, ls="--")
    right.set(xlabel="t / s", ylabel="reaction λ / N", title="Reactions")
    right.legend()
    return figure


if __name__ == "__main__":
    main()
