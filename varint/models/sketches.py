"""What an animation of a ready scene draws: points, rods and traces, by the model's name."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import casadi as ca

from varint.errors import InputError
from varint.models.model import Model
from varint.models.quaternions import rotation
from varint.parameters import Parameters
from varint.sketch import Sketch, cartesian
from varint.system import System


def sketch(model: Model) -> Sketch:
    """What to draw of a model, for `Trajectory.animate`.

    Parameters
    ----------
    model : Model

    Returns
    -------
    Sketch

    Raises
    ------
    InputError
        If the model has no place to show, such as a one-dimensional problem in r alone.

    Examples
    --------
    >>> import varint as vi
    >>> vi.models.sketch(vi.models.double_pendulum())
    Sketch(pin, 1, 2; 2 rods, 2 dimensions)
    """
    found = _SKETCHES[model.name](model.system) if model.name in _SKETCHES else None
    found = found or cartesian(model.system.names, model.system.q)
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


def _atwood(s: System) -> Sketch:
    return Sketch({"first": ca.vertcat(-0.5, -s.q[0]), "second": ca.vertcat(0.5, -s.q[1])})


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


def _top(s: System) -> Sketch:
    return Sketch({"foot": [0, 0, 0], "tip": _axis(s.q[1], s.q[0] - ca.pi / 2)}, rods=[("foot", "tip")], traces=["tip"])


def _body(s: System) -> Sketch:
    axes = rotation(s.q)
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


def _planet(s: System) -> Sketch:
    return Sketch({"centre": [0, 0], "body": _polar(s.q[0], s.q[1])}, traces=["body"])


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
}
