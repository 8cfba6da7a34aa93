"""Unilateral contacts: impacts, detachment, rest, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "a.json").read_text())
G = 9.81


def ball(restitution: float = 1.0) -> vi.System:
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2 - G * q, contact=q, restitution=restitution)


def disc_on_table(gravity: float = 0.0, restitution=1.0) -> vi.System:
    """A point in the box 0 ≤ x ≤ 1, 0 ≤ y."""
    q, v = vi.coordinates("x", "y")
    walls = ca.vertcat(q[0], 1 - q[0], q[1])
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - gravity * q[1], contact=walls, restitution=restitution
    )


def times(motion, kind=None):
    return np.array([event.time for event in motion.events if kind in (None, event.kind)])


def ladder(params) -> vi.System:
    q, v = vi.coordinates("x", "y", "theta")
    m, length, g = params["m"], params["L"], params["g"]
    lagrangian = m * ca.sumsqr(v[:2]) / 2 + m * length**2 / 12 * v[2] ** 2 / 2 - m * g * q[1]
    wall, floor = q[0] - length / 2 * ca.cos(q[2]), q[1] - length / 2 * ca.sin(q[2])
    return vi.System(q, v, lagrangian, contact=ca.vertcat(wall, floor, q[2]))


@pytest.mark.parametrize("name", ["A07_ladder_60deg", "A07_ladder_89deg"])
def test_the_falling_ladder_leaves_the_wall_slides_and_stops_as_it_must(name):
    entry = REFERENCE[name]
    params, exact, start = entry["params"], entry["reference"], entry["initial"]["theta"]
    m, length, g = params["m"], params["L"], params["g"]
    q0 = [length / 2 * np.cos(start), length / 2 * np.sin(start), start]
    motion = vi.simulate(
        ladder(params),
        vi.lobatto(4),
        q0=q0,
        v0=[0, 0, 0],
        h=0.01,
        duration=round(1.1 * entry["times"][-1], 1),
    )
    leaves, stops = motion.events
    assert (leaves.kind, leaves.contact, stops.kind, stops.contact) == ("detachment", 0, "stop", 2)
    assert (
        abs(leaves.time - exact["T_detach"]) <= 1e-10
        and abs(stops.time - exact["T_impact"]) <= 1e-10
    )
    at = motion.at(leaves.time)
    assert (
        abs(at.q[2] - exact["theta_detach"]) <= 1e-10
        and abs(at.v[2] - exact["thetadot_detach"]) <= 1e-10
    )
    inertia = m * length**2 / 3
    sine, cosine = np.sin(motion.q[:, 2]), np.cos(motion.q[:, 2])
    push = m**2 * g * length**2 / (4 * inertia) * (3 * sine - 2 * np.sin(start))
    weight = m * g * (m * length**2 / 12) / inertia
    leaning = motion.t < leaves.time
    np.testing.assert_allclose(
        motion.multipliers[leaning, 0], (push * cosine)[leaning], rtol=0, atol=1e-8
    )
    np.testing.assert_allclose(
        motion.multipliers[leaning, 1], (weight + push * sine)[leaning], rtol=0, atol=1e-8
    )
    free = (motion.t > leaves.time) & (motion.t < stops.time)
    assert (motion.multipliers[free, 0] == 0).all()
    np.testing.assert_allclose(motion.v[free, 0], exact["vx_cm_after_detach"], rtol=1e-9)
    np.testing.assert_allclose(motion.energy[motion.t < stops.time], exact["energy"], rtol=1e-9)
    for time, state, (wall, floor) in zip(
        entry["times"][:-1], exact["state"], exact["reactions"], strict=False
    ):
        there = motion.at([time])
        theta, thetadot, x, y, vx, vy = state
        np.testing.assert_allclose(
            np.hstack([there.q[0], there.v[0]]), [x, y, theta, vx, vy, thetadot], atol=1e-8
        )
        np.testing.assert_allclose(there.multipliers[0, :2], [wall, floor], atol=1e-7)
    assert abs(motion.q[-1, 2]) <= 1e-12 and abs(motion.v[-1, 2]) <= 1e-12


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


def test_a_particle_slides_off_a_sphere_at_the_angle_of_the_textbook():
    exact = REFERENCE["A12_sphere_detach_rest_0p2"]["reference"]
    q, v = vi.coordinates("x", "y")
    sphere = vi.System(
        q, v, ca.sumsqr(v) / 2 - G * q[1], contact=ca.vertcat(ca.sqrt(ca.sumsqr(q)) - 1, q[1] + 1)
    )
    motion = vi.simulate(
        sphere, vi.lobatto(4), q0=[np.sin(0.2), np.cos(0.2)], v0=[0, 0], h=0.01, duration=1.11
    )
    leaves, lands = motion.events
    assert (leaves.kind, lands.kind, lands.contact) == ("detachment", "stop", 1)
    assert (
        abs(leaves.time - exact["T_detach"]) <= 1e-10
        and abs(lands.time - exact["T_floor"]) <= 1e-10
    )
    there = motion.at(leaves.time)
    np.testing.assert_allclose(np.hstack([there.q, there.v]), exact["xy_v_detach"], atol=1e-9)
    assert abs(motion.at(lands.time).q[0] - exact["x_floor"]) <= 1e-9


def test_a_string_goes_slack_where_its_tension_vanishes_and_is_caught_again():
    entry = REFERENCE["A05_pendulum_slack"]
    q, v = vi.coordinates("x", "y")
    string = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], contact=1 - ca.sqrt(ca.sumsqr(q)))
    speed = np.sqrt(entry["params"]["thetadot0_squared"])
    motion = vi.simulate(string, vi.lobatto(4), q0=[0, -1], v0=[speed, 0], h=0.01, duration=1.5)
    assert motion.events[0].kind == "detachment" and motion.events[1].kind == "stop"
    assert abs(motion.events[0].time - entry["reference"]["t_slack"]) <= 1e-10
    assert motion.value(1 - ca.sumsqr(q)).min() >= -1e-12
    assert (motion.multipliers >= -1e-9).all()


def test_contacts_that_are_one_too_many_share_the_weight():
    """A beam on three legs of one line: two would do; the reactions of least norm carry it."""
    q, v = vi.coordinates("y", "tilt")
    legs = ca.vertcat(*(q[0] + s * ca.sin(q[1]) for s in (-1.0, 0.0, 1.0)))
    beam = vi.System(q, v, (v[0] ** 2 + v[1] ** 2 / 3) / 2 - G * q[0], contact=legs)
    motion = vi.simulate(beam, q0=[0.0, 0.0], v0=[0.0, 0.0], h=0.01, steps=50)
    assert not motion.events and np.abs(motion.q).max() <= 1e-14
    np.testing.assert_allclose(motion.multipliers, G / 3, rtol=1e-10)
    np.testing.assert_allclose(motion.reaction_forces, np.broadcast_to([G, 0], (51, 2)), atol=1e-10)


def test_a_plastic_landing_with_a_contact_already_closed_keeps_both():
    motion = vi.simulate(disc_on_table(G, 0.0), q0=[0.5, 0.0], v0=[1.0, 0.0], h=0.01, steps=100)
    (hit,) = motion.events
    assert (hit.contact, abs(hit.time - 0.5) <= 1e-12) == (1, True)
    np.testing.assert_allclose(motion.q[-1], [1.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(motion.multipliers[-1], [0, 0, G], atol=1e-12)


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


@pytest.mark.parametrize("rule", [vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)], ids=str)
@pytest.mark.parametrize("pulled", ["by the Lagrangian", "by a force", "by a control"])
def test_a_ball_that_is_pulled_up_ever_more_lets_go_when_its_weight_is_reached(rule, pulled):
    """λ = g − 3t, so it leaves at g/3 and rises as (t − g/3)³/2."""
    (q, v), t, u = vi.coordinates("y"), vi.time(), ca.SX.sym("u")
    weight, h = v**2 / 2 - G * q, 0.07
    kinds = {
        "by the Lagrangian": (vi.System(q, v, weight + 3 * t * q, contact=q, t=t), None),
        "by a force": (vi.System(q, v, weight, force=3 * t, contact=q, t=t), None),
        "by a control": (
            vi.System(q, v, weight, force=u, control=u, contact=q),
            3 * h * (np.arange(60)[:, None, None] + np.array(rule.nodes)[:, None]),
        ),
    }
    system, controls = kinds[pulled]
    motion = vi.simulate(system, rule, q0=0.0, v0=0.0, h=h, steps=60, u=controls)
    (leaves,) = motion.events
    assert leaves.kind == "detachment" and abs(leaves.time - G / 3) <= 1e-13
    held = motion.t < leaves.time
    np.testing.assert_allclose(
        motion.multipliers[held, 0], G - 3 * motion.t[held], rtol=0, atol=1e-13
    )
    if rule.order > 2:
        np.testing.assert_allclose(
            motion.q[~held, 0], (motion.t[~held] - G / 3) ** 3 / 2, rtol=0, atol=1e-13
        )


def test_two_contacts_that_hold_let_go_each_at_its_own_time():
    (q, v), t = vi.coordinates("x", "y"), vi.time()
    corner = vi.System(
        q, v, ca.sumsqr(v) / 2 + (2 * t - 3) * q[0] + (1.5 * t - 4) * q[1], contact=q, t=t
    )
    motion = vi.simulate(corner, q0=[0, 0], v0=[0, 0], h=0.1, steps=40)
    assert [(event.kind, event.contact) for event in motion.events] == [
        ("detachment", 0),
        ("detachment", 1),
    ]
    np.testing.assert_allclose(times(motion), [1.5, 8 / 3], rtol=1e-14)


def test_a_shaken_table_throws_a_grain_when_it_falls_away_faster_than_gravity():
    (q, v), t, size, w = vi.coordinates("y"), vi.time(), 0.5, 6.0
    shaken = vi.System(q, v, v**2 / 2 - G * q, contact=q - size * ca.sin(w * t), t=t)
    motion = vi.simulate(shaken, vi.lobatto(4), q0=0.0, v0=size * w, h=0.01, steps=300)
    leave = np.arcsin(G / (size * w**2)) / w
    flown = motion.events[1].time - leave  # then it lands where the table is
    up, speed = size * np.sin(w * leave), size * w * np.cos(w * leave)
    assert [event.kind for event in motion.events] == 3 * ["detachment", "stop"]
    assert abs(motion.events[0].time - leave) <= 1e-13
    there = up + speed * flown - G * flown**2 / 2
    assert abs(there - size * np.sin(w * (leave + flown))) <= 1e-13
    # the same every period
    np.testing.assert_allclose(np.diff(times(motion)[::2]), 2 * np.pi / w, rtol=1e-12)


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


def test_a_start_inside_a_contact_is_refused():
    with pytest.raises(vi.InputError, match=r"q0 violates the contacts \[0\]: gap = \[-0\.1\]"):
        vi.simulate(ball(), q0=-0.1, v0=0.0, h=0.01, steps=1)


def test_a_start_that_runs_into_a_contact_begins_with_the_impact():
    motion = vi.simulate(ball(0.5), q0=0.0, v0=-2.0, h=0.01, steps=3)
    (hit,) = motion.events
    assert hit.time == 0 and abs(hit.impulse - 3.0) <= 1e-14 and motion.v[0, 0] == 1.0


def test_rules_that_cannot_carry_a_contact_are_refused():
    with pytest.raises(vi.InputError, match=r"gauss\(2\) cannot carry contacts.*lobatto\(3\)"):
        vi.simulate(ball(), vi.gauss(2), q0=1.0, v0=0.0, h=0.01, steps=1)
    q, v = vi.coordinates("y")
    fast = vi.System(q, v, -ca.sqrt(1 - v**2), contact=q)
    with pytest.raises(vi.InputError, match="quadratic in the velocities"):
        vi.simulate(fast, q0=1.0, v0=0.0, h=0.01, steps=1)
    with pytest.raises(vi.InputError, match="no step of its own"):
        vi.step_function(ball())


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


def test_a_block_rocks_from_corner_to_corner_ever_faster_and_comes_to_rest_on_both():
    """On a smooth floor a plastic blow on one corner lifts the other: θ̇ falls by (1 − k)/(1 +
    k), k = m w²/4I.
    """
    q, v = vi.coordinates("x", "y", "tilt")
    width, height, tilt = 0.3, 1.0, 0.1
    inertia = (width**2 + height**2) / 12
    corners = q[1] - height / 2 * ca.cos(q[2]) + ca.vertcat(1, -1) * width / 2 * ca.sin(q[2])
    block = vi.System(
        q, v, (ca.sumsqr(v[:2]) + inertia * v[2] ** 2) / 2 - G * q[1], contact=corners
    )
    q0 = [0, height / 2 * np.cos(tilt) + width / 2 * np.sin(tilt), tilt]
    motion = vi.simulate(block, vi.lobatto(4), q0=q0, v0=[0, 0, 0], h=0.01, steps=100)
    assert len(motion.events) > 20 and {event.kind for event in motion.events} == {"stop"}
    assert [event.contact for event in motion.events[:6]] == [0, 1, 0, 1, 0, 1]
    k, rest = width**2 / 4 / inertia, G * height / 2
    ratios = [
        (event.energy_after - rest) / (event.energy_before - rest) for event in motion.events[:6]
    ]
    np.testing.assert_allclose(ratios, ((1 - k) / (1 + k)) ** 2, rtol=1e-9)
    np.testing.assert_allclose(motion.multipliers[-1], G / 2, rtol=1e-9)
    np.testing.assert_allclose(motion.q[-1], [0, height / 2, 0], atol=1e-9)


def test_a_compiled_run_with_contacts_is_refused():
    with pytest.raises(vi.InputError, match="runs with contacts are interpreted"):
        vi.simulate(ball(), q0=1.0, v0=0.0, h=0.1, steps=1, backend="compiled")


def test_a_blow_that_a_resting_contact_does_not_feel_leaves_it_closed():
    """Two balls at rest on each other and on the floor run along it into a wall: nothing
    vertical happens there.
    """
    q, v = vi.coordinates("x", "y", "z")
    gaps = ca.vertcat(q[1], q[2] - q[1], 2.0 - q[0])
    fall = ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[2]) - 0.3 * q[0] ** 2
    system = vi.System(q, v, fall, contact=gaps, restitution=[0.5, 0.8, 1.0])
    motion = vi.simulate(system, q0=[1.0, 0.0, 0.0], v0=[1.5, 0, 0], h=0.01, steps=3000)
    assert len(motion.events) > 2 and {(event.kind, event.contact) for event in motion.events} == {
        ("impact", 2)
    }
    assert np.abs(motion.q[:, 1:]).max() < 1e-15


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


@pytest.mark.parametrize("place", [1e-200, 1e-226, 1e-310])
def test_a_blow_on_a_contact_whose_gradient_vanishes_is_refused(place):
    q, v = vi.coordinates("x")
    squared = vi.System(q, v, 1e-20 * (v**2 / 2 - q), contact=q**2, restitution=0.0)
    with pytest.raises(
        vi.InputError, match="contact 0 closes at t = 0 where its gap has no gradient"
    ):
        vi.simulate(squared, q0=place, v0=-1.0, h=0.001, steps=1)
