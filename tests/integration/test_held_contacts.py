"""Contacts that hold: reactions, rest, and letting go when the reaction vanishes."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, disc_on_table, times
from references import entries
from scenes import rocking

import varint as vi

REFERENCE = entries("a")


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


def test_a_blow_that_a_resting_contact_does_not_feel_leaves_it_closed():
    """Two balls at rest on each other and on the floor run along it into a wall: nothing
    vertical happens there.
    """
    motion = vi.simulate(rocking(), q0=[1.0, 0.0, 0.0], v0=[1.5, 0, 0], h=0.01, steps=3000)
    assert len(motion.events) > 2 and {(event.kind, event.contact) for event in motion.events} == {
        ("impact", 2)
    }
    assert np.abs(motion.q[:, 1:]).max() < 1e-15
