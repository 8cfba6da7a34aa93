"""Contacts beside what else a run may have: constraints, controls, dense output, files."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, ball, times

import varint as vi


def test_dense_output_and_slices_follow_the_motion_through_events():
    motion = vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=0.05, duration=3.0)
    t1, speed = np.sqrt(2 / G), np.sqrt(2 * G) / 2
    between = t1 + np.array([0.01, 0.2, 0.4])
    np.testing.assert_allclose(
        motion.at(between).q[:, 0], speed * (between - t1) - G / 2 * (between - t1) ** 2, atol=1e-12
    )
    late = motion[len(motion) // 2 :]
    np.testing.assert_allclose(late.multipliers, motion.multipliers[len(motion) // 2 :])
    thin = vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=0.05, duration=3.0, save_every=7)
    assert len(thin) < len(motion) and thin.events == motion.events
    np.testing.assert_allclose(thin.q[-1], motion.q[-1], atol=1e-14)


def test_contacts_hold_together_with_constraints():
    """A pendulum between two stops, one below the other's height."""
    q, v = vi.coordinates("x", "y")
    swing = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - G * q[1],
        constraint=ca.sumsqr(q) - 1,
        contact=0.3 - q[0],
        restitution=1.0,
    )
    motion = vi.simulate(swing, vi.lobatto(4), q0=[-0.6, -0.8], v0=[0, 0], h=0.01, steps=400)
    assert len(motion.events) >= 3 and motion.q[:, 0].max() <= 0.3 + 1e-12
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-10)
    np.testing.assert_allclose(np.hypot(*motion.q.T), 1, atol=1e-13)
    speeds = [motion.at(event.time).v for event in motion.events]
    assert np.ptp([np.hypot(*speed) for speed in speeds]) <= 1e-9


def test_the_plan_says_that_contacts_are_watched():
    assert "contacts watched" in str(vi.plan(ball()))


def test_a_run_with_impacts_comes_back_from_disk_as_it_was(tmp_path):
    motion = vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=0.05, duration=2.0)
    motion.save(tmp_path / "ball.npz")
    again = vi.load(tmp_path / "ball.npz")
    assert again.events == motion.events and again.active_sets == motion.active_sets
    np.testing.assert_array_equal(again.multipliers, motion.multipliers)
    np.testing.assert_array_equal(again.at(0.71).q, motion.at(0.71).q)


def test_controls_that_vary_within_a_step_act_between_its_events_as_the_same_force_of_time():
    (q, v), t, u = vi.coordinates("y"), vi.time(), ca.SX.sym("u")
    rule, h, steps = vi.lobatto(4), 0.05, 60
    # cubic in time: interpolated without error
    at = h * (np.arange(steps)[:, None] + np.array(rule.nodes))
    weight = v**2 / 2 - G * q
    by_time = vi.System(q, v, weight, force=4 * t - t**3, contact=q, restitution=0.9, t=t)
    by_control = vi.System(q, v, weight, force=u, control=u, contact=q, restitution=0.9)
    start = dict(q0=1.0, v0=0.0, h=h, steps=steps)
    one, other = (
        vi.simulate(by_time, rule, **start),
        vi.simulate(by_control, rule, **start, u=(4 * at - at**3)[:, :, None]),
    )
    assert len(one.events) >= 4
    np.testing.assert_allclose(times(other), times(one), rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.q, one.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.multipliers, one.multipliers, rtol=0, atol=1e-11)
    between = times(one)[:4, None] + np.array([0.003, 0.01, 0.04])
    np.testing.assert_allclose(
        other.at(between.ravel()).q, one.at(between.ravel()).q, rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        other.at(times(one)).value(u), 4 * times(one) - times(one) ** 3, rtol=0, atol=1e-11
    )


@pytest.mark.parametrize("backend", ["native", "interpreted"])
def test_restitution_may_be_a_parameter_of_a_run(backend):
    """The same bytes as with its value in the scene; of alike scenes each has its own."""
    q, v = vi.coordinates("x", "y")
    run = dict(q0=[0.3, 1.0], v0=[0.2, 0.0], h=0.05, steps=60, backend=backend)

    def ball(e: float) -> vi.System:
        c = vi.Parameters(e=e, mass=2.0)
        weight = c.mass * ca.sumsqr(v) / 2 - 9.81 * c.mass * q[1] - q[0] ** 4
        return vi.System(q, v, weight, contact=q[1], restitution=1 - c.e, params=c)

    c = vi.Parameters(mass=2.0)
    weight = c.mass * ca.sumsqr(v) / 2 - 9.81 * c.mass * q[1] - q[0] ** 4
    fixed = vi.System(q, v, weight, contact=q[1], restitution=1 - 0.25, params=c)
    wanted = vi.simulate(fixed, vi.lobatto(3), **run)
    by_value = vi.simulate(ball(0.5), vi.lobatto(3), **run, params=dict(e=0.25))
    own = vi.simulate(ball(0.25), vi.lobatto(3), **run)
    assert wanted.events and wanted.energy[-1] < 0.9 * wanted.energy[0]
    for motion in (by_value, own):
        assert motion.q.tobytes() == wanted.q.tobytes() and motion.events == wanted.events
    with pytest.raises(vi.InputError, match=r"between 0 and 1, got \[1.5\]"):
        vi.simulate(ball(0.5), vi.lobatto(3), **run, params=dict(e=-0.5))
