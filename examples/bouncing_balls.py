"""Balls on a floor: elastic and inelastic bounces, infinitely many of them, and a light ball on a
heavy one.

Claim: an impact is located between nodes, so the elastic ball keeps its energy and its rhythm; with
restitution e each impact leaves e² of the energy and the ball rests after √(2h/g) (1 + e)/(1 − e),
a finite time for infinitely many impacts; of two balls of masses 3 : 1 that fall together the lower
one almost stops and the light one rises fourfold.
Source: Goldsmith, Impact (1960), ch. 1; Fetecau, Marsden, Ortiz & West, SIAM J. Appl. Dyn. Syst. 2
(2003) 381.
Run: python examples/bouncing_balls.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
G = 9.81


def two_balls(heavy: float, light: float) -> vi.System:
    """Balls one above the other, of no size: the lower one meets the floor and the upper one."""
    c = vi.Parameters(heavy=heavy, light=light, gravity=G)
    q, v = vi.coordinates("lower", "upper")
    masses = ca.vertcat(c.heavy, c.light)
    lagrangian = ca.dot(masses, v**2) / 2 - c.gravity * ca.dot(masses, q)
    return vi.System(
        q, v, lagrangian, contact=ca.vertcat(q[0], q[1] - q[0]), restitution=1.0, params=c
    )


def main(out: Path = Path("out")) -> None:
    fall = np.sqrt(2 / G)
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")

    model = vi.models.bouncing_ball(restitution=1.0)
    elastic = vi.simulate(model.system, **model.start)
    hits = [event.time for event in elastic.events]
    print(
        f"e = 1: {len(hits)}th impact, s     found {hits[-1]:.12f}   exact "
        f"{(2 * len(hits) - 1) * fall:.12f}"
    )
    print(f"e = 1: energy at the end, J  found {elastic.energy[-1]:.12f}   exact {G:.12f}")

    model = vi.models.bouncing_ball(restitution=0.5)
    motion = vi.simulate(model.system, **model.start)
    impacts = [event for event in motion.events if event.kind == "impact"]
    rests = next(event for event in motion.events if event.kind == "stop")
    print(
        "e = ½: energy left by an impact found "
        f"{impacts[0].energy_after / impacts[0].energy_before:.12f}   exact 0.25"
    )
    print(
        f"e = ½: fifth impact, s       found {impacts[4].time:.12f}   exact "
        f"{fall * (1 + 2 * (1 - 0.5**4)):.12f}"
    )
    print(f"e = ½: the ball rests, s     found {rests.time:.12f}   exact {3 * fall:.12f}")
    print(f"e = ½: the floor carries, N  found {motion.multipliers[-1, 0]:.12f}   exact {G:.12f}")
    print(f"{len(impacts)} impacts, then the ball is at rest")

    # both fall from about 1 m, a millimetre apart: the lower one turns round at the floor and meets
    # the upper one
    apart, speed = 0.001, np.sqrt(2 * G)
    pair = vi.simulate(
        two_balls(3.0, 1.0), q0=[1.0, 1.0 + apart], v0=[0.0, 0.0], h=0.005, duration=1.3
    )
    meet = pair.events[1]
    later = apart / (2 * speed)
    up = 2 * speed - G * later
    height = speed * later - G * later**2 / 2 + up**2 / (2 * G)
    after = pair.at(meet.time + 0.1)  # both fly freely then
    reached = after.q[1] + after.v[1] ** 2 / (2 * G)
    print(f"3 : 1, the balls meet, s     found {meet.time:.12f}   exact {fall + later:.12f}")
    print(f"3 : 1, the upper one rises to found {reached:.12f}   exact {height:.12f}")

    fine = np.linspace(0, 4, 1500)
    axes[0].plot(fine, elastic.at(fine).q, label="e = 1")
    axes[0].plot(fine, motion.at(fine).q, label="e = ½")
    axes[0].axvline(3 * fall, color="0.6", lw=1, ls="--")
    axes[0].set(xlabel="t in s", ylabel="y in m", title="A ball on the floor", ylim=(-0.05, 1.25))
    axes[0].legend(loc="upper right", ncols=2)
    left = 3 * fall - np.array([event.time for event in impacts])
    axes[1].loglog(
        left, [event.energy_before for event in impacts], "o", ms=4, label="before each impact"
    )
    axes[1].loglog(left, G**2 * left**2 / 8, lw=1, label="g² (T − t)²/8")
    axes[1].set(
        xlabel="time left to the rest, s",
        ylabel="energy in J",
        title="Infinitely many impacts, e = ½",
    )
    axes[1].legend()
    axes[2].plot(pair.t, pair.q, label=["mass 3", "mass 1"])
    axes[2].set(xlabel="t in s", ylabel="y in m", title="Two balls fall together")
    axes[2].legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "bouncing_balls.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
