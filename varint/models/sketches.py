"""What an animation of a ready scene draws: points, rods and traces, by the model's name."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import casadi as ca

from varint.drawing.sketch import Sketch, cartesian
from varint.errors import InputError
from varint.models.control import ControlModel
from varint.models.control_bodies import arm_angles
from varint.models.model import Model
from varint.models.sketch_parts import arm, axis, parameters_of, polar
from varint.models.sketches_of_bodies import (
    andrews,
    draw_arms,
    draw_ball,
    draw_body,
    draw_cat,
    draw_robot,
    draw_top,
    euler,
    four_bar,
    hovercraft,
    skate,
    slider_crank,
    walker,
)
from varint.scene.system import System


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
        raise InputError(
            f"the model {model.name} has no sketch; give one: "
            "motion.animate(sketch=varint.Sketch(…))"
        )
    return found


def _hung(pin: ca.SX | list, bob: ca.SX) -> Sketch:
    return Sketch({"pin": pin, "bob": bob}, rods=[("pin", "bob")], traces=["bob"])


def _pendulum(s: System) -> Sketch:
    return _hung([0, 0], arm(s.q, parameters_of(s).length))


def _lengthening(s: System) -> Sketch:
    return _hung([0, 0], arm(s.q, parameters_of(s).length + parameters_of(s).rate * s.t))


def _shaken(x: Callable, y: Callable) -> Callable[[System], Sketch]:
    def draw(s: System) -> Sketch:
        pin = ca.vertcat(x(parameters_of(s), s.t), y(parameters_of(s), s.t))
        return _hung(pin, pin + arm(s.q, parameters_of(s).length))

    return draw


def _links(s: System) -> Sketch:
    place, points = ca.SX.zeros(2), {"pin": ca.SX.zeros(2)}
    for i in range(s.q.numel()):
        place = place + arm(s.q[i], parameters_of(s).length[i])
        points[str(i + 1)] = place
    return Sketch(points, rods=list(pairwise(points)), traces=[str(s.q.numel())])


def _chain(s: System) -> Sketch:
    points = {"pin": ca.SX.zeros(2)} | {
        str(i + 1): part for i, part in enumerate(ca.vertsplit(s.q, 2))
    }
    return Sketch(points, rods=list(pairwise(points)), traces=[list(points)[-1]])


def _two_joints(s: System) -> Sketch:
    elbow = arm(s.q[0], parameters_of(s).length[0])
    points = {
        "shoulder": [0, 0],
        "elbow": elbow,
        "hand": elbow + arm(s.q[0] + s.q[1], parameters_of(s).length[1]),
    }
    return Sketch(points, rods=list(pairwise(points)), traces=["hand"])


def _on_cart(s: System) -> Sketch:
    return _hung(
        ca.vertcat(s.q[0], 0), ca.vertcat(s.q[0], 0) + arm(s.q[1], parameters_of(s).length)
    )


def _spherical(s: System) -> Sketch:
    down = axis(s.q[0], s.q[1])
    return _hung([0, 0, 0], parameters_of(s).length * ca.vertcat(down[:2], -down[2]))


def _hoop(s: System) -> Sketch:
    bead = parameters_of(s).R * ca.vertcat(
        ca.sin(s.q) * ca.cos(parameters_of(s).Omega * s.t),
        ca.sin(s.q) * ca.sin(parameters_of(s).Omega * s.t),
        -ca.cos(s.q),
    )
    return Sketch({"centre": [0, 0, 0], "bead": bead}, traces=["bead"])


def _wire(s: System) -> Sketch:
    turn = parameters_of(s).Omega * ca.SX(s.t)
    return Sketch({"axis": [0, 0], "bead": polar(s.q, turn)}, traces=["bead"])


def _wedge(s: System) -> Sketch:
    slope = ca.vertcat(ca.cos(parameters_of(s).alpha), -ca.sin(parameters_of(s).alpha))
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
    return _hung([0, 0], arm(s.q[1], s.q[0]))


def _ladder(s: System) -> Sketch:
    half = parameters_of(s).length / 2 * ca.vertcat(-ca.cos(s.q[2]), ca.sin(s.q[2]))
    points = {"wall": s.q[:2] + half, "foot": s.q[:2] - half, "centre": s.q[:2]}
    return Sketch(points, rods=[("wall", "foot")], traces=["centre"])


def _flat(s: System) -> Sketch:
    return Sketch({"body": s.q[:2]}, traces=["body"])


def _in_space(s: System) -> Sketch:
    return Sketch({"guiding centre": s.q[:3]}, traces=["guiding centre"])


def _on_surface(place: Callable[[System], ca.SX]) -> Callable[[System], Sketch]:
    return lambda s: Sketch({"particle": place(s)}, traces=["particle"])


def _on_torus(s: System) -> ca.SX:
    around = parameters_of(s).R + parameters_of(s).r * ca.cos(s.q[0])
    return ca.vertcat(polar(around, s.q[1]), parameters_of(s).r * ca.sin(s.q[0]))


def _on_spheroid(s: System) -> ca.SX:
    return ca.vertcat(
        polar(parameters_of(s).a * ca.cos(s.q[0]), s.q[1]), parameters_of(s).b * ca.sin(s.q[0])
    )


def _planet(s: System) -> Sketch:
    return Sketch({"centre": [0, 0], "body": polar(s.q[0], s.q[1])}, traces=["body"])


def _satellite(s: System) -> Sketch:
    mu = parameters_of(s).mu
    rest = [0] * (s.q.numel() - 1)
    earth, moon = ca.vertcat(-mu, *rest), ca.vertcat(1 - mu, *rest)
    points = {"Earth": earth, "Moon": moon, "satellite": s.q}
    return Sketch(points, traces=["satellite"], marks=["satellite"])


_SKETCHES: dict[str, Callable[[System], Sketch]] = {
    "pendulum": _pendulum,
    "inclined_axis": lambda s: _hung([0, 0], arm(s.q, parameters_of(s).distance)),
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
    "four_bar": four_bar,
    "slider_crank": slider_crank,
    "heavy_top": draw_top,
    "heavy_top_quaternion": draw_body,
    "free_body_quaternion": draw_body,
    "bouncing_ball": draw_ball,
    "knife_edge": skate,
    "chaplygin_sleigh": skate,
    "rolling_disc": _flat,
    "guiding_centre": _in_space,
    "central_force": _planet,
    "rosette": _planet,
    "arenstorf": _satellite,
    "restricted_three_body": _satellite,
    "duffing": _in_a_row(lambda s: [s.q]),
    "spring_pendulum": lambda s: _hung([0, 0], s.q),
    "kicked_rotor": lambda s: _hung([0, 0], arm(s.q)),
    "accelerated_pivot": _pendulum,  # as seen in the car
    "lengthening_pendulum": _lengthening,
    "forced_oscillator": _in_a_row(lambda s: [s.q]),
    "caldirola_kanai": _in_a_row(lambda s: [s.q]),
    "linear_drag": draw_ball,
    "rotating_wire": _wire,
    "block_on_wedge": _wedge,
    "coupled_oscillators": _in_a_row(lambda s: [s.q[0] - 2, s.q[1] + 2]),
    "fpu_chain": _in_a_row(_fpu_places),
    "toda_chain": _toda,
    "radial_motion": _in_a_row(lambda s: [ca.SX(0), s.q]),
    "free_rigid_body": euler,
    "heavy_rigid_body": euler,
    "great_circle": _on_surface(lambda s: parameters_of(s).R * axis(s.q[0], s.q[1])),
    "torus_geodesic": _on_surface(_on_torus),
    "spheroid_geodesic": _on_surface(_on_spheroid),
    "brachistochrone": _on_surface(lambda s: ca.vertcat(s.q[0], -(s.q[1] ** 2) / 2)),
    "catenary": _flat,
    "double_atwood": _double_atwood,
    "andrews_mechanism": andrews,
    "rest_to_rest": _in_a_row(lambda s: [s.q]),
    "fastest_transfer": _in_a_row(lambda s: [s.q]),
    "swing_up_cart_pole": _on_cart,
    "overhead_crane": _on_cart,
    "swing_up_pendulum": _pendulum,
    "swing_up_acrobot": _two_joints,
    "swing_up_rod": _chain,
    "orbit_transfer": _planet,
    "free_floating_robot": draw_robot,
    "walker": walker,
    "falling_cat": draw_cat,
    "hovercraft": hovercraft,
    "carried_load": lambda s: draw_arms(s.q[:4]),
    "carried_load_reduced": lambda s: draw_arms(arm_angles(s.q)),
}
