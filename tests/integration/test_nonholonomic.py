"""Non-holonomic constraints by Lagrange–d'Alembert: order 2, reversible, against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import slopes

import varint as vi

RULES = [vi.midpoint(), vi.trapezoidal()]
DOWN, SPIN = 9.81 * np.sin(0.4), 1.3


def knife_edge() -> vi.System:
    """Knife edge on an incline: it slides along its blade only (Bloch, Nonholonomic Mechanics
    and Control, §1.6).
    """
    q, v = vi.coordinates("x", "y", "phi")
    blade = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    return vi.System(
        q, v, (ca.sumsqr(v[:2]) + 0.5 * v[2] ** 2) / 2 + DOWN * q[0], nonholonomic=blade
    )


def knife_edge_exact(t):
    size = DOWN / (2 * SPIN**2)
    return size * np.sin(SPIN * t) ** 2, size * (SPIN * t - np.sin(2 * SPIN * t) / 2)


def sleigh(arm: float = 0.7) -> vi.System:
    """Chaplygin sleigh: the blade at (x, y), the centre of mass an arm ahead of it."""
    q, v = vi.coordinates("x", "y", "phi")
    c, s = ca.cos(q[2]), ca.sin(q[2])
    speed = (v[0] - arm * s * v[2]) ** 2 + (v[1] + arm * c * v[2]) ** 2
    return vi.System(q, v, (speed + 0.3 * v[2] ** 2) / 2, nonholonomic=ca.horzcat(-s, c, 0))


def rolling_disc() -> vi.System:
    q, v = vi.coordinates("x", "y", "roll", "heading")
    rolls = ca.vertcat(ca.horzcat(1, 0, -ca.cos(q[3]), 0), ca.horzcat(0, 1, -ca.sin(q[3]), 0))
    return vi.System(
        q, v, (ca.sumsqr(v[:2]) + 0.5 * v[2] ** 2 + 0.25 * v[3] ** 2) / 2, nonholonomic=rolls
    )


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_the_knife_edge_on_an_incline_follows_its_cycloid_with_order_two(rule):
    steps, errors = [100, 140, 200, 280], []
    for n in steps:
        motion = vi.simulate(
            knife_edge(), rule, q0=[0, 0, 0], v0=[0, 0, SPIN], duration=4.0, steps=n
        )
        along = np.abs(motion.q[-1, :2] - np.array(knife_edge_exact(4.0)))
        # λ = m φ̇ (along the blade) + weight across it, with m = 1
        push = -2 * DOWN * np.sin(SPIN * 4.0)
        errors.append([along.max(), np.abs(motion.multipliers[-1, 0] - push)])
    np.testing.assert_allclose(slopes(steps, np.array(errors), 1e-12), 2, atol=0.15)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_the_knife_edge_does_not_slide_downhill_and_its_energy_has_no_slope(rule):
    motion = vi.simulate(knife_edge(), rule, q0=[0, 0, 0], v0=[0, 0, SPIN], h=0.01, steps=20_000)
    top = DOWN / (2 * SPIN**2)
    assert motion.q[:, 0].min() >= -1e-4 * top and motion.q[:, 0].max() <= 1.0002 * top
    assert np.abs(motion.energy - motion.energy[0]).max() <= 1e-3
    windows = motion.energy[1:].reshape(50, -1).mean(axis=1)
    x = np.arange(50) - 24.5
    slope = x @ windows / (x @ x)
    noise = np.std(windows - windows.mean() - slope * x) / np.sqrt(x @ x)
    assert abs(slope) <= 4 * noise + 1e-15


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize(
    ("build", "q0", "v0"),
    [(knife_edge, [0, 0, 0.3], [0, 0, 1.1]), (sleigh, [0, 0, 0], [0.4, 0, 1.0])],
)
def test_momenta_keep_to_the_blade_at_every_node_and_the_motion_is_reversible(rule, build, q0, v0):
    system = build()
    there = vi.simulate(system, rule, q0=q0, v0=v0, h=0.05, steps=200)
    p, mass = ca.SX.sym("p", 3), system.mass_matrix
    slip = ca.Function("slip", [system.q, p], [ca.mtimes(system.nonholonomic, ca.solve(mass, p))])
    assert np.abs(np.array(slip.map(len(there))(there.q.T, there.p.T))).max() <= 1e-12
    back = vi.simulate(system, rule, q0=there.q[-1], p0=-there.p[-1], h=0.05, steps=200)
    np.testing.assert_allclose(back.q[-1], q0, atol=1e-10)
    np.testing.assert_allclose(back.v[-1], -np.array(v0), atol=1e-10)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_the_chaplygin_sleigh_turns_into_a_straight_run_as_the_hyperbolic_tangent_says(rule):
    arm, inertia, v0, w0 = 0.7, 0.3, 0.4, 1.0
    whole = inertia + arm**2
    top = np.sqrt(v0**2 + whole * w0**2)
    rate = arm / whole * top
    motion = vi.simulate(sleigh(), rule, q0=[0, 0, 0], v0=[v0, 0, w0], h=0.002, duration=4.0)
    along = motion.v[:, 0] * np.cos(motion.q[:, 2]) + motion.v[:, 1] * np.sin(motion.q[:, 2])
    np.testing.assert_allclose(
        along, top * np.tanh(rate * motion.t + np.arctanh(v0 / top)), rtol=0, atol=1e-5
    )
    errors = []
    for n in (100, 200, 400):
        v = vi.simulate(sleigh(), rule, q0=[0, 0, 0], v0=[v0, 0, w0], duration=2.0, steps=n).v[-1]
        errors.append(abs(np.hypot(v[0], v[1]) - top * np.tanh(rate * 2 + np.arctanh(v0 / top))))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2, atol=0.15)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_a_disc_that_rolls_and_turns_evenly_runs_on_a_circle(rule):
    roll, turn = 2.0, 0.5
    motion = vi.simulate(
        rolling_disc(), rule, q0=[0, 0, 0, 0], v0=[roll, 0, roll, turn], h=0.01, duration=10.0
    )
    np.testing.assert_allclose(motion.v[:, 2:], [[roll, turn]] * len(motion), rtol=1e-12)
    circle = np.stack([np.sin(turn * motion.t), 1 - np.cos(turn * motion.t)], -1) * roll / turn
    np.testing.assert_allclose(motion.q[:, :2], circle, rtol=0, atol=1e-4)
    radius = np.hypot(motion.q[:, 0], motion.q[:, 1] - motion.q[:, 1].max() / 2)
    np.testing.assert_allclose(
        motion.reaction_forces[:, :2], motion.v[:, :2] @ [[0, turn], [-turn, 0]], atol=1e-4
    )
    assert np.ptp(radius) <= 2e-3


def test_holonomic_and_nonholonomic_constraints_act_together():
    """The knife edge in three dimensions, its plane a holonomic constraint."""
    q, v = vi.coordinates("x", "y", "z", "phi")
    blade = ca.horzcat(ca.sin(q[3]), -ca.cos(q[3]), 0, 0)
    lagrangian = (ca.sumsqr(v[:3]) + 0.5 * v[3] ** 2) / 2 + DOWN * q[0] - 9.81 * q[2]
    solid = vi.System(q, v, lagrangian, constraint=q[2], nonholonomic=blade)
    start = dict(h=0.02, steps=200)
    motion = vi.simulate(solid, q0=[0, 0, 0, 0], v0=[0, 0, 0, SPIN], **start)
    plain = vi.simulate(knife_edge(), vi.trapezoidal(), q0=[0, 0, 0], v0=[0, 0, SPIN], **start)
    assert motion.rule == vi.trapezoidal()
    np.testing.assert_allclose(motion.q[:, [0, 1, 3]], plain.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.multipliers[:, 0], 9.81, rtol=1e-12)
    np.testing.assert_allclose(
        motion.multipliers[:, 1], plain.multipliers[:, 0], rtol=0, atol=1e-11
    )


def test_it_is_not_the_vakonomic_motion():
    """The constraint is not put into the action: the blade's reaction does no work and depends
    on the state alone.
    """
    motion = vi.simulate(knife_edge(), q0=[0, 0, 0], v0=[0, 0, SPIN], h=0.01, steps=300)
    power = np.einsum("ij,ij->i", motion.reaction_forces, motion.v)
    assert np.abs(power).max() <= 1e-11
    # a vakonomic blade would feel a torque
    np.testing.assert_allclose(motion.v[:, 2], SPIN, rtol=1e-13)


def test_rules_of_higher_order_are_refused():
    with pytest.raises(
        vi.InputError, match=r"gauss\(2\) cannot carry non-holonomic.*midpoint\(\) or trapezoidal"
    ):
        vi.simulate(knife_edge(), vi.gauss(2), q0=[0, 0, 0], v0=[0, 0, 1], h=0.1, steps=1)
    assert vi.plan(knife_edge()).rule == vi.midpoint()


def test_a_start_that_slips_is_refused_and_repaired():
    with pytest.raises(vi.InputError, match=r"velocity constraints of \['nonholonomic\[0\]'\]"):
        vi.simulate(knife_edge(), q0=[0, 0, 0], v0=[1, 1, 1], h=0.1, steps=1)
    q0, v0 = vi.project(knife_edge(), [0, 0, 0], [1, 1, 1])
    np.testing.assert_allclose(v0, [1, 0, 1], atol=1e-15)
    assert len(vi.simulate(knife_edge(), q0=q0, v0=v0, h=0.1, steps=2)) == 3


def test_dependent_rows_are_refused():
    q, v = vi.coordinates("x", "y")
    twice = vi.System(q, v, ca.sumsqr(v) / 2, nonholonomic=ca.DM([[1, 0], [2, 0]]))
    with pytest.raises(vi.InputError, match=r"\[0, 1\].*are dependent"):
        vi.simulate(twice, q0=[0, 0], v0=[0, 1], h=0.1, steps=1)


@pytest.mark.parametrize("steps", [{"h": 0.001, "steps": 3000}, {"duration": 3.0, "tol": 1e-7}])
def test_a_skate_that_meets_a_wall_glides_back_along_its_blade(steps):
    """x = 2 − e u/ω (sin φ − sin φ*) after the impact at φ*, where sin φ* = sin φ₀ + 2 ω/u."""
    q, v = vi.coordinates("x", "y", "phi")
    blade = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    lagrangian = (v[0] ** 2 + v[1] ** 2) / 2 + v[2] ** 2 / 6
    skate = vi.System(q, v, lagrangian, nonholonomic=blade, contact=2 - q[0], restitution=0.7)
    speed, turn, phi = 2.0, 0.2, 0.3
    v0 = [speed * np.cos(phi), speed * np.sin(phi), turn]
    motion = vi.simulate(skate, q0=[0, 0, phi], v0=v0, **steps)
    assert motion.rule == vi.trapezoidal()
    across = np.sin(motion.q[:, 2]) * motion.v[:, 0] - np.cos(motion.q[:, 2]) * motion.v[:, 1]
    assert np.abs(across).max() < 1e-13
    (hit,) = motion.events
    meets = np.arcsin(np.sin(phi) + 2 * turn / speed)
    assert hit.time == pytest.approx((meets - phi) / turn, abs=1e-6)
    assert hit.energy_before - hit.energy_after == pytest.approx(speed**2 / 2 * 0.51, abs=1e-6)
    end = phi + 3 * turn
    back = 2 - 0.7 * speed / turn * (np.sin(end) - np.sin(meets))
    assert motion.q[-1, 0] == pytest.approx(back, abs=1e-6)


def test_refusals_beside_contacts_name_a_rule_that_is_taken():
    q, v = vi.coordinates("x", "y")
    rows = ca.horzcat(ca.sin(q[0]), 1)
    scene = vi.System(q, v, ca.sumsqr(v) / 2, nonholonomic=rows, contact=1 - q[0])
    for rule in (vi.midpoint(), vi.lobatto(3)):
        with pytest.raises(vi.InputError, match=r"use trapezoidal\(\)"):
            vi.simulate(scene, rule, q0=[0, 0], v0=[0, 0], h=0.01, steps=1)
