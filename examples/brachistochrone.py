"""The curve of quickest descent and the hanging chain: two classical problems as paths of least and
stationary action.

Claim: with Fermat's Lagrangian and a free duration the action is the time of descent and the curve
a cycloid, to ten digits with ten steps; the hanging chain, with its length as third coordinate and
energy 0, is a catenary. The cycloid is also Huygens' tautochrone: a bead reaches its lowest point
after π √(R/g) from wherever on it it starts.
Source: Johann Bernoulli 1697; chain of the COPS test set (Dolan, Moré & Munson): x(0) = 1, x(1) =
3, length 4. Huygens, Horologium Oscillatorium, 1673.
Run: python examples/brachistochrone.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
CHAIN_ENERGY, TENSION = 5.068480110993415, 0.16369752952483355


def main(out: Path = Path("out")) -> None:
    figure, (descent, tautochrone, chain) = plt.subplots(
        1, 3, figsize=(15, 4.2), layout="constrained"
    )
    s = np.linspace(0, 1, 30)[:, None]
    for far, drop in ((1.0, 1.0), (3.0, 1.0), (np.pi, 2.0)):
        model = vi.models.brachistochrone(far, drop)
        radius, turn = vi.models.cycloid(far, drop)
        deep = np.sqrt(2 * drop)
        path = vi.least_action(
            model.system,
            vi.gauss(4),
            q_start=[0, 0],
            q_end=[far, deep],
            duration=vi.free(1.0, 0.01, 100.0),
            steps=10,
            guess=np.hstack([far * s, deep * np.sqrt(s)]),
        )
        exact = turn * np.sqrt(radius / 9.81)
        print(f"descent to ({far:.3f}, −{drop:g})    found {path.action:.12f}   exact {exact:.12f}")
        angle = np.linspace(0, turn, 200)
        line = descent.plot(radius * (angle - np.sin(angle)), radius * (np.cos(angle) - 1), lw=1)[0]
        descent.plot(path.q[:, 0], -(path.q[:, 1] ** 2) / 2, "o", ms=4, color=line.get_color())
    descent.set(
        aspect="equal",
        xlabel="x in m",
        ylabel="height in m",
        title="Quickest descent: nodes on cycloids",
    )

    # a bead on the cycloid of radius 1 m: T = R²(1 − cos φ) φ̇², V = −g R (1 − cos φ)
    phi, phidot = vi.coordinates("phi")
    bead = vi.System(phi, phidot, (1 - ca.cos(phi)) * (phidot**2 + 9.81))
    for start in (0.5, 1.5, 2.5):
        fall = vi.simulate(
            bead, vi.gauss(4), q0=start, v0=0.0, h=0.005, steps=400, until=phi - np.pi
        )
        print(
            f"fall to the lowest point    found {fall.t[-1]:.10f}   exact "
            f"{np.pi / np.sqrt(9.81):.10f}"
        )
        tautochrone.plot(fall.t, fall.q[:, 0], label=f"from φ = {start:g}")
    tautochrone.axhline(np.pi, color="k", ls=":", lw=0.8)
    tautochrone.set(xlabel="t in s", ylabel="φ in rad", title="Tautochrone: all arrive together")
    tautochrone.legend(fontsize="small")

    system = vi.models.catenary().system
    for length in (2.5, 3.0, 4.0):
        path = vi.least_action(
            system,
            vi.gauss(6),
            q_start=[0, 1, 0],
            q_end=[1, 3, length],
            energy=0.0,
            duration=vi.free(2.0, 0.01, 100),
            steps=60,
        )
        chain.plot(path.q[:, 0], path.q[:, 1], label=f"length {length:g}")
    print(f"potential energy            found {path.action:.12f}   exact {CHAIN_ENERGY:.12f}")
    print(f"horizontal tension          found {path.v[30, 0]:.12f}   exact {TENSION:.12f}")
    chain.set(aspect="equal", xlabel="x", ylabel="y", title="Hanging chains")
    chain.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "brachistochrone.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
