"""Holonomic constraints: orders, hidden constraint, structure, physical multipliers."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from references import entries
from scenes import cartesian_pendulum, slopes

import varint as vi
from varint.discrete.scales import scale_function
from varint.integration.steppers.constrained import constrained_stepper
from varint.integration.steppers.rattle import rattle_stepper

LOBATTO = [vi.lobatto(2), vi.lobatto(3), vi.lobatto(4)]
REFERENCE = entries("a")


def quartic_surface() -> vi.System:
    """Mass matrix depends on q and couples, potential is nonlinear, the surface is of degree
    four.
    """
    q, v = vi.coordinates("x", "y", "z")
    kinetic = (
        (1 + q[0] ** 2) * v[0] ** 2
        + v[1] ** 2
        + (1 + q[1] ** 2 / 2) * v[2] ** 2
        + 0.4 * q[2] * v[0] * v[1]
    ) / 2
    potential = ca.sin(q[0]) + q[1] * q[2] ** 2 + q[2]
    return vi.System(q, v, kinetic - potential, constraint=ca.sum1(q**4) - 1)


def rods(links: int) -> vi.System:
    """Chain of unit masses and rods, hung up at the origin."""
    q, v = vi.coordinates(*(f"{a}{i}" for i in range(links) for a in "xy"))
    ends = [ca.SX.zeros(2, 1), *ca.vertsplit(q, 2)]
    lengths = [ca.sumsqr(b - a) - 1 for a, b in pairwise(ends)]
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * ca.sum1(q[1::2]), constraint=ca.vertcat(*lengths)
    )


def start_on_the_surface():
    return vi.project(quartic_surface(), [0.7, 0.6, -0.6], [0.5, -0.3, 0.9])


@pytest.mark.parametrize(
    ("rule", "coarsest"), [(vi.lobatto(2), 100), (vi.lobatto(3), 40), (vi.lobatto(4), 30)], ids=str
)
def test_position_momentum_and_multiplier_have_the_order_of_the_rule(rule, coarsest):
    system, (q0, v0) = quartic_surface(), start_on_the_surface()
    exact = vi.simulate(system, vi.lobatto(8), q0=q0, v0=v0, duration=2.0, steps=200)
    steps = [round(coarsest * 1.4**i) for i in range(4)]
    errors = []
    for n in steps:
        motion = vi.simulate(system, rule, q0=q0, v0=v0, duration=2.0, steps=n)
        errors.append(
            [
                np.abs(getattr(motion, x)[-1] - getattr(exact, x)[-1]).max()
                for x in ("q", "p", "multipliers")
            ]
        )
    np.testing.assert_allclose(slopes(steps, np.array(errors), 1e-13), rule.order, atol=0.15)


@pytest.mark.parametrize("rule", LOBATTO, ids=str)
def test_dense_output_with_constraints_has_the_order_of_the_rule(rule):
    system, (q0, v0) = quartic_surface(), start_on_the_surface()
    times = np.linspace(0.1, 1.9, 7) + 0.0031
    exact = vi.simulate(system, vi.lobatto(8), q0=q0, v0=v0, duration=2.0, steps=200).at(times)
    steps = [round({2: 100, 4: 40, 6: 26}[rule.order] * 1.4**i) for i in range(4)]
    errors = [
        [
            np.linalg.norm(
                vi.simulate(system, rule, q0=q0, v0=v0, duration=2.0, steps=n).at(times).q - exact.q
            )
        ]
        for n in steps
    ]
    np.testing.assert_allclose(slopes(steps, np.array(errors), 1e-13), rule.order, atol=0.3)


@pytest.mark.parametrize("rule", LOBATTO, ids=str)
def test_both_constraints_hold_at_every_node_of_a_long_run_without_energy_slope(rule):
    system, (q0, v0) = quartic_surface(), start_on_the_surface()
    motion = vi.simulate(system, rule, q0=q0, v0=v0, h=0.02, steps=100_000)
    assert np.abs(motion.value(system.constraint)).max() <= 1e-12
    # v by M⁻¹ p alone, without the projection that Trajectory.v makes
    p = ca.SX.sym("p", 3)
    hidden = ca.mtimes(ca.jacobian(system.constraint, system.q), ca.solve(system.mass_matrix, p))
    both = ca.Function("hidden", [system.q, p], [hidden])
    assert np.abs(np.array(both.map(len(motion))(motion.q.T, motion.p.T))).max() <= 1e-10
    windows = motion.energy[1:].reshape(100, -1).mean(axis=1)
    x = np.arange(100) - 49.5
    slope = (x @ windows) / (x @ x)
    rest = windows - windows.mean() - slope * x
    alike = rest[1:] @ rest[:-1] / (rest @ rest)  # slow beats: neighbours are no independent draws
    noise = np.std(rest) / np.sqrt(x @ x) * np.sqrt((1 + alike) / (1 - alike))
    assert abs(slope) < 4 * noise + 1e-15


def test_a_step_is_symplectic_on_the_tangent_space_of_the_constraint_manifold():
    system, (q0, v0) = quartic_surface(), start_on_the_surface()
    for rule in LOBATTO:
        start = vi.simulate(system, rule, q0=q0, v0=v0, h=0.05, steps=3)
        q, p = ca.MX.sym("q", 3), ca.MX.sym("p", 3)
        out = vi.step_function(system, rule)(q0=q, p0=p, t=0, h=0.1)
        y = ca.vertcat(q, p)
        a = np.array(
            ca.Function("slope", [q, p], [ca.jacobian(ca.vertcat(out["q1"], out["p1"]), y)])(
                *_last(start)
            )
        )
        sq, sp = ca.SX.sym("q", 3), ca.SX.sym("p", 3)
        mass = ca.substitute(system.mass_matrix, system.q, sq)
        g = ca.substitute(system.constraint, system.q, sq)
        both = ca.vertcat(g, ca.mtimes(ca.jacobian(g, sq), ca.solve(mass, sp)))
        rows = np.array(
            ca.Function("rows", [sq, sp], [ca.jacobian(both, ca.vertcat(sq, sp))])(*_last(start))
        )
        tangent = np.linalg.svd(rows)[2][2:].T
        j = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
        moved = a @ tangent
        assert np.abs(moved.T @ j @ moved - tangent.T @ j @ tangent).max() <= 1e-12
        assert np.abs(a.T @ j @ a - j).max() > 1e-6  # off the manifold it is not: the test can fail


def _last(motion):
    return motion.q[-1], motion.p[-1]


@pytest.mark.parametrize("rule", LOBATTO, ids=str)
def test_constrained_motion_is_reversible(rule):
    system, (q0, v0) = quartic_surface(), start_on_the_surface()
    there = vi.simulate(system, rule, q0=q0, v0=v0, h=0.05, steps=100)
    back = vi.simulate(system, rule, q0=there.q[-1], p0=-there.p[-1], h=0.05, steps=100)
    np.testing.assert_allclose(back.q[-1], q0, atol=1e-11)
    np.testing.assert_allclose(back.p[-1], -there.p[0], atol=1e-11)


def test_the_angular_momentum_of_a_spherical_pendulum_stays_over_1e5_steps():
    q, v = vi.coordinates("x", "y", "z")
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[2], constraint=ca.sumsqr(q) - 1)
    entry = REFERENCE["A05_spherical_pendulum"]
    start = entry["initial"]
    turn = q[0] * v[1] - q[1] * v[0]
    for rule in (vi.trapezoidal(), vi.lobatto(3)):
        motion = vi.simulate(system, rule, q0=start["q"], v0=start["v"], h=0.01, steps=100_000)
        assert np.abs(motion.value(turn) - motion.value(turn)[0]).max() <= 1e-11
    exact = entry["reference"]
    motion = vi.simulate(
        system, vi.lobatto(6), q0=start["q"], v0=start["v"], duration=3.0, steps=300
    )
    at = [25, 100, 300]
    states = np.array(exact["state"])[[0, 1, 3]]
    np.testing.assert_allclose(np.hstack([motion.q, motion.v])[at], states, atol=1e-12)
    np.testing.assert_allclose(
        -2 * motion.multipliers[at, 0], np.array(exact["tension"])[[0, 1, 3]], rtol=1e-12
    )


def test_the_cartesian_pendulum_follows_the_exact_motion_and_tension():
    entry = REFERENCE["A05_pendulum_cartesian_iftomm_A01"]
    motion = vi.simulate(
        cartesian_pendulum(), vi.lobatto(4), q0=[-1, 0], v0=[0, 0], h=0.01, steps=1000
    )
    at = [round(100 * t) for t in entry["times"]]
    np.testing.assert_allclose(
        np.hstack([motion.q, motion.v])[at], entry["reference"]["state"], atol=2e-10
    )
    np.testing.assert_allclose(
        -2 * motion.multipliers[at, 0], entry["reference"]["tension"], rtol=0, atol=1e-9
    )


def test_full_turns_in_cartesian_coordinates_are_those_of_the_angle_to_the_order_of_the_rule():
    a, w = vi.coordinates("a")
    angle = vi.System(a, w, w**2 / 2 + 9.81 * ca.cos(a))
    exact = vi.simulate(angle, vi.gauss(8), q0=0.0, v0=7.0, duration=3.0, steps=300)
    end = [np.sin(exact.q[-1, 0]), -np.cos(exact.q[-1, 0])]
    tension = 9.81 * np.cos(exact.q[-1, 0]) + exact.v[-1, 0] ** 2
    for rule, coarsest in ((vi.lobatto(2), 400), (vi.lobatto(3), 100), (vi.lobatto(4), 60)):
        steps, errors = [round(coarsest * 1.4**i) for i in range(3)], []
        for n in steps:
            motion = vi.simulate(
                cartesian_pendulum(), rule, q0=[0, -1], v0=[7, 0], duration=3.0, steps=n
            )
            errors.append(
                [np.abs(motion.q[-1] - end).max(), abs(-2 * motion.multipliers[-1, 0] - tension)]
            )
        np.testing.assert_allclose(slopes(steps, np.array(errors), 1e-13), rule.order, atol=0.15)


def test_the_atwood_machine_is_exact():
    entry = REFERENCE["A06_atwood_light_pulley"]
    m1, m2, g, total = (entry["params"][name] for name in ("m1", "m2", "g", "ell"))
    q, v = vi.coordinates("x1", "x2")
    system = vi.System(
        q,
        v,
        (m1 * v[0] ** 2 + m2 * v[1] ** 2) / 2 + g * (m1 * q[0] + m2 * q[1]),
        constraint=q[0] + q[1] - total,
    )
    for rule in LOBATTO:
        motion = vi.simulate(
            system, rule, **{f"{k}0": x for k, x in entry["initial"].items()}, h=0.5, steps=4
        )
        found = np.hstack([motion.q, motion.v])[[1, 2, 4]]
        np.testing.assert_allclose(found, entry["reference"]["state"], rtol=0, atol=1e-13)
        np.testing.assert_allclose(motion.multipliers, -entry["reference"]["tension_1"], rtol=1e-13)


def test_a_wire_that_turns_moves_its_bead_and_pushes_with_the_exact_force():
    entry = REFERENCE["A03_bead_rotating_wire"]
    spin, r, rdot = entry["params"]["Omega"], entry["initial"]["r"], entry["initial"]["rdot"]
    (q, v), t = vi.coordinates("x", "y"), vi.time()
    wire = q[1] * ca.cos(spin * t) - q[0] * ca.sin(spin * t)
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=wire, t=t)
    motion = vi.simulate(system, vi.lobatto(5), q0=[r, 0], v0=[rdot, spin * r], h=0.02, steps=100)
    for time, (radius, _, normal) in zip(entry["times"], entry["reference"]["state"], strict=True):
        k = round(time / 0.02)
        np.testing.assert_allclose(np.hypot(*motion.q[k]), radius, rtol=1e-12)
        np.testing.assert_allclose(motion.multipliers[k, 0], normal, rtol=1e-11)
        np.testing.assert_allclose(np.hypot(*motion.reaction_forces[k]), abs(normal), rtol=1e-11)


@pytest.mark.parametrize("links", [3, 50, 150])
def test_a_chain_at_rest_hangs_with_the_weight_below_each_rod(links):
    hanging = np.array([[0.0, -1.0 - i] for i in range(links)]).ravel()
    for rule in (vi.trapezoidal(), vi.lobatto(3)):
        motion = vi.simulate(
            rods(links), rule, q0=hanging, v0=np.zeros(2 * links), h=1e-2, steps=20
        )
        np.testing.assert_allclose(
            motion.q, np.broadcast_to(hanging, motion.q.shape), rtol=0, atol=1e-12
        )
        weights = 9.81 * np.arange(links, 0, -1)
        np.testing.assert_allclose(-2 * motion.multipliers[-1], weights, rtol=1e-9)


@pytest.mark.parametrize("links", [1, 4, 30])
def test_the_stepper_that_eliminates_positions_makes_the_steps_of_the_general_one(links):
    system, rule, c = rods(links), vi.trapezoidal(), np.zeros(0)
    q = np.array([[0.8 * i + 0.8, -0.6 * i - 0.6] for i in range(links)]).ravel()
    p = np.zeros(2 * links)
    general, short = constrained_stepper(system, rule), rattle_stepper(system, rule)
    assert vi.plan(system, rule).method == "SHAKE and RATTLE"
    scale = scale_function(system)(q, p, [], 0, 0.01, c)
    states = [stepper.start(q, p, [], 0, 0.01, c) for stepper in (general, short)]
    n = 2 * links
    for k in range(100):
        states = [
            s.step(x, [], 0.01 * k, 0.01, c, scale)
            for s, x in zip((general, short), states, strict=True)
        ]
    for part in (slice(0, n), slice(2 * n, 3 * n)):
        np.testing.assert_allclose(
            np.array(states[0])[part], np.array(states[1])[part], rtol=0, atol=1e-12 * links
        )


def test_a_long_level_chain_starts_where_a_sparse_factorisation_breaks_down():
    """40 links, h = 1e-3: round-off along the chain underflows in sparse QR, and the normal
    equations stand by.
    """
    links = 40
    level = np.array([[i + 1.0, 0.0] for i in range(links)]).ravel()
    start = {"q0": level, "v0": np.zeros(2 * links), "h": 1e-3, "steps": 10}
    motion = vi.simulate(rods(links), vi.lobatto(3), **start, backend="interpreted")
    assert motion.stats["residual"] <= 1e-12
    np.testing.assert_allclose(motion.energy, 0, atol=1e-10)
    # all but the first links fall freely
    np.testing.assert_allclose(motion.q[-1, -1], -9.81 * 0.01**2 / 2, rtol=1e-9)


@pytest.mark.parametrize("rule", LOBATTO, ids=str)
def test_a_bead_that_nothing_pushes_runs_round_its_ring_evenly(rule):
    q, v = vi.coordinates("x", "y")
    ring = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    motion = vi.simulate(ring, rule, q0=[1, 0], v0=[0, 1], h=0.01, steps=100)
    np.testing.assert_allclose(np.hypot(*motion.v.T), 1, rtol=1e-12)
    np.testing.assert_allclose(motion.multipliers[:, 0], -0.5, rtol=1e-10)


@pytest.mark.parametrize("links", [2, 5, 10, pytest.param(20, marks=pytest.mark.long)])
def test_a_chain_of_rods_moves_like_the_chain_in_angles(links):
    a, w = vi.coordinates(*(f"a{i}" for i in range(links)))
    x, y = ca.cumsum(ca.sin(a)), -ca.cumsum(ca.cos(a))
    speed = ca.sumsqr(ca.jtimes(x, a, w)) + ca.sumsqr(ca.jtimes(y, a, w))
    angles = vi.System(a, w, speed / 2 - 9.81 * ca.sum1(y))
    a0, duration = np.linspace(0.6, 1.0, links), 1.0 if links < 10 else 0.2
    steps = round(200 * duration)
    exact = vi.simulate(
        angles, vi.gauss(8), q0=a0, v0=np.zeros(links), duration=duration, steps=steps
    )
    both = ca.Function("points", [a], [ca.vec(ca.horzcat(x, y).T)])
    q0 = np.array(both(a0)).ravel()
    motion = vi.simulate(
        rods(links),
        vi.lobatto(5),
        q0=q0,
        v0=np.zeros(2 * links),
        duration=duration,
        steps=2 * steps,
    )
    np.testing.assert_allclose(motion.q[-1], np.array(both(exact.q[-1])).ravel(), rtol=0, atol=1e-9)


def test_forces_controls_parameters_and_time_act_on_constrained_scenes():
    """A driven, damped bead on a circle whose radius is a parameter, against the angle form."""
    (q, v), t, u = vi.coordinates("x", "y"), vi.time(), ca.SX.sym("u")
    c = vi.Parameters(radius=2.0)
    along = ca.vertcat(-q[1], q[0]) / c.radius
    system = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - q[1] * (1 + ca.sin(t)),
        constraint=ca.sumsqr(q) - c.radius**2,
        params=c,
        t=t,
        force=-0.1 * v + u * along,
        control=u,
    )
    a, w = vi.coordinates("a")
    lagrangian = (1.5 * w) ** 2 / 2 - 1.5 * ca.sin(a) * (1 + ca.sin(t))
    angle = vi.System(a, w, lagrangian, force=-0.1 * 1.5**2 * w + 1.5 * u, control=u, t=t)
    push = np.cos(np.arange(200) / 20)[:, None]
    exact = vi.simulate(angle, vi.gauss(6), q0=0.3, v0=0.5, h=0.01, steps=200, u=push)
    start = dict(
        q0=[1.5 * np.cos(0.3), 1.5 * np.sin(0.3)], v0=[-0.75 * np.sin(0.3), 0.75 * np.cos(0.3)]
    )
    motion = vi.simulate(
        system, vi.lobatto(5), **start, h=0.01, steps=200, u=push, params=dict(radius=1.5)
    )
    np.testing.assert_allclose(
        np.arctan2(motion.q[-1, 1], motion.q[-1, 0]), exact.q[-1, 0], rtol=0, atol=1e-11
    )


def test_velocities_enter_a_kinetic_energy_that_is_not_quadratic():
    """A relativistic bead on a circle: p is not linear in v."""
    q, v = vi.coordinates("x", "y")
    bead = vi.System(q, v, -4 * ca.sqrt(1 - ca.sumsqr(v) / 4) - q[1], constraint=ca.sumsqr(q) - 1)
    a, w = vi.coordinates("a")
    angle = vi.System(a, w, -4 * ca.sqrt(1 - w**2 / 4) - ca.sin(a))
    exact = vi.simulate(angle, vi.gauss(6), q0=0.0, v0=1.2, h=0.02, steps=100)
    motion = vi.simulate(bead, vi.lobatto(5), q0=[1, 0], v0=[0, 1.2], h=0.02, steps=100)
    np.testing.assert_allclose(
        motion.q[-1], [np.cos(exact.q[-1, 0]), np.sin(exact.q[-1, 0])], rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-10)


def test_the_action_along_a_constrained_path_is_that_of_the_angle():
    a, w = vi.coordinates("a")
    exact = vi.simulate(
        vi.System(a, w, w**2 / 2 + 9.81 * ca.cos(a)), vi.gauss(8), q0=0.9, v0=0.0, h=0.01, steps=100
    )
    start = dict(q0=[np.sin(0.9), -np.cos(0.9)], v0=[0, 0])
    motion = vi.simulate(cartesian_pendulum(), vi.lobatto(5), **start, h=0.01, steps=100)
    np.testing.assert_allclose(motion.action, exact.action, rtol=1e-12)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("rule", [vi.trapezoidal(), vi.lobatto(3)], ids=str)
def test_a_free_particle_on_a_sphere_follows_a_great_circle(rule, backend):
    """No force at all: a structural zero that a stepper must not take for nothing."""
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=(ca.sumsqr(q) - 1) / 2)
    motion = vi.simulate(
        sphere, rule, q0=[1, 0, 0], v0=[0, 0.6, 0.8], h=0.01, steps=200, backend=backend
    )
    t = motion.t[:, None]
    exact = np.cos(t) * [1, 0, 0] + np.sin(t) * [0, 0.6, 0.8]
    np.testing.assert_allclose(motion.q, exact, atol=1e-4 if rule.order == 2 else 1e-10)
    np.testing.assert_allclose(motion.multipliers, -1.0, rtol=1e-10)
