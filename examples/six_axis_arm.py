"""A six-axis arm from its URDF: in least time past a ball, and with least effort.

Claim: nobody writes the Lagrangian of such an arm, `from_urdf` does. Its fastest way from rest to
rest keeps all limits of torque and speed and leaves the ball alone; it cannot be faster than the
first axis, whose torque speeds it up as far as its limit of speed lets it. The way of least effort
takes the time that it is given. As the arm starts and ends at rest in the same height, its motors
do no work in all, whatever the way.
Source: Bobrow, Dubowsky & Gibson, Int. J. Robotics Research 4 (1985) 3; Craig, Introduction to
Robotics, 4th ed., §6.
Run: python examples/six_axis_arm.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi
import varint.multibody as mb

plt.style.use("tableau-colorblind10")
URDF = Path(__file__).parent / "six_axis_arm.urdf"
RULE, STEPS = vi.gauss(3), 16
BALL, RADIUS, SLOWER = np.array([0.68, 0.1, 0.28]), 0.2, 1.1
START = np.array([-0.9, -1.0, 1.2, -1.8, -1.57, 0.0])
END = START + 1.8 * np.eye(6)[0]


def plans():
    """The arm, its fastest way past the ball, and the one of least effort in a given time."""
    arm = mb.from_urdf(URDF, motors="all")
    scene = arm.system()
    strongest = np.array([x.limits[1] for x in arm.machine.actuators.values()])
    effort = ca.sumsqr(scene.control / strongest)
    apart = [
        (RADIUS**2, ca.sumsqr(arm.frame(name).position - BALL), None)
        for name in ("hand", "wrist_2", "wrist_1")
    ]
    still = np.zeros(6)
    problem = dict(
        start=dict(q=START, v=still),
        end=dict(q=END, v=still),
        bounds=[*arm.bounds(), *apart],
        control="linear",
    )
    fast = vi.optimal_control(
        scene,
        RULE,
        duration=vi.free(0.8, 0.3, 3.0),
        steps=STEPS,
        cost=1 + 0.05 * effort,
        **problem,
    )
    easy = vi.optimal_control(
        scene, RULE, duration=SLOWER, steps=STEPS, cost=effort, guess=fast, **problem
    )
    return arm, strongest, fast, easy


def main(out: Path = Path("out")) -> None:
    arm, strongest, fast, easy = plans()
    scene, hand = arm.system(), arm.frame("hand").position
    figure = plt.figure(figsize=(14, 4.4), layout="constrained")
    space = figure.add_subplot(1, 3, 1, projection="3d")
    speeds, torques = figure.add_subplot(1, 3, 2), figure.add_subplot(1, 3, 3)
    for name, motion, style in (("fast", fast, "-"), ("easy", easy, "--")):
        t = np.linspace(0, motion.duration, 2001)
        dense, u = motion.at(t), motion.u_at(t)
        gap = np.linalg.norm(dense.value(hand) - BALL, axis=1).min()
        work = np.trapezoid((u * dense.v).sum(axis=1), t)
        spent = np.trapezoid(((u / strongest) ** 2).sum(axis=1), t)
        print(
            f"{name}: {motion.duration:.4f} s, effort {spent:.3f}, work of the motors {work:.1e} J"
        )
        print(f"  the hand comes within {gap:.4f} m of the ball's centre, its radius is {RADIUS} m")
        print(f"  largest torques, of their limits: {np.abs(u / strongest).max(axis=0).round(2)}")
        again = vi.simulate(
            scene, RULE, q0=START, v0=np.zeros(6), h=motion.h, steps=STEPS, u=motion.u
        )
        print(f"  pan at the end when replayed   found {again.q[-1, 0]:.9f}   exact {END[0]:.9f}")
        space.plot(*dense.value(hand).T, style, label=f"{name}, {motion.duration:.2f} s")
        for axis, joint in enumerate(scene.names[:3]):
            what = {"label": joint} if name == "fast" else {}
            speeds.plot(t, dense.v[:, axis], style, color=f"C{axis}", **what)
            torques.plot(t, u[:, axis] / strongest[axis], style, color=f"C{axis}", **what)
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    ball = [np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)]
    space.plot_surface(*(c + RADIUS * x for c, x in zip(BALL, ball, strict=True)), alpha=0.3)
    for motion, colour in ((fast, "C0"), (easy, "C1")):
        for k in (0, 8, 16):
            joints = [arm.frame(x).position for x in (*list(arm.bodies)[1:], "hand")]
            places = motion.value(ca.horzcat(*joints))[k]
            space.plot(*places, "o-", color=colour, ms=3, lw=1, alpha=0.5)
    space.set(xlabel="x in m", ylabel="y in m", zlabel="z in m", aspect="equal")
    speeds.set(xlabel="t in s", ylabel="rad/s", title="Speeds, limit 3.15; least effort dashed")
    torques.set(xlabel="t in s", title="Torques, of their limits")
    for axes in figure.axes:
        axes.legend(fontsize="small")
    out.mkdir(exist_ok=True)
    figure.savefig(out / "six_axis_arm.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
