"""Machines that several tests look at."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import varint.multibody as mb
from varint.models.linkages import ANDREWS
from varint.multibody.rotations import frame_along

AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1))


def spatial_chain(links: int) -> mb.Model:
    """Equal links that turn about y, x and z by turns."""
    world, last = mb.Model(), "world"
    for i in range(links):
        link = world.body(1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}")
        world.revolute(last, link, AXES[i % 3], (0, 0, -1 if i else 0))
        last = link
    return world


def plane_chain(links: int, length: float = 1.0, mass: float = 1.0) -> mb.Model:
    """A pendulum of point masses whose links swing about −y, angles from link to link."""
    world, last = mb.Model(), "world"
    for i in range(links):
        link = world.body(mass, (0, 0, -length), 0.0, f"link{i}")
        world.revolute(last, link, (0, -1, 0), (0, 0, -length if i else 0))
        last = link
    return world


def many_joints() -> mb.Model:
    """A tree with every joint of plain coordinates, placed askew, with rotors and couplings."""
    world = mb.Model(gravity=(1.0, 2.0, 3.0))
    bodies = [
        world.body(1.0 + i, (0.1, 0.2, -0.3), (1, 2, 1.5 + 0.1 * i), f"b{i}") for i in range(9)
    ]
    world.planar(world, bodies[0], (1, 2, 3))
    askew = mb.placed((0.1, 0.2, 0.3), mb.roll_pitch_yaw(0.1, 0.2, 0.3))
    world.universal(bodies[0], bodies[1], at=askew, child_at=(0.1, 0.1, 0.1))
    rotor = mb.Passive(armature=0.3, stiffness=2.0, rest=0.1, damping=0.2)
    world.prismatic(bodies[0], bodies[2], (1, 1, 0), (0, 0, 1), passive=rotor)
    world.revolute(bodies[2], bodies[3], (0, 1, 1), passive=rotor)
    world.fixed(bodies[3], bodies[4], mb.placed((1, 0, 0), mb.axis_rotation((1, 1, 0), 0.4)))
    world.revolute(bodies[3], bodies[5], (1, 0, 0))
    world.prismatic(bodies[1], bodies[6])
    world.revolute(bodies[6], bodies[7], (0, 2, 1), (1, 2, 3))
    world.revolute(bodies[4], bodies[8])
    world.couple("b7", "b5", (0.1, 0.2, 0.3))
    world.mimic("b8", "b3", 2.0)
    return world


def floating() -> mb.Model:
    """A body that floats, with a ball joint, a hinge and a slide behind it."""
    world = mb.Model(gravity=(1.0, 2.0, 3.0))
    bodies = [world.body(1.0 + i, (0.1, 0.2, -0.3), (1, 2, 1.5), f"b{i}") for i in range(4)]
    world.free(world, bodies[0])
    inside = mb.placed((0.1, 0.2, 0.3), mb.roll_pitch_yaw(1, 2, 3))
    world.spherical(bodies[0], bodies[1], (1, 2, 3), child_at=inside)
    world.revolute(bodies[1], bodies[2], (0, 1, 1))
    world.prismatic(bodies[2], bodies[3])
    return world


def flat_four_bar(loops: int) -> mb.Model:
    """N parallelograms in a row of uniform rods of length and mass 1 in the plane x, z."""
    world, inertia = mb.Model(), (1 / 12, 1 / 12, 0.0)
    for i in range(loops + 1):
        crank = world.body(1.0, (0, 0, 0.5), inertia, f"crank{i}")
        world.revolute(world, crank, (0, 1, 0), (i, 0, 0))
    for i in range(loops):
        coupler = world.body(1.0, (0.5, 0, 0), (0.0, 1 / 12, 1 / 12), f"coupler{i}")
        world.revolute(f"crank{i}", coupler, (0, 1, 0), (0, 0, 1))
        world.loop("point", (coupler, (1, 0, 0)), (f"crank{i + 1}", (0, 0, 1)))
    return world


def slider_crank() -> mb.Model:
    """Simeon's slider-crank in the plane x, z: crank, rod and slider in a tree, one loop."""
    world = mb.Model()
    crank = world.body(0.36, (0.075, 0, 0), (0, 0.000675, 0.000675), "crank")
    rod = world.body(0.151104, (0.15, 0, 0), (0, 0.00113328, 0.00113328), "rod")
    slider = world.body(0.075552, (0, 0, 0), 1e-4, "slider")
    world.revolute(world, crank, (0, -1, 0), name="phi")
    world.revolute(crank, rod, (0, -1, 0), (0.15, 0, 0), name="psi")
    world.prismatic(world, slider, (1, 0, 0), name="x")
    world.loop("point", (rod, (0.3, 0, 0)), slider)
    return world


def andrews() -> mb.Model:
    """Andrews' squeezing mechanism (IFToMM A03) in the plane x, y: seven bodies, three loops at one
    point, a spring, and a motor on the crank; coordinates as in Hairer & Wanner II, VII.7.
    """
    n = SimpleNamespace(**ANDREWS)
    world, at = mb.Model(gravity=(0, 0, 0)), (n.xa, n.ya, 0)
    coms = {
        "beta": (n.m1, n.ra, 0, n.i1),
        "theta": (n.m2, -n.da, 0, n.i2),
        "gamma": (n.m3, n.sa, n.sb, n.i3),
        "phi": (n.m4, 0, n.ea - n.e, n.i4),
        "delta": (n.m5, n.ta, n.tb, n.i5),
        "omega": (n.m6, n.zf - n.fa, 0, n.i6),
        "epsilon": (n.m7, n.ua, n.ub, n.i7),
    }
    for name, (mass, x, y, inertia) in coms.items():
        world.body(mass, (x, y, 0), (0, 0, inertia), name)
    for name, parent, place in (
        ("beta", world, (0, 0, 0)),
        ("theta", "beta", (n.rr, 0, 0)),
        ("gamma", world, (n.xb, n.yb, 0)),
        ("phi", "delta", (n.zt, 0, 0)),
        ("delta", world, at),
        ("omega", "epsilon", (0, -n.u, 0)),
        ("epsilon", world, at),
    ):
        world.revolute(parent, name, (0, 0, 1), place)
    tip = ("theta", (-n.d, 0, 0))
    for end in (("gamma", (0, -n.ss, 0)), ("phi", (0, -n.e, 0)), ("omega", (n.zf, 0, 0))):
        world.loop("point", end, tip)
    world.spring(("gamma", (n.sd, -n.sc, 0)), ("world", (n.xc, n.yc, 0)), n.c0, n.l0)
    world.motor("beta", "torque")
    return world


def bricard() -> mb.Model:
    """The over-constrained loop of Bricard (IFToMM A04): six rods along the edges of a cube, hinges
    at right angles, five rods in a tree and the loop closed by a sixth hinge.
    """
    world = mb.Model()
    corners = np.array(
        [[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1], [0, 0, 0]], float
    )
    edges = np.diff(corners, axis=0)
    # the hinge between rods i and i + 1 is across both
    axes = [np.cross(edges[i], edges[(i + 1) % 6]) for i in range(6)]
    last, at = "world", np.zeros(3)
    for i in range(5):
        inertia = np.diag([1.0, 1.0, 1.0]) / 12 - np.diag(abs(edges[i])) / 12
        rod = world.body(1.0, edges[i] / 2, inertia, f"rod{i + 1}")
        # the first hinge is that between the last, fixed rod and the first
        world.revolute(last, rod, axes[i - 1], at)
        last, at = rod, edges[i]
    turned = frame_along(axes[4])
    world.loop(
        "axis", (last, mb.placed(edges[4], turned)), ("world", mb.placed(corners[5], turned))
    )
    return world


# Theo Jansen's lengths; the crank's centre is the origin, the fixed pivot at (−A, −L)
JANSEN = dict(
    A=0.38, B=0.415, C=0.393, D=0.401, E=0.558, F=0.394, G=0.367, H=0.657, I=0.49, J=0.5, K=0.619,
    L=0.078, M=0.15,
)  # fmt: skip


def _meet(p: np.ndarray, r: float, q: np.ndarray, s: float, side: float) -> np.ndarray:
    """The point at the distances r from p and s from q on one side of the way from p to q."""
    way = q - p
    d = np.linalg.norm(way)
    along = (r**2 - s**2 + d**2) / (2 * d)
    height = np.sqrt(r**2 - along**2)
    return p + along * way / d + side * height * np.array([-way[1], way[0]]) / d


def jansen_legs() -> tuple[mb.Model, tuple[np.ndarray, np.ndarray]]:
    """Two mirrored legs of Theo Jansen's walker on one crank in the plane x, z: thirteen bodies,
    twelve rows, one freedom; and a start near the loops, the crank turning once a second.
    """
    n, world = JANSEN, mb.Model()
    tip = np.array([0.0, n["M"]])
    crank = world.body(0.5, (0, 0, n["M"] / 2), (0.01, 0.01, 0.01), "crank")
    world.revolute(world, crank, (0, 1, 0))

    def link(parent, name, joint, points, at):
        """A body whose axes are those of space at the start, with a hinge at `joint`."""
        corners = np.array([joint, *points])
        centre = corners.mean(axis=0) - joint
        inertia = 0.3 * ((corners - corners.mean(axis=0)) ** 2).sum() / len(corners)
        body = world.body(0.3, (centre[0], 0, centre[1]), inertia, name)
        world.revolute(parent, body, (0, 1, 0), (at[0], 0, at[1]))
        return lambda point: (body, (point[0] - joint[0], 0, point[1] - joint[1]))

    for name, side in (("left", -1.0), ("right", 1.0)):
        pivot = np.array([side * n["A"], -n["L"]])
        up = _meet(tip, n["J"], pivot, n["B"], side)
        low = _meet(tip, n["K"], pivot, n["C"], -side)
        out = _meet(up, n["E"], pivot, n["D"], side)
        knee = _meet(out, n["F"], low, n["G"], side)
        foot = _meet(knee, n["H"], low, n["I"], side)
        rod = link(crank, f"{name}_upper_rod", tip, [up], tip)
        triangle = link(world, f"{name}_triangle", pivot, [up, out], pivot)
        lower = link(crank, f"{name}_lower_rod", tip, [low], tip)
        bar = link(world, f"{name}_bar", pivot, [low], pivot)
        strut = link(f"{name}_triangle", f"{name}_strut", out, [knee], out - pivot)
        shin = link(f"{name}_bar", f"{name}_shin", low, [knee, foot], low - pivot)
        world.loop("point", rod(up), triangle(up))
        world.loop("point", lower(low), bar(low))
        world.loop("point", strut(knee), shin(knee))
    rates = np.zeros(world.q.numel())
    rates[0] = 2 * np.pi
    return world, (np.zeros(world.q.numel()), rates)
