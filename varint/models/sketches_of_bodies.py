"""What animations draw of machines, tops, rolling bodies and robots."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca

from varint.drawing.sketch import Sketch
from varint.models.control_bodies import BASES, LINK
from varint.models.quaternions import rotation
from varint.models.sketch_parts import arm, axis, parameters_of, polar
from varint.scene.system import System


def four_bar(s: System) -> Sketch:
    ends = {f"joint {i}": part for i, part in enumerate(ca.vertsplit(s.q, 2))}
    feet = {f"foot {i}": [float(i), 0.0] for i in range(len(ends))}
    rods = [*zip(feet, ends, strict=True), *pairwise(ends)]
    return Sketch({**feet, **ends}, rods=rods, traces=[list(ends)[-1]])


def slider_crank(s: System) -> Sketch:
    pin = 2 * s.q[0:2]
    points = {"bearing": [0, 0], "pin": pin, "rod": s.q[3:5], "slider": s.q[6:8]}
    return Sketch(points, rods=[("bearing", "pin"), ("pin", "slider")], traces=["pin", "rod"])


def andrews(s: System) -> Sketch:
    c = parameters_of(s)
    beta, theta, gamma, _, delta, _, epsilon = ca.vertsplit(s.q)
    a, b = ca.vertcat(c.xa, c.ya), ca.vertcat(c.xb, c.yb)
    points = {
        "bearing": [0, 0],
        "crank": polar(c.rr, beta),
        "a": a,
        "b": b,
        "spring": ca.vertcat(c.xc, c.yc),
    }
    points["tip"] = points["crank"] - polar(c.d, beta + theta)
    points["upper"], points["lower"] = a + polar(c.zt, delta), a + arm(epsilon, c.u)
    points["pull"] = b + polar(c.sd, gamma) + arm(gamma, c.sc)
    rods = [("bearing", "crank"), ("crank", "tip"), ("b", "tip"), ("b", "pull")]
    rods += [end for joint in ("upper", "lower") for end in (("a", joint), (joint, "tip"))]
    return Sketch(points, rods=rods, traces=["tip"])


def draw_top(s: System) -> Sketch:
    return Sketch(
        {"foot": [0, 0, 0], "tip": axis(s.q[1], s.q[0] - ca.pi / 2)},
        rods=[("foot", "tip")],
        traces=["tip"],
    )


def draw_body(s: System) -> Sketch:
    return _three_axes(rotation(s.q))


def euler(s: System) -> Sketch:
    """Axes of a body with Euler angles φ, θ, ψ."""
    phi, theta, psi = (ca.vertcat(ca.cos(x), ca.sin(x)) for x in ca.vertsplit(s.q))
    line = ca.vertcat(phi, 0)  # of nodes
    up = ca.vertcat(-theta[0] * phi[1], theta[0] * phi[0], theta[1])
    third = ca.vertcat(theta[1] * phi[1], -theta[1] * phi[0], theta[0])
    return _three_axes(ca.horzcat(psi[0] * line + psi[1] * up, psi[0] * up - psi[1] * line, third))


def _three_axes(axes: ca.SX) -> Sketch:
    points = {"centre": [0, 0, 0]} | {f"axis {i + 1}": axes[:, i] for i in range(3)}
    return Sketch(points, rods=[("centre", f"axis {i + 1}") for i in range(3)], traces=["axis 3"])


def draw_ball(s: System) -> Sketch:
    return Sketch({"ball": ca.vertcat(0, s.q), "ground": [0, 0]}, marks=["ball"])


def skate(s: System) -> Sketch:
    ahead = 0.2 * ca.vertcat(ca.cos(s.q[2]), ca.sin(s.q[2]))
    points = {"contact": s.q[:2], "heading": s.q[:2] + ahead}
    return Sketch(points, rods=[("contact", "heading")], traces=["contact"], marks=["contact"])


def draw_robot(s: System) -> Sketch:
    arm = 5 * ca.vertcat(-ca.sin(s.q[2]), ca.cos(s.q[2]))
    points = {"centre": s.q[:2], "left": s.q[:2] + arm, "right": s.q[:2] - arm}
    return Sketch(points, rods=[("left", "right")], traces=["centre"])


def walker(s: System) -> Sketch:
    hip = s.q[:2]
    points = {"hip": hip, "stance": hip + arm(s.q[2]), "swing": hip + arm(s.q[3])}
    return Sketch(points, rods=[("hip", "stance"), ("hip", "swing")], traces=["hip", "swing"])


def draw_cat(s: System) -> Sketch:
    points: dict[str, ca.SX] = {}
    for name, side, bend in (("left", -1, s.q[1]), ("right", 1, s.q[2])):
        points[f"{name} shoulder"] = side * polar(0.6, s.q[0])
        points[f"{name} hand"] = points[f"{name} shoulder"] + side * polar(1, s.q[0] + bend)
    rods = [
        ("left hand", "left shoulder"),
        ("left shoulder", "right shoulder"),
        ("right shoulder", "right hand"),
    ]
    return Sketch(points, rods=rods, traces=["left hand", "right hand"])


def hovercraft(s: System) -> Sketch:
    corners = {
        f"corner {i}": s.q[:2] + 0.15 * polar(ca.SX(1), s.q[2] + 2 * ca.pi * i / 3)
        for i in range(3)
    }
    rods = [("centre", name) for name in corners]
    return Sketch({"centre": s.q[:2]} | corners, rods=rods, traces=["centre"], marks=["corner 0"])


def draw_arms(angles: ca.SX) -> Sketch:
    points: dict = {}
    for side, (name, base) in enumerate(zip("ab", BASES, strict=True)):
        elbow = ca.DM(base) + polar(ca.SX(LINK), angles[2 * side])
        points |= {
            name: base,
            f"{name} elbow": elbow,
            f"{name} hand": elbow + polar(ca.SX(LINK), angles[2 * side + 1]),
        }
    rods = (
        [(x, f"{x} elbow") for x in "ab"]
        + [(f"{x} elbow", f"{x} hand") for x in "ab"]
        + [("a hand", "b hand")]
    )
    return Sketch(
        points | {"load": (points["a hand"] + points["b hand"]) / 2}, rods=rods, traces=["load"]
    )
