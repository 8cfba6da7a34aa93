"""Zeros along motions with contacts: the search in C finds what the search by NumPy finds."""

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G

import varint as vi
from varint.integration.events import first_crossing, native_crossings
from varint.integration.events.crossings import find_crossings
from varint.integration.events.substeps import interpreted_substeps


def balls(random):
    """Two above each other, in a box."""
    q, v = vi.coordinates("a", "b")
    gaps = ca.vertcat(q[0], q[1] - q[0], 3 - q[1])
    bounce = random.uniform(0.6, 1, 3)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - G * ca.sum1(q), contact=gaps, restitution=bounce)
    return system, random.uniform([0.2, 1.2], [1, 2]), random.normal(size=2)


def billiard(random):
    """A ball in a rectangle, in a field that pulls to its middle."""
    q, v = vi.coordinates("x", "y")
    gaps = ca.vertcat(1 - q[0], q[0] + 1, 1 - q[1], q[1] + 1)
    lagrangian = ca.sumsqr(v) / 2 - random.uniform() * ca.sumsqr(q) ** 2
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=1.0)
    return system, random.uniform(-0.8, 0.8, 2), 2 * random.normal(size=2)


def ladder(random):
    """A rod that slides down between a wall and a floor and leaves them."""
    q, v = vi.coordinates("x", "y", "angle")
    half = ca.vertcat(ca.cos(q[2]), ca.sin(q[2]))
    gaps = ca.vertcat(q[:2] - half, q[:2] + half * ca.DM([1, -1]))[[0, 3]]
    lagrangian = ca.sumsqr(v[:2]) / 2 + v[2] ** 2 / 6 - G * q[1]
    angle = random.uniform(0.9, 1.3)
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=random.uniform(0, 0.5))
    return system, [np.cos(angle), np.sin(angle), angle], [0.0, 0.0, 0.0]


def chain_with_stops(random):
    """A double pendulum whose joints have stops."""
    q, v = vi.coordinates("a", "b")
    speeds = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    lagrangian = speeds + G * ca.dot(ca.DM([2, 1]), ca.cos(q))
    gaps = ca.vertcat(0.4 - (q[1] - q[0]), 0.4 + (q[1] - q[0]), q[0] + 0.7)
    bounce = random.uniform(0.3, 1, 3)
    system = vi.System(q, v, lagrangian, contact=gaps, restitution=bounce)
    return system, [random.uniform(0.5, 1.5)] * 2, random.normal(size=2)


def rod_at_a_wall(random):
    """A mass on a rod that bounces off a wall, watched as a constrained one."""
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    gap = q[0] + random.uniform(0.2, 0.5)
    system = vi.System(q, v, lagrangian, constraint=ca.sumsqr(q) - 1, contact=gap, restitution=0.9)
    return system, [0.6, -0.8], [0.0, 0.0]


def shaken_ball(random):
    """A ball that comes to rest on a table and is thrown up again."""
    q, v = vi.coordinates("y")
    t = ca.SX.sym("t")
    gap = q - 0.1 * ca.sin(7 * t + random.uniform(0, 6))
    system = vi.System(q, v, v**2 / 2 - G * q, contact=gap, restitution=0.3, t=t)
    return system, [random.uniform(0.2, 0.8)], [0.0]


SCENES = [balls, billiard, ladder, chain_with_stops, rod_at_a_wall, shaken_ball]


def watched(system, motion, random):
    """Levels of coordinates and velocities, some of them several times in a step, a gap that ends
    at zero, a clock, and an expression with a pole.
    """
    q, v = system.q, system.v
    i, j = random.integers(len(motion.q[0]), size=2)
    level, speed = (random.uniform(x.min(), x.max()) for x in (motion.q[:, i], motion.v[:, j]))
    holds = any(0 in active_set.holding for active_set in motion.active_sets)
    return {
        "coordinate": (q[int(i)] - level, 0),
        "velocity": (v[int(j)] - speed, 0),
        "rising velocity": (v[int(j)] - speed, 1),
        "both": (ca.sin(5 * q[int(i)]) * (v[int(j)] - speed) - 0.01, -1),
        "gap": (system.contact[0] - 0.01, 0),
        **({} if holds else {"closed": (system.contact[0], -1)}),  # what holds is round-off
        "several in a step": (ca.sin(400 * system.t + 1), 0),
        "pole": (1 / (q[int(i)] - level), 0),
    }


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("seed", range(3))
def test_both_searches_find_the_same_zeros(scene, seed, monkeypatch):
    """Nodes, order and jumps exactly, times and states on both sides to round-off over the slope;
    the other search is not asked.
    """
    random, pairs = np.random.default_rng(seed), []
    system, q0, v0 = scene(random)
    run = dict(q0=q0, v0=v0, h=0.01, steps=150, backend="native")
    in_c = native_crossings.crossings_by
    monkeypatch.setattr(native_crossings, "find_crossings", None)

    def compared(kernel, search, motion, impacts, loop_in=None):
        other = find_crossings(search, motion, impacts, interpreted_substeps)
        pairs.append((search.name, in_c(kernel, search, motion, impacts, loop_in), other))
        return pairs[-1][1]

    monkeypatch.setattr(native_crossings, "crossings_by", compared)
    motion = vi.simulate(system, **run)
    some = watched(system, motion, random)
    events = vi.simulate(system, **run, events=some).events
    assert len(pairs) == len(some)
    for name, found, other in pairs:
        assert np.array_equal(found.jump, other.jump), name
        for one, two in ((found.before, other.before), (found.after, other.after)):
            assert np.array_equal(one.node, two.node), name
            for x, y in zip(one[1:5], two[1:5], strict=True):
                assert np.allclose(x, y, rtol=0, atol=1e-11 * max(abs(y).max(initial=1.0), 1.0))
    assert sum(event.kind in some for event in events) > 20
    assert sum(len(found.jump) for _, found, _ in pairs) == sum(e.kind in some for e in events)


def test_the_scenes_have_what_they_are_for():
    """Impacts that change signs, and other contacts that hold meanwhile."""
    kinds, active = set(), 0
    for scene in SCENES:
        system, q0, v0 = scene(np.random.default_rng(0))
        motion = vi.simulate(system, q0=q0, v0=v0, h=0.01, steps=150)
        kinds |= {event.kind for event in motion.events}
        active = max(active, len(motion.active_sets))
    assert kinds == {"impact", "stop", "detachment"} and active >= 2


def test_an_impact_ends_a_run_where_the_velocity_changes_its_sign(monkeypatch):
    """`until` of a ball's velocity upwards: the impact, with both states, and no later node."""
    monkeypatch.setattr(native_crossings, "find_crossings", None)
    q, v = vi.coordinates("y")
    system = vi.System(q, v, v**2 / 2 - 2 * q, contact=q, restitution=0.5)
    run = dict(q0=1.0, v0=0.0, h=0.03, steps=100, backend="native")
    motion = vi.simulate(system, **run, until=(v, 1))
    assert motion.t[-1] == pytest.approx(1.0, abs=1e-12)
    assert motion.v[-1] == pytest.approx([1.0], abs=1e-12)
    (hit,) = (
        e for e in vi.simulate(system, **run, events={"v": (v, 1)}).events[:2] if e.kind == "v"
    )
    assert hit.before.v == pytest.approx([-2.0]) and hit.after.v == pytest.approx([1.0])


def test_no_zero_is_looked_for_across_an_impact():
    """A velocity that an impact turns passes all speeds in between at once: one change of sign of
    each, at the impact, and none within a step beside it.
    """
    q, v = vi.coordinates("y")
    system = vi.System(q, v, v**2 / 2, contact=q, restitution=1.0)
    run = dict(q0=1.0, v0=-1.0, h=0.3, steps=10, backend="native")
    levels = {str(x): v - x for x in np.linspace(-0.9, 0.9, 7)}
    events = [e for e in vi.simulate(system, **run, events=levels).events if e.kind in levels]
    assert len(events) == 7
    assert np.allclose([e.time for e in events], 1.0, rtol=0, atol=1e-12)


def test_what_holds_without_a_loop_goes_to_the_other_search(monkeypatch):
    """All zeros are found where one of the active sets has none."""
    asked, other = [], native_crossings.find_crossings
    monkeypatch.setattr(native_crossings, "find_crossings", lambda *x: asked.append(1) or other(*x))
    system, q0, v0 = shaken_ball(np.random.default_rng(0))
    run = dict(q0=q0, v0=v0, h=0.01, steps=150, backend="native")
    some = {"level": system.q - 0.05}
    found = vi.simulate(system, **run, events=some).events
    assert not asked
    in_c = native_crossings.crossings_by
    lacking = lambda k, s, m, i, loop: in_c(k, s, m, i, lambda x: None if x.holding else loop(x))  # noqa: E731
    monkeypatch.setattr(native_crossings, "crossings_by", lacking)
    again = vi.simulate(system, **run, events=some).events
    assert asked and len(again) == len(found)
    assert np.allclose([e.time for e in again], [e.time for e in found], rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore:the constraint rows")
def test_redundant_rows_are_searched_in_c(monkeypatch):
    """A constraint that is given twice: the loop is that of the rows that are solved for."""
    monkeypatch.setattr(native_crossings, "find_crossings", None)
    q, v = vi.coordinates("x", "y")
    row = ca.sumsqr(q) - 1
    once, twice = (
        vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], constraint=ca.vertcat(*rows))
        for rows in ([row], [row, 2 * row])
    )
    run = dict(q0=[0.8, 0.6], v0=[0.0, 0.0], h=0.01, steps=300, backend="native")
    one, two = (vi.simulate(s, **run, events={"x": q[0]}) for s in (once, twice))
    assert two.active_set is not None and len(two.events) == len(one.events) > 1
    assert np.allclose([e.time for e in one.events], [e.time for e in two.events], atol=1e-12)


def test_the_first_of_many_zeros_ends_a_run_with_contacts(monkeypatch):
    """`until` and the first of `events` are the same instant."""
    calls, real = [], first_crossing.crossings_by
    monkeypatch.setattr(first_crossing, "crossings_by", lambda *x: calls.append(1) or real(*x))
    monkeypatch.setattr(native_crossings, "find_crossings", None)
    for scene in SCENES:
        system, q0, v0 = scene(np.random.default_rng(1))
        run = dict(q0=q0, v0=v0, h=0.01, steps=150, backend="native")
        what = ca.sin(11 * system.q[0]) + system.v[0] / 3
        first = next(
            e for e in vi.simulate(system, **run, events={"w": what}).events if e.kind == "w"
        )
        end = vi.simulate(system, **run, until=what)
        assert end.t[-1] == pytest.approx(first.time, abs=1e-12)
        assert np.allclose(end.v[-1], first.v_after, rtol=0, atol=1e-10)
    assert calls


@pytest.mark.parametrize("duration", [2.5, 20.0])
def test_a_ball_that_comes_to_rest_is_watched_for_an_end_all_the_time(duration):
    """Blows within blocks of nodes, of which the last node begins the search in the next one."""
    q, v = vi.coordinates("x", "y")
    thrown = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], contact=q[1], restitution=0.5)
    start = dict(q0=[0.0, 1.0], v0=[1.0, 0.0], duration=duration)
    never = vi.simulate(thrown, **start, until=q[0] + 1)
    assert never.t[-1] == pytest.approx(duration) and never.q[-1, 1] == pytest.approx(0, abs=1e-9)
    assert vi.simulate(thrown, **start, until=q[0] - 2.2).t[-1] == pytest.approx(2.2, abs=1e-9)


RUNS = [
    {"duration": 10.0},
    {"duration": 1.0},
    {"h": 0.01, "steps": 100},
    {"h": 0.037, "steps": 30, "backend": "interpreted"},
]


@pytest.mark.parametrize("run", RUNS)
@pytest.mark.parametrize("floor", [0.0, 1000.0])
@pytest.mark.parametrize("bounce", [0.0, 0.3, 0.7, 1.0])
def test_a_run_until_a_gap_closes_ends_at_the_first_impact(run, floor, bounce):
    """What the gap is there, 1e-15 or less than nothing, is round-off: runs went on to the second
    impact or the third, and did not come together.
    """
    q, v = vi.coordinates("x", "y")
    lagrangian, gap = ca.sumsqr(v) / 2 - G * q[1], q[1] - floor
    ball = vi.System(q, v, lagrangian, contact=gap, restitution=bounce)
    for watched in (gap, (gap, -1), -3 * gap, (-3 * gap, 1)):
        motion = vi.simulate(ball, q0=[0, floor + 1], v0=[1, 0], until=watched, **run)
        hit = motion.events[-1]
        assert len(motion.events) == 1 and motion.t[-1] == hit.time
        assert hit.time == pytest.approx(np.sqrt(2 / G), abs=1e-12)
        assert motion.q[-1] == pytest.approx([hit.time, floor], abs=1e-9)
        assert np.allclose(motion.v[-1], hit.v_after)


@pytest.mark.parametrize("backend", ["native", "interpreted"])
@pytest.mark.parametrize("drag", [0.0, 0.1])
def test_every_impact_is_one_zero_of_its_gap(backend, drag):
    q, v = vi.coordinates("y")
    force = -drag * v if drag else None
    ball = vi.System(q, v, v**2 / 2 - G * q, contact=q, restitution=0.8, force=force)
    run = dict(q0=1.0, v0=0.0, h=0.01, steps=250, backend=backend)
    events = vi.simulate(ball, **run, events={"closes": (q, -1)}).events
    times = {kind: [e.time for e in events if e.kind == kind] for kind in ("impact", "closes")}
    assert len(times["impact"]) > 3
    assert times["closes"] == pytest.approx(times["impact"], abs=1e-12)
