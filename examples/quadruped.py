"""A quadruped that leaps, twisted and tilted, and lands level: its legs turn it in the air.

Claim: its base floats in space, a position and a unit quaternion that no constraint holds. Nothing
touches it in flight: its centre of mass falls along a parabola, and its angular momentum about it
stays zero, as it was on the ground, whatever the motors do. Yet the trunk turns by 0.4 rad about
the vertical and by 0.15 rad about its length, and its legs are back as they were: each of them goes
around a closed curve, and what lies within makes the turn. Least effort of the motors.
Source: Montgomery, Comm. Math. Phys. 128 (1990) 565 (falling cat); Kane & Scher, Int. J. Solids
Struct. 5 (1969) 663.
Run: python examples/quadruped.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi
import varint.multibody as mb

plt.style.use("tableau-colorblind10")
RULE, STEPS, G = vi.gauss(3), 20, 9.81
ALONG, RISE, TILT, TWIST = 1.0, 2.5, 0.15, -0.4  # m/s, m/s, rad, rad when it leaves the ground
LEGS = {"left front": (0.3, 0.1), "right front": (0.3, -0.1)}
LEGS |= {name.replace("front", "hind"): (-x, y) for name, (x, y) in LEGS.items()}
POSE = [0.0, 0.2] * 4  # of a leg: to the side, and swung forward, in rad
LEG = """
<body name="{0}" pos="{1} {2} 0"><site name="{0} foot" pos="0 0 -.3"/>
  <joint name="{0} side" class="side"/><joint name="{0} swing" class="swing"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".025" mass=".8"/>
  <geom type="sphere" pos="0 0 -.3" size=".03" mass=".3"/></body>"""
FILE = """
<mujoco><compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/><joint armature=".005"/>
    <default class="side"><joint axis="1 0 0" range="-1.2 1.2"/></default>
    <default class="swing"><joint axis="0 -1 0" range="-1.5 1.5"/></default>
  </default>
  <worldbody><body name="trunk"><freejoint name="trunk"/>
    <geom type="box" size=".3 .1 .06" mass="6"/>{}
  </body></worldbody><actuator>{}</actuator></mujoco>"""


def quadruped() -> mb.Model:
    """A trunk of 6 kg that floats, and four legs on hips of two hinges each."""
    joints = [f"{name} {way}" for name in LEGS for way in ("side", "swing")]
    motors = [f'<motor name="{x} motor" joint="{x}" ctrlrange="-30 30"/>' for x in joints]
    legs = [LEG.format(name, *place) for name, place in LEGS.items()]
    return mb.from_mjcf(FILE.format("".join(legs), "".join(motors)))


def leap(animal: mb.Model) -> vi.Trajectory:
    """From the ground to the ground with least effort of the motors."""
    scene, still = animal.system(), [0.0] * 8
    attitude = mb.matrix_quaternion(mb.roll_pitch_yaw(TILT, 0, TWIST))
    return vi.optimal_control(
        scene,
        RULE,
        duration=2 * RISE / G,
        steps=STEPS,
        cost=ca.sumsqr(scene.control),
        control="linear",
        start=dict(q=[0, 0, 0, *attitude, *POSE], v=[ALONG, 0, RISE, 0, 0, 0, 0, *still]),
        end=dict(q=[None] * 3 + [1, 0, 0, 0, *POSE], v=[None] * 7 + still),
        bounds=animal.bounds(),
    )


def momenta(animal: mb.Model) -> tuple[ca.SX, ca.SX]:
    """Centre of mass, and angular momentum about it, as expressions."""
    moved = [(body, animal.frame((body, body.com))) for body in animal.bodies.values()]
    mass = sum(body.mass for body, _ in moved)
    centre = sum(body.mass * at.position for body, at in moved) / mass
    spin = ca.SX.zeros(3)
    for body, at in moved:
        turned = [at.rotation, ca.DM(body.inertia), at.rotation.T, at.angular_velocity]
        spin += body.mass * ca.cross(at.position - centre, at.velocity) + ca.mtimes(turned)
    return centre, spin


def main(out: Path = Path("out")) -> None:
    motion = leap(animal := quadruped())
    centre, spin = (motion.value(x) for x in momenta(animal))
    fall = centre[0] + np.outer(motion.t, [ALONG, 0, RISE]) - np.outer(motion.t**2, [0, 0, G / 2])
    start = dict(q0=motion.q[0], v0=motion.v[0], u=motion.u, h=motion.h)
    again = vi.simulate(motion.system, RULE, **start, steps=STEPS)
    print(f"error of the path {motion.stats['error_estimate']:.0e} of its range", end=", ")
    print(f"largest torque {abs(motion.u).max():.1f} N m, cost {motion.cost:.2f} N² m² s")
    print(f"centre of mass at the end, x  found {centre[-1, 0]:.9f}   exact {fall[-1, 0]:.9f}")
    print(f"off the parabola by {abs(centre - fall).max():.0e} m at most", end=", ")
    print(f"angular momentum about it {abs(spin).max():.0e} N m s")
    print(f"attitude when replayed, w     found {abs(again.q[-1, 3]):.9f}   exact 1.000000000")

    fine = motion.at(np.linspace(0, motion.duration, 201))
    figure = plt.figure(figsize=(14, 4.6), layout="constrained")
    space = figure.add_subplot(1, 3, 1, projection="3d")
    angles, ways = figure.add_subplot(1, 3, 2), figure.add_subplot(1, 3, 3)
    corners = [fine.value(animal.frame((name, (0, 0, 0))).position) for name in LEGS]
    feet = [fine.value(animal.frame(f"{name} foot").position) for name in LEGS]
    for k in (0, 50, 100, 150, 200):
        colour = plt.cm.viridis(k / 240)
        space.plot(*np.array([corners[i][k] for i in (0, 1, 3, 2, 0)]).T, color=colour, lw=3)
        for hip, foot in zip(corners, feet, strict=True):
            space.plot(*np.array([hip[k], foot[k]]).T, "o-", ms=2, color=colour)
    space.plot(*fine.value(momenta(animal)[0]).T, "C1--", label="centre of mass")
    space.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    angles.plot(fine.t, mb.euler_angles(fine.q[:, 3:7]), label=["yaw", "pitch", "roll"])
    angles.set(xlabel="t in s", title="The trunk lands level, facing ahead (rad)")
    for k, name in enumerate(LEGS):
        ways.plot(*fine.q[:, 7 + 2 * k : 9 + 2 * k].T, label=name)
    ways.set(xlabel="leg to the side in rad", ylabel="swung forward in rad", aspect="equal")
    for axes, side in ((space, "best"), (angles, "best"), (ways, "center left")):
        axes.legend(fontsize="small", loc=side, bbox_to_anchor=(1, 0.5) if axes is ways else None)
    out.mkdir(exist_ok=True)
    figure.savefig(out / "quadruped.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
