"""How high does a rocket fly? Goddard's problem: a mass that burns, an arc of partial thrust.

Claim: the mass is a state beside the mechanics, collocated at the nodes of the rule; fifty steps of
gauss(2) rise to 1.01283, the height of the COPS test set. Its slices show three arcs: full thrust,
a singular arc, coasting. As phases with free durations these give ten digits, and on the singular
arc drag and weight obey D (1 + v/c) = m g, which nobody told the solver.
Source: Goddard 1919; Dolan, Moré & Munson, Benchmarking optimization software with COPS 3.0, 2004;
Tsien & Evans, Optimum thrust programming for a sounding rocket, 1951.
Run: python examples/control_rocket.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
FULL, SPEED = 3.5, 0.5  # largest thrust, speed of the exhaust; weight and height 1 at the start


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("height")
    thrust, mass = ca.SX.sym("thrust"), ca.SX.sym("mass")
    drag = 310 * v**2 * ca.exp(-500 * (q - 1))
    rocket = vi.System(
        q, v, v**2 / 2 + 1 / q, force=(thrust - drag) / mass, control=ca.vertcat(thrust, mass)
    )
    burning = {mass: -thrust / SPEED}
    start = dict(q=[1], v=[0], states={mass: 1.0})
    end = dict(states={mass: 0.6})
    rough = vi.optimal_control(
        rocket,
        vi.gauss(2),
        duration=vi.free(0.2, 0.05, 0.5),
        steps=50,
        terminal_cost=-q,
        states=burning,
        start=start,
        end=end,
        bounds=[(0, thrust, FULL)],
    )
    print(f"height by one phase    {rough.q[-1, 0]:.7f}, of COPS 1.01283…")

    mean = rough.u[..., 0].mean(axis=1)
    throttled = np.flatnonzero(mean < 0.999 * FULL)[0]
    coasting = np.flatnonzero(mean > 0.001 * FULL)[-1] + 1
    ends = rough.t[[0, throttled, coasting, -1]]

    def arc(k: int, steps: int, low: float, high: float) -> vi.Phase:
        """A phase that starts from its slice of the rough flight."""
        return vi.Phase(
            rocket,
            vi.gauss(5),
            vi.free(ends[k + 1] - ends[k], 0.001, 0.5),
            steps,
            terminal_cost=-q if k == 2 else 0,
            start=start if k == 0 else None,
            end=end if k == 2 else None,
            bounds=[(low, thrust, high)],
            states=burning,
            guess=dict(
                q=lambda t: rough.at(min(t, ends[-1])).q, u=lambda t: rough.u_at(min(t, ends[-1]))
            ),
        )

    legs = vi.optimal_phases([arc(0, 10, FULL, FULL), arc(1, 20, 0, FULL), arc(2, 10, 0, 0)])
    print(f"height by three arcs   {legs[-1].q[-1, 0]:.10f}")
    print("thrust is throttled at {:.7f}, cut off at {:.7f}".format(*(x.t[-1] for x in legs[:2])))
    singular = legs[1]
    weight = singular.stats["states"]["mass"] / singular.q[:, 0] ** 2
    resistance = 310 * singular.v[:, 0] ** 2 * np.exp(-500 * (singular.q[:, 0] - 1))
    law = resistance * (1 + singular.v[:, 0] / SPEED) / weight
    print(f"D (1 + v/c) / (m g) half-way along the singular arc   found {law[10]:.9f}   exact 1")

    figure, (pushes, masses, flight) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    pushes.step(rough.t[:-1], mean, where="post", color="0.7", label="one phase, 50 steps")
    for k, leg in enumerate(legs):
        t = np.linspace(leg.t[0], leg.t[-1], 100)
        pushes.plot(t, leg.u_at(t)[:, 0], f"C{k}")
        masses.plot(leg.t, leg.stats["states"]["mass"], f"C{k}")
        flight.plot(t, leg.at(t).q, f"C{k}", label=("full", "singular", "coasting")[k])
    pushes.set(xlabel="time", ylabel="thrust", title="Three arcs")
    masses.set(xlabel="time", ylabel="mass", title="The mass burns")
    flight.set(xlabel="time", ylabel="distance to the centre", title="Flight")
    pushes.legend(fontsize="small")
    flight.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_rocket.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
