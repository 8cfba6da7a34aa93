"""Zeros of expressions along a run: located with the rule's accuracy, logged or terminal, with
direction.
"""

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
    motion = vi.simulate(
        OSCILLATOR, vi.gauss(4), q0=1.0, v0=0.0, h=0.1, steps=4321, events={"turn": V}
    )
    exact = np.pi * np.arange(1, 200)
    np.testing.assert_allclose(
        [event.time for event in motion.events], exact[exact < 432.1], rtol=0, atol=1e-6
    )


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
        motion = vi.simulate(
            OSCILLATOR, vi.gauss(2), q0=1.0, v0=0.0, h=h, steps=round(10 / h), events={"middle": Q}
        )
        errors.append(abs(motion.events[2].time - 2.5 * np.pi))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -4, atol=0.15)


def test_events_are_found_in_backward_runs():
    motion = vi.simulate(
        OSCILLATOR, vi.gauss(6), q0=1.0, v0=0.0, h=-0.1, steps=50, events={"middle": Q}
    )
    np.testing.assert_allclose(
        [event.time for event in motion.events], [-np.pi / 2, -3 * np.pi / 2], atol=1e-11
    )


def test_events_work_with_constraints_and_between_impacts():
    q, v = vi.coordinates("x", "y")
    pendulum = vi.System(q, v, ca.sumsqr(v) / 2 - q[1], constraint=ca.sumsqr(q) - 1)
    motion = vi.simulate(
        pendulum, vi.lobatto(4), q0=[1, 0], v0=[0, 0], h=0.02, steps=300, until=(q[0], -1)
    )
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


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_every_node_is_watched_whatever_is_saved(backend):
    fine = run(events={"middle": Q}, backend=backend)
    coarse = run(events={"middle": Q}, save_every=70, backend=backend)
    assert len(fine.events) == 6 and coarse.events == fine.events
    np.testing.assert_array_equal(coarse.k, [0, 70, 140, 200])
    np.testing.assert_array_equal(coarse.q, fine.q[coarse.k])
    ends = [run(until=(Q, 1), save_every=every, backend=backend) for every in (1, 30)]
    np.testing.assert_array_equal(ends[1].k, [0, 30, 47])
    np.testing.assert_allclose(ends[1].q[-1], ends[0].q[-1], rtol=0, atol=1e-15)
    assert ends[1].t[-1] == ends[0].t[-1]


@pytest.mark.parametrize("save_every", [1, 7])
def test_two_zeros_between_neighbouring_nodes_are_found_by_the_slopes(save_every):
    """x = cos t rises above 0.999 for 0.09 around every full turn, steps are 0.25 long."""
    level = 0.999
    watched = {"up": (Q - level, 1), "down": (Q - level, -1)}
    motion = vi.simulate(
        OSCILLATOR,
        vi.gauss(6),
        q0=0.0,
        v0=1.0,
        h=0.25,
        steps=400,
        events=watched,
        save_every=save_every,
    )
    turns = np.pi / 2 + 2 * np.pi * np.arange(16)
    half = np.arccos(level)
    for kind, exact in (("up", turns - half), ("down", turns + half)):
        found = [event.time for event in motion.events if event.kind == kind]
        np.testing.assert_allclose(found, exact[exact < 100], rtol=0, atol=1e-9)
    first = vi.simulate(
        OSCILLATOR, vi.gauss(6), q0=0.0, v0=1.0, h=0.25, steps=400, until=(Q - level, -1)
    )
    assert abs(first.t[-1] - np.pi / 2 - half) <= 1e-10


def test_a_curve_that_touches_zero_or_turns_before_it_has_no_zero():
    for level in (1.0 + 1e-9, 1.001):
        assert not run(events={"top": Q - level}).events


def test_zeros_of_expressions_that_depend_on_time_are_found_twice_in_a_step():
    t = vi.time()
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - ca.sin(t) * q, t=t)
    motion = vi.simulate(
        system,
        vi.gauss(4),
        q0=0.0,
        v0=0.0,
        h=0.5,
        steps=10,
        events={"hill": (t - 1.25) ** 2 - 1e-4},
    )
    np.testing.assert_allclose(
        [event.time for event in motion.events], [1.24, 1.26], rtol=0, atol=1e-12
    )


def test_a_run_with_contacts_keeps_its_event_nodes_when_it_is_watched_and_thinned():
    y, w = vi.coordinates("y")
    ball = vi.System(y, w, w**2 / 2 - y, contact=y, restitution=1.0)
    start = dict(q0=0.5, v0=0.0, h=0.05, duration=4.5)
    motion = vi.simulate(ball, **start, events={"top": (w, -1)}, save_every=20)
    assert [event.kind for event in motion.events] == ["impact", "top", "impact", "top"]
    whole = vi.simulate(ball, **start)
    assert len(motion) < 12
    np.testing.assert_allclose(
        motion.at([0.3, 1.7, 4.01]).q, whole.at([0.3, 1.7, 4.01]).q, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("wrong", [Q, [Q], np.ones(2)])
@pytest.mark.parametrize("asked", [dict(duration=2.0), dict(h=0.1, steps=5)])
def test_events_that_are_no_dictionary_are_refused(asked, wrong):
    with pytest.raises(vi.InputError, match="a dictionary of names and expressions"):
        vi.simulate(OSCILLATOR, q0=1.0, v0=0.0, events=wrong, **asked)
