"""Impacts: their times, impulses and energies are the closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, ball, disc_on_table, times

import varint as vi


def test_an_elastic_ball_bounces_at_the_exact_times_and_keeps_its_energy_to_round_off():
    motion = vi.simulate(ball(), vi.lobatto(3), q0=1.0, v0=0.0, h=0.05, duration=500.0)
    first = np.sqrt(2 / G)
    np.testing.assert_allclose(
        times(motion), first * (1 + 2 * np.arange(len(motion.events))), rtol=1e-12
    )
    assert len(motion.events) > 500 and motion.q.min() > -1e-14
    energies = np.array([event.energy_after for event in motion.events])
    x = np.arange(len(energies)) - (len(energies) - 1) / 2
    slope = x @ energies / (x @ x)
    assert abs(slope * len(energies)) <= 1e-11 and np.abs(energies - G).max() <= 1e-11


def energy_changes(rule, h, impacts):
    """Relative change of the energy at each of so many impacts of an elastic ball."""
    period = 2 * np.sqrt(2 / G)
    motion = vi.simulate(ball(), rule, q0=1.0, v0=0.0, h=h, steps=int((impacts + 1) * period / h))
    return np.array([event.energy_after for event in motion.events])[:impacts] / G - 1


def drifts(change):
    """Mean change an impact in units of its standard error, were the changes of single impacts
    independent.
    """
    single = np.diff(change)
    return abs(single.mean()) / (single.std() / np.sqrt(len(single)))


@pytest.mark.parametrize("h", [0.3, 0.29, 0.27])
def test_the_energy_of_an_elastic_ball_has_no_slope_over_many_impacts(h):
    """Before compensations outlived impacts there were 2e-17 to 9e-17 an impact, 5 to 15
    standard errors.
    """
    change = energy_changes(vi.lobatto(3), h, 2000)
    assert len(change) == 2000 and drifts(change) <= 4 and np.abs(change).max() <= 4e-14


@pytest.mark.long
@pytest.mark.parametrize("rule", [vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)], ids=str)
def test_the_energy_of_an_elastic_ball_has_no_slope_over_1e4_impacts_whatever_the_step(rule):
    steps = (0.3, 0.29, 0.31, 0.27, 0.23, 0.2, 0.17, 0.35, 0.45, 0.13)
    changes = [energy_changes(rule, h, 10_000) for h in steps]
    assert sum(drifts(change) > 3 for change in changes) <= 1
    assert max(np.abs(change).max() for change in changes) < 1e-13
    assert 2 <= sum(change[-1] > 0 for change in changes) <= 8


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
def test_a_cradle_of_three_swings_on_with_one_ball_at_a_time(backend):
    """Balls that should rest move by round-off, and would hit each other for ever."""
    q, v = vi.coordinates("a", "b", "c")
    lagrangian = ca.sumsqr(v) / 2 + G * ca.sum1(ca.cos(q))
    gaps = ca.vertcat(q[1] - q[0], q[2] - q[1])
    cradle = vi.System(q, v, lagrangian, contact=gaps, restitution=1.0)
    duration = 40.0 if backend == "auto" else 6.0
    motion = vi.simulate(
        cradle, q0=[-1.0, 0.0, 0.0], v0=[0.0] * 3, h=0.02, duration=duration, backend=backend
    )
    hits = motion.events
    assert all(event.kind == "impact" for event in hits)  # what rests neither holds nor lets go
    speed = np.sqrt(2 * G * (1 - np.cos(1.0)))
    assert len(hits) >= (70 if backend == "auto" else 10)
    np.testing.assert_allclose([abs(e.impulse) for e in hits], speed, rtol=1e-6)
    assert [e.contact for e in hits[:6]] == [0, 1, 1, 0, 0, 1]
    assert (np.sort(np.abs(motion.q), axis=1)[:, :2] < 1e-12).all()  # the two that rest


@pytest.mark.parametrize("restitution", [0.5, 0.8])
def test_a_lossy_ball_comes_to_rest_at_the_closed_form_time_after_infinitely_many_bounces(
    restitution,
):
    motion = vi.simulate(ball(restitution), vi.lobatto(3), q0=1.0, v0=0.0, h=0.05, duration=6.0)
    first = np.sqrt(2 / G)
    last = motion.events[-1]
    assert last.kind == "stop" and all(event.kind == "impact" for event in motion.events[:-1])
    assert abs(last.time - first * (1 + restitution) / (1 - restitution)) <= 1e-9
    gained = [event.energy_after / event.energy_before for event in motion.events[:10]]
    np.testing.assert_allclose(gained, restitution**2, rtol=1e-9)
    after = motion.t > last.time + 0.1
    assert np.abs(motion.q[after]).max() <= 1e-15 and np.abs(motion.v[after]).max() <= 1e-12
    np.testing.assert_allclose(motion.multipliers[after, 0], G, rtol=1e-12)


def test_impulses_are_the_change_of_normal_momentum():
    motion = vi.simulate(ball(0.6), q0=1.0, v0=0.0, h=0.05, duration=0.6)
    (hit,) = motion.events
    assert abs(hit.impulse - 1.6 * np.sqrt(2 * G)) <= 1e-12
    assert abs(hit.energy_before - G) <= 1e-12 and abs(hit.energy_after - 0.36 * G) <= 1e-12


def test_several_impacts_in_one_step_are_found_in_their_order():
    motion = vi.simulate(disc_on_table(), q0=[0.5, 0.1], v0=[3.0, -0.7], h=1.0, steps=2)
    walls = (0.5 + np.arange(6)) / 3
    floor = 0.1 / 0.7
    exact = np.sort(np.append(walls[walls < 2], floor))
    np.testing.assert_allclose(times(motion), exact, rtol=0, atol=1e-14)
    assert [event.contact for event in motion.events] == [2, 1, 0, 1, 0, 1, 0]
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-14)
    assert (np.diff(motion.t) > 0).all() and motion.t[-1] == 2.0


def test_a_corner_reflects_both_velocities_at_once():
    motion = vi.simulate(disc_on_table(), q0=[0.5, 0.5], v0=[-1.0, -1.0], h=0.3, steps=3)
    assert [event.time for event in motion.events] == [0.5, 0.5]
    np.testing.assert_allclose(motion.v[-1], [1, 1], rtol=1e-14)
    np.testing.assert_allclose(motion.q[-1], [0.4, 0.4], atol=1e-14)


def test_a_graze_between_two_nodes_is_an_impact():
    """The gap is positive at both ends of the step and negative between."""
    q, v = vi.coordinates("x", "y")
    hill = vi.System(q, v, ca.sumsqr(v) / 2, contact=ca.sumsqr(q) - 1, restitution=1.0)
    motion = vi.simulate(hill, q0=[-2.0, 0.98], v0=[1.0, 0.0], h=4.0, steps=1)
    (hit,) = motion.events
    assert abs(hit.time - (2 - np.sqrt(1 - 0.98**2))) <= 1e-12
    assert motion.v[-1, 1] > 0


@pytest.mark.parametrize("apart", [0.0, 0.2])
def test_a_row_of_equal_balls_hands_a_blow_on_to_the_last(apart):
    """Newton's cradle, its balls touching or not."""
    q, v = vi.coordinates(*(f"x{i}" for i in range(5)))
    cradle = vi.System(q, v, ca.sumsqr(v) / 2, contact=q[1:] - q[:-1] - 1, restitution=1.0)
    x = np.array([-3.0, *(1 + (1 + apart) * np.arange(4))])
    motion = vi.simulate(cradle, q0=x, v0=[1.0, 0, 0, 0, 0], h=0.25, steps=40)
    assert [event.contact for event in motion.events] == [0, 1, 2, 3]
    np.testing.assert_allclose(times(motion), 3 + apart * np.arange(4), rtol=1e-14)
    np.testing.assert_allclose(motion.v[-1], [0, 0, 0, 0, 1], atol=1e-14)


@pytest.mark.parametrize(("ratio", "digits"), [(1, 3), (100, 31), (10_000, 314)])
def test_two_balls_and_a_wall_count_the_digits_of_pi(ratio, digits):
    """Galperin, Regular and Chaotic Dynamics 8 (2003): so many impacts for masses 1 and 100ᵏ."""
    q, v = vi.coordinates("x", "y")
    lagrangian = (v[0] ** 2 + ratio * v[1] ** 2) / 2
    balls = vi.System(q, v, lagrangian, contact=ca.vertcat(q[0], q[1] - q[0]), restitution=1.0)
    motion = vi.simulate(balls, q0=[1.0, 2.0], v0=[0.0, -1.0], h=0.5, duration=10.0)
    assert len(motion.events) == digits
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-13)


def test_a_wedge_of_45_degrees_sends_a_ball_back_the_way_it_came_after_four_impacts():
    q, v = vi.coordinates("x", "y")
    wedge = vi.System(
        q, v, ca.sumsqr(v) / 2, contact=ca.vertcat(q[1], q[0] - q[1]), restitution=1.0
    )
    motion = vi.simulate(wedge, q0=[2.0, 1.0], v0=[-1.0, -0.3], h=0.3, steps=20)
    assert [event.contact for event in motion.events] == [1, 0, 1, 0]
    np.testing.assert_allclose(
        times(motion), [2 - 0.4 / 0.7, 2, 2 + 0.4 / 1.3, 2 + 4 / 3], rtol=1e-14
    )
    np.testing.assert_allclose(motion.v[-1], [1.0, 0.3], rtol=1e-14)


def test_a_table_that_rises_gives_a_ball_its_speed_twice():
    """Seen from the table the ball just falls: impulse, energies and the time of rest are closed
    forms.
    """
    (q, v), t, rise = vi.coordinates("y"), vi.time(), 0.3
    table = vi.System(q, v, v**2 / 2 - G * q, contact=q - rise * t, restitution=0.5, t=t)
    motion = vi.simulate(table, q0=1.0, v0=0.0, h=0.05, steps=60)
    first, last = motion.events[0], motion.events[-1]
    hit = (np.sqrt(rise**2 + 2 * G) - rise) / G
    before, after = -G * hit, rise + 0.5 * (rise + G * hit)
    assert abs(first.time - hit) <= 1e-14 and abs(first.impulse - (after - before)) <= 1e-13
    assert abs(first.energy_before - (before**2 / 2 + G * rise * hit)) <= 1e-13
    assert abs(first.energy_after - (after**2 / 2 + G * rise * hit)) <= 1e-13
    assert last.kind == "stop" and abs(last.time - (hit + 2 * (rise + G * hit) / G)) <= 1e-10
    np.testing.assert_allclose([motion.v[-1, 0], motion.multipliers[-1, 0]], [rise, G], rtol=1e-12)


def test_a_ball_falls_through_air_and_bounces_at_the_exact_time():
    q, v = vi.coordinates("y")
    drag = 0.4
    system = vi.System(q, v, v**2 / 2 - G * q, force=-drag * v, contact=q, restitution=1.0)
    motion = vi.simulate(system, vi.lobatto(4), q0=1.0, v0=0.0, h=0.01, steps=100)
    hit = motion.events[0].time
    assert abs(1 + G / drag**2 * (1 - np.exp(-drag * hit)) - G / drag * hit) <= 1e-13
    assert abs(motion.events[0].impulse - 2 * G / drag * (1 - np.exp(-drag * hit))) <= 1e-12


def test_a_run_backwards_undoes_elastic_impacts_and_refuses_lossy_ones():
    box = disc_on_table(G)
    there = vi.simulate(box, q0=[0.3, 0.4], v0=[2.0, 5.0], h=0.02, duration=3.0)
    back = vi.simulate(box, q0=there.q[-1], v0=there.v[-1], h=-0.02, duration=-3.0, t0=3.0)
    np.testing.assert_allclose(
        np.hstack([back.q[-1], back.v[-1]]), [0.3, 0.4, 2.0, 5.0], rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(times(back), times(there)[::-1], rtol=1e-13)
    lossy = r"contact 0 is hit at t = 0.678476 .* backwards.*restitution is 0.5"
    with pytest.raises(vi.ConvergenceError, match=lossy) as caught:
        vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=-0.05, duration=-1.0, t0=1.13)
    fall = caught.value.trajectory
    assert len(fall) == 10 and np.abs(fall.energy - fall.energy[0]).max() < 1e-13, (
        "the nodes before it are kept"
    )


def test_a_start_that_runs_into_a_contact_begins_with_the_impact():
    motion = vi.simulate(ball(0.5), q0=0.0, v0=-2.0, h=0.01, steps=3)
    (hit,) = motion.events
    assert hit.time == 0 and abs(hit.impulse - 3.0) <= 1e-14 and motion.v[0, 0] == 1.0


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
@pytest.mark.parametrize("steepness", [1e-140, 1e-20, 1e20, 1e140])
def test_the_scale_of_a_gap_changes_nothing_but_its_impulse(unit, steepness):
    """gap = s y: the ball bounces alike, and ∂gap/∂q Λ is the same."""
    q, v = vi.coordinates("y")
    scaled = vi.System(q, v, unit * (v**2 / 2 - G * q), contact=steepness * q, restitution=0.5)
    motion = vi.simulate(scaled, q0=0.0, v0=-2.0, h=0.01, steps=3)
    (hit,) = motion.events
    assert motion.v[0, 0] == pytest.approx(1.0, rel=1e-14)
    assert hit.impulse * steepness == pytest.approx(3.0 * unit, rel=1e-13)
