"""Machines in motion against closed forms and the benchmarks of the multibody community."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machines import andrews, bricard, flat_four_bar, jansen_legs, slider_crank
from references import entries

import varint as vi
import varint.multibody as mb


def body_on_a_ball(inertia, com=(0.0, 0.0, 0.0), gravity=0.0, mass=1.0) -> mb.Model:
    world = mb.Model(gravity=(0, 0, -gravity))
    world.spherical(world, world.body(mass, com, inertia, "top"))
    return world


def test_a_free_body_on_a_ball_joint_turns_as_jacobi_says():
    found = entries("a")["A11_euler_top_generic"]
    model = body_on_a_ball(found["params"]["I"])
    q0, v0 = mb.start_values(model, {"top": [2, 0, 0, 0]}, {"top": found["initial"]["omega_body"]})
    motion = vi.simulate(model.system(), vi.gauss(6), q0=q0, v0=v0, h=0.02, duration=20.0)
    exact = found["reference"]["quaternion"][2]
    assert abs(motion.q[-1] - exact).max() <= 1e-13
    spin = motion.value(
        ca.mtimes(
            ca.mtimes(model.frame("top").rotation, ca.diag(ca.DM(found["params"]["I"]))),
            ca.mtimes(model.frame("top").rotation.T, model.frame("top").angular_velocity),
        )
    )
    assert abs(spin - found["reference"]["L_space"]).max() <= 1e-13


def test_a_heavy_top_on_a_ball_joint_nods_as_lagrange_says():
    found = entries("a")["A11_lagrange_top_loops"]
    one, three, weight = (found["params"][name] for name in ("I1", "I3", "mgl"))
    height = 0.5
    across = one - height**2
    model = body_on_a_ball((across, across, three), (0, 0, height), weight / height)
    start = found["initial"]
    q0, v0 = mb.start_values(model, {"top": start["quaternion"]}, {"top": start["omega_body"]})
    motion = vi.simulate(model.system(), vi.gauss(6), q0=q0, v0=v0, h=0.005, duration=5.0)
    assert abs(motion.q[-1] - found["reference"]["quaternion"][-1]).max() <= 1e-11


def test_a_free_joint_flies_and_turns_at_once():
    """The centre of mass falls on a parabola while the body turns about it as if alone."""
    found = entries("a")["A11_euler_top_generic"]
    world, com = mb.Model(), np.array([0.3, -0.2, 0.1])
    body = world.body(2.0, com, found["params"]["I"], "stone")
    world.free(world, body)
    omega = np.array(found["initial"]["omega_body"])
    velocity = np.array([1.0, 2.0, 3.0]) - np.cross(omega, com)
    q0, v0 = mb.start_values(world, {}, {"stone": [*velocity, *omega]})
    motion = vi.simulate(world.system(), q0=q0, v0=v0, h=0.002, duration=1.0)
    assert abs(motion.q[-1, 3:] - found["reference"]["quaternion"][0]).max() <= 1e-10
    centre = motion.value(world.frame(("stone", com)).position)[-1]
    fallen = np.array([1.0, 2.0, 3.0 - 9.81 / 2])
    assert abs(centre - com - fallen).max() <= 1e-10


def test_the_slider_crank_meets_its_reference():
    found = entries("c")["C_slider_crank_rigid"]
    model, start = slider_crank(), found["initial"]
    phi, psi = start["phi"], start["q"][5]
    q0 = [phi, psi - phi, start["q"][6]]
    v0 = [start["phidot"], start["v"][5] - start["phidot"], start["v"][6]]
    q0, v0 = vi.project(model.system(), q0, v0)
    motion = vi.simulate(model.system(), vi.lobatto(5), q0=q0, v0=v0, h=1e-3, duration=0.2)
    exact, rates = found["reference"]["q"][2], found["reference"]["v"][2]
    wanted = [exact[2], exact[5] - exact[2], exact[6]]
    assert abs(motion.q[-1] - wanted).max() <= 1e-11
    assert abs(motion.v[-1, 0] - rates[2]) <= 1e-9


def test_the_four_bar_of_iftomm_meets_its_reference():
    """Until just before it folds for the first time; rows out of its plane were left out."""
    found = entries("c")["C_N_four_bar_N2"]
    model = flat_four_bar(2)
    system = model.system()
    assert (system.structure.n, system.structure.constraints) == (5, 4)
    rates = dict.fromkeys(("crank0", "crank1", "crank2"), 1.0) | dict.fromkeys(
        ("coupler0", "coupler1"), -1.0
    )
    q0, v0 = mb.start_values(model, {}, rates)
    motion = vi.simulate(system, vi.lobatto(5), q0=q0, v0=v0, h=0.01, duration=0.5)
    [theta, rate] = found["reference"]["state"][0][4:]
    assert abs(motion.q[-1, :3] - theta).max() <= 1e-12
    assert abs(motion.v[-1, :3] - rate).max() <= 1e-12


def test_the_squeezer_is_that_of_its_equations():
    """From bodies, joints, loops and a spring: L and the loops of the hand-written scene."""
    made, hand = andrews().system(), vi.models.andrews_mechanism()
    torque = hand.system.defaults["mom"]
    terms = [
        ca.Function("terms", [s.q, s.v, s.c], [s.lagrangian, s.constraint])
        for s in (made, hand.system)
    ]
    random = np.random.default_rng(3)
    for _ in range(3):
        q, v = random.normal(size=(2, 7))
        [lagrangian, rows], [other, theirs] = (
            terms[0](q, v, []),
            terms[1](q, v, hand.system.default_vector),
        )
        assert np.isclose(float(lagrangian), float(other) - torque * q[0], rtol=1e-13)
        assert abs(np.array(rows - theirs)).max() <= 1e-15
    force = ca.Function("F", [made.q, made.v, made.control], [made.force])
    assert (np.array(force(q, v, torque)).ravel() == torque * np.eye(7)[0]).all()


@pytest.mark.long
def test_the_squeezer_of_iftomm_meets_its_reference():
    found = entries("c")["C_andrews"]
    system = andrews().system()
    q0, v0 = vi.project(system, found["initial"]["q"], np.zeros(7))
    u = [found["params"]["mom"]]
    motion = vi.simulate(system, vi.lobatto(6), q0=q0, v0=v0, h=2e-5, duration=0.03, u=u)
    state = np.array(found["reference"]["state"][3])
    assert abs(motion.q[-1] - state[:7]).max() <= 1e-11
    assert abs(motion.v[-1] - state[7:14]).max() <= 1e-11 * abs(state[7:14]).max()
    gaps = ca.Function("g", [system.q], [system.constraint])
    assert max(abs(np.array(gaps(q))).max() for q in motion.q[::50]) <= 1e-15


def test_the_pendulum_of_iftomm_meets_its_reference():
    """Benchmark A01, released level, from a hinge; the place of the bob and its velocity."""
    found = entries("a")["A05_pendulum_cartesian_iftomm_A01"]
    world = mb.Model(gravity=(0, -9.81, 0))
    bob = world.body(1.0, (1, 0, 0), name="bob")
    world.revolute(world, bob, (0, 0, 1))
    end = world.frame((bob, (1, 0, 0)))
    motion = vi.simulate(world.system(), vi.gauss(8), q0=np.pi, v0=0.0, h=0.02, duration=10.0)
    state = np.hstack([motion.value(x)[-1, :2] for x in (end.position, end.velocity)])
    assert abs(state - found["reference"]["state"][-1]).max() <= 1e-12


def test_the_loop_of_bricard_turns_though_it_has_a_row_too_many():
    """Five hinges and five rows of rank four; by its threefold symmetry every other hinge turns
    alike, and two neighbours a, b from the right angles at the start by sin a sin b + sin a + sin b
    = 0.
    """
    model = bricard()
    system = model.system()
    assert system.structure.constraints == system.structure.n == 5
    q0 = np.zeros(5)
    slope = ca.Function("G", [system.q], [ca.jacobian(system.constraint, system.q)])
    rows = np.array(slope(q0))
    assert np.linalg.matrix_rank(rows, tol=1e-12) == 4
    free = np.linalg.svd(rows)[2][-1]
    with pytest.warns(UserWarning, match="redundant"):
        motion = vi.simulate(system, q0=q0, v0=free / abs(free).max(), h=0.005, duration=1.0)
    gaps = ca.Function("g", [system.q], [system.constraint])
    assert max(abs(np.array(gaps(q))).max() for q in motion.q[::20]) <= 1e-12
    assert np.ptp(motion.energy) <= 1e-7 * abs(motion.energy).max() + 1e-7
    turned = abs(motion.q)
    assert abs(turned[:, 0] - turned[:, 2]).max() <= 1e-11
    assert abs(turned[:, 0] - turned[:, 4]).max() <= 1e-11
    assert abs(turned[:, 1] - turned[:, 3]).max() <= 1e-11
    assert turned[:, 0].max() > 1
    one, other = np.sin(motion.q[:, :2] * [np.sign(free[0]), -np.sign(free[1])]).T
    assert abs(one * other + one + other).max() <= 1e-11


def test_gears_and_screws_are_no_coordinates():
    """A nut on a turning spindle with a geared wheel: one coordinate, the reflected inertia."""
    world = mb.Model()
    spindle = world.body(1.0, inertia=0.2, name="spindle")
    wheel = world.body(1.0, inertia=0.3, name="wheel")
    nut = world.body(2.0, name="nut")
    world.revolute(world, spindle)
    world.revolute(world, wheel, at=(1, 0, 0))
    world.prismatic(world, nut)
    world.mimic("wheel", "spindle", -3.0)
    world.screw("nut", "spindle", 0.5)
    pitch = 0.5 / (2 * np.pi)
    inertia = 0.2 + 9 * 0.3 + 2.0 * pitch**2
    assert np.isclose(float(world.dynamics.mass_matrix(0.0)), inertia, rtol=1e-15)
    motion = vi.simulate(world.system(), q0=0.0, v0=0.0, h=0.01, duration=1.0)
    assert np.isclose(motion.q[-1, 0], -2.0 * pitch * 9.81 / inertia / 2, rtol=1e-12)
    assert np.isclose(motion.value(world.frame("nut").position)[-1, 2], pitch * motion.q[-1, 0])


def test_springs_dampers_friction_and_motors_act_as_they_say():
    world = mb.Model(gravity=(0, 0, 0), creep=1e-6)
    block = world.body(2.0, name="block")
    passive = mb.Passive(armature=1.0, damping=0.5, friction=0.7, stiffness=3.0, rest=0.1)
    world.prismatic(world, block, (1, 0, 0), passive=passive)
    world.spring(block, ("world", (0, 1, 0)), 5.0, 0.2, 0.3)
    motor = world.motor("block", gear=4.0, limits=(-1, 1))
    s = world.system()
    force = ca.Function("f", [s.q, s.v, s.control], [ca.gradient(s.lagrangian, s.q) + s.force])
    x, v, u = 0.6, 0.8, 0.9
    length = np.hypot(x, 1)
    pull = 5.0 * (length - 0.2) + 0.3 * (x * v / length)
    wanted = -0.5 * v - 0.7 - 3.0 * (x - 0.1) - pull * x / length + 4.0 * u
    assert np.isclose(float(force(x, v, u)), wanted, rtol=1e-10)
    assert float(s.mass_matrix) == 3.0
    [(least, control, most)] = world.bounds()
    assert (least, most) == (-1, 1) and ca.is_equal(control, motor.u)


def test_computed_torque_follows_a_path_and_gravity_compensation_holds():
    world = mb.Model()
    upper = world.body(1.0, (0, 0, -0.5), 0.1, "upper")
    lower = world.body(1.0, (0, 0, -0.5), 0.1, "lower")
    for parent, child, at in ((world, upper, 0.0), (upper, lower, -1.0)):
        world.revolute(parent, child, (0, 1, 0), (0, 0, at))
        world.motor(child.name)
    system, steps, h = world.system(), 100, 0.01
    held = np.array(world.dynamics.gravity([0.4, 0.3])).ravel()
    still = vi.simulate(
        system, vi.gauss(3), q0=[0.4, 0.3], v0=[0, 0], h=h, steps=50, u=np.tile(held, (50, 3, 1))
    )
    assert abs(still.q - [0.4, 0.3]).max() <= 1e-12
    nodes = np.array(vi.gauss(3).nodes)
    t = (np.arange(steps)[:, None] + nodes) * h
    path = [np.stack([np.sin(t), np.cos(2 * t)], -1)]
    path.append(np.stack([np.cos(t), -2 * np.sin(2 * t)], -1))
    path.append(np.stack([-np.sin(t), -4 * np.cos(2 * t)], -1))
    torque = world.dynamics.inverse(*(x.reshape(-1, 2).T for x in path))
    motion = vi.simulate(
        system,
        vi.gauss(3),
        q0=[0, 1],
        v0=[1, 0],
        h=h,
        steps=steps,
        u=np.array(torque).T.reshape(steps, 3, 2),
    )
    assert abs(motion.q[-1] - [np.sin(1.0), np.cos(2.0)]).max() <= 1e-9


@pytest.mark.long
@pytest.mark.parametrize("weight", [0.0, 2.0])
def test_tops_keep_their_momenta_over_a_hundred_thousand_steps(weight):
    model = body_on_a_ball((0.75, 0.75, 0.5), (0, 0, 0.5), weight / 0.5)
    q0, v0 = mb.start_values(model, {"top": [0.9, 0.43, 0, 0]}, {"top": [0.3, -0.5, 9.6]})
    s, frame = model.system(), model.frame("top")
    steps = 100_000
    motion = vi.simulate(s, vi.gauss(6), q0=q0, v0=v0, h=0.01, steps=steps, save_every=1000)
    omega = ca.mtimes(frame.rotation.T, frame.angular_velocity)
    spin = ca.mtimes(frame.rotation, ca.DM([1.0, 1.0, 0.5]) * omega)
    kept = spin if not weight else ca.vertcat(spin[2], omega[2])
    values = motion.value(kept)
    assert abs(values - values[0]).max() <= 1e-12 * max(1, abs(values[0]).max())
    assert np.ptp(motion.energy) <= 1e-12 * abs(motion.energy[0])


@pytest.mark.long
def test_jansens_legs_walk_for_a_hundred_seconds_with_closed_loops():
    model, start = jansen_legs()
    system = model.system()
    assert (len(model.bodies), system.structure.constraints) == (13, 12)
    q0, v0 = vi.project(system, *start)
    motion = vi.simulate(system, q0=q0, v0=v0, h=0.005, duration=100.0, save_every=20)
    gaps = ca.Function("g", [system.q], [system.constraint])
    assert max(abs(np.array(gaps(q))).max() for q in motion.q) <= 1e-13
    drift = motion.energy - motion.energy[0]
    assert abs(drift).max() <= 1e-4 * abs(motion.energy[0])
    assert motion.q[-1, 0] > 2 * np.pi  # the crank turns
