"""Runs of a few steps that constraint rows hold are those of the loops in one call of the core."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.errors import ConvergenceError, InputError
from varint.integration import few_steps, fixed_steps

q2, v2 = vi.coordinates("x", "y")
q3, v3 = vi.coordinates("x", "y", "phi")
q4, v4 = vi.coordinates("x1", "y1", "x2", "y2")
t, push = vi.time(), ca.SX.sym("push")
CIRCLE = ca.sumsqr(q2) - 1
RODS = ca.vertcat(ca.sumsqr(q4[:2]) - 1, ca.sumsqr(q4[2:] - q4[:2]) - 0.25)
BARS = ca.vertcat(
    ca.sumsqr(q4[:2]) - 1,
    ca.sumsqr(q4[2:] - q4[:2]) - 4,
    ca.sumsqr(q4[2:] - ca.DM([2, 0])) - 1,
)
FALLING = ca.sumsqr(v4) / 2 - 9.81 * (q4[1] + q4[3])
HEAVY = ca.sumsqr(v2) / 2 - 9.81 * q2[1]
SCENES = {
    "circle": vi.System(q2, v2, HEAVY, constraint=CIRCLE),
    "circle, driven": vi.System(
        q2, v2, HEAVY, constraint=CIRCLE, force=ca.vertcat(push, 0), control=push
    ),
    "chain": vi.System(q4, v4, FALLING, constraint=RODS),
    "chain, slowed": vi.System(q4, v4, FALLING, constraint=RODS, force=-0.1 * v4),
    "chain, swayed": vi.System(q4, v4, FALLING + ca.sin(t) * q4[2], constraint=RODS, t=t),
    "chain, coupled": vi.System(
        q4, v4, FALLING + 0.3 * v4[0] * v4[2] + 0.1 * q4[1] ** 2 * v4[1] ** 2, constraint=RODS
    ),
    "skate": vi.System(
        q3,
        v3,
        ca.sumsqr(v3) / 2 - q3[0],
        nonholonomic=ca.horzcat(ca.sin(q3[2]), -ca.cos(q3[2]), 0),
    ),
    "linkage": vi.System(q4, v4, FALLING, constraint=BARS),
}
RULES = None, vi.lobatto(2), vi.lobatto(4), vi.gauss(1), vi.composition("suzuki4")


def asked(scene, seed, steps, h=0.02, **more):
    system = SCENES[scene]
    rng, n = np.random.default_rng(seed), system.structure.n
    q0, v0 = vi.project(system, rng.normal(size=n), rng.normal(size=n))
    u = dict(u=rng.normal(size=(steps, 1))) if system.structure.controls else {}
    return system, dict(q0=q0, v0=v0, h=h, steps=steps, t0=0.7, **u) | more


def told(system, rule, call):
    """The motion, or what it failed of, and what was warned of."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(system, rule, **call)
        except (ConvergenceError, InputError) as error:
            motion = str(error)
    return motion, [str(x.message) for x in said]


def assert_told_alike(monkeypatch, system, rule, call):
    """As by the way of all other runs; whether the core took it."""
    taken = []

    def watched(*given):
        taken.append(by_core(*given))
        return taken[-1]

    by_core = few_steps.few_steps_call
    with monkeypatch.context() as patch:
        patch.setattr(few_steps, "few_steps_call", watched)
        (few, said) = told(system, rule, call)
        patch.setattr(few_steps, "few_steps_call", lambda *_: None)
        (other, said_there) = told(system, rule, call)
    assert said == said_there
    if isinstance(other, str):
        assert few == other
    else:
        for name in ("t", "q", "p", "k", "u", "v", "multipliers"):
            assert np.array_equal(getattr(few, name), getattr(other, name), equal_nan=True)
        assert few.events == other.events
        for name in ("iterations", "residual", "steps"):
            assert few.stats[name] == other.stats[name]
        # the compiler may have ended in between
        loops = [x.stats["backend"].split(": ")[-1] for x in (few, other)]
        assert loops[0] == loops[1]
        assert list(few.stats) == list(other.stats)
    return bool(taken) and taken != [None]


def steps_it(system, rule):
    try:
        vi.plan(system, rule)
    except InputError:
        return False
    return True


@pytest.mark.parametrize("steps, every", [(1, 1), (7, 1), (120, 1), (120, 12)])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_a_few_held_steps_are_those_of_the_loop(monkeypatch, scene, rule, steps, every):
    if not steps_it(SCENES[scene], rule):
        pytest.skip("no rule for this scene")
    for seed in range(3):
        system, call = asked(scene, seed, steps, save_every=every)
        assert_told_alike(monkeypatch, system, rule, call)


@pytest.mark.parametrize("h", [0.02, -0.02])
@pytest.mark.parametrize("scene", SCENES)
def test_held_steps_that_are_watched_are_those_of_the_loop(monkeypatch, scene, h):
    seen = 0
    for seed in range(3):
        system, call = asked(scene, seed, 80, h)
        x, v = system.q[0], system.v[1]
        for more in ({"until": x - 0.3}, {"events": {"place": x - 0.3, "speed": (v + 0.4, -1)}}):
            assert_told_alike(monkeypatch, system, None, call | more)
            motion, _ = told(system, None, call | more)
            seen += len(getattr(motion, "events", ()))
    assert seen or scene == "linkage"


@pytest.mark.parametrize("scene", [scene for scene in SCENES if scene != "linkage"])
def test_the_core_takes_held_runs_of_a_few_steps(monkeypatch, scene):
    def none(*_):
        raise AssertionError("not by the core")

    monkeypatch.setattr(fixed_steps, "simulate_steps", none)
    rule = vi.lobatto(2) if scene == "skate" else vi.lobatto(3)
    system, call = asked(scene, 1, 20)
    assert len(vi.simulate(system, rule, **call)) == 21


@pytest.mark.parametrize("off", [1e-13, 3e-12, 9e-12, 1.1e-11, 1e-7, np.nan])
@pytest.mark.parametrize("what", ["q0", "v0"])
def test_starts_off_their_rows_are_refused_alike(monkeypatch, what, off):
    taken = set()
    for scene in ("circle", "chain", "skate"):
        system, call = asked(scene, 2, 3)
        call[what] = call[what] + off * np.sign(call[what])
        taken.add(assert_told_alike(monkeypatch, system, None, call))
    if off < 5e-12:
        assert taken == {True}
    elif not off < 1e-8:
        assert taken == {False}


def test_rows_that_depend_on_others_are_told_of_alike(monkeypatch):
    twice = vi.System(q2, v2, HEAVY, constraint=ca.vertcat(CIRCLE, 2 * CIRCLE))
    call = dict(q0=[0.6, -0.8], v0=[0.8, 0.6], h=0.02, steps=5)
    assert not assert_told_alike(monkeypatch, twice, None, call)
    for turn in (1e-2, 1e-4, 1e-6, 1e-8):  # a third row that hardly differs
        near = ca.sumsqr(q3) - 1, q3[0] * np.cos(turn) + q3[1] * np.sin(turn), q3[0] + q3[2] * turn
        sphere = vi.System(q3, v3, ca.sumsqr(v3) / 2, constraint=ca.vertcat(*near[:2]))
        start = dict(q0=[np.sin(turn), -np.cos(turn), 0.0], v0=[0, 0, 1.0], h=0.02, steps=5)
        assert_told_alike(monkeypatch, sphere, None, start)


def test_folds_are_told_of_alike(monkeypatch):
    """A linkage that is folded on its way, or at the last step."""
    passed = 0
    for seed in range(4):
        for steps in (3, 40, 250):
            for h in (0.02, 0.3):
                system, call = asked("linkage", seed, steps, h)
                passed += not assert_told_alike(monkeypatch, system, vi.trapezoidal(), call)
    assert passed


def test_held_steps_too_large_are_told_of_alike(monkeypatch):
    said = 0
    for scene in ("circle", "chain", "chain, slowed", "chain, coupled"):
        for rule in (vi.lobatto(2), vi.lobatto(3), vi.trapezoidal()):
            for h in (0.2, 0.5, -0.9):
                system, call = asked(scene, 3, 60, h)
                assert_told_alike(monkeypatch, system, rule, call)
                said += bool(told(system, rule, call)[1])
    assert said


def test_a_start_that_was_asked_for_before_is_put_on_its_rows_once_more(monkeypatch):
    system, call = asked("chain", 4, 6)
    _, other = asked("chain", 5, 6)
    first = vi.simulate(system, **call)
    vi.simulate(system, **other)
    for _ in range(2):
        assert np.array_equal(vi.simulate(system, **call).p, first.p)
