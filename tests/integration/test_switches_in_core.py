"""Switches passed in one call of C are those that are passed one by one, to the last digit; both
meet closed forms.
"""

import casadi as ca
import numpy as np
import pytest
from contact_scenes import times

import varint as vi
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.switches import follow as following
from varint.integration.switches import watching
from varint.integration.switches.course import Course
from varint.integration.switches.follow import first_unit, follow
from varint.integration.switches.passage import Passage
from varint.integration.switches.timetable import timetable

SCENES, HELD, PARTS = 40, 12, 8


def random_scene(seed):
    """A scene of some switches, and how it begins."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    q, v = vi.coordinates(*(f"x{i}" for i in range(n)))
    t = vi.time()
    masses, springs = random.uniform(0.5, 2.0, n), random.uniform(0.5, 3.0, n)
    potential = ca.dot(ca.DM(springs), q**2) / 2
    if n > 1:
        potential += random.uniform(0.1, 1.0) * ca.sumsqr(q[1:] - q[:-1])
    if random.random() < 0.5:  # a kink of the potential, or a scene that is not linear
        potential += random.uniform(0.1, 0.5) * ca.fabs(q[0] - random.uniform(-0.3, 0.3))
    else:
        potential += random.uniform(0.1, 0.5) * (1 - ca.cos(q[0]))
    force = -random.uniform(0.0, 0.05) * v
    switched = random.choice(5, size=int(random.integers(1, 3)), replace=False)
    for kind in switched.tolist():
        i, size = int(random.integers(n)), random.uniform(0.02, 0.3)
        a, b = random.uniform(-0.4, 0.4, 2)
        force[i] += [
            -size * ca.sign(v[i]),
            -size * ca.sign(q[i] - a),
            -size * ca.sign(q[i] + abs(b) * v[i]),
            ca.if_else(q[i] > a, -size * (q[i] - a) - size, 0),
            -size * ca.sign(v[i] - a) * (1 - 0.3 * ca.fabs(v[i] - a)),
        ][kind]
    drive = ca.sin(random.uniform(0.5, 2.0) * t)
    if random.random() < 0.4:
        force[0] += random.uniform(0.1, 0.4) * (drive if seed % 3 else ca.sign(drive))
    if seed % 7 == 6:
        force[0] -= 0.1 * ca.floor(3 * q[0])
    system = vi.System(q, v, ca.dot(ca.DM(masses), v**2) / 2 - potential, force=force, t=t)
    way = -1.0 if seed % 5 == 4 else 1.0
    stages = int(random.choice([2, 4, 8]))
    start = random.uniform(-1.5, 1.5, n), random.uniform(-1, 1, n)
    return system, *start, way * 40.0, vi.gauss(stages)


def random_held_scene(seed):
    """A bead on a wire, or on a circle, with a spring, switches and perhaps a drive."""
    random = np.random.default_rng(seed)
    q, v = vi.coordinates("x", "y")
    t = vi.time()
    x, size = random.uniform(-1, 1), random.uniform(0.005, 0.1, 3)
    if seed % 2:
        bend = random.uniform(0.05, 0.3)
        wire, slope = bend * ca.sin(q[0]), bend * ca.cos(q[0])
        constraint, along = q[1] - wire, ca.vertcat(1, slope)
        start = [x, bend * np.sin(x)], [0.5, 0.5 * bend * np.cos(x)]
    else:
        constraint, along = ca.sumsqr(q) - 1, ca.vertcat(-q[1], q[0])
        start = [np.sin(x), -np.cos(x)], [0.7 * np.cos(x), 0.7 * np.sin(x)]
    force = -size[0] * ca.sign(ca.dot(along, v)) * along
    force[0] += -size[1] * ca.sign(q[0] - random.uniform(-0.3, 0.3))
    force[0] += size[2] * ca.sin(random.uniform(0.5, 2) * t) if seed % 3 else 0
    lagrangian = ca.sumsqr(v) / 2 - 3 * q[1] - random.uniform(0.5, 2) * q[0] ** 2 / 2
    system = vi.System(q, v, lagrangian, force=force, constraint=constraint, t=t)
    return system, *start, 20.0, vi.lobatto(int(random.choice([3, 5])))


def pieces_of(scene):
    """The pieces in so many steps a unit; None where the motion cannot be followed."""
    system, q0, v0, duration, rule = scene
    start = Start(q0, v0)
    problem = initial_value_problem(
        system, plan(system, rule).rule, start, RunOptions(h=duration, steps=1)
    )
    table = timetable(system, problem.c, 0.0, duration, problem.u[:, 0])
    course = Course(system, rule, problem, table, "native")
    with np.errstate(all="ignore"):
        assert first_unit(course) is not None
        return [x for some in follow(course, PARTS) for x in some or (None,)]


def one_by_one(monkeypatch):
    monkeypatch.setattr(following.Passage, "take", lambda *given: None)


def same_bytes(one, other):
    return (
        one.branch == other.branch
        and one[1:3] == other[1:3]
        and one[5:] == other[5:]
        and one.t.tobytes() == other.t.tobytes()
        and one.states.tobytes() == other.states.tobytes()
    )


ALL = [(random_scene, i) for i in range(SCENES)] + [(random_held_scene, i) for i in range(HELD)]


@pytest.mark.parametrize(("scene_of", "seed"), ALL)
def test_switches_passed_at_once_and_one_by_one_are_the_same_bytes(scene_of, seed, monkeypatch):
    scene = scene_of(seed)
    with monkeypatch.context() as patch:
        one_by_one(patch)
        alone = pieces_of(scene)
    together = pieces_of(scene)
    assert len(alone) == len(together)
    for one, other in zip(alone, together, strict=True):
        assert (one is None) == (other is None)
        assert one is None or same_bytes(one, other)


def test_all_but_the_first_of_each_branch_are_passed_at_once(monkeypatch):
    """Random scenes would agree, too, if nothing were passed so."""
    made, take = [], Passage.take

    def noted(self, *given):
        found = take(self, *given)
        made.append(len(found or ()))
        return found

    monkeypatch.setattr(following.Passage, "take", noted)
    q, v = vi.coordinates("x", "y")
    spring = vi.System(q[0], v[0], v[0] ** 2 / 2 - q[0] ** 2 / 2, force=-1e-3 * ca.sign(v[0]))
    along = ca.vertcat(-q[1], q[0])
    pendulum = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - q[1],
        constraint=ca.sumsqr(q) - 1,
        force=-1e-3 * ca.sign(ca.dot(along, v)) * along,
    )
    for scene in (
        (spring, [1.0], [0.0], 600.0, vi.gauss(8)),
        (pendulum, [0.6, -0.8], [0.0, 0.0], 200.0, vi.lobatto(5)),
    ):
        made.clear()
        pieces = pieces_of(scene)
        assert len(pieces) > 60
        assert sum(made) >= len(pieces) - 3
        assert len(made) <= 9


def test_dry_friction_takes_as_much_of_the_amplitude_in_every_half_period():
    """|x| = A − 2 k μ after k half periods of length π."""
    q, v = vi.coordinates("x")
    friction, amplitude = 1e-3, 1.0
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=-friction * ca.sign(v))
    motion = vi.simulate(system, q0=[amplitude], v0=[0.0], duration=120.5 * np.pi, tol=1e-10)
    k = np.arange(1, 121)
    at = np.searchsorted(motion.t, np.pi * k - 1e-6)
    assert motion.stats["switches"] == 120
    np.testing.assert_allclose(motion.t[at], np.pi * k, atol=1e-11)
    np.testing.assert_allclose(
        motion.q[at, 0], (-1.0) ** k * (amplitude - 2 * k * friction), atol=1e-11
    )


def test_a_relay_keeps_its_period():
    """x'' = −a sign(x) from the amplitude A has the period 4 √(2 A / a)."""
    q, v = vi.coordinates("x")
    a, amplitude = 0.7, 1.3
    system = vi.System(q, v, v**2 / 2, force=-a * ca.sign(q))
    period = 4 * np.sqrt(2 * amplitude / a)
    motion = vi.simulate(system, q0=[amplitude], v0=[0.0], duration=100 * period, tol=1e-10)
    assert motion.stats["switches"] == 200
    crossings = np.flatnonzero(np.abs(motion.q[:, 0]) < 1e-9)
    np.testing.assert_allclose(
        motion.t[crossings], period * (0.25 + 0.5 * np.arange(200)), rtol=1e-12
    )
    np.testing.assert_allclose([motion.q[-1, 0], motion.v[-1, 0]], [amplitude, 0], atol=1e-10)


def test_a_block_that_is_pushed_and_left_alone_rests_between_pushes():
    """Pushed by f for τ and left alone for as long, under friction μ < f < 2 μ, it goes
    (f − μ) f τ² / (2 μ) further each time, and rests before the next push.
    """
    q, v = vi.coordinates("x")
    t, push, friction, tau, times = vi.time(), 1.5, 1.0, 0.8, 40
    on = ca.if_else(ca.sin(np.pi * t / tau) > 0, push, 0)
    system = vi.System(q, v, v**2 / 2, force=on - friction * ca.sign(v), t=t)
    motion = vi.simulate(system, q0=[0.0], v0=[0.0], duration=2 * tau * times, tol=1e-10)
    way = (push - friction) * push * tau**2 / (2 * friction)
    rests = np.searchsorted(motion.t, 2 * tau * np.arange(1, times) - 1e-9)
    np.testing.assert_allclose(motion.q[rests, 0], way * np.arange(1, times), rtol=1e-11)
    np.testing.assert_allclose(motion.v[rests, 0], 0, atol=1e-14)


@pytest.mark.parametrize("failing", ["an unknown branch", "two at once"])
def test_what_is_not_clear_is_decided_one_by_one(failing, monkeypatch):
    """Two switches at one instant, and branches that come up late, are those of the slow way."""
    q, v = vi.coordinates("x", "y")
    if failing == "two at once":  # both coordinates turn together
        force, q0 = -0.01 * ca.sign(v), [1.0, 1.0]
    else:  # the spring behind x = 1.2 is met as energy comes in
        force = ca.vertcat(
            0.02 * v[0] - ca.if_else(q[0] > 1.2, q[0] - 1.2, 0), -0.01 * ca.sign(v[1])
        )
        q0 = [1.0, 0.5]
    scene = (
        vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2, force=force),
        q0,
        [0.0, 0.0],
        60.0,
        vi.gauss(4),
    )
    together = pieces_of(scene)
    one_by_one(monkeypatch)
    alone = pieces_of(scene)
    assert len(together) == len(alone) > 15
    assert all(same_bytes(one, other) for one, other in zip(alone, together, strict=True))


@pytest.mark.parametrize("direction", [0, 1, -1])
@pytest.mark.parametrize("scene_of", [random_scene, random_held_scene])
@pytest.mark.parametrize("seed", [0, 3, 4])
def test_events_and_the_stop_are_those_of_pieces_that_are_searched_one_by_one(
    scene_of, seed, direction, monkeypatch
):
    """To the last digits of a time: those of all pieces of a branch are searched together."""
    system, q0, v0, duration, rule = scene_of(seed)
    x = system.q[0]
    watched = {"level": (x - 0.05, direction), "turn": (system.v[0] - 0.01, direction)}
    start = dict(q0=q0, v0=v0, duration=duration, tol=1e-6, events=watched)

    def runs():
        whole = vi.simulate(system, rule, **start)
        middle = whole.events[len(whole.events) // 2]
        stop = x - middle.q[0], direction
        return whole, vi.simulate(system, rule, **start, until=stop)

    together = runs()
    monkeypatch.setattr(watching, "zeros_in_steps", lambda *given: None)
    one_by_one(monkeypatch)
    alone = runs()
    assert len(together[0].events) > 5
    for some, others in zip(together, alone, strict=True):
        assert [x.kind for x in some.events] == [x.kind for x in others.events]
        np.testing.assert_allclose(times(some), times(others), rtol=1e-12)
        assert some.t.tobytes() == others.t.tobytes() or abs(some.t - others.t).max() < 1e-11
    assert abs(together[1].t[-1]) < abs(duration)


def test_times_of_switches_are_found_to_the_last_digit_and_anew_for_other_parameters():
    q, v = vi.coordinates("x")
    t, c = vi.time(), vi.Parameters(when=1.0)
    push = ca.if_else(t < c.when, 1, 0) + ca.if_else(t > 2 * c.when, 1, 0) + ca.sign(ca.sin(7 * t))
    system = vi.System(q, v, v**2 / 2, force=push, params=c, t=t)
    for when in (1.0, 1.0, 1.3):
        asked = np.array([when]), 0.0, 3.0, np.empty((1, 0))
        table = timetable(system, *asked)
        exact = sorted([when, 2 * when, *(np.pi / 7 * np.arange(1, 7))])
        assert np.abs(table.times - exact).max() <= 2 * np.spacing(3.0)
        before = np.nextafter(table.times, 0.0) - np.spacing(3.0)
        assert (table.values[1:] != table.values[:-1]).any(axis=1).all()
        assert (before < exact).all()
    assert timetable(system, *asked) is table
