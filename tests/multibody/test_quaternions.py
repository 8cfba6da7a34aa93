"""Quaternions of machines: no constraint holds their length, and nothing depends on it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machines import floating

import varint as vi
import varint.multibody as mb
from varint.integration.error_scale import error_scales
from varint.scene.rays import tangent_columns

UNIT = 1e-15


def start(model: mb.Model) -> tuple[np.ndarray, np.ndarray]:
    return mb.start_values(
        model,
        {"b0": [1, 2, 3, 0.5, 0.1, -0.7, 0.2], "b1": [0.3, 0.4, -0.2, 0.9], "b2": 0.4},
        {"b0": [0.3, 0.2, 0.1, 1.0, -0.6, 0.8], "b1": [-0.5, 0.7, 1.1], "b3": 0.2},
    )


def held() -> vi.System:
    """The same machine with |q|² = 1 as a constraint and no energy of the lengths."""
    s = floating().system()
    quaternions = [s.q[list(group)] for group in s.rays]
    rates = [s.v[list(group)] for group in s.rays]
    along = ca.vertcat(
        *(ca.dot(x, y) / ca.sumsqr(x) for x, y in zip(quaternions, rates, strict=True))
    )
    inertias = ca.hessian(s.lagrangian, s.v)[0]
    weights = [
        ca.bilin(inertias[list(group), list(group)], x, x)
        for group, x in zip(s.rays, quaternions, strict=True)
    ]
    lagrangian = s.lagrangian - ca.dot(ca.vertcat(*weights), along**2) / 2
    rows = ca.vertcat(*(ca.sumsqr(x) - 1 for x in quaternions))
    return vi.System(s.q, s.v, lagrangian, constraint=rows)


@pytest.mark.long
def test_the_motion_is_that_of_quaternions_held_by_a_constraint():
    """Two formulations, two families of rules, one motion."""
    model = floating()
    q0, v0 = start(model)
    free = vi.simulate(model.system(), vi.gauss(4), q0=q0, v0=v0, h=0.01, steps=10)
    bound = vi.simulate(held(), vi.lobatto(5), q0=q0, v0=v0, h=0.005, steps=20)
    assert not model.system().structure.constraints
    assert abs(free.q[-1] - bound.q[-1]).max() <= 1e-12
    assert abs(free.v[-1] - bound.v[-1]).max() <= 1e-11


def test_nodes_and_what_is_between_them_are_unit_quaternions():
    model = floating()
    q0, v0 = start(model)
    motion = vi.simulate(model.system(), vi.gauss(1), q0=q0, v0=v0, h=0.05, steps=20)
    between = motion.at([0.123, 0.777])
    for found in (motion, between):
        for group in model.system().rays:
            q, v = found.q[:, list(group)], found.v[:, list(group)]
            assert abs(np.linalg.norm(q, axis=1) - 1).max() <= UNIT
            assert abs((q * v).sum(axis=1)).max() <= 1e-13


def test_the_length_of_a_start_does_not_matter():
    model = floating()
    q0, v0 = start(model)
    long, fast = q0.copy(), v0.copy()
    long[3:7] *= 3.0
    fast[7:11] += 0.8 * q0[7:11]  # along the quaternion, where no rotation is
    runs = [
        vi.simulate(model.system(), vi.gauss(3), q0=q, v0=v, h=0.01, steps=20)
        for q, v in ((q0, v0), (long, fast))
    ]
    assert abs(runs[0].q - runs[1].q).max() <= 1e-14


@pytest.mark.parametrize("rule", [vi.gauss(1), vi.gauss(3)])
def test_angular_momentum_about_any_axis_is_kept_by_coarse_steps(rule):
    """Rotations act linearly on quaternions: bilinear integrals, kept exactly by Gauss rules."""
    model = floating()
    model.machine.gravity = np.zeros(3)
    q0, v0 = start(model)
    total = ca.SX.zeros(3)
    for body in model.bodies.values():
        centre = model.frame((body, body.com))
        inertia = ca.mtimes([centre.rotation, ca.SX(body.inertia), centre.rotation.T])
        total += ca.mtimes(inertia, centre.angular_velocity)
        total += ca.cross(centre.position, body.mass * centre.velocity)
    motion = vi.simulate(model.system(), rule, q0=q0, v0=v0, h=0.05, steps=100)
    kept = motion.value(total)
    assert abs(kept - kept[0]).max() <= 1e-12 * abs(kept[0]).max()
    assert abs(motion.q[-1, 3:7] - motion.q[0, 3:7]).max() > 0.1


def test_a_scene_with_rays_comes_back_from_another_process():
    s = floating().system()
    rebuild, arguments = s.__reduce__()
    assert rebuild(*arguments).rays == s.rays == ((3, 4, 5, 6), (7, 8, 9, 10))


def test_rays_are_refused_where_the_length_matters():
    q, v = vi.coordinates("x", "y")
    with pytest.raises(vi.InputError, match="changes with the length"):
        vi.System(q, v, ca.sumsqr(v) / 2, rays=[(0, 1)])
    with pytest.raises(vi.InputError, match="groups of different coordinates"):
        vi.System(q, v, ca.sumsqr(v) / ca.sumsqr(q), rays=[(0, 2)])
    turning = ((q[0] * v[1] - q[1] * v[0]) / ca.sumsqr(q)) ** 2 / 2
    with pytest.raises(vi.InputError, match="no inertia"):
        vi.System(q, v, turning, rays=[(0, 1)])
    vi.System(q, v, turning + (ca.dot(q, v) / ca.sumsqr(q)) ** 2 / 2, rays=[(0, 1)])
    scene = vi.System(q, v, ca.sumsqr(v) / ca.sumsqr(q) / 2, rays=[(0, 1)])
    with pytest.raises(vi.InputError, match="all zero"):
        vi.simulate(scene, q0=[0, 0], v0=[0, 1], h=0.1, steps=1)


def test_a_ray_of_two_turns_on_the_circle():
    """L = ½ |v|²/|q|²: the angle moves uniformly, 1 rad/s."""
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / ca.sumsqr(q) / 2, rays=[(0, 1)])
    motion = vi.simulate(scene, vi.gauss(6), q0=[5, 0], v0=[0, 1], h=0.1, steps=10)
    assert abs(motion.q[-1] - [np.cos(1), np.sin(1)]).max() <= 1e-13
    assert abs(tangent_columns(scene.rays, motion.q[-1]).T @ motion.q[-1]).max() <= 1e-15


def test_tangents_are_rotation_vectors():
    """R(q + dq) = R(q) (1 + [δθ]×) to first order for δq = B δθ."""
    model = floating()
    q0, _ = start(model)
    basis = tangent_columns(model.system().rays, q0)
    assert basis.shape == (13, 11)
    turn, step = np.array([0.3, -0.2, 0.5]), 1e-6
    moved = q0 + step * basis @ np.concatenate([np.zeros(3), turn, np.zeros(5)])
    before, after = (mb.quaternion_matrix(q[3:7] / np.linalg.norm(q[3:7])) for q in (q0, moved))
    skew = (before.T @ after - np.eye(3)) / step
    assert abs(np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) - turn).max() <= 1e-6


def test_an_attitude_is_reached_at_the_same_cost_by_coarse_steps_of_two_rules():
    """The end is a direction of four numbers: no path pays for their length."""
    world = mb.Model(gravity=(0, 0, 0))
    world.spherical(world, world.body(1.0, inertia=(0.6, 0.75, 0.5), name="top"))
    for axis, turn in zip("xyz", ([0, 1, 0], [-1, 0, 0], [0, 0, 1]), strict=True):
        angle = 0.0 if axis == "z" else np.pi / 2
        place = mb.placed((0, 0, 0), mb.axis_rotation(turn, angle))
        world.thrust(("top", place), axis, kind="torque")
    scene, (q0, v0) = world.system(), mb.start_values(world)
    wanted = mb.start_values(world, {"top": [0.5, 0.4, -0.6, 0.3]})[0]
    given = dict(duration=1.0, steps=8, cost=ca.sumsqr(scene.control))
    ends = dict(start=dict(q=q0, v=v0), end=dict(q=2 * wanted, v=np.zeros(4)))
    found = [
        vi.optimal_control(scene, rule, **given, **ends) for rule in (vi.gauss(2), vi.lobatto(3))
    ]
    assert np.isclose(found[0].cost, found[1].cost, rtol=2e-3)
    for path in found:
        assert abs(path.q[-1] - wanted).max() <= 1e-8
        assert abs(path.v[-1]).max() <= 1e-7


def test_errors_of_attitudes_and_places_are_measured_by_the_whole_of_them():
    """A plate that falls and hardly turns: x and qw move by round-off, z and qx by far more."""
    world = mb.Model()
    plate = world.body(5.0, inertia=(0.1, 0.1, 0.2), name="plate")
    world.free(world, plate, name="plate")
    for x, y in ((0.4, 0.0), (-0.4, 0.3), (-0.4, -0.3)):
        world.spring(("world", (x, y, 1)), (plate, (x, y, 0)), stiffness=2e4, rest=1, damping=50)
    scene = world.system()
    q0, v0 = mb.start_values(world, {}, {"plate": [0, 0, 0, 0, 0, 0.2]})
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=0.5)
    scales = error_scales(scene, motion)
    assert np.ptp(scales[:3]) == 0 and np.ptp(scales[3:]) == 0
    assert motion.stats["error_estimate"] <= 1e-9
