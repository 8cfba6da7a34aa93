"""Central forces: effective potential, a rosette, and the two orbits that close.

Claim: θ is cyclic and p_θ conserved for any V(r); r(t) is the motion in V + p_θ²/2mr²; for V = −k/r
+ b/r² the pericentre turns by 2π (1/γ − 1), γ² = 1 + 2mb/p_θ²; only −k/r and k r²/2 have closed
orbits (Bertrand).
Source: Landau & Lifshitz, Mechanics, §14 and §15, problem 3.
Run: python examples/central_force.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
POTENTIALS = {  # V(r) of potentials that are not scale models of each other
    "−1/r": lambda r, c: -c.k / r,
    "r²/2": lambda r, c: c.k * r**2 / 2,
    "−1/√r": lambda r, c: -c.k / r**0.5,
    "r": lambda r, c: c.k * r,
}


def plane(motion: vi.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    r, theta = motion.q.T
    return r * np.cos(theta), r * np.sin(theta)


def main(out: Path = Path("out")) -> None:
    rule = vi.gauss(6)
    figure, (orbits, rosette, radial) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for name, potential in POTENTIALS.items():
        model = vi.models.central_force(potential, {"k": 1.0}, r0=1.0, thetadot0=0.6)
        motion = vi.simulate(model.system, rule, **model.start)
        print(
            f"p_θ in V = {name:6}: cyclic {model.system.structure.cyclic}, drift "
            f"{np.ptp(motion.p[:, 1]):.1e}"
        )
        orbits.plot(*plane(motion), lw=0.7, label=f"V = {name}")
    orbits.set(
        aspect="equal", xlabel="x", ylabel="y", title="Four central forces", ylim=(-1.1, 1.75)
    )
    orbits.legend(fontsize="small", loc="upper center", ncols=2)

    model = vi.models.rosette()
    motion = vi.simulate(model.system, rule, **model.start)
    period = vi.models.radial_period(motion.energy[0], m=1.0, k=1.0)
    state = motion.at(period)
    print(f"r after one radial period    found {state.q[0]:.12f}   exact {model.q0[0]:.12f}")
    print(
        f"θ after one radial period    found {state.q[1]:.12f}   exact "
        f"{vi.models.apsidal_angle(0.8, 1.0, 0.04):.12f}"
    )
    rosette.plot(*plane(motion), lw=0.7)
    rosette.set(
        aspect="equal", xlabel="x", ylabel="y", title="V = −1/r + 0.04/r²: the ellipse turns"
    )

    reduced = vi.models.radial_motion(
        motion.p[0, 1], lambda r, c: -c.k / r + c.b / r**2, {"k": 1.0, "b": 0.04}, r0=model.q0[0]
    )
    line = vi.simulate(reduced.system, rule, **reduced.start)
    print(
        f"r(20) of the reduced problem found {line.q[-1, 0]:.12f}   exact "
        f"{model.exact(20.0)[0][0, 0]:.12f}"
    )
    shown = motion.t <= 20
    radial.plot(motion.t[shown], motion.q[shown, 0], label="plane motion")
    radial.plot(
        line.t[::40], line.q[::40, 0], "o", ms=3, label="one dimension, effective potential"
    )
    radial.set(xlabel="t", ylabel="r", title="The same r(t)", ylim=(0.4, 1.7))
    radial.legend(fontsize="small", loc="upper left")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "central_force.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
