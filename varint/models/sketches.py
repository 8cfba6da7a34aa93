"""What an animation of a ready scene draws: points, rods and traces, by the model's name."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import casadi as ca

from varint.errors import InputError
from varint.models.control import ControlModel
from varint.models.control_bodies import BASES, LINK, arm_angles
from varint.models.model import Model
from varint.models.quaternions import rotation
from varint.parameters import Parameters
from varint.sketch import Sketch, cartesian
from varint.system import System


def sketch(model: Model | ControlModel) -> Sketch:
    """What to draw of a model, for `Trajectory.animate`.

    Parameters
    ----------
    model : Model or ControlModel

    Returns
    -------
    Sketch

    Raises
    ------
    InputError
        If the model has no place to show, such as numbers of prey and predators.

    Examples
    --------
    >>> import varint as vi
    >>> vi.models.sketch(vi.models.double_pendulum())
    Sketch(pin, 1, 2; 2 rods, 2 dimensions)
    """
    system = model.phases[0].system if isinstance(model, ControlModel) else model.system
    found = _SKETCHES[model.name](system) if model.name in _SKETCHES else None
    found = found or cartesian(system.names, system.q)
    if found is None:
        raise InputError(f"the model {model.name} has no sketch; give one: motion.animate(sketch=varint.Sketch(…))")
    return found


def _given(s: System) -> Parameters:
    assert s.params is not None  # every model has its quantities as parameters
    return s.params


def _arm(angle: ca.SX, length: ca.SX | float = 1.0) -> ca.SX:
    """From the pin of a pendulum to its bob, the angle from the downward vertical."""
    return length * ca.vertcat(ca.sin(angle), -ca.cos(angle))


def _polar(r: ca.SX, angle: ca.SX) -> ca.SX:
    return r * ca.vertcat(ca.cos(angle), ca.sin(angle))


def _axis(theta: ca.SX, phi: ca.SX) -> ca.SX:
    return ca.vertcat(ca.sin(theta) * ca.cos(phi), ca.sin(theta) * ca.sin(phi), ca.cos(theta))


def _hung(pin: ca.SX | list, bob: ca.SX) -> Sketch:
    return Sketch({"pin": pin, "bob": bob}, rods=[("pin", "bob")], traces=["bob"])


def _pendulum(s: System) -> Sketch:
    return _hung([0, 0], _arm(s.q, _given(s).length))


def _lengthening(s: System) -> Sketch:
    return _hung([0, 0], _arm(s.q, _given(s).length + _given(s).rate * s.t))


def _shaken(x: Callable, y: Callable) -> Callable[[System], Sketch]:
    def draw(s: System) -> Sketch:
        pin = ca.vertcat(x(_given(s), s.t), y(_given(s), s.t))
        return _hung(pin, pin + _arm(s.q, _given(s).length))

    return draw


def _links(s: System) -> Sketch:
    place, points = ca.SX.zeros(2), {"pin": ca.SX.zeros(2)}
    for i in range(s.q.numel()):
        place = place + _arm(s.q[i], _given(s).length[i])
        points[str(i + 1)] = place
    return Sketch(points, rods=list(pairwise(points)), traces=[str(s.q.numel())])


def _chain(s: System) -> Sketch:
    points = {"pin": ca.SX.zeros(2)} | {str(i + 1): part for i, part in enumerate(ca.vertsplit(s.q, 2))}
    return Sketch(points, rods=list(pairwise(points)), traces=[list(points)[-1]])


def _two_joints(s: System) -> Sketch:
    elbow = _arm(s.q[0], _given(s).length[0])
    points = {"shoulder": [0, 0], "elbow": elbow, "hand": elbow + _arm(s.q[0] + s.q[1], _given(s).length[1])}
    return Sketch(points, rods=list(pairwise(points)), traces=["hand"])


def _on_cart(s: System) -> Sketch:
    return _hung(ca.vertcat(s.q[0], 0), ca.vertcat(s.q[0], 0) + _arm(s.q[1], _given(s).length))


def _spherical(s: System) -> Sketch:
    down = _axis(s.q[0], s.q[1])
    return _hung([0, 0, 0], _given(s).length * ca.vertcat(down[:2], -down[2]))


def _hoop(s: System) -> Sketch:
    bead = _given(s).R * ca.vertcat(
        ca.sin(s.q) * ca.cos(_given(s).Omega * s.t), ca.sin(s.q) * ca.sin(_given(s).Omega * s.t), -ca.cos(s.q)
    )
    return Sketch({"centre": [0, 0, 0], "bead": bead}, traces=["bead"])


def _wire(s: System) -> Sketch:
    turn = _given(s).Omega * ca.SX(s.t)
    return Sketch({"axis": [0, 0], "bead": _polar(s.q, turn)}, traces=["bead"])


def _wedge(s: System) -> Sketch:
    slope = ca.vertcat(ca.cos(_given(s).alpha), -ca.sin(_given(s).alpha))
    top = ca.vertcat(s.q[0], 0)
    points = {"top": top, "foot": top + slope, "block": top + s.q[1] * slope}
    return Sketch(points, rods=[("top", "foot")], traces=["block"], marks=["block"])


def _in_a_row(places: Callable[[System], list[ca.SX]]) -> Callable[[System], Sketch]:
    """Masses on a straight line, as in one dimension they are."""

    def draw(s: System) -> Sketch:
        return Sketch({str(i + 1): ca.vertcat(x, 0) for i, x in enumerate(places(s))})

    return draw


def _fpu_places(s: System) -> list[ca.SX]:
    pairs = s.q.numel() // 2
    ends = [(2 * i, s.q[i] + sign * s.q[pairs + i], sign) for i in range(pairs) for sign in (-1, 1)]
    return [2 * base + sign / 2 + x / ca.sqrt(2) for base, x, sign in ends]


def _toda(s: System) -> Sketch:
    """Displacements, enlarged, drawn across the chain."""
    count = s.q.numel()
    return Sketch({str(i + 1): ca.vertcat(i, count / 10 * s.q[i]) for i in range(count)})


def _atwood(s: System) -> Sketch:
    return Sketch({"first": ca.vertcat(-0.5, -s.q[0]), "second": ca.vertcat(0.5, -s.q[1])})


def _double_atwood(s: System) -> Sketch:
    x = {"first": (-1, 0), "pulley": (1, 3), "second": (0.6, 1), "third": (1.4, 2)}
    return Sketch({name: ca.vertcat(across, -s.q[i]) for name, (across, i) in x.items()})


def _swinging_atwood(s: System) -> Sketch:
    return _hung([0, 0], _arm(s.q[1], s.q[0]))


def _ladder(s: System) -> Sketch:
    half = _given(s).length / 2 * ca.vertcat(-ca.cos(s.q[2]), ca.sin(s.q[2]))
    points = {"wall": s.q[:2] + half, "foot": s.q[:2] - half, "centre": s.q[:2]}
    return Sketch(points, rods=[("wall", "foot")], traces=["centre"])


def _four_bar(s: System) -> Sketch:
    ends = {f"joint {i}": part for i, part in enumerate(ca.vertsplit(s.q, 2))}
    feet = {f"foot {i}": [float(i), 0.0] for i in range(len(ends))}
    rods = [*zip(feet, ends, strict=True), *pairwise(ends)]
    return Sketch({**feet, **ends}, rods=rods, traces=[list(ends)[-1]])


def _slider_crank(s: System) -> Sketch:
    pin = 2 * s.q[0:2]
    points = {"bearing": [0, 0], "pin": pin, "rod": s.q[3:5], "slider": s.q[6:8]}
    return Sketch(points, rods=[("bearing", "pin"), ("pin", "slider")], traces=["pin", "rod"])


def _andrews(s: System) -> Sketch:
    c = _given(s)
    beta, theta, gamma, _, delta, _, epsilon = ca.vertsplit(s.q)
    a, b = ca.vertcat(c.xa, c.ya), ca.vertcat(c.xb, c.yb)
    points = {"bearing": [0, 0], "crank": _polar(c.rr, beta), "a": a, "b": b, "spring": ca.vertcat(c.xc, c.yc)}
    points["tip"] = points["crank"] - _polar(c.d, beta + theta)
    points["upper"], points["lower"] = a + _polar(c.zt, delta), a + _arm(epsilon, c.u)
    points["pull"] = b + _polar(c.sd, gamma) + _arm(gamma, c.sc)
    rods = [("bearing", "crank"), ("crank", "tip"), ("b", "tip"), ("b", "pull")]
    rods += [end for joint in ("upper", "lower") for end in (("a", joint), (joint, "tip"))]
    return Sketch(points, rods=rods, traces=["tip"])


def _top(s: System) -> Sketch:
    return Sketch({"foot": [0, 0, 0], "tip": _axis(s.q[1], s.q[0] - ca.pi / 2)}, rods=[("foot", "tip")], traces=["tip"])


def _body(s: System) -> Sketch:
    return _three_axes(rotation(s.q))


def _euler(s: System) -> Sketch:
    """Axes of a body with Euler angles φ, θ, ψ."""
    phi, theta, psi = (ca.vertcat(ca.cos(x), ca.sin(x)) for x in ca.vertsplit(s.q))
    line = ca.vertcat(phi, 0)  # of nodes
    up = ca.vertcat(-theta[0] * phi[1], theta[0] * phi[0], theta[1])
    third = ca.vertcat(theta[1] * phi[1], -theta[1] * phi[0], theta[0])
    return _three_axes(ca.horzcat(psi[0] * line + psi[1] * up, psi[0] * up - psi[1] * line, third))


def _three_axes(axes: ca.SX) -> Sketch:
    points = {"centre": [0, 0, 0]} | {f"axis {i + 1}": axes[:, i] for i in range(3)}
    return Sketch(points, rods=[("centre", f"axis {i + 1}") for i in range(3)], traces=["axis 3"])


def _ball(s: System) -> Sketch:
    return Sketch({"ball": ca.vertcat(0, s.q), "ground": [0, 0]}, marks=["ball"])


def _skate(s: System) -> Sketch:
    ahead = 0.2 * ca.vertcat(ca.cos(s.q[2]), ca.sin(s.q[2]))
    points = {"contact": s.q[:2], "heading": s.q[:2] + ahead}
    return Sketch(points, rods=[("contact", "heading")], traces=["contact"], marks=["contact"])


def _flat(s: System) -> Sketch:
    return Sketch({"body": s.q[:2]}, traces=["body"])


def _in_space(s: System) -> Sketch:
    return Sketch({"guiding centre": s.q[:3]}, traces=["guiding centre"])


def _on_surface(place: Callable[[System], ca.SX]) -> Callable[[System], Sketch]:
    return lambda s: Sketch({"particle": place(s)}, traces=["particle"])


def _on_torus(s: System) -> ca.SX:
    around = _given(s).R + _given(s).r * ca.cos(s.q[0])
    return ca.vertcat(_polar(around, s.q[1]), _given(s).r * ca.sin(s.q[0]))


def _on_spheroid(s: System) -> ca.SX:
    return ca.vertcat(_polar(_given(s).a * ca.cos(s.q[0]), s.q[1]), _given(s).b * ca.sin(s.q[0]))


def _robot(s: System) -> Sketch:
    arm = 5 * ca.vertcat(-ca.sin(s.q[2]), ca.cos(s.q[2]))
    points = {"centre": s.q[:2], "left": s.q[:2] + arm, "right": s.q[:2] - arm}
    return Sketch(points, rods=[("left", "right")], traces=["centre"])


def _walker(s: System) -> Sketch:
    hip = s.q[:2]
    points = {"hip": hip, "stance": hip + _arm(s.q[2]), "swing": hip + _arm(s.q[3])}
    return Sketch(points, rods=[("hip", "stance"), ("hip", "swing")], traces=["hip", "swing"])


def _cat(s: System) -> Sketch:
    points: dict[str, ca.SX] = {}
    for name, side, arm in (("left", -1, s.q[1]), ("right", 1, s.q[2])):
        points[f"{name} shoulder"] = side * _polar(0.6, s.q[0])
        points[f"{name} hand"] = points[f"{name} shoulder"] + side * _polar(1, s.q[0] + arm)
    rods = [("left hand", "left shoulder"), ("left shoulder", "right shoulder"), ("right shoulder", "right hand")]
    return Sketch(points, rods=rods, traces=["left hand", "right hand"])


def _planet(s: System) -> Sketch:
    return Sketch({"centre": [0, 0], "body": _polar(s.q[0], s.q[1])}, traces=["body"])


def _hovercraft(s: System) -> Sketch:
    corners = {f"corner {i}": s.q[:2] + 0.15 * _polar(ca.SX(1), s.q[2] + 2 * ca.pi * i / 3) for i in range(3)}
    rods = [("centre", name) for name in corners]
    return Sketch({"centre": s.q[:2]} | corners, rods=rods, traces=["centre"], marks=["corner 0"])


def _arms(angles: ca.SX) -> Sketch:
    points: dict = {}
    for side, (name, base) in enumerate(zip("ab", BASES, strict=True)):
        elbow = ca.DM(base) + _polar(ca.SX(LINK), angles[2 * side])
        points |= {
            name: base,
            f"{name} elbow": elbow,
            f"{name} hand": elbow + _polar(ca.SX(LINK), angles[2 * side + 1]),
        }
    rods = [(x, f"{x} elbow") for x in "ab"] + [(f"{x} elbow", f"{x} hand") for x in "ab"] + [("a hand", "b hand")]
    return Sketch(points | {"load": (points["a hand"] + points["b hand"]) / 2}, rods=rods, traces=["load"])


_SKETCHES: dict[str, Callable[[System], Sketch]] = {
    "pendulum": _pendulum,
    "inclined_axis": lambda s: _hung([0, 0], _arm(s.q, _given(s).distance)),
    "driven_pendulum": _pendulum,
    "horizontal_pivot": _shaken(lambda c, t: c.amplitude * ca.cos(c.Omega * t), lambda c, t: 0),
    "kapitza_pendulum": _shaken(lambda c, t: 0, lambda c, t: c.amplitude * ca.cos(c.Omega * t)),
    "double_pendulum": _links,
    "chain_pendulum": _links,
    "chain_rods": _chain,
    "pendulum_cartesian": _chain,
    "acrobot": _two_joints,
    "two_link_arm": _two_joints,
    "cart_pole": _on_cart,
    "sliding_support": _on_cart,
    "spherical_pendulum": _spherical,
    "rotating_hoop": _hoop,
    "atwood": _atwood,
    "swinging_atwood": _swinging_atwood,
    "falling_ladder": _ladder,
    "four_bar": _four_bar,
    "slider_crank": _slider_crank,
    "heavy_top": _top,
    "heavy_top_quaternion": _body,
    "free_body_quaternion": _body,
    "bouncing_ball": _ball,
    "knife_edge": _skate,
    "chaplygin_sleigh": _skate,
    "rolling_disc": _flat,
    "guiding_centre": _in_space,
    "central_force": _planet,
    "rosette": _planet,
    "accelerated_pivot": _pendulum,  # as seen in the car
    "lengthening_pendulum": _lengthening,
    "forced_oscillator": _in_a_row(lambda s: [s.q]),
    "caldirola_kanai": _in_a_row(lambda s: [s.q]),
    "linear_drag": _ball,
    "rotating_wire": _wire,
    "block_on_wedge": _wedge,
    "coupled_oscillators": _in_a_row(lambda s: [s.q[0] - 2, s.q[1] + 2]),
    "fpu_chain": _in_a_row(_fpu_places),
    "toda_chain": _toda,
    "radial_motion": _in_a_row(lambda s: [ca.SX(0), s.q]),
    "free_rigid_body": _euler,
    "heavy_rigid_body": _euler,
    "great_circle": _on_surface(lambda s: _given(s).R * _axis(s.q[0], s.q[1])),
    "torus_geodesic": _on_surface(_on_torus),
    "spheroid_geodesic": _on_surface(_on_spheroid),
    "brachistochrone": _on_surface(lambda s: ca.vertcat(s.q[0], -(s.q[1] ** 2) / 2)),
    "catenary": _flat,
    "double_atwood": _double_atwood,
    "andrews_mechanism": _andrews,
    "rest_to_rest": _in_a_row(lambda s: [s.q]),
    "fastest_transfer": _in_a_row(lambda s: [s.q]),
    "swing_up_cart_pole": _on_cart,
    "overhead_crane": _on_cart,
    "swing_up_pendulum": _pendulum,
    "swing_up_acrobot": _two_joints,
    "swing_up_rod": _chain,
    "orbit_transfer": _planet,
    "free_floating_robot": _robot,
    "walker": _walker,
    "falling_cat": _cat,
    "hovercraft": _hovercraft,
    "carried_load": lambda s: _arms(s.q[:4]),
    "carried_load_reduced": lambda s: _arms(arm_angles(s.q)),
}
