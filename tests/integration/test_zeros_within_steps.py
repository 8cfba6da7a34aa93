"""Zeros of watched expressions: several in a step, of velocities, at impacts, and poles that are
none; the states that events hold.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi

Q, V = vi.coordinates("x")
OSCILLATOR = vi.System(Q, V, (V**2 - Q**2) / 2)
Y, W = vi.coordinates("y")
G = 9.81


def ball(restitution):
    return vi.System(Y, W, W**2 / 2 - G * Y, contact=Y, restitution=restitution)


def found(expression, h=0.4, steps=16, **more):
    """Times of the zeros along x = cos t, v = −sin t."""
    motion = vi.simulate(
        OSCILLATOR,
        vi.gauss(8),
        q0=1.0,
        v0=0.0,
        h=h,
        steps=steps,
        events={"zero": expression},
        **more,
    )
    return np.array([event.time for event in motion.events])


def crossings(f, end):
    """Zeros of f on (0, end] by a fine scan, poles left out."""
    t = np.linspace(0, end, 400_001)[1:]
    with np.errstate(divide="ignore"):
        x = f(t)
    change = np.flatnonzero((x[:-1] * x[1:] < 0) & (np.abs(x[:-1]) + np.abs(x[1:]) < 1))
    a, b = x[change], x[change + 1]
    return t[change] + (t[1] - t[0]) * a / (a - b)


@pytest.mark.parametrize(
    ("expression", "exact"),
    [
        (ca.sin(40 * Q), lambda t: np.sin(40 * np.cos(t))),
        (V + 0.999, lambda t: -np.sin(t) + 0.999),
        (Q * V - 0.4999, lambda t: -np.cos(t) * np.sin(t) - 0.4999),
        ((V - Q) ** 2 - 1e-4, lambda t: (np.sin(t) + np.cos(t)) ** 2 - 1e-4),
        (ca.fabs(V) - 0.01, lambda t: np.abs(np.sin(t)) - 0.01),
        (ca.tan(2 * Q), lambda t: np.tan(2 * np.cos(t))),
    ],
    ids=["sin", "speed", "product", "square", "kink", "pole"],
)
@pytest.mark.parametrize("h", [0.4, 0.1])
def test_all_zeros_of_positions_and_velocities_within_a_step_are_found(expression, exact, h):
    wanted = crossings(exact, 6.4)
    times = found(expression, h, round(6.4 / h))
    assert len(times) == len(wanted) > 0
    np.testing.assert_allclose(times, wanted, rtol=0, atol=2e-7)


@pytest.mark.parametrize("pole", [1 / Q, 1 / V, 1 / (Q - 0.3), 1 / (Q * V - 0.2), ca.tan(20 * Q)])
def test_a_pole_is_no_zero(pole):
    """1/x changes its sign through infinity; of tan only the zeros count."""
    times = found(pole)
    value = ca.Function("value", [Q, V], [pole])
    assert all(abs(float(value(np.cos(t), -np.sin(t)))) < 1e-6 for t in times)
    assert len(times) == (26 if ca.is_equal(pole, ca.tan(20 * Q), 9) else 0)


def test_a_jump_through_zero_is_one():
    np.testing.assert_allclose(found(ca.sign(Q) + 0.1), np.pi * np.array([0.5, 1.5]), atol=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_run_until_the_velocity_rises_ends_with_the_impact_that_turns_it(restitution):
    motion = vi.simulate(
        ball(restitution), q0=1.0, v0=0.0, h=0.05, steps=40, until=(W, 1), events={"turn": (W, 1)}
    )
    speed = np.sqrt(2 * G)
    assert abs(motion.t[-1] - np.sqrt(2 / G)) < 1e-14
    assert abs(motion.v[-1, 0] - restitution * speed) < 1e-13
    kinds = [event.kind for event in motion.events]
    assert kinds == ["impact" if restitution else "stop", "turn"]
    assert [event.time for event in motion.events] == [motion.t[-1]] * 2
    again = motion[: len(motion) - 1]
    assert len(again) == len(motion) - 1 and (np.diff(motion.t) > 0).all()


def test_events_hold_the_states_on_both_sides_and_dense_output_gives_either():
    motion = vi.simulate(ball(0.5), q0=1.0, v0=0.0, h=0.03, duration=1.2, events={"low": Y - 0.1})
    for event in motion.events:
        if event.kind == "stop":
            continue
        for side, state in (("before", event.before), ("after", event.after)):
            there = motion.at(event.time, side=side)
            np.testing.assert_allclose(there.q, state.q, rtol=0, atol=1e-13)
            np.testing.assert_allclose(there.v, state.v, rtol=0, atol=1e-12)
            np.testing.assert_allclose(there.p, state.p, rtol=0, atol=1e-12)
        ratio = -0.5 if event.kind == "impact" else 1.0
        np.testing.assert_allclose(event.after.v, ratio * event.before.v, rtol=1e-12)
    hit = next(event for event in motion.events if event.kind == "impact")
    assert abs(hit.before.v[0] + np.sqrt(2 * G)) < 1e-13 and abs(hit.before.q[0]) < 1e-14
    times = np.array([event.time for event in motion.events[:3]])
    both = motion.at(times, side="before"), motion.at(times)
    np.testing.assert_allclose(both[0].q, both[1].q, rtol=0, atol=1e-13)
    with pytest.raises(vi.InputError, match="side must be 'after' or 'before', got 'left'"):
        motion.at(0.5, side="left")


def test_events_with_states_come_back_from_files_and_checkpoints_as_they_were(tmp_path):
    run = dict(q0=1.0, v0=0.0, h=0.03, duration=1.2, events={"low": Y - 0.1})
    motion = vi.simulate(ball(0.5), **run)
    motion.save(tmp_path / "ball.npz")
    assert vi.load(tmp_path / "ball.npz").events == motion.events
    for _ in range(2):
        kept = vi.simulate(ball(0.5), **run, checkpoint=tmp_path / "run.npz")
        assert kept.events == motion.events
    assert motion.events != vi.simulate(ball(0.6), **run).events


def test_states_of_events_in_variable_steps_are_physical_ones():
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    motion = vi.simulate(
        kepler,
        q0=[1.0, 0.0],
        v0=[0.0, 1.2],
        h=0.05,
        steps=300,
        time_scale=ca.norm_2(q),
        events={"node": (q[1], -1)},
    )
    assert motion.events
    for event in motion.events:
        there = motion.at(event.time)
        assert len(event.q) == 2 and event.before.t == event.time
        np.testing.assert_allclose(event.after.q, there.q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(event.after.v, there.v, rtol=0, atol=1e-11)


def test_zeros_are_the_same_whether_few_or_many_nodes_are_searched_at_once():
    """Blocks of compiled and interpreted runs differ, and so do those of a run with an end."""
    watched = {"low": (Q - 0.95, -1), "fast": V + 0.99}
    start = dict(q0=1.0, v0=0.0, h=0.3, events=watched)
    long = vi.simulate(OSCILLATOR, vi.gauss(4), steps=12_345, backend="interpreted", **start)
    short = vi.simulate(OSCILLATOR, vi.gauss(4), steps=50, backend="interpreted", **start)
    stopped = vi.simulate(
        OSCILLATOR, vi.gauss(4), steps=50, backend="interpreted", until=Q + 2, **start
    )
    assert len(long.events) > 1500
    assert long.events[: len(short.events)] == short.events == stopped.events
    turns = 2 * np.pi * np.arange(3)
    first = [event.time for event in long.events if event.kind == "low"][:3]
    np.testing.assert_allclose(first, turns + np.arccos(0.95), rtol=0, atol=1e-3)


def test_controls_that_vary_within_a_step_are_watched_between_its_nodes():
    u = ca.SX.sym("u")
    rule, h, steps = vi.gauss(2), 0.5, 8
    pushed = vi.System(Q, V, V**2 / 2, force=u, control=u)
    t = h * (np.arange(steps)[:, None] + np.array(rule.nodes))
    motion = vi.simulate(
        pushed,
        rule,
        q0=0.0,
        v0=0.0,
        h=h,
        steps=steps,
        u=(1.3 - t)[:, :, None],
        events={"turn": u, "half": Q - 0.25},
    )
    exact = crossings(lambda t: 0.65 * t**2 - t**3 / 6 - 0.25, 4.0)
    times = {kind: [e.time for e in motion.events if e.kind == kind] for kind in ("turn", "half")}
    np.testing.assert_allclose(times["turn"], [1.3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(times["half"], exact, rtol=0, atol=1e-7)


def roller():
    """A bead on a circle."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], constraint=ca.sumsqr(q) - 1)


def swing():
    """A pendulum whose pivot shakes."""
    t, (q, v) = vi.time(), vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + (G + ca.cos(3 * t)) * ca.cos(q), force=-0.1 * v, t=t)


@pytest.mark.parametrize(
    ("scene", "rule", "start", "watched"),
    [
        (swing, vi.gauss(4), (1.0, 0.0), lambda s: {"low": (s.q, 1), "late": ca.sin(s.t + s.q)}),
        (lambda: OSCILLATOR, vi.gauss(2), (1.0, 0.0), lambda s: {"low": s.q * s.v - 0.3}),
        (lambda: OSCILLATOR, vi.composition("suzuki4"), (1.0, 0.0), lambda s: {"slow": s.v}),
        (roller, vi.lobatto(3), ([1, 0], [0, 0]), lambda s: {"low": s.q[0], "deep": s.q[1] + 0.5}),
    ],
    ids=["time", "map", "explicit", "constraint"],
)
def test_both_gears_find_the_same_zeros(scene, rule, start, watched):
    system = scene()
    run = dict(q0=start[0], v0=start[1], h=0.03, steps=400, events=watched(system))
    ours, other = (
        vi.simulate(system, rule, **run, backend=backend).events
        for backend in ("compiled", "interpreted")
    )
    assert [e.kind for e in ours] == [e.kind for e in other] and len(ours) >= 3
    for a, b in zip(ours, other, strict=True):
        assert abs(a.time - b.time) < 1e-11
        np.testing.assert_allclose(a.q, b.q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(a.p_after, b.p_after, rtol=0, atol=1e-11)


WATCHED = [
    ca.sin(40 * Q),
    (V - Q) ** 2 - 1e-4,
    ca.fabs(V) - 0.01,
    Q * V - 0.4999,
    ca.tan(2 * Q),
    ca.sign(Q) + 0.1,
    Q - 0.999999,
    1 / Q,
]


@pytest.mark.parametrize("expression", WATCHED, ids=str)
def test_boxes_around_many_steps_lose_no_zero(expression, monkeypatch):
    from varint.integration.events import crossings

    all_at_once = found(expression, h=0.1, steps=2000, backend="interpreted")

    def never(search, motion, left, right):
        return np.zeros(len(left.t)), np.zeros(len(left.t), dtype=bool)

    monkeypatch.setattr(crossings, "look_at_groups", never)
    one_by_one = found(expression, h=0.1, steps=2000, backend="interpreted")
    np.testing.assert_array_equal(all_at_once, one_by_one)


def test_three_substeps_locate_a_zero_and_functions_are_built_once():
    from varint.integration.events import crossings as c
    from varint.integration.events.substeps import interpreted_substeps

    motion = vi.simulate(OSCILLATOR, vi.gauss(8), q0=1.0, v0=0.0, h=0.2, steps=3000)
    search, taken = c.crossing_search(OSCILLATOR, c.Watch("zero", Q - 0.3, 0)), []

    def counted(motion, node, t):
        taken.append(len(t))
        return interpreted_substeps(motion, node, t)

    zeros = c.find_crossings(search, motion, {}, counted).before
    turns = 2 * np.pi * np.arange(96)
    exact = np.sort(np.concatenate([turns + np.arccos(0.3), turns - np.arccos(0.3)]))
    exact = exact[(exact > 0) & (exact < 600)]
    np.testing.assert_allclose(zeros.t, exact, rtol=0, atol=3e-12)  # after 3,000 steps
    np.testing.assert_allclose(zeros.q[:, 0], 0.3, rtol=0, atol=1e-12)
    assert sum(taken) <= 3 * len(exact)
    again = c.crossing_search(OSCILLATOR, c.Watch("other", Q - 0.3, 1))
    assert again.values is search.values and again.box is search.box
    assert c.crossing_search(OSCILLATOR, c.Watch("zero", Q - 0.31, 0)).values is not search.values


def test_zeros_in_steps_too_large_for_fixed_points_are_found_in_one_coordinate():
    """The sub-steps begin with the velocities of the step around them, of which there is one."""
    (q, v), t = vi.coordinates("x"), vi.time()
    pushed = -0.1 * v + 0.3 * ca.cos(1.2 * t)
    duffing = vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=pushed, t=t)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the energy leaps
        motion = vi.simulate(duffing, vi.midpoint(), q0=0.99, v0=0, h=5.5, steps=9, until=q - 0.8)
    assert abs(motion.q[-1, 0] - 0.8) < 1e-9
