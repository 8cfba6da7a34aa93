"""A crane that hoists while it travels, and a quadruped that turns itself in the air.

Claim: both are built from bodies and joints. The crane brings its load to rest behind a wall, with
a rope that only pulls. The quadruped has left the ground without angular momentum; its centre of
mass falls along a parabola, its angular momentum stays zero, and yet it lands with its nose up and
its legs as they were: they swing there and back on different ways.
Source: Sakawa & Shindo, Automatica 18 (1982) 257 (container crane); Montgomery, Comm. Math. Phys.
128 (1990) 565 (falling cat).
Run: python examples/crane_and_leap.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi
import varint.multibody as mb

plt.style.use("tableau-colorblind10")
RULE, G = vi.gauss(3), 9.81
DOWN, HALF, RISE = (0, 0, -1), 0.3, 2.5  # half the trunk's length in m, speed upwards in m/s


def wall_at(x, z):
    """Below one in the wall."""
    return ((x - 1.5) / 0.5) ** 4 + ((z + 3) / 1.8) ** 4


def planned(world, cost, duration, steps, ends, rows):
    """A machine and its way of least cost within all limits."""
    given = dict(steps=steps, control="linear", bounds=[*world.bounds(), *rows], **ends)
    return world, vi.optimal_control(world.system(), RULE, duration=duration, cost=cost, **given)


def crane():
    """A trolley, a rope that turns and is wound up, and its load; over a wall in 4 s."""
    world = mb.Model()
    trolley, rope = world.body(3, name="trolley"), world.body(name="rope")
    load = world.body(1, name="load")
    world.prismatic(world, trolley, (1, 0, 0), name="way", limits=(-0.5, 3.5))
    world.revolute(trolley, rope, (0, 1, 0), name="swing")
    world.prismatic(rope, load, DOWN, name="length", limits=(0.3, 2.5))
    world.motor("way", "push", limits=(-15, 15))
    world.motor("length", "winch", limits=(-25, 0))  # it only pulls
    scene, place = world.system(), world.frame("load").position
    push, winch = ca.vertsplit(scene.control)
    ends = dict(start=dict(q=[0, 0, 2], v=[0, 0, 0]), end=dict(q=[3, 0, 2], v=[0, 0, 0]))
    wall = [(1, wall_at(place[0], place[2]), None)]
    return planned(world, push**2 + (winch + G) ** 2, 4.0, 30, ends, wall)


def quadruped():
    """A trunk that floats in the plane, four legs of two rods; left and right move together."""
    world = mb.Model()
    trunk = world.body(6.0, inertia=0.3, name="trunk")
    world.planar(world, trunk, (0, -1, 0), direction=(1, 0, 0), name="trunk")
    for side, y in (("left", 0.1), ("right", -0.1)):
        for end, x in (("front", HALF), ("hind", -HALF)):
            name = f"{side}_{end}"
            thigh = world.body(0.5, (0, 0, -0.1), 0.003, f"{name}_thigh")
            shin = world.body(0.3, (0, 0, -0.1), 0.002, f"{name}_shin")
            world.revolute(trunk, thigh, (0, -1, 0), (x, y, 0), f"{name}_hip", limits=(-2, 2))
            world.revolute(thigh, shin, (0, -1, 0), (0, 0, -0.2), f"{name}_knee", limits=(-2.5, 0))
            world.marker(shin, (0, 0, -0.2), f"{name}_foot")
            for joint in ("hip", "knee"):
                if side == "left":
                    world.motor(f"{name}_{joint}", limits=(-40, 40))
                else:
                    world.mimic(f"{name}_{joint}", f"left_{end}_{joint}")
    scene = world.system()
    legs, still, free = [0.5, -1.0, 0.5, -1.0], [0] * 4, [None] * 3
    start = dict(q=[0, 0, 0, *legs], v=[1, RISE, 0, *still])
    ends = dict(start=start, end=dict(q=[None, None, 0.1, *legs], v=[*free, *still]))
    return planned(world, ca.sumsqr(scene.control), 2 * RISE / G, 24, ends, [])


def main(out: Path = Path("out")) -> None:
    (world, way), (animal, leap) = crane(), quadruped()
    figure, (yard, air, turn) = plt.subplots(1, 3, figsize=(14, 4.2), layout="constrained")
    again = vi.simulate(way.system, RULE, q0=[0, 0, 2], v0=[0] * 3, h=way.h, steps=30, u=way.u)
    print(f"the load when replayed, way        found {again.q[-1, 0]:.9f}   exact {3:.9f}")
    fine = way.at(np.linspace(0, way.duration, 400))
    place = fine.value(world.frame("load").position)
    print(f"the rope pulls with {-way.u[..., 1].max():.2f} to {-way.u[..., 1].min():.2f} N")
    x, z = np.meshgrid(np.linspace(-0.5, 3.5, 200), np.linspace(-3, 0.2, 200))
    yard.contourf(x, z, wall_at(x, z), [0, 1], colors=["0.8"])
    yard.plot([fine.q[::30, 0], place[::30, 0]], [0 * place[::30, 2], place[::30, 2]], "k-", lw=0.5)
    yard.plot(place[:, 0], place[:, 2])
    yard.set(xlabel="x in m", ylabel="z in m", aspect="equal", title="Over a wall in 4 s")

    fine = leap.at(np.linspace(0, leap.duration, 201))
    moved = [(body, animal.frame(name)) for name, body in animal.bodies.items()]
    weighed = [b.mass * (x.position + ca.mtimes(x.rotation, b.com)) for b, x in moved]
    c, t = fine.value(sum(weighed) / sum(body.mass for body, _ in moved)), fine.t
    fall = c[0] + np.outer(t, [1.0, 0, RISE]) + np.outer(t**2, [0, 0, -G / 2])
    print(f"quadruped, centre of mass, x       found {c[-1, 0]:.9f}   exact {fall[-1, 0]:.9f}")
    x, z = c[:, 0] - fine.q[:, 0], c[:, 2] - fine.q[:, 1]  # from the trunk's middle
    spin = fine.p[:, 2] - x * fine.p[:, 1] + z * fine.p[:, 0]
    print(f"angular momentum about it at most {abs(spin).max():.0e} N m s, off by", end=" ")
    print(f"{abs(c - fall).max():.0e} m; turned by {fine.q[-1, 2]:.3f} rad")
    for end in ("front", "hind"):
        names = ("trunk", f"left_{end}_thigh", f"left_{end}_shin", f"left_{end}_foot")
        legs = np.array([fine.value(animal.frame(name).position) for name in names])
        for k, colour in ((0, "0.75"), (100, "C0"), (200, "k")):
            air.plot(legs[:, k, 0], legs[:, k, 2], "o-", ms=2, color=colour)
    air.plot(c[:, 0], c[:, 2], "C1--", label="centre of mass")
    air.set(xlabel="x in m", ylabel="z in m", aspect="equal", title="In the air")
    turn.plot(t, fine.q[:, 2:6], label=[x.replace("_", " ") for x in leap.system.names[2:6]])
    turn.set(xlabel="t in s", ylabel="rad", title="The trunk turns, the legs come back")
    air.legend(loc="upper left")
    turn.legend()
    out.mkdir(exist_ok=True)
    figure.savefig(out / "crane_and_leap.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))
