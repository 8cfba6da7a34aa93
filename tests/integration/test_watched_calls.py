"""What is watched for along short runs is found in the call of the core that makes them, as by the
searches for all other runs.
"""

from __future__ import annotations

import sys
import warnings
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration import few_steps, run, times_at_once, until_call
from varint.integration import simulate as module
from varint.integration.error_scale import error_scales
from varint.results import dense_output
from varint.scene.expressions import as_written, is_written_so

q1, v1 = vi.coordinates("theta")
q2, v2 = vi.coordinates("x", "y")
t = vi.time()
circle = ca.sumsqr(q2) - 1
SCENES = {
    "pendulum": (vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1)), [1.0], [0.0]),
    "slowed": (vi.System(q1, v1, v1**2 / 2 - q1**4 / 4, force=-0.3 * v1), [2.0], [0.3]),
    "swayed": (vi.System(q1, v1, v1**2 / 2 + ca.cos(q1) + q1 * ca.sin(t), t=t), [1.0], [0.2]),
    "orbit": (vi.System(q2, v2, ca.sumsqr(v2) / 2 + 1 / ca.norm_2(q2)), [0.9, 0.0], [0.0, 1.1]),
    "spring": (vi.System(q2, v2, ca.sumsqr(v2) / 2 - ca.sumsqr(q2)), [0.5, 0.0], [0.1, 0.3]),
    "fast": (vi.System(q1, v1, -25 * ca.sqrt(1 - v1**2 / 25) - q1**2 / 2), [1.0], [2.0]),
    "on a circle": (
        vi.System(q2, v2, ca.sumsqr(v2) / 2 - 9.81 * q2[1], constraint=circle),
        [1.0, 0.0],
        [0.0, 0.5],
    ),
}
RULES = None, vi.gauss(4), vi.lobatto(4)


def expressions(system):
    """Zeros within steps, at a node, at the start, of speeds, none, many, double ones, a pole."""
    x, v = system.q[0], system.v[0]
    return {
        "within": x - 0.3,
        "speed": v + 0.2,
        "start": x - 1.0,
        "never": x - 50,
        "many": ca.sin(40 * x),
        "double": ca.sin(x) ** 2,
        "pole": 1 / (x - 0.4),
        "kink": ca.fabs(x) - 0.5,
    }


def steppable(scene, rule):
    try:
        vi.plan(SCENES[scene][0], rule)
    except vi.InputError:
        pytest.skip("no rule for this scene")
    return SCENES[scene]


def told(system, rule, call):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(system, rule, **call)
        except vi.VarintError as error:
            motion = str(error)
    return motion, [str(x.message) for x in said]


def assert_told_alike(monkeypatch, where, name, system, rule, call):
    """As by the way of all other calls; the motion."""
    short, said = told(system, rule, call)
    with monkeypatch.context() as patch:
        patch.setattr(where, name, lambda *_: None)
        long, said_there = told(system, rule, call)
    assert said == said_there
    if isinstance(long, str):
        assert short == long
        return None
    numbers, other = (
        {**x.stats, "seconds": 0, "backend": x.stats["backend"].split(": ")[1]}
        for x in (short, long)  # the compiler may have come to its end between them
    )
    proves_ends = "until" in call and "tol" in other
    for x in "tqpkuhv":
        here, there = getattr(short, x), getattr(long, x)
        assert np.array_equal(
            here[:-1] if x in "tqpv" else here, there[:-1] if x in "tqpv" else there
        )
        if x in "tqpv":  # what loops are told on the way to an end depends on what is behind it
            assert here[-1] == pytest.approx(there[-1], abs=1e-12 if proves_ends else 0, rel=0)
    if proves_ends:  # the core makes no steps behind the end, whose velocity is known there
        other |= {name: numbers[name] for name in ("iterations", "residual")}
        other["error_estimate"] = pytest.approx(other["error_estimate"], rel=1e-3)
        assert [x.kind for x in short.events] == [x.kind for x in long.events]
    else:
        assert short.events == long.events
    assert numbers == other and list(short.stats) == list(long.stats)
    return short


@pytest.mark.parametrize("h, steps", [(0.05, 20), (0.011, 400), (-0.04, 90), (0.4, 12)])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_zeros_by_the_core_are_those_of_the_search_of_whole_runs(
    monkeypatch, scene, rule, h, steps
):
    system, q0, v0 = steppable(scene, rule)
    by_name, found = expressions(system), 0
    start = dict(q0=q0, v0=v0, h=h, steps=steps, t0=0.7)
    for name, x in by_name.items():
        for until in (x, (x, 1), (x, -1)):
            some = dict(list(by_name.items())[:3]) if name in ("within", "never") else {}
            call = start | dict(until=until, events=some)
            way = few_steps, "few_steps_call", system, rule, call
            motion = assert_told_alike(monkeypatch, *way)
            found += motion is not None and len(motion) <= steps
    call = start | dict(events={name: (x, 0) for name, x in by_name.items()})
    assert_told_alike(monkeypatch, few_steps, "few_steps_call", system, rule, call)
    assert found


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_events_of_default_calls_are_those_along_the_run_that_proves_its_error(scene, rule):
    system, q0, v0 = steppable(scene, rule)
    by_name, found = expressions(system), 0
    for duration, tol in ((2.0, None), (0.3, 1e-6), (-1.5, 1e-4), (0.01, 1e-8)):
        start = dict(q0=q0, v0=v0, t0=0.7, duration=duration)
        proved = vi.simulate(system, rule, **start, tol=tol)
        steps = dict(steps=proved.stats["steps"])
        for names in (["within"], ["speed", "never"], ["many", "pole", "start"]):
            events = {name: by_name[name] for name in names}
            motion = vi.simulate(system, rule, **start, tol=tol, events=events)
            again = vi.simulate(system, proved.rule, **start, **steps, events=events)
            for x in "tqpkuhv":
                assert np.array_equal(getattr(motion, x), getattr(proved, x))
            assert motion.stats["error_estimate"] == proved.stats["error_estimate"]
            assert [x.kind for x in motion.events] == [x.kind for x in again.events]
            times, others = ([x.time for x in one.events] for one in (motion, again))
            assert times == pytest.approx(others, abs=10 * (tol or 1e-9))
            found += len(times)
    assert found


def test_the_core_takes_default_calls_with_events(monkeypatch):
    monkeypatch.setattr(module, "_to_tolerance", None)  # the way of all other calls
    monkeypatch.setattr(module, "_few_steps", None)
    for system, q0, v0 in SCENES.values():
        watched = {"within": expressions(system)["within"]}
        motion = vi.simulate(system, q0=q0, v0=v0, duration=5.0, events=watched)
        assert motion.events and abs(motion.events[0].q[0] - 0.3) < 1e-12


def ends_asked(system):
    by_name = expressions(system)
    for duration, tol in ((2.0, None), (0.3, 1e-6), (-1.5, 1e-4), (400.0, 1e-5)):
        for name in ("within", "speed", "start", "pole", "never"):
            if name == "never" and duration > 2:
                continue  # long
            call = dict(duration=duration, tol=tol, t0=0.7, until=(by_name[name], 0))
            if name == "speed":
                call["events"] = {"place": by_name["within"]}
            yield call


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", ["pendulum", "orbit", "on a circle"])
def test_ends_of_default_calls_are_those_of_the_longer_way(monkeypatch, scene, rule):
    """Also of those that are found in pieces, or never."""
    system, q0, v0 = steppable(scene, rule)
    found = 0
    for call in ends_asked(system):
        way = until_call, "call_until", system, rule, call | dict(q0=q0, v0=v0)
        motion = assert_told_alike(monkeypatch, *way)
        found += motion is not None and abs(motion.t[-1] - 0.7) < 0.9 * abs(call["duration"])
    assert found


@pytest.mark.parametrize("scene", SCENES)
def test_ends_of_default_calls_are_where_finer_runs_end(scene):
    system, q0, v0 = SCENES[scene]
    for call in ends_asked(system):
        if call["duration"] > 2:
            continue
        motion = vi.simulate(system, q0=q0, v0=v0, **call)
        finer = vi.simulate(system, q0=q0, v0=v0, **call | dict(tol=1e-11))
        late = np.abs(motion.t[-1] - finer.t[-1]) * np.abs(finer.v[-1])
        off = (np.abs(motion.q[-1] - finer.q[-1]) + late) / error_scales(system, finer)
        assert off.max() <= motion.stats["error_estimate"] + 2e-11 <= 1.1 * motion.stats["tol"]
        assert [x.kind for x in motion.events] == [x.kind for x in finer.events]


@pytest.mark.parametrize(
    "scene, duration",
    [(scene, 5.0) for scene in SCENES] + [("orbit", 300.0), ("slowed", 20.0)],
)
def test_the_core_takes_default_calls_that_end_at_a_zero(monkeypatch, scene, duration):
    monkeypatch.setattr(module, "_to_tolerance", None)  # the way of all other calls
    system, q0, v0 = SCENES[scene]
    motion = vi.simulate(system, q0=q0, v0=v0, duration=duration, until=system.q[0] - 0.3)
    assert abs(motion.q[-1, 0] - 0.3) < 1e-12


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_times_by_the_core_are_met_as_by_the_motion(monkeypatch, scene, rule):
    system, q0, v0 = steppable(scene, rule)
    for sign in (1, -1):
        for parts in ([0.0, 0.013, 0.5, 0.5, 0.77, 1.0], [1e-17, 1.0 - 1e-16], [0.3], [0, 1]):
            times = 0.7 + sign * np.array(parts)
            for grid in ({}, dict(h=0.05 * sign, steps=20), dict(tol=1e-5)):
                call = dict(q0=q0, v0=v0, at=times, t0=0.7) | grid
                way = times_at_once, "only_at_by_core", system, rule, call
                motion = assert_told_alike(monkeypatch, *way)
                assert motion is None or motion.t.tobytes() == times.tobytes()


def test_the_core_meets_times_of_runs_that_nothing_holds(monkeypatch):
    system, q0, v0 = SCENES["pendulum"]
    monkeypatch.setattr(dense_output, "nodes_at", None)
    times = np.linspace(0, 1, 30)
    motion = vi.simulate(system, q0=q0, v0=v0, at=times)
    assert len(motion) == 30 and np.abs(motion.energy - motion.energy[0]).max() < 1e-8


@pytest.mark.parametrize("scene", SCENES)
def test_the_core_looks_along_runs_of_a_few_steps(monkeypatch, scene):
    def none(*_):
        raise AssertionError("not by the core")

    monkeypatch.setattr(few_steps, "looked_along", none)
    monkeypatch.setattr(run, "looked_along", none)
    system, q0, v0 = SCENES[scene]
    by_name = expressions(system)
    for more in ({"until": by_name["speed"]}, {"events": {"within": (by_name["within"], -1)}}):
        vi.simulate(system, q0=q0, v0=v0, h=0.05, steps=60, **more)


@pytest.mark.parametrize(
    "wrong", [{"until": 3.0}, {"until": (q1, 2)}, {"events": [q1]}, {"events": {"a": q1 > 0}}]
)
def test_what_cannot_be_watched_for_is_refused(wrong):
    system, q0, v0 = SCENES["pendulum"]
    for span in (dict(h=0.1, steps=5), dict(duration=1.0)):
        with pytest.raises(vi.InputError, match=r"until|events|a "):
            vi.simulate(system, q0=q0, v0=v0, **span, **wrong)


def test_an_expression_that_was_changed_is_another_one():
    system, q0, v0 = SCENES["pendulum"]
    watched = ca.SX(q1 - 0.5)
    for level in (0.5, 0.25, 0.7):
        watched[0] = q1[0] - level
        motion = vi.simulate(system, q0=q0, v0=v0, h=0.05, steps=40, until=watched)
        assert abs(motion.q[-1, 0] - level) < 1e-12


@pytest.mark.parametrize("backend", ["native", "interpreted"])
@pytest.mark.parametrize("save_every", [1, 70])
def test_steps_are_those_until_the_end(backend, save_every):
    """However many a block has that an end is found in."""
    system, q0, v0 = SCENES["pendulum"]
    start = dict(q0=q0, v0=v0, progress=False)
    grid = dict(h=1e-3, duration=4.0, save_every=save_every)
    within = expressions(system)["within"]
    motion = vi.simulate(system, vi.gauss(2), **start, **grid, until=within, backend=backend)
    assert 0 < motion.k[-1] < 3000 and motion.stats["steps"] == motion.k[-1] + 1
    short = vi.simulate(system, **start, duration=4.0, until=within)
    assert short.stats["steps"] == len(short) - 1


def test_only_what_says_the_same_is_taken_for_known():
    x, y = ca.SX.sym("x"), ca.SX.sym("x")

    def say(x, number=0.5):
        return ca.sin(x) * x - number

    kept = say(x)
    known = as_written(kept, 8)
    assert is_written_so(kept, known) and is_written_so(say(x), known)
    for other in (say(y), say(x, 0.4), say(x) + 1, ca.cos(x) * x - 0.5, x * ca.sin(x) - 0.5, x):
        assert not is_written_so(other, known)
    deep = kept
    for _ in range(20):
        deep = ca.sin(deep)
    assert is_written_so(deep, as_written(deep, 8))
    assert not is_written_so(deep, as_written(ca.sin(say(y)), 8))


def test_threads_watch_for_expressions_of_their_own():
    """What one of them asks for is kept while others look through what was asked for before."""
    system = vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1))

    def runs(level):
        levels = level + np.arange(40) / 200
        found = (
            vi.simulate(system, q0=1.0, v0=0.0, duration=2.0, until=q1 - x, progress=False)
            for x in levels.tolist()
        )
        return max(abs(motion.q[-1, 0] - x) for motion, x in zip(found, levels, strict=True))

    often, interval = 1e-6, sys.getswitchinterval()
    sys.setswitchinterval(often)
    try:
        with ThreadPoolExecutor(4) as pool:
            off = [*pool.map(runs, [-0.5, -0.2, 0.1, 0.4])]
    finally:
        sys.setswitchinterval(interval)
    assert max(off) < 1e-9
