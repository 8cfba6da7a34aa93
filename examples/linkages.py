"""Machines with closed loops and one freedom: a slider-crank and two parallelograms in a row.

Claim: bodies and joints suffice, no angle is singled out: the slider-crank has the period of its
energy integral and the joint forces of the balance, and the parallelograms, whose constraints are
dependent where the cranks lie level, run through that position on the parallel branch, as one crank
with ((N+1)/3 + N) θ̈ = ((N+1)/2 + N) g sin θ.
Source: Simeon, Computational Flexible Multibody Dynamics (2013), §1.3; IFToMM Technical Committee
for Multibody Dynamics, benchmark A02. Reference values in extended precision: quadrature and
Jacobi's functions.
Run: python examples/linkages.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RULE = vi.lobatto(5)
TURN = 0.3458046820738877  # of the crank, from its energy integral
AT_50_MS = {
    "crank angle, rad": 1.0674783648568622,
    "slider, m": 0.342043642247426,
    "guide's force, N": 0.9018814842809665,
}
CRANK_AT_4_S, RATE_AT_4_S = 12.684259593513971, 1.076511180085543  # of the parallelograms


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 4, figsize=(16, 4), layout="constrained")
    model = vi.models.slider_crank()
    phi = model.system.q[2]
    motion = vi.simulate(model.system, RULE, **model.start)
    turn = vi.simulate(model.system, RULE, **model.start, until=phi - model.q0[2] - 2 * np.pi)
    print(f"slider-crank: a turn takes, s          found {turn.t[-1]:.13f}   exact {TURN:.13f}")
    there = motion.at([0.05])
    values = there.q[0, 2], there.q[0, 6], there.multipliers[0, 6]
    for (name, exact), value in zip(AT_50_MS.items(), values, strict=True):
        print(f"slider-crank: {name:16} at 50 ms found {value:.13f}   exact {exact:.13f}")
    print(f"slider-crank: energy off by {np.abs(motion.energy - motion.energy[0]).max():.1e} J")
    for k in range(0, 346, 29):
        x1, y1, _, _, _, _, x3, y3, _ = motion.q[k]
        axes[0].plot(
            [0, 2 * x1, x3],
            [0, 2 * y1, y3],
            "o-",
            ms=3,
            lw=1,
            color=plt.get_cmap("viridis")(k / 346),
        )
    axes[0].set(
        aspect="equal", xlabel="x in m", ylabel="y in m", title="Slider-crank during a turn"
    )
    axes[1].plot(
        motion.t,
        motion.multipliers[:, [0, 1, 6]],
        lw=1.2,
        label=["bearing, x", "bearing, y", "guide"],
    )
    axes[1].axvline(TURN, color="0.6", lw=1, ls="--")
    axes[1].set(xlabel="t in s", ylabel="N", title="Forces on crank and slider")
    axes[1].legend(fontsize="small")

    model = vi.models.four_bar(loops=2)
    h, steps = 0.0031, 1300  # no node lies where the linkage folds
    bars = vi.simulate(model.system, RULE, q0=model.q0, v0=model.v0, h=h, steps=steps)
    state = bars.at(4.0)
    angle = np.unwrap(np.arctan2(bars.q[:, 0], bars.q[:, 1]))
    turned = np.arctan2(state.q[0], state.q[1]) + 2 * np.pi * 2
    rate = state.v[0] * state.q[1] - state.v[1] * state.q[0]
    print(f"parallelograms: crank after 4 s, rad   found {turned:.12f}   exact {CRANK_AT_4_S:.12f}")
    print(f"parallelograms: its rate, rad/s        found {rate:.12f}   exact {RATE_AT_4_S:.12f}")
    lag = np.abs(bars.q[:, 2:].reshape(-1, 2, 2) - bars.q[:, None, :2] - [[1, 0], [2, 0]]).max()
    print(f"parallelograms: the other cranks are off the parallel branch by {lag:.1e} m")
    for k in range(0, 627, 57):
        ends = bars.q[k].reshape(3, 2)
        colour = plt.get_cmap("viridis")(k / 627)
        axes[2].plot(*ends.T, "o-", ms=3, lw=1, color=colour)
        for i, (x, y) in enumerate(ends):
            axes[2].plot([i, x], [0, y], lw=0.6, color=colour)
    axes[2].set(
        aspect="equal", xlabel="x in m", ylabel="y in m", title="Two parallelograms, first turn"
    )
    axes[3].plot(bars.t, angle / np.pi)
    axes[3].set(xlabel="t in s", ylabel="crank angle / π", title="Crank of the parallelograms")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "linkages.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
