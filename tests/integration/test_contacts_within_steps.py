"""Contacts that close and open again within one step: found by bounds along it, not at nodes."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

TOGETHER = 8  # throws in one scene
RADIUS = 0.1


def throws(rng, count):
    """Start and velocity (2, count) of points thrown at the origin from up to 22 radii away, ten
    radii a unit of time; some miss.
    """
    angle, aside = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.15, 0.15, count)
    away, speed = rng.uniform(1.2, 2.2, count), rng.uniform(0.8, 1.2, count)
    along = np.stack([np.cos(angle), np.sin(angle)])
    across = np.stack([-along[1], along[0]])
    return aside * across - away * along, speed * along


def meets_disc(x, v):
    """When a point first meets the disc, or nothing."""
    a, b, c = v @ v, x @ v, x @ x - RADIUS**2
    return (-b - np.sqrt(b * b - a * c)) / a if b * b > a * c else None


def meets_square(x, v):
    """When a point first meets the square of half the width RADIUS, or nothing."""
    sides = np.sort([(-RADIUS - x) / v, (RADIUS - x) / v], axis=0)
    return sides[0].max() if sides[0].max() < sides[1].min() else None


def scene(kind):
    """So many throws in one scene, and when each should meet its obstacle."""
    q, v = vi.coordinates(*(f"{name}{i}" for i in range(TOGETHER) for name in "xy"))
    x = ca.horzsplit(ca.reshape(q, 2, TOGETHER))
    if kind == "disc":
        gaps = [ca.norm_2(a) - RADIUS for a in x]
    elif kind == "square":
        gaps = [ca.fmax(ca.fabs(a[0]), ca.fabs(a[1])) - RADIUS for a in x]
    else:
        gaps = [ca.norm_2(a - b) - RADIUS for a, b in zip(x[::2], x[1::2], strict=True)]
    return vi.System(q, v, ca.sumsqr(v) / 2, contact=ca.vertcat(*gaps), restitution=1.0)


KINDS = [("disc", meets_disc), ("square", meets_square), ("balls", meets_disc)]


def assert_none_is_missed(kind, meets, number):
    rng, system, hits = np.random.default_rng(14), scene(kind), 0
    count = system.contact.numel()
    for _ in range(number // count):
        x, v = throws(rng, count)
        start, speed = x, v
        if kind == "balls":  # seen from a ball that flies itself
            there, drift = rng.normal(size=(2, 2, count))
            start = np.stack([there + x, there], axis=2).reshape(2, -1)
            speed = np.stack([drift + v, drift], axis=2).reshape(2, -1)
        motion = vi.simulate(system, q0=start.T.ravel(), v0=speed.T.ravel(), h=1.0, steps=4)
        found = {}
        for event in motion.events:
            found.setdefault(event.contact, event.time)
        exact = {i: meets(x[:, i], v[:, i]) for i in range(count)}
        exact = {i: time for i, time in exact.items() if time is not None}
        assert found.keys() == exact.keys()
        np.testing.assert_allclose(
            [found[i] for i in exact], list(exact.values()), rtol=0, atol=1e-12
        )
        hits += len(exact)
    assert hits > number / 2


@pytest.mark.parametrize(("kind", "meets"), KINDS)
def test_no_contact_is_missed_in_random_throws(kind, meets):
    """Obstacles are hit at ten radii a step; at the nodes 60 % of the hits are not to be seen."""
    assert_none_is_missed(kind, meets, 120)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "meets"), KINDS)
def test_no_contact_is_missed_in_a_thousand_random_throws(kind, meets):
    assert_none_is_missed(kind, meets, 1000)


def test_a_needle_is_hit_in_the_middle_of_a_step():
    """No node sees it: it is 1/400 of a step wide where the point flies."""
    q, v = vi.coordinates("x", "y")
    needle = q[1] - 5 * ca.exp(-(((q[0] - 0.5) / 1e-3) ** 2))
    system = vi.System(q, v, ca.sumsqr(v) / 2, contact=needle, restitution=1.0)
    motion = vi.simulate(system, q0=[0.0, 1.0], v0=[1.0, 0.0], h=1.0, steps=2)
    (hit,) = motion.events
    assert abs(hit.time - (0.5 - 1e-3 * np.sqrt(np.log(5)))) < 1e-12 and motion.v[-1, 0] < -0.99


def test_a_thin_wall_that_a_gap_jumps_at_is_found_and_refused():
    q, v = vi.coordinates("x", "y")
    wall = q[1] - ca.if_else(ca.logic_and(q[0] > 0.5, q[0] < 0.501), 5.0, 0.0)
    system = vi.System(q, v, ca.sumsqr(v) / 2, contact=wall, restitution=1.0)
    with pytest.raises(vi.ConvergenceError, match=r"gap 0 jumps to -4 at t = 0\.5.*continuous"):
        vi.simulate(system, q0=[0.0, 1.0], v0=[1.0, 0.0], h=1.0, steps=2)


def test_a_curved_flight_over_a_post_is_told_from_one_that_hits_it():
    """The parabola's top passes the post by 1e-6 above or below within one step."""
    q, v = vi.coordinates("x", "y")
    speed, g = 4.0, 9.81
    top = speed**2 / (2 * g)
    for height, hits in ((top - 1e-6, False), (top + 1e-6, True)):
        post = ca.sqrt((q[0] - 2.0 * speed / g) ** 2 + (q[1] - height - 1) ** 2) - 1
        system = vi.System(q, v, ca.sumsqr(v) / 2 - g * q[1], contact=post, restitution=1.0)
        motion = vi.simulate(system, q0=[0.0, 0.0], v0=[2.0, speed], h=0.8, steps=1)
        assert bool(motion.events) != hits


def test_plastic_bodies_on_a_table_shaken_faster_than_the_steps_come_to_an_end():
    """Contacts that let go and close again within a step once made 10,000 events, then an error."""
    (q, v), t = vi.coordinates("y"), vi.time()
    c = vi.Parameters(a=1.0, w=1.0, ph=0.0)
    table = q - c.a * ca.sin(c.w * t + c.ph)
    shaken = vi.System(q, v, v**2 / 2 - 9.81 * q, contact=table, t=t, params=c)
    for h, a, w, ph in (
        (0.005, 0.005748505887289805, 298.92238938213865, 1.6398224076093721),
        (0.01, 0.0001428965742693653, 287.49694185734904, 2.582736922021334),
    ):
        motion = vi.simulate(
            shaken, q0=3.0, v0=0.0, h=h, duration=3.0, params=dict(a=a, w=w, ph=ph)
        )
        cycles = w * (3.0 - np.sqrt(6 / 9.81)) / (2 * np.pi)
        assert motion.t[-1] == 3.0 and len(motion.events) <= 4 * cycles
        assert motion.value(table).min() >= -1e-9 * abs(a)


@pytest.mark.parametrize("surface", [0.9, 0.999])
def test_a_run_close_beside_an_obstacle_is_the_run_without_it(surface):
    """A circular orbit of radius 1: bounds along steps of 1/20 make no contact of the surface."""
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 + 1 / ca.norm_2(q)
    planet = vi.System(q, v, lagrangian, contact=ca.norm_2(q) - surface)
    start = dict(q0=[1.0, 0.0], v0=[0.0, 1.0], h=0.05, steps=300, backend="interpreted")
    beside = vi.simulate(planet, vi.lobatto(4), **start)
    alone = vi.simulate(vi.System(q, v, lagrangian), vi.lobatto(4), **start)
    assert not beside.events and len(beside) == len(alone)
    np.testing.assert_allclose(beside.q, alone.q, rtol=0, atol=1e-13)


def bounces(backend):
    """A ball on a spring that bounces on a slope."""
    q, v = vi.coordinates("x", "y")
    ball = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - 9.81 * q[1] - 20 * (ca.norm_2(q) - 1) ** 2,
        contact=q[1] + 1.5 - 0.2 * q[0],
        restitution=0.95,
    )
    start = {"q0": [0.3, -0.7], "v0": [0.5, -1.0]}
    return vi.simulate(ball, vi.lobatto(3), **start, h=0.01, steps=600, backend=backend)


@pytest.mark.parametrize("backend", ["interpreted", "native"])
def test_impacts_are_found_to_the_round_off_of_the_gap(backend):
    motion = bounces(backend)
    places = np.array([event.q for event in motion.events])
    assert len(places) > 3
    gaps = places[:, 1] + 1.5 - 0.2 * places[:, 0]
    assert np.abs(gaps).max() <= 2 * np.finfo(float).eps * 1.5


def test_shorter_steps_end_where_a_gap_is_round_off(monkeypatch):
    from varint.integration.events import gaps

    looked, closing = [], gaps._closing

    def counted(passage, *others):
        before = len(passage.made)
        found = closing(passage, *others)
        looked.append(len(passage.made) - before)
        return found

    monkeypatch.setattr(gaps, "_closing", counted)
    bounces("interpreted")
    assert len(looked) > 3 and max(looked) <= 3
