"""Default calls that are asked for once more: one call in C, and the motion of the longer way."""

from __future__ import annotations

import threading

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.integration.simulate as simulate
from varint.codegen.built import built_module
from varint.codegen.cache import compiler
from varint.integration.gears import compiled_kernel, scheme_of
from varint.integration.repeated import PLACE

pytestmark = pytest.mark.skipif(
    built_module() is None or compiler() is None, reason="no headers of Python or no C compiler"
)
FIELDS = "t", "q", "p", "v", "h", "c", "origin"


def falling(drag=0.1):
    q, v = vi.coordinates("x", "z")
    c = vi.Parameters(drag=drag)
    force = -c.drag * v * ca.norm_2(v)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=force, params=c)


START = {"q0": [0.0, 1.0], "v0": [3.0, 4.0], "duration": 1.5}


def shifted_up(system, **call):
    """The scene with its compiled loop, after two such calls."""
    rule = vi.simulate(system, **call).rule
    compiled_kernel(system, rule, scheme_of(system, rule))
    vi.simulate(system, **call), vi.simulate(system, **call)
    return system


@pytest.fixture
def counted(monkeypatch):
    """How many calls went by the short way."""
    made = []

    def count(*arguments):
        motion = built_module().repeated(*arguments)
        made.append(motion is not None)
        return motion

    monkeypatch.setattr(simulate, "_repeated_call", lambda: count)
    return made


def same(one, other):
    assert one.rule == other.rule
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        assert a.tobytes() == b.tobytes() if isinstance(a, np.ndarray) else a == b
    told = "steps", "runs", "error_estimate", "tol", "residual", "iterations_max", "rule"
    assert [one.stats.get(x) for x in told] == [other.stats.get(x) for x in told]


def test_the_same_call_makes_the_same_motion(counted):
    system = shifted_up(falling(), **START)
    ways = (
        START,
        START | {"q0": (0, 1), "v0": np.array([3.0, 4.0])},
        START | {"tol": 1e-9, "t0": 0, "progress": False, "save_every": 1},
    )
    longer = vi.simulate(falling(), **START, backend="compiled")
    for way in ways:
        counted.clear()
        motion = vi.simulate(system, **way)
        assert counted == [True]
        same(motion, longer)
        assert 0 < motion.stats["seconds"] < 60


def watches(system):
    q, v = system.q, system.v
    high, turn = q[1] - 1.2, v[1] + 0.0
    return (
        {"until": high},
        {"events": {"high": high, "turn": turn}},
        {"until": q[0] - 50, "events": {"high": high}},
        {"until": high, "events": {"until": turn}},
    )


@pytest.mark.parametrize("which", range(4))
def test_the_same_is_found_on_the_way(counted, which):
    system, fresh = falling(), falling()
    call = START | watches(system)[which]
    shifted_up(system, **call)
    counted.clear()
    motion = vi.simulate(system, **call)
    assert counted == [True]
    longer = vi.simulate(fresh, **START, **watches(fresh)[which], backend="compiled")
    assert [x.kind for x in motion.events] == [x.kind for x in longer.events]
    assert motion.t[-1] == pytest.approx(longer.t[-1], abs=1e-11)
    again = vi.simulate(system, **call | {"q0": [0.0, 1.0 + 1e-13]})  # the longer way
    same(motion, vi.simulate(system, **call))
    assert len(again) == len(motion) and counted == [True] + 3 * [False]


def test_what_is_watched_for_in_another_way_takes_another_way(counted):
    system = falling()
    until, events, both, _ = watches(system)
    high, turn = events["events"].values()
    shifted_up(system, **START, **events)
    counted.clear()
    others = (
        {"events": {"low": high, "turn": turn}},
        {"events": {"turn": turn, "high": high}},
        {"events": {"high": high}},
        {"events": {"high": (high, 1), "turn": turn}},
        {"events": {"high": high, "turn": turn}, "until": system.q[0] - 50},
        {"until": high},
        {},
        {"events": {}},
    )
    for other in others:
        motion = vi.simulate(system, **START, **other)
        names = set(other.get("events", ()))
        assert {x.kind for x in motion.events} <= names
        assert not names or {x.kind for x in motion.events} == names
    assert not any(counted)
    shifted_up(system, **START, **events)
    high += 0.1  # in place, or another one: it is not taken for what it was
    events["events"]["high"] = high
    vi.simulate(system, **START, **events)
    assert counted[-1] is False
    shifted_up(system, **START, **until)
    for other in ({}, {"events": {}}, both, {"until": turn}):
        vi.simulate(system, **START, **other)
        assert counted[-1] is False


def test_held_motions_are_made_again(counted):
    q, v = vi.coordinates("x", "z")

    def swinging():
        return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1)

    call = dict(q0=[0.6, -0.8], v0=[0.0, 0.0], duration=1.0, progress=False)
    system = shifted_up(swinging(), **call)
    counted.clear()
    motion = vi.simulate(system, **call)
    assert counted == [True]
    same(motion, vi.simulate(swinging(), **call, backend="compiled"))


def test_motions_do_not_share_their_nodes(counted):
    system = shifted_up(falling(), **START)
    one, other = vi.simulate(system, **START), vi.simulate(system, **START)
    kept = other.q.copy()
    one.q[:] = 0
    assert counted[-2:] == [True, True] and np.array_equal(other.q, kept)


DIFFERENT = (
    {"v0": [3.0, 4.0000001]},
    {"q0": [-0.0, 1.0]},
    {"q0": np.array([0.0, 1.0], dtype=np.float32)},
    {"q0": np.array([0.0, 7.0, 1.0, 7.0])[::2]},
    {"duration": 1.25},
    {"duration": -0.25},
    {"t0": 0.5},
    {"tol": 1e-6},
    {"params": {"drag": 0.2}},
    {"rule": vi.gauss(4)},
    {"at": [0.5, 1.0]},
    {"events": {}},
    {"backend": "compiled"},
    {"save_every": 2},
    {"progress": True},
)


@pytest.mark.parametrize("other", DIFFERENT, ids=range(len(DIFFERENT)))
def test_another_call_takes_another_way(other, counted):
    system = shifted_up(falling(), **START)
    counted.clear()
    motion = vi.simulate(system, **START | other)
    assert counted == [False]
    same(motion, vi.simulate(falling(), **START | other))
    same(vi.simulate(system, **START), vi.simulate(falling(), **START))


@pytest.mark.parametrize("bad", [{"q0": [0.0]}, {"q0": [np.nan, 1.0]}, {"v0": "ab"}, {"h": 0.1}])
def test_bad_calls_are_refused_as_ever(bad):
    system = shifted_up(falling(), **START)
    with pytest.raises(vi.InputError):
        vi.simulate(system, **START | bad, steps=7 if "h" in bad else None)


def test_scenes_that_are_alike_keep_their_parameters(counted):
    """They share the room in which starts are."""
    one, other = shifted_up(falling(0.1), **START), shifted_up(falling(0.3), **START)
    counted.clear()
    for _ in range(3):
        for system, drag in ((one, 0.1), (other, 0.3)):
            same(vi.simulate(system, **START), vi.simulate(falling(drag), **START))
    assert not any(counted)


def test_a_room_in_use_is_not_shared():
    system = shifted_up(falling(), **START)
    wanted = vi.simulate(system, **START).q.tobytes()
    found = []

    def call():
        found.extend(vi.simulate(system, **START).q.tobytes() == wanted for _ in range(300))

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 1200 and all(found)


def test_what_needs_a_closer_look_is_not_remembered():
    """By a force that has no bounds as data."""
    q, v = vi.coordinates("x")
    t = vi.time()
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=ca.erf(t), t=t)
    shifted_up(system, q0=1.0, v0=0.0, duration=4.0)
    assert PLACE not in system.__dict__


def test_arguments_are_those_of_simulate():
    with pytest.raises(TypeError):
        built_module().repeated(falling())
