"""Between the times that were asked for motions know of impacts and of controls that lie there."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

import varint as vi

MIDDLE = np.linspace(0.013, 1.97, 41)


def _ball() -> vi.System:
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.8)


def _driven() -> vi.System:
    (q, v), u = vi.coordinates("a"), ca.SX.sym("u")
    return vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=u, control=u)


def _settling() -> vi.System:
    q, v = vi.coordinates("a")
    return vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-1.5 * v)


def _rocket() -> vi.System:
    (q, v), t = vi.coordinates("z"), vi.time()
    m = ca.if_else(t < 5, 10 - t, 5.0)
    thrust = ca.if_else(t < 5, 200.0 - v, 0.0)
    return vi.System(q, v, m * v**2 / 2 - m * 9.81 * q, force=thrust, t=t)


SCENES = {
    "contact": (_ball, {"q0": 1.0, "v0": 0.0}),
    "controls": (_driven, {"q0": 1.0, "v0": 0.0, "u": [[0.5], [-1.0], [2.0], [0.1], [-0.3]]}),
}
# steps of more than one size
UNEVEN = {
    "growing steps": (_settling, {"q0": 1.2, "v0": 0.3}, 60.0),
    "switches": (_rocket, {"q0": 0.0, "v0": 0.0}, 12.0),
}


@pytest.mark.parametrize("name", SCENES)
def test_other_nodes_leave_the_motion_between_as_it_is(name, tmp_path):
    make, start = SCENES[name]
    system = make()
    motion = vi.simulate(system, **start, duration=2.0)
    asked = vi.simulate(system, **start, at=[0.0, 0.7, 2.0])
    asked.save(tmp_path / "asked.npz")
    others = {
        "asked for": asked,
        "of some nodes": motion[:: len(motion) - 1],
        "at times": motion.at(np.array([0.0, 1.1, 2.0])),
        "of those": asked[::2],
        "read": vi.load(tmp_path / "asked.npz"),
        "pickled": pickle.loads(pickle.dumps(asked)),
    }
    expected = motion.at(MIDDLE)
    for way, other in others.items():
        found = other.at(MIDDLE)
        assert len(other) <= 3, way
        np.testing.assert_array_equal(found.q, expected.q, err_msg=way)
        np.testing.assert_array_equal(found.p, expected.p, err_msg=way)
    assert motion.whole is None


def test_the_ball_is_where_parabolas_have_it():
    asked = vi.simulate(_ball(), q0=1.0, v0=0.0, at=[0.0, 0.2, 2.0])
    g, fall = 9.81, np.sqrt(2 / 9.81)
    hit, again = fall, fall + 2 * 0.8 * fall
    t = np.array([0.3, hit + 0.1, again - 0.1])
    speed = 0.8 * g * fall
    after = t[1:] - hit
    expected = [1 - g * t[0] ** 2 / 2, *(speed * after - g * after**2 / 2)]
    np.testing.assert_allclose(asked.at(t).q[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(asked.at(hit, "before").v, -g * fall, rtol=1e-12)
    np.testing.assert_allclose(asked.at(hit, "after").v, 0.8 * g * fall, rtol=1e-12)


def test_times_beyond_the_nodes_are_refused():
    part = vi.simulate(_ball(), q0=1.0, v0=0.0, duration=2.0)[:5]
    with pytest.raises(vi.InputError, match="times must lie between"):
        part.at(1.9)


def test_values_at_rows_of_controls_are_those_of_the_row():
    system = _driven()
    start = SCENES["controls"][1]
    asked = vi.simulate(system, **start, at=[0.0, 0.1, 0.9, 2.0])
    # rows of 0.4 time units
    np.testing.assert_array_equal(asked.at(np.array([0.2, 0.5, 1.0])).value("u"), [0.5, -1.0, 2.0])


EVERY = {name: (*given, 2.0) for name, given in SCENES.items()} | UNEVEN


@pytest.mark.parametrize("name", EVERY)
def test_sums_and_derivatives_do_not_depend_on_the_nodes_that_are_left(name):
    make, start, duration = EVERY[name]
    system = make()
    motion = vi.simulate(system, **start, duration=duration)
    loss = {"loss": system.q[0] ** 2, "terminal_loss": system.q[0] + system.v[0]}
    action, map_of, slope = motion.action, motion.transition_matrix(), vi.gradient(motion, **loss)
    others = {
        "asked for": vi.simulate(system, **start, at=np.linspace(0.0, duration, 7)),
        "of some nodes": motion[[0, len(motion) // 3, len(motion) - 1]],
        "at times": motion.at(np.array([0.0, 0.4 * duration, duration])),
    }
    for way, other in others.items():
        np.testing.assert_allclose(other.action, action, rtol=1e-9, err_msg=way)
        np.testing.assert_allclose(other.transition_matrix(), map_of, atol=1e-8, err_msg=way)
        found = vi.gradient(other, **loss)
        np.testing.assert_allclose(found.v0, slope.v0, rtol=1e-8, err_msg=way)
        np.testing.assert_allclose(found.value, slope.value, rtol=1e-9, err_msg=way)
        assert (found.h is None) == (name in UNEVEN), way


def test_the_action_of_a_bouncing_ball_is_that_of_its_parabolas():
    asked = vi.simulate(_ball(), q0=1.0, v0=0.0, at=[0.0, 0.2, 0.8])
    fall, g = np.sqrt(2 / 9.81), 9.81
    rise, after = 0.8 * g * fall, 0.8 - fall
    falling = g**2 * fall**3 / 3 - g * fall
    rising = rise**2 * after / 2 - g * rise * after**2 + g**2 * after**3 / 3
    np.testing.assert_allclose(asked.action, falling + rising, rtol=1e-11)


def test_balances_of_momenta_do_not_depend_on_the_nodes_that_are_left():
    system = _ball()
    asked = vi.simulate(system, q0=1.0, v0=0.0, at=np.linspace(0.0, 2.0, 7))
    for found in asked.conserved():
        assert found.expected is not None
        assert len(found.values) == 7
        assert found.drift < 1e-14


def test_events_in_a_time_of_their_own_are_known_at_asked_times():
    q, v = vi.coordinates("x", "y")
    orbit = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = {"q0": [0.01, 0.0], "v0": [0.0, np.sqrt(199.0)], "events": {"axis": q[0] + 0.5}}
    motion = vi.simulate(orbit, **start, duration=7.0)
    asked = vi.simulate(orbit, **start, at=[0.0, 2.0, 7.0])
    assert len(motion.events) > 1
    assert motion.fictitious is not None
    for event, other in zip(motion.events, asked.events, strict=True):
        expected = vi.event_sensitivity(motion, event, expression=q[0] + 0.5)
        found = vi.event_sensitivity(asked, other, expression=q[0] + 0.5)
        np.testing.assert_allclose(found.time, expected.time, rtol=1e-6)
