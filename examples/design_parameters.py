"""Designs as unknowns of an optimum: a counterweight, a spring and the angle of a throw.

Claim: free parameters of a scene are found together with the control, at the closed forms: the
counterweight M (g² T − 12 d²/T³) / (g² T + 12 d²/T³) that lifts a load with least ∫ u² dt, the
spring m (π/T)² that swings a mass over without a push, the angle arctan(v / √(v² + 2 g h)) that
throws farthest; and so are the changes of the best design with what was given.
Source: the closed forms by the calculus of variations; Fiacco, Introduction to Sensitivity and
Stability Analysis in Nonlinear Programming (1983), §3.2.
Run: python examples/design_parameters.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
G = 9.81


def lift(load: float, counter: float | None = None) -> vi.Trajectory:
    """A load with a counterweight over a pulley: 2 m up from rest to rest in 1.5 s."""
    q, v = vi.coordinates("height")
    u, c = ca.SX.sym("pull"), vi.Parameters(load=1.0, counter=1.0)
    lagrangian = (c.load + c.counter) * v**2 / 2 - (c.load - c.counter) * G * q
    system = vi.System(q, v, lagrangian, force=u, control=u, params=c)
    return vi.optimal_control(
        system,
        duration=1.5,
        steps=6,
        cost=u**2,
        start=dict(q=[0], v=[0]),
        end=dict(q=[2], v=[0]),
        params=dict(load=load, counter=vi.free(1.0, 0.0, 50.0) if counter is None else counter),
    )


def swing() -> vi.Trajectory:
    """A mass on a spring from one side to the other in 0.8 s."""
    q, v = vi.coordinates("x")
    u, c = ca.SX.sym("push"), vi.Parameters(mass=2.0, rate=1.0)
    system = vi.System(q, v, c.mass * v**2 / 2 - c.rate * q**2 / 2, force=u, control=u, params=c)
    ends = dict(start=dict(q=[1], v=[0]), end=dict(q=[-1], v=[0]))
    rate = dict(rate=vi.free(5.0, 0.0, 1e3))
    return vi.optimal_control(
        system, vi.gauss(4), duration=0.8, steps=10, cost=u**2, params=rate, **ends
    )


def throw(height: float) -> vi.Trajectory:
    """A ball from a tower at 12 m/s, as far as it goes."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(angle=0.5)
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], params=c)
    off = v - 12 * ca.vertcat(ca.cos(c.angle), ca.sin(c.angle))
    return vi.optimal_control(
        ball,
        duration=vi.free(1.0, 0.1, 5.0),
        steps=8,
        terminal_cost=-q[0],
        start=dict(q=[0, height], bounds=[(0, off[0], 0), (0, off[1], 0)]),
        end=dict(q=[None, 0.0]),
        params=dict(angle=vi.free(0.5, 0.0, 1.5)),
    )


def main(out: Path = Path("out")) -> None:
    best, move, hold = lift(3.0), 12 * 2**2 / 1.5**3, G**2 * 1.5
    ratio = (hold - move) / (hold + move)
    print(f"counterweight   found {best.parameters['counter']:.9f}   exact {3 * ratio:.9f}")
    slope = best.solution.sensitivity("load").parameters[1, 0]
    print(f"its change with the load   found {slope:.9f}   exact {ratio:.9f}")
    over = swing()
    print(f"spring rate   found {over.parameters['rate']:.6f}   exact {2 * (np.pi / 0.8) ** 2:.6f}")
    thrown = [throw(height) for height in (0.0, 3.0, 10.0)]
    angle = np.arctan(12 / np.sqrt(144 + 2 * G * 10))
    print(f"angle from 10 m   found {thrown[-1].parameters['angle']:.9f}   exact {angle:.9f}")
    figure, (cost, path, arcs) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    weights = np.linspace(0, 6, 13)
    cost.plot(weights, [lift(3.0, float(x)).cost for x in weights], lw=1.2)
    cost.plot(float(best.parameters["counter"]), best.cost, "o")
    cost.set(xlabel="counterweight in kg", ylabel="∫ u² dt", title="Least effort to lift 3 kg")
    fine = over.at(np.linspace(0, 0.8, 200))
    path.plot(fine.t, fine.q[:, 0], lw=1.2, label="x")
    path.plot(over.t[:-1], over.u.mean(axis=1)[:, 0], lw=1.2, label="push")
    path.set(xlabel="t in s", title="The spring that needs no push")
    path.legend(fontsize="small")
    for motion in thrown:
        fine = motion.at(np.linspace(0, motion.t[-1], 100))
        degrees = np.degrees(motion.parameters["angle"].item())
        arcs.plot(*fine.q.T, lw=1.2, label=f"{degrees:.1f}°")
    arcs.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Farthest throws")
    arcs.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "design_parameters.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
