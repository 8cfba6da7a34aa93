"""Flights between impacts in C: what the interpreted loop finds, to round-off, and never less."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, ball, disc_on_table, times
from stopped_runs import assert_same_bytes

import varint as vi
from varint.codegen.contacts import contact_data
from varint.integration.events import contact_loop, flights


def stack():
    """Two balls above each other on a floor."""
    q, v = vi.coordinates("a", "b")
    gaps = ca.vertcat(q[0], q[1] - q[0])
    lagrangian = ca.sumsqr(v) / 2 - G * ca.sum1(q)
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=[0.9, 0.8])
    return system, {"q0": [1.0, 1.5], "v0": [0.0, 0.0], "h": 0.01, "steps": 250}


def arm_at_walls():
    """A double pendulum whose elbow and tip hit walls: the mass depends on the angles."""
    q, v = vi.coordinates("a", "b")
    elbow = ca.vertcat(ca.sin(q[0]), -ca.cos(q[0]))
    tip = elbow + ca.vertcat(ca.sin(q[1]), -ca.cos(q[1]))
    speeds = [ca.jtimes(x, q, v) for x in (elbow, tip)]
    lagrangian = sum(ca.sumsqr(x) for x in speeds) / 2 - G * (elbow[1] + tip[1])
    gaps = ca.vertcat(0.6 - elbow[0], 1.2 - tip[0])
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=[0.9, 0.7])
    return system, {"q0": [-1.0, -0.5], "v0": [0.0, 0.0], "h": 0.01, "steps": 500}


def ball_with_drag():
    """Air drag, a wavy floor and a circle around."""
    q, v = vi.coordinates("x", "y")
    gaps = ca.vertcat(q[1] - 0.2 * ca.cos(3 * q[0]), 4 - ca.sumsqr(q - ca.DM([0, 1])))
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    system = vi.System(q, v, lagrangian, force=-0.1 * v, contact=gaps, restitution=0.9)
    return system, {"q0": [0.1, 1.0], "v0": [1.0, 0.0], "h": 0.01, "steps": 400}


def shaken_ball():
    """A table that moves, until the ball has come to rest on it and is thrown up again."""
    t = ca.SX.sym("t")
    q, v = vi.coordinates("y")
    gap = q - 0.1 * ca.sin(7 * t)
    system = vi.System(q, v, v**2 / 2 - G * q, contact=gap, restitution=0.3, t=t)
    return system, {"q0": 0.5, "v0": 0.0, "h": 0.01, "steps": 150}


def sliding_disc():
    """A disc that slides on a floor, in a hollow, between two walls."""
    q, v = vi.coordinates("x", "y")
    gaps = ca.vertcat(q[1], q[0] + 1, 1 - q[0])
    lagrangian = ca.sumsqr(v) / 2 - G * q[1] - q[0] ** 2 / 2
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=[0.0, 0.9, 0.8])
    return system, {"q0": [0.0, 0.0], "v0": [2.0, 0.0], "h": 0.02, "steps": 200}


def rod_at_a_wall():
    """A point on a rod in Cartesian coordinates, which holds it, and a wall."""
    q, v = vi.coordinates("x", "y")
    rod, wall = ca.sumsqr(q) - 1, 0.5 - q[0]
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    system = vi.System(q, v, lagrangian, constraint=rod, contact=wall, restitution=0.9)
    return system, {"q0": [-0.6, -0.8], "v0": [0.0, 0.0], "h": 0.01, "steps": 400}


def ladder():
    """Two contacts that hold, of which one lets go, and a third that closes."""
    model = vi.models.falling_ladder()
    return model.system, model.start


def cradle():
    """Five pendulums side by side, of which one comes: its blow goes through all."""
    q, v = vi.coordinates(*(f"angle{i}" for i in range(5)))
    lagrangian = ca.sumsqr(v) / 2 + G * ca.sum1(ca.cos(q))
    system = vi.System(q, v, lagrangian, contact=q[1:] - q[:-1], restitution=[1.0] * 4)
    return system, {"q0": [-0.5, 0, 0, 0, 0], "v0": [0.0] * 5, "h": 0.01, "steps": 170}


def pile():
    """A plastic floor, and elastic and plastic balls above: blows are handed on, and stop."""
    q, v = vi.coordinates("a", "b", "c")
    lagrangian = (v[0] ** 2 + 2 * v[1] ** 2 + v[2] ** 2) / 2 - G * (q[0] + 2 * q[1] + q[2])
    gaps = ca.vertcat(q[0], q[1] - q[0] - 0.2, q[2] - q[1] - 0.2)
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=[0.0, 0.5, 0.0])
    return system, {"q0": [0.0, 0.2, 1.4], "v0": [0.0] * 3, "h": 0.01, "steps": 65}


def rocking_block():
    """A block that falls on a corner, slaps down on the other one and rocks to rest."""
    q, v = vi.coordinates("x", "y", "a")
    reach, height = 0.5 * ca.sin(q[2]), 0.3 * ca.cos(q[2])
    gaps = ca.vertcat(q[1] - reach - height, q[1] + reach - height)
    lagrangian = (v[0] ** 2 + v[1] ** 2 + 0.1 * v[2] ** 2) / 2 - G * q[1]
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=0.0)
    return system, {"q0": [0, 0.5, 0.1], "v0": [0.3, 0, 0], "h": 0.01, "steps": 100}


def hopper():
    """Two masses and a spring, of which the lower one sticks and is torn off again and again."""
    q, v = vi.coordinates("a", "b")
    lagrangian = ca.sumsqr(v) / 2 - G * ca.sum1(q) - 200 * (q[1] - q[0] - 1) ** 2
    system = vi.System(q, v, lagrangian, contact=q[0], restitution=0.0)
    return system, {"q0": [0.5, 1.5], "v0": [0.0, 0.0], "h": 0.01, "steps": 100}


def arm_with_stops():
    """Three links whose joints stop: coupled so strongly that equations change places."""
    q, v = vi.coordinates("a", "b", "c")
    angle, place, lagrangian, gaps = 0, ca.SX.zeros(2), 0, []
    for joint in (q[0], q[1], q[2]):
        angle += joint
        place = place + ca.vertcat(ca.sin(angle), -ca.cos(angle))
        lagrangian += ca.sumsqr(ca.jtimes(place, q, v)) / 2 - G * place[1]
    for joint in (q[1], q[2]):
        gaps += [joint + 0.5, 0.5 - joint]
    system = vi.System(q, v, lagrangian, contact=ca.vertcat(*gaps), restitution=0.0)
    return system, {"q0": [1.5, 0, 0], "v0": [0.0] * 3, "h": 0.01, "steps": 450}


SCENES = [stack, arm_at_walls, ball_with_drag, shaken_ball, sliding_disc, rod_at_a_wall, ladder]
EVERY = [(build, rule) for build in SCENES for rule in (vi.trapezoidal(), vi.lobatto(3))]
EVERY += [(build, vi.lobatto(3)) for build in (cradle, pile, rocking_block, hopper, arm_with_stops)]


@pytest.mark.parametrize(("build", "rule"), EVERY)
def test_flights_in_c_find_what_the_interpreted_loop_finds(build, rule):
    system, start = build()
    plain = vi.simulate(system, rule, **start, backend="interpreted")
    motion = vi.simulate(system, rule, **start, backend="native")
    assert motion.stats["backend"].startswith("native") and len(motion.events) >= 2
    assert [(e.kind, e.contact) for e in motion.events] == [
        (e.kind, e.contact) for e in plain.events
    ]
    np.testing.assert_allclose(times(motion), times(plain), rtol=1e-9)
    for one, other in zip(motion.events, plain.events, strict=True):
        found = [(e.impulse, e.energy_before, e.energy_after, *e.v_after) for e in (one, other)]
        np.testing.assert_allclose(*found, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(motion.q[-1], plain.q[-1], rtol=1e-8, atol=1e-12)
    assert len(motion) == len(plain) and (motion.k == plain.k).all()


def test_a_billiard_in_a_box_is_the_folded_straight_line_however_long_its_steps():
    system = disc_on_table()
    for h in (0.037, 0.9):  # many steps a flight, and several impacts a step
        steps = int(200 / h)
        motion = vi.simulate(system, q0=[0.3, 0.4], v0=[1.0, 0.01], h=h, steps=steps)
        x = (0.3 + motion.t) % 2
        np.testing.assert_allclose(motion.q[:, 0], np.minimum(x, 2 - x), atol=1e-11)
        hits = [event for event in motion.events if event.contact in (0, 1)]
        np.testing.assert_allclose([e.time for e in hits], 0.7 + np.arange(len(hits)), rtol=1e-12)
        assert motion.q.min() >= -1e-12 and motion.q[:, 0].max() <= 1 + 1e-12


@pytest.mark.parametrize("depth", [1e-6, -1e-6])
def test_a_gap_that_closes_and_opens_within_one_step_is_no_gap_that_stays_open(depth):
    """A parabola whose top dips 1e-6 into a ceiling, or stays as far below it, between two
    nodes."""
    q, v = vi.coordinates("y")
    system = vi.System(q, v, v**2 / 2 - q, contact=0.5 + 0.125 - depth - q)
    start = {"q0": 0.5, "v0": 0.5, "h": 1.0, "steps": 1, "backend": "native"}
    events = vi.simulate(system, **start).events
    assert len(events) == (1 if depth > 0 else 0)
    for event in events:
        assert abs(event.time - (0.5 - np.sqrt(2 * depth))) < 1e-9


def test_saved_nodes_are_those_of_the_whole_run_to_the_bit():
    system, start = arm_at_walls()
    whole = vi.simulate(system, **start)
    some = vi.simulate(system, **start, save_every=7)
    grid = np.isin(whole.t, times(whole)) | (whole.k % 7 == 0) | (whole.k == start["steps"])
    assert (some.t == whole.t[grid]).all() and (some.q == whole.q[grid]).all()
    assert some.events == whole.events


@pytest.mark.parametrize("build", [arm_at_walls, hopper, rocking_block])
def test_a_run_in_pieces_is_the_run_in_one(monkeypatch, build):
    system, start = build()
    whole = vi.simulate(system, **start)
    monkeypatch.setattr(flights, "PATIENCE", 0.0)  # a call a look
    pieces = vi.simulate(system, **start)
    assert (pieces.q == whole.q).all() and (pieces.p == whole.p).all()
    assert pieces.events == whole.events


@pytest.mark.long
def test_the_compiled_loop_gives_the_same_bytes():
    system, start = arm_at_walls()
    one, other = (vi.simulate(system, **start, backend=b) for b in ("native", "compiled"))
    assert one.stats["backend"].startswith("native")
    assert other.stats["backend"].startswith("compiled")
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()
    assert one.events == other.events


def test_a_crossing_ends_the_run_at_the_impact_that_makes_it():
    q, v = vi.coordinates("y")
    system = vi.System(q, v, v**2 / 2 - G * q, contact=q, restitution=0.5)
    start = {"q0": 1.0, "v0": 0.0, "h": 0.05, "steps": 40}
    motion = vi.simulate(system, **start, until=(v, 1))
    assert [event.kind for event in motion.events] == ["impact"]
    assert abs(motion.t[-1] - np.sqrt(2 / G)) < 1e-14
    logged = vi.simulate(system, **start, events={"up": (v, 1)}).events
    impacts = [event.time for event in logged if event.kind == "impact"]
    assert len(impacts) > 4 and [e.time for e in logged if e.kind == "up"][:-1] == impacts


def test_bounces_die_out_and_the_ball_rests():
    motion = vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=0.05, duration=2.0, backend="native")
    rests = np.sqrt(2 / G) * (1 + 0.5) / (1 - 0.5)
    assert motion.events[-1].kind == "stop" and abs(motion.events[-1].time - rests) < 1e-12
    assert motion.q[-1, 0] == pytest.approx(0, abs=1e-14)


def test_too_many_coordinates_for_the_loop_are_refused():
    with pytest.raises(vi.VarintError, match="too large"):
        contact_data(1000, 1, np.ones(1), ca.SX(0, 1), {})


def test_a_cradle_hands_the_momentum_on_and_back():
    """All of it, to the last pendulum, half a period later back to the first."""
    system, start = cradle()
    motion = vi.simulate(system, **start)
    first, back = motion.events[:4], motion.events[4:8]
    assert [e.contact for e in first] == [0, 1, 2, 3] and [e.contact for e in back] == [3, 2, 1, 0]
    speed = np.sqrt(2 * G * (1 - np.cos(0.5)))
    for blows, leaves in ((first, 4), (back, 0)):
        moves = np.array(blows[-1].v_after)
        assert abs(abs(moves[leaves]) - speed) < 1e-6
        assert np.abs(np.delete(moves, leaves)).max() < 1e-13


@pytest.mark.parametrize("build", [cradle, pile, hopper])
def test_blows_stops_and_releases_are_dealt_with_in_the_core(build, monkeypatch):
    dealt = []
    settle = contact_loop.settle
    monkeypatch.setattr(contact_loop, "settle", lambda *x, **y: dealt.append(x) or settle(*x, **y))
    system, start = build()
    events = vi.simulate(system, **start).events
    assert len(events) >= 3 and not dealt
    assert {e.kind for e in events} >= ({"detachment", "stop"} if build is hopper else set())


@pytest.mark.parametrize("build", [pile, hopper, arm_with_stops, ladder, shaken_ball])
def test_changes_of_what_holds_end_no_call_and_show_in_no_byte(build, monkeypatch):
    system, start = build()
    fly, calls = flights.fly, []
    monkeypatch.setattr(flights, "fly", lambda *x, **y: calls.append(x) or fly(*x, **y))
    whole = vi.simulate(system, **start)
    assert len(calls) == 1 and len(whole.active_sets) > 1
    alone = flights.fly
    monkeypatch.setattr(flights, "fly", lambda *x, **y: alone(*x, **{**y, "change": None}))
    each = vi.simulate(system, **start)
    assert len(calls) > 2
    assert_same_bytes(whole, each, "v", "multipliers")
    assert each.events == whole.events and each.active_sets == whole.active_sets
    assert (each.active_set == whole.active_set).all()


def test_an_error_while_what_holds_changes_is_raised(monkeypatch):
    system, start = hopper()

    def broken(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(flights, "_change", broken)
    monkeypatch.setattr(flights, "PATIENCE", 0.0)  # as a long run
    motion = vi.simulate(system, **start)
    assert motion.stats["interrupted"] and len(motion) < start["steps"]


def test_every_blow_of_a_stack_that_chatters_to_rest_takes_its_part_of_the_energy():
    """½ Λ |ġ| (1 − e) by Newton's law, e = 0 where the flight would be too short."""
    q, v = vi.coordinates("a", "b")
    gaps, e = ca.vertcat(q[0], q[1] - q[0] - 0.2), 0.7
    lagrangian = (ca.sumsqr(v) - 2 * G * ca.sum1(q)) / 2
    scene = vi.System(q, v, lagrangian, contact=gaps, restitution=[e, e])
    motion = vi.simulate(scene, q0=[1.0, 2.0], v0=[0.0, 0.0], h=0.01, steps=220)
    blows = [x for x in motion.events if x.kind in ("impact", "stop")]
    assert len(blows) > 100
    assert {x.kind for x in blows} == {"impact", "stop"}
    for blow in blows:
        before = np.array(blow.v_before)
        rate = before[0] if blow.contact == 0 else before[1] - before[0]
        loss = blow.impulse * -rate / 2
        kept = {loss * (1 - e), loss}  # what bounced too shortly has stopped
        taken = blow.energy_before - blow.energy_after
        assert min(abs(taken - x) for x in kept) < 1e-13
    assert motion.q[-1] == pytest.approx([0.0, 0.2], abs=1e-12)
    assert np.abs(motion.v[-1]).max() < 1e-12


def test_iterations_of_steps_before_an_impact_are_counted():
    q, v = vi.coordinates("x", "y")
    L = ca.sumsqr(v) / 2 - G * q[1] - 20 * (ca.norm_2(q) - 1) ** 2
    system = vi.System(q, v, L, contact=q[1] + 0.8, restitution=1.0)
    motion = vi.simulate(
        system, vi.lobatto(3), q0=[0.3, -0.7], v0=[0.5, -1.0], h=0.01, steps=500, backend="native"
    )
    assert len(motion.events) > 5
    assert motion.stats["iterations"] >= 500


def test_a_dip_between_nodes_of_a_long_flight_is_seen():
    """The turning points of an oscillator reach a wall that comes nearer by 4e-8 a turn, and no
    node does, thousands of steps after the start.
    """
    q, v = vi.coordinates("x", "y")
    gap = 1 + 1e-5 - q[1] - 1.3e-7 * q[0]
    system = vi.System(q, v, ca.sumsqr(v) / 2 - q[1] ** 2 / 2, contact=gap)

    def impacts(backend):
        return vi.simulate(
            system,
            vi.lobatto(3),
            q0=[0, 1.0],
            v0=[0.05, 0.0],
            h=0.37,
            steps=8000,
            backend=backend,
        ).events

    found, expected = impacts("native"), impacts("interpreted")
    assert len(found) == len(expected) > 0
    assert found[0].time > 1000
    assert abs(found[0].time - expected[0].time) < 1e-3
    assert abs(found[0].time / 0.37 - round(found[0].time / 0.37)) > 1e-3
