"""Motions that are made of what the core has proved: by Python's interface in C, and by Python."""

from __future__ import annotations

import copy
import pickle
import sys
import threading

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.integration.asked_times as asked_times
import varint.integration.even_motion as even
from varint.codegen.beside import Beside
from varint.codegen.built import built_module
from varint.codegen.two_runs import NO_RATES
from varint.integration.short_scenes import known_of

FIELDS = "t", "q", "p", "h", "k", "u", "c", "active_sets", "events", "fictitious", "origin"


def falling():
    q, v = vi.coordinates("x", "z")
    drag = -0.1 * v * ca.norm_2(v)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=drag), [0.0, 1.0], [3.0, 4.0], 1.5


def swinging():
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q)), [1.0], [0.0], 2.0


def swinging_long():
    return *swinging()[:3], 600.0


def relativistic():
    """Velocities have no formula: nodes have them."""
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 + 0.1 * v**4 - q**2), [0.4], [0.3], 3.0


def driven():
    """By a force that has no bounds as data: more is to be looked at."""
    q, v = vi.coordinates("x")
    t = vi.time()
    return vi.System(q, v, v**2 / 2 - q**2 / 2, force=ca.erf(t), t=t), [1.0], [0.0], 4.0


def thrown():
    """All steps are one map, and the loop that goes between nodes is told typical sizes."""
    q, v = vi.coordinates("x", "z")
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1]), [0.0, 1.0], [3.0, 4.0], 1.5


def on_its_circle():
    q, v = vi.coordinates("x", "z")
    energies = ca.sumsqr(v) / 2 - 9.81 * q[1]
    system = vi.System(q, v, energies, constraint=ca.sumsqr(q) - 1)
    return system, [0.6, -0.8], [0.0, 0.0], 1.5


SCENES = falling, swinging, swinging_long, relativistic, driven, thrown, on_its_circle
AT_ONCE = [make for make in SCENES if make is not driven]


@pytest.fixture
def by_python(monkeypatch):
    monkeypatch.setattr(even, "built_module", lambda: None)
    even.proved_motion.cache_clear()
    yield
    even.proved_motion.cache_clear()


def as_found(make, at=None, **watched):
    system, q0, v0, duration = make()
    times = None if at is None else 0.5 + duration * np.array(at)
    call = dict(q0=q0, v0=v0, t0=0.5, duration=duration, at=times)
    given = {name: watch(system) for name, watch in watched.items()}
    return vi.simulate(system, **call, **given, progress=False)


TIMES = None, [0.0, 0.013, 0.5, 0.5, 0.77, 1.0], [0.3], np.linspace(0, 1, 300), [1e-17, 1 - 1e-16]


@pytest.mark.parametrize("at", TIMES, ids=range(len(TIMES)))
@pytest.mark.parametrize("make", SCENES)
def test_c_and_python_make_the_same_motion(make, at, by_python):
    def is_by(kind):
        return type(even.proved_motion()) is kind

    assert is_by(type(lambda: 0))
    other = as_found(make, at)
    even.proved_motion.cache_clear()
    even.built_module = built_module  # the fixture puts it back
    if built_module() is None:
        pytest.skip("Python came without its headers")
    one = as_found(make, at)
    assert not is_by(type(lambda: 0))
    assert_same(one, other)


def assert_same(one, other):
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
    assert one.v.tobytes() == other.v.tobytes()
    assert list(one.stats) == list(other.stats)
    by_the_clock = "seconds", "plan", "backend"  # which gear runs, too
    told = {k: x for k, x in one.stats.items() if k not in by_the_clock}
    assert told == {k: x for k, x in other.stats.items() if k not in by_the_clock}
    assert 0 < one.stats["seconds"] < 60


def half_way(system):
    return system.q[0] - 0.5


def two_of_them(system):
    return {"half": half_way(system), "turns": (system.v[0], -1)}


WATCHED = {"until": half_way}, {"events": two_of_them}, {"until": half_way, "events": two_of_them}


@pytest.mark.parametrize("watched", WATCHED, ids=range(len(WATCHED)))
@pytest.mark.parametrize("make", SCENES)
def test_c_and_python_find_the_same_on_the_way(make, watched, by_python):
    other = as_found(make, **watched), as_found(make, [0.0, 1e-4], **watched)
    even.proved_motion.cache_clear()
    even.built_module = built_module  # the fixture puts it back
    one = as_found(make, **watched), as_found(make, [0.0, 1e-4], **watched)
    for a, b in zip(one, other, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("make", SCENES)
def test_what_happened_outlives_the_next_call(make):
    """Events are made of what was found when they are looked at."""
    system, q0, v0, duration = make()
    call = dict(v0=v0, duration=duration, events=two_of_them(system), progress=False)
    alone = vi.simulate(system, q0=q0, **call).events
    motion = vi.simulate(system, q0=q0, **call)
    for away in (0.9, 0.8):  # expressions that are written anew are known again
        again = dict(call, events=two_of_them(system))
        if system.structure.constraints:
            again |= dict(duration=away * duration)
            vi.simulate(system, q0=q0, **again)
        else:
            vi.simulate(system, q0=away * np.array(q0), **again)
    assert motion.events == alone and alone


@pytest.mark.parametrize("make", AT_ONCE)
def test_times_are_met_in_the_call_that_proves_the_motion(make, monkeypatch):
    if built_module() is None:
        pytest.skip("Python came without its headers")
    monkeypatch.setattr(asked_times, "_at_once", None)  # another call
    motion, whole = as_found(make, TIMES[1]), as_found(make)
    assert len(motion) == len(TIMES[1]) and motion.stats["steps"] == whole.stats["steps"]
    assert motion.q[[0, -1]].tobytes() == whole.q[[0, -1]].tobytes()
    between = whole.at(motion.t)
    for name in FIELDS:
        a, b = getattr(motion, name), getattr(between, name)
        assert a.tobytes() == b.tobytes() if isinstance(a, np.ndarray) else a == b
    assert motion.v.tobytes() == between.v.tobytes()


@pytest.mark.parametrize("make", SCENES)
def test_motions_do_not_share_their_nodes(make):
    one = as_found(make)
    kept = one.q.copy()
    other = as_found(make)
    other.q[:] = 0
    assert np.array_equal(one.q, kept) and not np.shares_memory(one.q, other.q)


def test_motions_travel_before_they_are_looked_at():
    for at in TIMES:
        whole = as_found(falling, at)
        for made in (pickle.loads(pickle.dumps(whole)), copy.deepcopy(as_found(falling, at))):
            assert np.array_equal(made.t, whole.t) and np.array_equal(made.k, whole.k)
            assert made.stats["runs"] == whole.stats["runs"]


def test_nothing_is_left_behind():
    as_found(falling)
    system, q0, v0, duration = falling()
    times = np.linspace(0, duration, 7)

    def some():
        for _ in range(200):
            for at in (None, times, times[::2]):
                call = dict(q0=q0, v0=v0, duration=duration, at=at, progress=False)
                assert vi.simulate(system, **call).stats["runs"]

    some()
    whole = [system, system.default_vector, times, float, vi.Trajectory]
    before = [sys.getrefcount(x) for x in whole]
    some()
    assert max(np.subtract([sys.getrefcount(x) for x in whole], before)) < 20


def test_threads_find_what_one_finds():
    system, q0, v0, duration = falling()
    alone = vi.simulate(system, q0=q0, v0=v0, duration=duration, progress=False)
    found = []

    def some():
        for _ in range(50):
            found.append(vi.simulate(system, q0=q0, v0=v0, duration=duration, progress=False))

    threads = [threading.Thread(target=some) for _ in range(4)]
    for x in threads:
        x.start()
    for x in threads:
        x.join()
    assert len(found) == 200
    assert all(x.q.tobytes() == alone.q.tobytes() for x in found)


def test_what_is_not_made_for_it_is_refused():
    if built_module() is None:
        pytest.skip("Python came without its headers")
    prove = built_module().prove
    numbers = 0.0, 1.0, 4, 1.0, 1e-9
    with pytest.raises(TypeError, match="eleven"):
        prove(1)
    with pytest.raises(TypeError, match="are needed"):
        prove((), (), None, None, *numbers, NO_RATES, 0.0)
    system, q0, v0, _ = falling()
    vi.simulate(system, q0=q0, v0=v0, duration=1.0, progress=False)
    known = known_of(system, None)
    loop = next(x for x in known.loops if x is not None)
    how, places = loop.last[1], known.rooms[-1].places
    with pytest.raises(TypeError):
        prove(how, places, system, system.default_vector, "now", *numbers[1:], NO_RATES, 0.0)
    with pytest.raises(TypeError, match="between nodes"):
        prove(how, places, system, None, *numbers, NO_RATES, 0.0, None, np.zeros(1), ())
    with pytest.raises(TypeError, match="another size"):
        prove(how, places._replace(head=b""), system, None, *numbers, NO_RATES, 0.0)
    with pytest.raises(TypeError, match="another size"):
        prove(how, places, system, None, *numbers, NO_RATES, 0.0, Beside(b""))
