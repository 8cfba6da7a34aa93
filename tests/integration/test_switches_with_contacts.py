"""Forces that jump or kink beside contacts: steps end at switches and at impacts, to the round-off
of closed forms.
"""

import math

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.errors import InputError

G = 9.81
CLOSE = dict(rel=1e-9, abs=1e-9)


def ball(force, restitution, **more):
    """A ball above the floor z = 0."""
    q, v = vi.coordinates("z")
    push = force(v[0])
    return vi.System(q, v, v**2 / 2 - G * q, force=push, contact=q, restitution=restitution, **more)


def block(force, restitution):
    """A block that slides on a table, which is a contact, up to a wall at x = 1."""
    q, v = vi.coordinates("x", "y")
    lagrangian = (v[0] ** 2 + v[1] ** 2) / 2 - G * q[1]
    push = ca.vertcat(force(v[0]), 0)
    gaps = ca.vertcat(q[1], 1 - q[0])
    return vi.System(q, v, lagrangian, force=push, contact=gaps, restitution=[0, restitution])


def test_a_ball_with_a_drag_of_constant_size_bounces_and_comes_to_rest():
    """Up with g + c, down with g − c: bounces are a geometric series."""
    c, e = 2.0, 0.8
    scene = ball(lambda v: -c * ca.sign(v), e)
    motion = vi.simulate(scene, q0=1.0, v0=0.0, duration=4.0)
    hit, speed = math.sqrt(2 / (G - c)), math.sqrt(2 * (G - c))
    slower = math.sqrt((G - c) / (G + c))
    flight = e * speed * (1 / (G + c) + slower / (G - c))
    impacts = [x.time for x in motion.events if x.kind == "impact"]
    ratio = (e * slower) ** np.arange(10)
    expected = hit + np.append(0, np.cumsum(flight * ratio))[:10]
    assert impacts[:10] == pytest.approx(expected, **CLOSE)
    stop = motion.events[-1]
    assert stop.kind == "stop" and stop.time == pytest.approx(
        hit + flight / (1 - e * slower), **CLOSE
    )
    assert motion.q[-1] == pytest.approx(0, abs=1e-15)
    assert motion.multipliers[-1] == pytest.approx(G)
    apex = impacts[0] + e * speed / (G + c)
    assert motion.at(apex).q.item() == pytest.approx((e * speed) ** 2 / (2 * (G + c)), **CLOSE)
    assert motion.stats["error_estimate"] < 1e-12 and len(motion) < 500


def test_a_ball_with_quadratic_drag_bounces():
    """Torricelli's law with k v |v|, by logarithms and arcs."""
    k, e, height, t = 0.2, 0.8, 1.0, 0.0
    scene = ball(lambda v: -k * v * ca.fabs(v), e)
    motion = vi.simulate(scene, q0=height, v0=0.0, duration=2.0)
    root, impacts = math.sqrt(G * k), []
    for _ in range(4):
        t += math.acosh(math.exp(k * height)) / root
        impacts.append(t)
        speed = e * math.sqrt(G / k * -math.expm1(-2 * k * height))
        t += math.atan(speed * math.sqrt(k / G)) / root
        height = math.log1p(k * speed**2 / G) / (2 * k)
        if t < 2:
            assert motion.at(t).q.item() == pytest.approx(height, **CLOSE)
    assert [x.time for x in motion.events] == pytest.approx(impacts, **CLOSE)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_block_slides_into_a_wall_and_back_until_friction_holds_it(e):
    """Distances are v²/2c; a plastic wall and friction share nothing: the block stays."""
    c, v0 = 2.0, 3.0
    motion = vi.simulate(block(lambda v: -c * ca.sign(v), e), q0=[0, 0], v0=[v0, 0], duration=3.0)
    left = e**2 * (v0**2 - 2 * c)
    assert motion.q[-1] == pytest.approx([1 - left / (2 * c), 0], **CLOSE)
    assert np.abs(motion.v[-1]).max() < 1e-15
    impact = (v0 - math.sqrt(v0**2 - 2 * c)) / c
    assert motion.events[0].time == pytest.approx(impact, **CLOSE)
    assert motion.multipliers[-1, 0] == pytest.approx(G)
    energy = motion.energy
    assert energy[0] - energy[-1] == pytest.approx(v0**2 / 2)


def test_a_block_falls_on_the_table_and_slides():
    """The impact takes no friction: that is a force of the scene."""
    scene = block(lambda v: -2.0 * ca.sign(v), 0.5)
    motion = vi.simulate(scene, q0=[0, 0.2], v0=[1.0, 0], duration=2.0)
    assert motion.events[0].kind == "stop"
    assert motion.events[0].time == pytest.approx(math.sqrt(0.4 / G), **CLOSE)
    assert motion.q[-1] == pytest.approx([0.25, 0], **CLOSE)


def test_what_rests_leaves_the_floor_where_the_force_outweighs_friction_too():
    """At r t = g + c; then s³ r/6."""
    c, rate, t = 2.0, 8.0, vi.time()
    scene = ball(lambda v: -c * ca.sign(v) + rate * t, 0.0, t=t)
    motion = vi.simulate(scene, q0=0.0, v0=0.0, duration=3.0)
    begin = (G + c) / rate
    (event,) = motion.events
    assert event.kind == "detachment" and event.time == pytest.approx(begin, **CLOSE)
    assert motion.q[-1].item() == pytest.approx(rate * (3 - begin) ** 3 / 6, **CLOSE)


def test_friction_and_a_wall_hold_a_block_until_the_force_pulls_it_off():
    """A sin t with A > c: away from the wall where A sin t = −c, and until it is slow again."""
    c, a, t = 2.0, 4.0, vi.time()
    q, v = vi.coordinates("x")
    force = -c * ca.sign(v) + a * ca.sin(t)
    scene = vi.System(q, v, v**2 / 2, force=force, contact=1 - q, t=t)
    motion = vi.simulate(scene, q0=0.0, v0=1.0, duration=5.0)
    off = math.pi + math.asin(c / a)
    # dv/dt = a sin t + c from rest at `off` on
    speed = a * (math.cos(off) - math.cos(5.0)) + c * (5.0 - off)
    way = a * ((5 - off) * math.cos(off) - math.sin(5.0) + math.sin(off)) + c * (5 - off) ** 2 / 2
    assert motion.events[0].kind == "stop"
    assert motion.v[-1].item() == pytest.approx(speed, **CLOSE)
    assert motion.q[-1].item() == pytest.approx(1 + way, **CLOSE)


def test_a_table_that_moves_throws_a_ball_with_drag():
    """It leaves with the table's speed where that falls behind, and the switch of the drag comes
    while the table carries it.
    """
    c, w, a, t = 2.0, 12.0, 0.1, vi.time()
    q, v = vi.coordinates("z")
    table = a * ca.sin(w * t)
    scene = vi.System(
        q, v, v**2 / 2 - G * q, force=-c * ca.sign(v), contact=q - table, t=t, restitution=0.0
    )
    motion = vi.simulate(scene, q0=0.0, v0=a * w, duration=0.4)
    # at rest on it until −a w² sin(w t) = −(g + c), upwards
    off = math.asin((G + c) / (a * w**2)) / w
    speed, place = a * w * math.cos(w * off), a * math.sin(w * off)
    apex, top = off + speed / (G + c), place + speed**2 / (2 * (G + c))
    assert [x.kind for x in motion.events[:2]] == ["detachment", "stop"]
    assert motion.events[0].time == pytest.approx(off, **CLOSE)
    assert motion.at(apex).q.item() == pytest.approx(top, **CLOSE)
    hit = motion.events[1].time
    fallen = top - (G - c) * (hit - apex) ** 2 / 2
    assert fallen == pytest.approx(a * math.sin(w * hit), **CLOSE)


def test_elastic_bounces_over_a_kink_keep_the_energy_and_run_back():
    q, v = vi.coordinates("z")
    potential = G * q + 3 * ca.fabs(q - 0.5)
    scene = vi.System(q, v, v**2 / 2 - potential, contact=q, restitution=1.0)
    motion = vi.simulate(scene, q0=1.0, v0=0.0, duration=20.0)
    assert np.ptp(motion.energy) < 1e-12 * motion.energy[0]
    # both halves of a fall, with g + 3 and g − 3
    speed = math.sqrt(2 * (G + 3) * 0.5)
    fall = speed / (G + 3) + (math.sqrt(speed**2 + (G - 3)) - speed) / (G - 3)
    times = [x.time for x in motion.events]
    assert times == pytest.approx(fall * (2 * np.arange(len(times)) + 1), **CLOSE)
    back = vi.simulate(scene, q0=motion.q[-1], v0=motion.v[-1], t0=20.0, duration=-20.0)
    assert back.q[-1].item() == pytest.approx(1, **CLOSE)


def test_zeros_stops_times_and_files_go_with_contacts_and_switches(tmp_path):
    """The velocity changes its sign at the wall, which ends the run there."""
    scene = block(lambda v: -2.0 * ca.sign(v), 0.5)
    given = dict(q0=[0, 0.2], v0=[3.0, 0], duration=2.0)
    x, v = scene.q[0], scene.v[0]
    whole = vi.simulate(scene, **given, events={"half": x - 0.5, "turn": (v, -1)})
    half, hit = (3 - math.sqrt(9 - 4 * y) for y in (0.5, 1.0))
    assert [(e.kind, e.time) for e in whole.events if e.kind != "stop"] == [
        ("half", pytest.approx(half / 2, **CLOSE)),
        ("impact", pytest.approx(hit / 2, **CLOSE)),
        ("turn", pytest.approx(hit / 2, **CLOSE)),
    ]
    ends = vi.simulate(scene, **given, until=(v, -1))
    assert ends.t[-1] == pytest.approx(hit / 2, **CLOSE) and ends.q[-1, 0] == pytest.approx(1)
    times = np.linspace(0, 2, 9)
    at = vi.simulate(scene, q0=[0, 0.2], v0=[3.0, 0], at=times)
    assert at.q == pytest.approx(whole.at(times).q, abs=1e-12)
    whole.save(tmp_path / "motion")
    loaded = vi.load(tmp_path / "motion")
    assert np.array_equal(loaded.at(times).q, whole.at(times).q)
    assert np.array_equal(loaded.multipliers, whole.multipliers)
    first, again = (vi.simulate(scene, **given, checkpoint=tmp_path / "file") for _ in range(2))
    assert np.array_equal(first.q, again.q) and first.events == again.events
    assert np.array_equal(first.active_set, again.active_set)


def test_files_without_the_contacts_of_their_switches_are_refused(tmp_path):
    scene = ball(lambda v: -2.0 * ca.sign(v), 0.0)
    path = tmp_path / "motion.npz"
    vi.simulate(scene, q0=1.0, v0=0.0, duration=1.0).save(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files if name != "switches_contacts"}
    assert len(arrays) > 10
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="which contacts hold"):
        vi.load(path)


def test_steps_of_a_given_size_end_at_switches_and_impacts_and_go_on_by_the_grid():
    """Uniform forces between them are exact by any step."""
    c, e, h = 2.0, 0.8, 0.05
    motion = vi.simulate(ball(lambda v: -c * ca.sign(v), e), q0=1.0, v0=0.0, h=h, steps=40)
    hit, speed = math.sqrt(2 / (G - c)), math.sqrt(2 * (G - c))
    apex = hit + e * speed / (G + c)
    assert motion.events[0].time == pytest.approx(hit, **CLOSE)
    assert motion.at(apex).q.item() == pytest.approx((e * speed) ** 2 / (2 * (G + c)), **CLOSE)
    assert motion.h == h
    steps = motion.t / h
    grid = np.abs(steps - np.round(steps)) < 1e-9
    assert np.round(steps[grid]) == pytest.approx(np.arange(41))
    between = motion.t[~grid]
    assert between[:2] == pytest.approx([hit, apex], **CLOSE)
    assert len(between) == len(motion.events) + motion.stats["switches"] // 2
    some = vi.simulate(
        ball(lambda v: -c * ca.sign(v), e), q0=1.0, v0=0.0, h=h, steps=40, save_every=7
    )
    assert len(some) == len(between) + 7 and some.q[-1] == motion.q[-1]


def test_the_rule_keeps_its_order_through_bounces_and_switches():
    """Of order 4 by lobatto(3), with a drag that kinks in its slope at every apex."""
    scene = ball(lambda v: -0.8 * v * ca.fabs(v) - ca.sign(v), 0.9)
    exact = vi.simulate(scene, q0=1.0, v0=0.0, duration=2.0, tol=1e-12).q[-1].item()
    errors = [
        abs(vi.simulate(scene, q0=1.0, v0=0.0, duration=2.0, h=h).q[-1].item() - exact)
        for h in (0.05, 0.025, 0.0125)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert ((orders > 3.5) & (orders < 4.5)).all(), (errors, orders)


def test_a_block_is_held_by_friction_on_a_table_in_steps_of_a_given_size():
    c, v0 = 2.0, 3.0
    scene = block(lambda v: -c * ca.sign(v), 0.5)
    motion = vi.simulate(scene, q0=[0, 0], v0=[v0, 0], h=0.25, duration=2.0)
    assert motion.q[-1] == pytest.approx([1 - 0.25 * (v0**2 - 2 * c) / (2 * c), 0], **CLOSE)
    assert np.abs(motion.v[-1]).max() < 1e-15


@pytest.mark.parametrize("c", [0.95, 1.3])
def test_frictions_of_both_coordinates_hold_a_block_on_a_slope_together(c):
    """With y = x/10 both velocities are zero at once; how much each of them holds is not
    determined, and 0.95 alone would not do.
    """
    d, slope, v0 = 1.5, 0.1, 2.0
    q, v = vi.coordinates("x", "y")
    force = ca.vertcat(-c * ca.sign(v[0]), -d * ca.sign(v[1]))
    lagrangian = (v[0] ** 2 + v[1] ** 2) / 2 - G * q[1]
    scene = vi.System(q, v, lagrangian, force=force, contact=q[1] - slope * q[0])
    motion = vi.simulate(scene, q0=[0, 0], v0=[v0, slope * v0], duration=3.0)
    mass, friction = 1 + slope**2, c + slope * d
    way = mass * v0**2 / (2 * (friction + slope * G))
    assert slope * G < friction  # it stays
    assert motion.q[-1] == pytest.approx([way, slope * way], **CLOSE)
    assert np.abs(motion.v[-1]).max() < 1e-14


def test_a_blow_turns_the_signs_of_all_that_it_moves():
    """Two balls over each other, both with friction: the lower one is on its way up when the upper
    one hits it, and they come to rest on the floor.
    """
    q, v = vi.coordinates("a", "b")
    lagrangian = (v[0] ** 2 + 2 * v[1] ** 2) / 2 - G * (q[0] + 2 * q[1])
    force = ca.vertcat(-2 * ca.sign(v[0]), -0.3 * ca.sign(v[1] - v[0]))
    gaps = ca.vertcat(q[0], q[1] - q[0] - 0.1)
    scene = vi.System(q, v, lagrangian, force=force, contact=gaps, restitution=[0.5, 0.0])
    motion = vi.simulate(scene, q0=[0.5, 1.0], v0=[0, 0], duration=3.0)
    assert motion.q[-1] == pytest.approx([0, 0.1], abs=1e-12)
    assert motion.multipliers[-1] == pytest.approx([3 * G, 2 * G])
    assert (np.diff(motion.energy) < 1e-12).all()
    # the first fall and bounce of the lower one, and where they meet
    hit = math.sqrt(2 * 0.5 / (G - 2))
    assert motion.events[0].time == pytest.approx(hit, **CLOSE)
    steps = vi.simulate(scene, q0=[0.5, 1.0], v0=[0, 0], duration=0.5, h=1 / 64)
    assert [x.time for x in steps.events[:2]] == pytest.approx(
        [x.time for x in motion.events[:2]], **CLOSE
    )


def test_sides_of_a_kink_at_nodes_are_no_missed_impulses():
    """Steps end at x = 0, where round-off says which side it is."""
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    lagrangian = (v[0] ** 2 + v[1] ** 2) / 2 - 3 * ca.fabs(q[0]) - q[1] ** 2
    force = ca.vertcat(-2 * ca.sign(v[0]) + 1.2 * ca.sin(3 * t), -0.1 * ca.sign(v[1]))
    scene = vi.System(q, v, lagrangian, force=force, contact=q[1], t=t)
    motion = vi.simulate(scene, q0=[0, 0.67], v0=[0.9, 0], duration=1.3)
    assert motion.stats["error_estimate"] < 1e-12 and len(motion) < 400
    assert motion.stats["switches_by_motion"] > 3


@pytest.mark.parametrize("steps", [dict(), dict(h=0.02)])
def test_derivatives_go_through_bounces_and_kinks_that_let_no_force_jump(steps):
    """v |v| is as smooth at the apex as they need it; sign(v) is not."""
    given = dict(v0=0.0, duration=1.2) | steps
    scene, d = ball(lambda v: -0.3 * v * ca.fabs(v), 0.7), 1e-5
    motion = vi.simulate(scene, q0=1.0, **given)
    ends = [vi.simulate(scene, q0=x, **given) for x in (1 + d, 1 - d)]
    slope = [(ends[0].q[-1] - ends[1].q[-1]) / (2 * d), (ends[0].v[-1] - ends[1].v[-1]) / (2 * d)]
    assert motion.transition_matrix()[:, 0] == pytest.approx(np.ravel(slope), rel=1e-6)
    dry = vi.simulate(ball(lambda v: -ca.sign(v), 0.7), q0=1.0, **given)
    with pytest.raises(InputError, match="jump or kink"):
        dry.transition_matrix()


@pytest.mark.parametrize("asked", [{}, {"backend": "interpreted"}, {"on_failure": "subdivide"}])
def test_a_body_rests_on_a_gap_that_switches(asked):
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - ca.fabs(q), contact=ca.fabs(q), restitution=0.0)
    motion = vi.simulate(scene, q0=0.0, v0=0.0, h=1e-3, steps=3, **asked)
    assert np.abs(motion.q).max() < 1e-12
