"""Runs of a few steps in one call of the core are those of the loops, and looked at as those."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.errors import ConvergenceError
from varint.integration import few_steps, fixed_steps
from varint.results import dense_output

q1, v1 = vi.coordinates("theta")
q2, v2 = vi.coordinates("x", "y")
t, u1 = vi.time(), ca.SX.sym("u")
PENDULUM = vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1))
POLAR = vi.System(q2, v2, (v2[0] ** 2 + q2[0] ** 2 * v2[1] ** 2) / 2 - (q2[0] - 2) ** 2)
CHARGE = vi.System(
    q2, v2, ca.sumsqr(v2) / 2 + (q2[0] * v2[1] - q2[1] * v2[0]) / 2 - 1 / ca.norm_2(q2)
)
SLOWED = vi.System(q1, v1, v1**2 / 2 - q1**4 / 4, force=-0.3 * v1 * ca.fabs(v1))
GROWING = vi.System(
    q2, v2, (1 + 0.1 * t) * ca.sumsqr(v2) / 2 - ca.sumsqr(q2) / 2 - 0.3 * q2[0] ** 2 * q2[1], t=t
)
FAST = vi.System(q1, v1, -25 * ca.sqrt(1 - v1**2 / 25) - q1**2 / 2)
FAST_SLOWED = vi.System(q1, v1, -25 * ca.sqrt(1 - v1**2 / 25) - q1**2 / 2, force=-0.1 * v1)
LINEAR = vi.System(q1, v1, v1**2 / 2 - q1**2 / 2, force=ca.cos(t) - 0.1 * v1, t=t)
PUSHED = vi.System(q1, v1, v1**2 / 2 + ca.cos(q1), force=u1 - 0.1 * v1, control=u1)
SCENES = {
    "pendulum": (PENDULUM, [2.0], [0.3]),
    "polar": (POLAR, [1.5, 0.2], [0.1, 1.0]),
    "charge": (CHARGE, [1.0, 0.1], [0.2, -0.4]),
    "slowed": (SLOWED, [2.0], [0.3]),
    "growing": (GROWING, [0.5, 0.2], [0.1, 0.6]),
    "fast": (FAST, [1.0], [2.0]),
    "fast, slowed": (FAST_SLOWED, [1.0], [2.0]),
    "linear": (LINEAR, [1.0], [2.0]),
    "pushed": (PUSHED, [1.0], [0.2]),
}
# beside these rules Lobatto's, whose speeds may be false, and one that fixed points do not solve
RULES = None, vi.gauss(1), vi.gauss(4), vi.gauss(8), vi.lobatto(3)


def asked(scene, steps, h=0.03, **more):
    system, q0, v0 = SCENES[scene]
    u = dict(u=np.cos(np.arange(steps))[:, None]) if system.structure.controls else {}
    return system, dict(q0=q0, v0=v0, h=h, steps=steps, t0=0.7, **u) | more


def in_general(monkeypatch, system, rule, call):
    """The motion by the way of all other runs, and what it warns of."""
    with monkeypatch.context() as patch:
        patch.setattr(few_steps, "few_steps_call", lambda *_: None)
        return told(system, rule, call)


def told(system, rule, call):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = vi.simulate(system, rule, **call)
    return motion, [str(x.message) for x in said]


def assert_alike(few, other):
    for name in "tqpku":
        assert np.array_equal(getattr(few, name), getattr(other, name))
    for name in ("iterations", "residual", "steps"):
        assert few.stats[name] == other.stats[name]
    # the compiler may have ended in between
    loops = [x.stats["backend"].split(": ")[-1] for x in (few, other)]
    assert loops[0] == loops[1]
    assert list(few.stats) == list(other.stats)


@pytest.mark.parametrize("steps, every", [(1, 1), (9, 1), (250, 1), (250, 25), (1100, 550)])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_a_few_steps_are_those_of_the_loop(monkeypatch, scene, rule, steps, every):
    system, call = asked(scene, steps, save_every=every)
    few, said = told(system, rule, call)
    other, said_there = in_general(monkeypatch, system, rule, call)
    assert_alike(few, other)
    assert said == said_there


@pytest.mark.parametrize("scene", ["pendulum", "growing", "fast"])
def test_a_few_steps_from_momenta_are_those_of_the_loop(monkeypatch, scene):
    system, call = asked(scene, 20, v0=None, p0=[0.3, -0.2][: SCENES[scene][0].structure.n])
    few, _ = told(system, vi.gauss(4), call)
    assert_alike(few, in_general(monkeypatch, system, vi.gauss(4), call)[0])
    assert few.p[0].tolist() == call["p0"]


@pytest.mark.parametrize("h", [0.1, -0.1])
@pytest.mark.parametrize("scene", ["pendulum", "linear", "pushed"])
def test_times_that_are_asked_for_are_met_alike(monkeypatch, scene, h):
    times = 0.7 + h * np.array([0.0, 0.4, 1.0, 1.0, 3.7, 8.2, 11.0])
    system, call = asked(scene, 12, h=h, at=times)
    few, _ = told(system, vi.gauss(4), call)
    assert_alike(few, in_general(monkeypatch, system, vi.gauss(4), call)[0])
    assert few.t.tobytes() == times.tobytes()


@pytest.mark.parametrize("side", ["before", "after"])
@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("scene", SCENES)
def test_times_within_a_step_are_met_as_those_steps_away(monkeypatch, scene, every, side):
    for h in (0.05, -0.05):
        system, call = asked(scene, 12, h, save_every=every)
        motion = vi.simulate(system, vi.gauss(2), **call)
        parts = np.array([0.0, 1e-16, 0.2, 3.0, 3.4, 6.0 - 1e-15, 6.999, 9.0, 11.6, 12.0])
        for some in (parts, parts[[0, 3, 7]], parts[[2, 4, 6]]):
            times = call["t0"] + h * some
            found = motion.at(times, side)
            with monkeypatch.context() as patch:
                patch.setattr(dense_output, "_within_a_step", lambda *_: False)
                other = motion.at(times, side)
            for name in "tqpk":
                assert np.array_equal(getattr(found, name), getattr(other, name))


@pytest.mark.parametrize("u", [0.4, [0.4], np.full((30, 4, 1), 0.2)])
def test_controls_of_any_shape_are_those_of_the_loop(monkeypatch, u):
    system, call = asked("pushed", 30, u=u)
    few, _ = told(system, vi.gauss(4), call)
    assert_alike(few, in_general(monkeypatch, system, vi.gauss(4), call)[0])


@pytest.mark.parametrize("more", [{}, dict(save_every=5), dict(v0=None, p0=0.1)])
@pytest.mark.parametrize("scene", ["pendulum", "slowed", "fast", "linear", "pushed"])
def test_the_core_takes_runs_of_a_few_steps(monkeypatch, scene, more):
    def none(*_):
        raise AssertionError("not by the core")

    monkeypatch.setattr(fixed_steps, "short_run", none)
    monkeypatch.setattr(few_steps, "energy_alarm", none)  # nothing is wrong
    system, call = asked(scene, 50, **more)
    assert len(vi.simulate(system, vi.gauss(4), **call)) == 50 // more.get("save_every", 1) + 1


@pytest.mark.parametrize("every", [1, 5])
def test_steps_too_large_are_told_of_alike(monkeypatch, every):
    """Explicit steps beyond their limit, implicit ones that leap: in most scenes some of them are
    told of.
    """
    found = set()
    for scene in SCENES:
        for rule in (vi.lobatto(2), vi.gauss(1), vi.gauss(4), vi.composition("verlet")):
            for h in (0.3, 1.1, 2.3, -6.0):
                system, call = asked(scene, 40, h=h, save_every=every)
                try:
                    few, said = told(system, rule, call)
                except (ConvergenceError, vi.InputError):
                    continue
                other, said_there = in_general(monkeypatch, system, rule, call)
                assert_alike(few, other)
                assert said == said_there
                found |= {scene} if said else set()
    assert len(found) >= (5 if every == 1 else 3)  # an explosion alone tells of nodes far apart


@pytest.mark.parametrize("wanted", [("until",), ("events",), ("until", "events")])
@pytest.mark.parametrize("scene", SCENES)
def test_short_runs_that_are_watched_are_those_made_in_blocks(monkeypatch, scene, wanted):
    system, call = asked(scene, 90, save_every=2)
    x, v = system.q[0], system.v[0]
    watched = {"until": (v - 0.11, -1), "events": {"place": x - 0.8, "speed": v - 0.25}}
    call |= {name: watched[name] for name in wanted}
    short, said = told(system, vi.gauss(4), call)
    monkeypatch.setattr(fixed_steps, "short_run", lambda *_: None)
    other, said_there = told(system, vi.gauss(4), call)
    assert_alike(short, other)
    assert np.array_equal(short.v, other.v) and short.events == other.events
    assert said == said_there


@pytest.mark.parametrize("wanted", [("until",), ("events",), ("until", "events")])
@pytest.mark.parametrize("h", [0.03, -0.03, 0.4])
@pytest.mark.parametrize("scene", SCENES)
def test_a_few_steps_that_are_watched_are_those_of_the_loop(monkeypatch, scene, h, wanted):
    system, call = asked(scene, 90, h)
    x, v = system.q[0], system.v[0]
    watched = {"until": v - 0.11, "events": {"place": x - 0.8, "speed": (v - 0.25, 1)}}
    call |= {name: watched[name] for name in wanted}
    try:
        few, said = told(system, vi.gauss(4), call)
    except ConvergenceError:
        pytest.skip("steps too large")
    other, said_there = in_general(monkeypatch, system, vi.gauss(4), call)
    assert_alike(few, other)
    assert few.events == other.events
    assert said == said_there


def test_the_core_takes_runs_that_are_watched(monkeypatch):
    def none(*_):
        raise AssertionError("not by the core")

    monkeypatch.setattr(fixed_steps, "simulate_steps", none)
    system, call = asked("pendulum", 90)
    motion = vi.simulate(system, **call, until=(system.v[0], 1), events={"low": system.q[0]})
    assert abs(motion.v[-1, 0]) < 1e-12 and len(motion.events) == 1


def test_expressions_written_anew_are_those_that_were_watched_before():
    """And others, however alike, are not."""
    system, call = asked("pendulum", 60)
    for level in (0.5, 0.5, 0.25, 0.5, -0.25):
        motion = vi.simulate(system, **call, until=2 * system.q[0] - level)
        assert abs(2 * motion.q[-1, 0] - level) < 1e-12
    with pytest.raises(vi.InputError, match="phi"):
        vi.simulate(system, **call, until=2 * ca.SX.sym("phi") - 0.5)


def test_speeds_that_are_false_are_told_of_alike(monkeypatch):
    held = vi.System(q1, v1, v1**2 / 2 + q1, force=-3 * ca.tanh(v1 / 1e-4))
    call = dict(q0=0.0, v0=2.0, h=0.1, steps=60)
    _, said = told(held, vi.lobatto(3), call)
    assert len(said) == 1 and "the speed of theta" in said[0]
    assert in_general(monkeypatch, held, vi.lobatto(3), call)[1] == said


def test_an_energy_that_is_no_number_between_others_is_told():
    wall = vi.System(q1, v1, v1**2 / 2 - q1**2 / 2 + 1e-9 * ca.log(1 - q1))
    with pytest.warns(UserWarning, match="the energy is not defined near q = .1.02"):
        motion = vi.simulate(wall, vi.gauss(4), q0=0.9, v0=0.5, h=0.25, steps=5)
    assert np.isnan(motion.energy).sum() == 1


def test_a_step_that_is_too_large_for_the_energy_is_told():
    with pytest.warns(UserWarning, match="the energy went from"):
        vi.simulate(PENDULUM, q0=3.1, v0=20.0, h=2.0, steps=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vi.simulate(PENDULUM, q0=3.1, v0=2.0, h=0.01, steps=5)


def test_an_energy_that_is_no_number_is_told():
    wall = vi.System(q1, v1, v1**2 / 2 - ca.log(1 - q1))
    with pytest.warns(UserWarning, match="the energy is not defined"):
        vi.simulate(wall, vi.gauss(4), q0=0.9, v0=30.0, h=0.5, steps=3)


def test_a_step_that_is_not_possible_ends_the_run():
    edge = vi.System(q1, v1, v1**2 / 2 + ca.sqrt(1 - q1))
    with pytest.raises(ConvergenceError):
        vi.simulate(edge, vi.gauss(4), q0=0.9, v0=3.0, h=0.5, steps=3)


SPRING_K = ca.SX.sym("k")
SPRING = vi.System(q1, v1, v1**2 / 2 - SPRING_K * q1**2 / 2, params={SPRING_K: 2.0})
ASKED = {"steps": dict(h=0.01, steps=3), "tol": dict(duration=1.0, tol=1e-6)}


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize(
    "bad", [np.nan, -np.inf, "one", [1.0, 2.0], [[1.0]], [None], [], True, 1j, 10**400, [10**400]]
)
def test_what_is_no_start_is_refused_between_those_that_are(asked, bad):
    how = ASKED[asked]
    good = vi.simulate(PENDULUM, q0=[1.0], v0=[0.5], **how)
    for start in (dict(q0=bad, v0=[0.5]), dict(q0=[1.0], v0=bad)):
        if bad is True:  # a number for Python, and for NumPy
            assert len(vi.simulate(PENDULUM, **start, **how)) == len(good)
            continue
        with pytest.raises(vi.InputError, match="q0" if start["q0"] is bad else "v0"):
            vi.simulate(PENDULUM, **start, **how)
    again = vi.simulate(PENDULUM, q0=[1.0], v0=[0.5], **how)
    assert again.q.tobytes() == good.q.tobytes() and again.p.tobytes() == good.p.tobytes()


@pytest.mark.parametrize("asked", ASKED)
def test_numbers_of_any_kind_are_the_same_start(asked):
    kinds = [2.0], (2,), 2, np.array([2.0]), np.array([2], dtype=np.int32), np.float32(2)
    found = [vi.simulate(PENDULUM, q0=x, v0=x, t0=1, **ASKED[asked]) for x in kinds]
    assert len({(x.t.tobytes(), x.q.tobytes(), x.p.tobytes()) for x in found}) == 1


@pytest.mark.parametrize("asked", ASKED)
def test_parameters_of_a_call_are_not_those_of_the_next(asked):
    def run(k):
        params = None if k is None else {"k": k}
        return vi.simulate(SPRING, q0=1.0, v0=0.0, params=params, **ASKED[asked])

    first, stiff = run(None), run(5.0)
    with pytest.raises(vi.InputError):
        run(np.nan)
    assert run(None).q.tobytes() == first.q.tobytes() == run(2.0).q.tobytes()
    assert run(5.0).q.tobytes() == stiff.q.tobytes() != first.q.tobytes()


@pytest.mark.parametrize(
    "name, value", [("steps", True), ("steps", 3.0), ("steps", 0), ("h", np.nan), ("h", 0.0)]
)
def test_a_grid_that_is_none_is_refused_after_one_that_is(name, value):
    grid = dict(h=0.1, steps=3)
    vi.simulate(PENDULUM, q0=1.0, v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=f"{name} must"):
        vi.simulate(PENDULUM, q0=1.0, v0=0.0, **(grid | {name: value}))
