"""Five ways for a pendulum to go from 0 to 1 rad in ten time units, and what the Morse index says of them.

Claim: there are exactly five paths; two have least action among their neighbours, and the index of each is the number
of conjugate times on the way, where the Jacobi field ∂θ(t)/∂p(0) vanishes.
Source: Milnor, Morse Theory, §15; v(0) of all solutions by elliptic functions and a complete scan.
Run: python examples/pendulum_paths.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt

import varint as vi

plt.style.use("tableau-colorblind10")
SPEEDS = (1.9995687170165601, -1.9987718156357737, -1.9097736918867088, 1.8318277309910875, 1.3287479250456455)


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("theta")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    found = vi.paths(pendulum, vi.gauss(4), q_start=0.0, q_end=1.0, duration=10.0, steps=200, starts=20, spread=3.0)
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for path, speed in zip(found, SPEEDS, strict=True):
        print(f"S = {path.action:+.6f}, index {path.morse_index}: v(0)   found {path.v[0, 0]:.9f}   exact {speed:.9f}")
        line = axes.plot(path.t, path.q[:, 0], label=f"S = {path.action:.3f}, index {path.morse_index}")[0]
        times = path.conjugate_times
        if len(times):
            axes.plot(times, path.at(times).q[:, 0], "o", color=line.get_color())
    print(f"number of paths             found {len(found)}   exact 5")
    axes.set(xlabel="t", ylabel="θ in rad", title="All paths from 0 to 1 in T = 10; dots are conjugate to the start")
    axes.set_ylim(-3.5, 5.2)
    axes.legend(fontsize="small", loc="upper center", ncols=3)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "pendulum_paths.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
