"""Five ways for a pendulum to go from 0 to 1 rad in ten time units, and what the Morse index says
of them.

Claim: there are exactly five paths; two have least action among their neighbours, and the index of
each is the number of conjugate times on the way, where the Jacobi field ∂θ(t)/∂p(0) vanishes. As
S(T) solves the Hamilton–Jacobi equation, ∂S/∂T = −H along each family of paths. Shooting shows why
there are five: θ(T) as a function of v(0) takes the value 1 that often, and the slope at each
crossing is the Jacobi field at T, negative where the index is odd. (Faster starts go over the top
and do not come back.)
Source: Milnor, Morse Theory, §15; v(0) of all solutions by elliptic functions and a complete scan.
Run: python examples/pendulum_paths.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
SPEEDS = (
    1.9995687170165601,
    -1.9987718156357737,
    -1.9097736918867088,
    1.8318277309910875,
    1.3287479250456455,
)


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    found = vi.paths(
        pendulum,
        vi.gauss(4),
        q_start=0.0,
        q_end=1.0,
        duration=10.0,
        steps=200,
        starts=20,
        spread=3.0,
    )
    figure, (axes, shooting) = plt.subplots(1, 2, figsize=(13, 4.5), layout="constrained")
    for path, speed in zip(found, SPEEDS, strict=True):
        print(
            f"S = {path.action:+.6f}, index {path.morse_index}: v(0)   found {path.v[0, 0]:.9f}   "
            f"exact {speed:.9f}"
        )
        line = axes.plot(
            path.t, path.q[:, 0], label=f"S = {path.action:.3f}, index {path.morse_index}"
        )[0]
        times = path.conjugate_times
        near = [
            vi.least_action(
                pendulum, vi.gauss(4), q_start=0.0, q_end=1.0, duration=t, steps=200, guess=path.q
            ).action
            for t in (9.999, 10.001)
        ]
        print(f"  conjugate times           found {len(times)}   exact {path.morse_index}")
        print(
            f"  H = −∂S/∂T                found {(near[0] - near[1]) / 0.002:.6f}   exact "
            f"{path.energy[0]:.6f}"
        )
        shooting.plot(path.v[0, 0], 1.0, "o", color=line.get_color())
        if len(times):
            axes.plot(times, path.at(times).q[:, 0], "o", color=line.get_color())
    print(f"number of paths             found {len(found)}   exact 5")
    fan = vi.ensemble(
        pendulum, vi.gauss(4), q0=0.0, v0=np.linspace(-2.3, 2.3, 461)[:, None], h=0.05, steps=200
    )
    shooting.plot(fan.v[:, 0, 0], fan.q[:, -1, 0], "k", lw=0.8, zorder=0)
    above = fan.q[:, -1, 0] > 1.0
    print(
        f"crossings of θ(10) = 1      found {np.count_nonzero(above[1:] != above[:-1])}   exact 5"
    )
    shooting.axhline(1.0, color="gray", ls=":")
    shooting.set(
        xlabel="v(0) in rad per unit of time",
        ylabel="θ(10) in rad",
        title="Where each start ends",
        ylim=(-6, 8),
    )
    axes.set(
        xlabel="t",
        ylabel="θ in rad",
        title="All paths from 0 to 1 in T = 10; dots are conjugate to the start",
    )
    axes.set_ylim(-3.5, 5.2)
    axes.legend(fontsize="small", loc="upper center", ncols=3)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "pendulum_paths.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
