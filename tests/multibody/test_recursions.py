"""Recursions over the tree against what follows from the Lagrangian, two ways to each quantity."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machines import floating, many_joints, plane_chain, spatial_chain

import varint as vi
import varint.multibody as mb
from varint.codegen.gauss import gauss_scheme
from varint.scene.rays import start_on_rays

MACHINES = {
    "spatial chain": lambda: spatial_chain(7),
    "plane chain": lambda: plane_chain(4),
    "all joints": many_joints,
    "floating": floating,
}


def random_state(system: vi.System, seed: int) -> tuple[np.ndarray, ...]:
    """q, v, a with unit quaternions and rates at right angles to them."""
    random = np.random.default_rng(seed)
    q, v, a = random.normal(size=(3, system.structure.n))
    return *start_on_rays(system.rays, q, v), a


@pytest.mark.parametrize("name", MACHINES)
def test_composite_bodies_give_the_mass_matrix_of_the_lagrangian(name):
    model = MACHINES[name]()
    s = model.system()
    derived = ca.Function("M", [s.q], [ca.densify(ca.hessian(s.lagrangian, s.v)[0])])
    for seed in range(3):
        q, _, _ = random_state(s, seed)
        true, found = np.array(derived(q)), np.array(model.dynamics.mass_matrix(q))
        assert abs(found - true).max() <= 1e-14 * abs(true).max()


@pytest.mark.parametrize("name", MACHINES)
def test_newton_and_euler_give_the_forces_of_lagrange(name):
    """d/dt ∂L/∂v − ∂L/∂q less damping."""
    model = MACHINES[name]()
    s, a = model.system(), ca.SX.sym("a", model.v.numel())
    lagrange = ca.jtimes(s.momentum, ca.vertcat(s.q, s.v), ca.vertcat(s.v, a))
    lagrange -= ca.gradient(s.lagrangian, s.q) + s.force
    derived = ca.Function("EL", [s.q, s.v, a], [lagrange])
    for seed in range(3):
        q, v, acceleration = random_state(s, seed)
        true = np.array(derived(q, v, acceleration)).ravel()
        found = np.array(model.dynamics.inverse(q, v, acceleration)).ravel()
        assert abs(found - true).max() <= 1e-13 * abs(true).max()


def test_inverse_dynamics_is_mass_times_acceleration_and_bias():
    model = many_joints()
    d, (q, v, a) = model.dynamics, random_state(model.system(), 5)
    together = np.array(d.mass_matrix(q)) @ a + np.array(d.bias(q, v)).ravel()
    assert np.allclose(np.array(d.inverse(q, v, a)).ravel(), together, rtol=1e-13)
    falling = many_joints()
    falling.machine.gravity = np.zeros(3)
    held = np.array(d.bias(q, 0 * v) - falling.dynamics.bias(q, 0 * v))
    assert np.allclose(np.array(d.gravity(q)), held, atol=1e-12)


@pytest.mark.parametrize("links", [2, 7, 30, 0])
def test_articulated_bodies_invert_the_momentum(links):
    """p(v(p)) = p to round-off, though M of thirty links has a condition of a million; 0: a tree
    with ball joints, whatever the lengths of its quaternions.
    """
    s = spatial_chain(links).system() if links else floating().system()
    p = s.kinetics.momentum
    back = ca.Function("v", [s.q, p], [s.kinetics.velocity])
    momentum = ca.Function("p", [s.q, s.v], [s.momentum])
    for seed in range(3):
        q, v = np.random.default_rng(seed).normal(size=(2, s.structure.n))
        wanted = np.array(momentum(q, v))
        assert abs(np.array(momentum(q, back(q, wanted))) - wanted).max() <= (
            1e-14 * (links or 4) * abs(wanted).max()
        )


def test_operations_grow_with_the_links_and_not_faster():
    """L, its gradient and v(q, p): three further links cost what the three before did."""

    def costs(links: int) -> np.ndarray:
        s = spatial_chain(links).system()
        known, state = s.kinetics, ca.vertcat(s.q, s.v)
        functions = (
            ca.Function("L", [s.q, s.v], [s.lagrangian], {"cse": True}),
            ca.Function("dL", [s.q, s.v], [ca.gradient(s.lagrangian, state)], {"cse": True}),
            ca.Function("v", [s.q, known.momentum], [known.velocity], {"cse": True}),
        )
        return np.array([f.n_instructions() for f in functions])

    one, two, three = costs(6), costs(9), costs(12)
    assert (abs((three - two) - (two - one)) <= 0.02 * (two - one)).all()


def test_steps_do_not_depend_on_when_inertias_are_taken():
    """The native loop takes them once a step, where its first evaluation puts the stages; here each
    step turns the links by half a radian. Where the iteration ends is round-off's: for 300 starts
    near this one after at most 37 evaluations a step.
    """
    world, last = mb.Model(gravity=(0, 0, -9.81)), "world"
    for i in range(3):
        body = world.body(1.0 + i, (0.05, 0.02, -0.3), (0.1, 0.12, 0.05), f"link{i}")
        world.revolute(last, body, np.eye(3)[i], (0, 0, -0.5))
        last = body.name
    scene, start = world.system(), {"q0": [0.3, -0.8, 1.2], "v0": [5.0, -6.0, 7.0]}
    run = {"h": 0.06, "steps": 8} | start
    assert "inertia" in gauss_scheme(scene, 2).functions
    native = vi.simulate(scene, vi.gauss(2), backend="native", **run)
    exact = vi.simulate(scene, vi.gauss(2), backend="interpreted", **run)
    assert abs(np.diff(native.q, axis=0)).max() > 0.4
    assert abs(native.q - exact.q).max() <= 1e-11
    assert native.stats["iterations"] <= 40 * 8


def test_a_chain_is_the_hand_written_one():
    """Joint angles are differences of the model's angles: M and forces transform as tensors."""
    links = 4
    hand, made = vi.models.chain_pendulum(links).system, plane_chain(links, 0.25, 0.25).system()
    sums = np.tril(np.ones((links, links)))  # θ = sums @ q
    forces = [
        ca.Function(
            "f", [s.q, s.v, s.c], [ca.densify(s.mass_matrix), ca.gradient(s.lagrangian, s.q)]
        )
        for s in (hand, made)
    ]
    for seed in range(3):
        q, v = np.random.default_rng(seed).normal(size=(2, links))
        mass, force = map(np.array, forces[0](sums @ q, sums @ v, hand.default_vector))
        other_mass, other_force = map(np.array, forces[1](q, v, []))
        assert np.allclose(sums.T @ mass @ sums, other_mass, rtol=1e-14, atol=1e-15)
        assert np.allclose(sums.T @ force, other_force, rtol=1e-13, atol=1e-14)


def test_frames_move_with_their_jacobians():
    """J v is the velocity, and the velocity is the derivative of the place along the motion."""
    model = floating()
    s, frame = model.system(), model.frame(("b3", (0.2, 0.3, 0.4)))
    state = [s.q, s.v]
    along = ca.jtimes(frame.position, s.q, s.v)
    turned = ca.reshape(ca.jtimes(ca.vec(frame.rotation), s.q, s.v), 3, 3)
    turning = ca.mtimes(turned, frame.rotation.T)
    spin = ca.vertcat(turning[2, 1], turning[0, 2], turning[1, 0])
    check = ca.Function(
        "check",
        state,
        [
            ca.vertcat(frame.velocity - along, frame.angular_velocity - spin),
            ca.mtimes(frame.jacobian, s.v) - ca.vertcat(frame.velocity, frame.angular_velocity),
        ],
    )
    q, v, _ = random_state(s, 1)
    assert all(abs(np.array(x)).max() <= 1e-13 for x in check(q, v))


def test_energy_of_a_machine_is_that_of_its_bodies():
    """Σ ½ m |v|² + ½ ω·I ω + m g z of the bodies' own frames, rotors and springs added."""
    model = floating()
    s, total = model.system(), ca.SX(0)
    for body in model.bodies.values():
        centre = model.frame((body, body.com))
        omega = ca.mtimes(centre.rotation.T, centre.angular_velocity)
        total += body.mass * ca.sumsqr(centre.velocity) / 2
        total += ca.dot(omega, ca.mtimes(ca.SX(body.inertia), omega)) / 2
        total -= body.mass * ca.dot(ca.SX(model.machine.gravity), centre.position)
    difference = ca.Function("d", [s.q, s.v], [total - s.energy, s.energy])
    q, v, _ = random_state(s, 2)
    gap, energy = map(float, difference(q, v))
    assert abs(gap) <= 1e-13 * abs(energy)
    assert isinstance(model.frame("b1"), mb.Frame)
