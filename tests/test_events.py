"""Zeros of expressions along a run: located with the rule's accuracy, logged or terminal, with direction."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

Q, V = vi.coordinates("x")
OSCILLATOR = vi.System(Q, V, (V**2 - Q**2) / 2)


def run(rule=None, **more):
    return vi.simulate(OSCILLATOR, rule or vi.gauss(6), q0=1.0, v0=0.0, h=0.1, steps=200, **more)


@pytest.mark.parametrize(("direction", "first", "apart"), [(0, 0.5, 1), (1, 1.5, 2), (-1, 0.5, 2)])
def test_zeros_are_logged_with_their_direction(direction, first, apart):
    motion = run(events={"middle": (Q, direction)})
    exact = np.pi * (first + apart * np.arange(20))
    exact = exact[exact < 20]
    assert all(event.kind == "middle" and event.contact is None for event in motion.events)
    np.testing.assert_allclose([event.time for event in motion.events], exact, rtol=0, atol=1e-11)
    np.testing.assert_allclose([event.energy_before for event in motion.events], 0.5, rtol=1e-11)


def test_zeros_of_long_runs_are_logged_once_each():
    motion = vi.simulate(OSCILLATOR, vi.gauss(4), q0=1.0, v0=0.0, h=0.1, steps=4321, events={"turn": V})
    exact = np.pi * np.arange(1, 200)
    np.testing.assert_allclose([event.time for event in motion.events], exact[exact < 432.1], rtol=0, atol=1e-6)


def test_several_watches_are_merged_in_the_order_of_time():
    motion = run(events={"middle": Q, "turn": V})
    assert [event.kind for event in motion.events] == ["middle", "turn"] * 6
    assert np.all(np.diff([event.time for event in motion.events]) > 0)


@pytest.mark.parametrize(("until", "end"), [(Q, 0.5), ((Q, 1), 1.5), ((Q, -1), 0.5)])
def test_the_run_ends_at_the_zero_it_is_told_to(until, end):
    motion = run(until=until, events={"turn": V})
    assert abs(motion.t[-1] - end * np.pi) <= 1e-12 and abs(motion.q[-1, 0]) <= 1e-12
    assert [event.kind for event in motion.events] == ["turn"] * round(end - 0.5)


def test_located_times_have_the_order_of_the_rule():
    errors = []
    for h in (0.2, 0.1, 0.05):
        motion = vi.simulate(OSCILLATOR, vi.gauss(2), q0=1.0, v0=0.0, h=h, steps=round(10 / h), events={"middle": Q})
        errors.append(abs(motion.events[2].time - 2.5 * np.pi))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -4, atol=0.15)


def test_events_are_found_in_backward_runs():
    motion = vi.simulate(OSCILLATOR, vi.gauss(6), q0=1.0, v0=0.0, h=-0.1, steps=50, events={"middle": Q})
    np.testing.assert_allclose([event.time for event in motion.events], [-np.pi / 2, -3 * np.pi / 2], atol=1e-11)


def test_events_work_with_constraints_and_between_impacts():
    q, v = vi.coordinates("x", "y")
    pendulum = vi.System(q, v, ca.sumsqr(v) / 2 - q[1], constraint=ca.sumsqr(q) - 1)
    motion = vi.simulate(pendulum, vi.lobatto(4), q0=[1, 0], v0=[0, 0], h=0.02, steps=300, until=(q[0], -1))
    assert abs(motion.t[-1] - 1.8540746773013719) <= 1e-9  # quarter period K(1/√2)
    y, w = vi.coordinates("y")
    ball = vi.System(y, w, w**2 / 2 - y, contact=y, restitution=1.0)
    motion = vi.simulate(ball, q0=0.5, v0=0.0, h=0.05, duration=4.5, events={"top": (w, -1)})
    assert [event.kind for event in motion.events] == ["impact", "top", "impact", "top"]
    np.testing.assert_allclose([event.time for event in motion.events], [1, 2, 3, 4], atol=1e-12)
    stopped = vi.simulate(ball, q0=0.5, v0=0.0, h=0.05, duration=4.5, until=(w, -1))
    assert abs(stopped.t[-1] - 2) <= 1e-12 and len(stopped.events) == 1


@pytest.mark.parametrize("wrong", [(Q, 2), "x", 3.0, ca.vertcat(Q, V)])
def test_what_cannot_be_watched_is_refused(wrong):
    with pytest.raises(vi.InputError, match=r"direction|must be one SX expression"):
        run(events={"odd": wrong})
