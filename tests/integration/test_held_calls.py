"""Default calls of motions that constraint rows hold are proved by the core as by others."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import opening as told_at_starts
from varint.integration import short_call
from varint.integration import simulate as module
from varint.integration.error_scale import error_scales

q2, v2 = vi.coordinates("x", "y")
q3, v3 = vi.coordinates("x", "y", "z")
q4, v4 = vi.coordinates("x1", "y1", "x2", "y2")
pull = ca.SX.sym("pull")
FALLING = ca.sumsqr(v4) / 2 - 9.81 * (q4[1] + q4[3])
FIRST = ca.sumsqr(q4[:2]) - 1
HEAVY = ca.sumsqr(v2) / 2 - 9.81 * q2[1]
SCENES = {
    "circle": vi.System(q2, v2, HEAVY, constraint=ca.sumsqr(q2) - 1),
    "circle, with a parameter": vi.System(
        q2, v2, ca.sumsqr(v2) / 2 - pull * q2[1], constraint=ca.sumsqr(q2) - 1, params={pull: 2.0}
    ),
    "sphere": vi.System(q3, v3, ca.sumsqr(v3) / 2 - 9.81 * q3[2], constraint=ca.sumsqr(q3) - 1),
    "line": vi.System(q2, v2, ca.sumsqr(v2) / 2 - 2 * q2[0] ** 2, constraint=q2[0] - q2[1]),
    "chain": vi.System(
        q4, v4, FALLING, constraint=ca.vertcat(FIRST, ca.sumsqr(q4[2:] - q4[:2]) - 0.25)
    ),
    "linkage": vi.System(
        q4,
        v4,
        FALLING,
        constraint=ca.vertcat(
            FIRST, ca.sumsqr(q4[2:] - q4[:2]) - 4, ca.sumsqr(q4[2:] - ca.DM([2, 0])) - 1
        ),
    ),
    "skate": vi.System(
        q3,
        v3,
        ca.sumsqr(v3) / 2 - q3[0],
        nonholonomic=ca.horzcat(ca.sin(q3[2]), -ca.cos(q3[2]), 0),
    ),
}
RULES = None, vi.lobatto(4), vi.lobatto(2), vi.composition("suzuki4")


def asked(scene, seed, rule=None):
    system, rng = SCENES[scene], np.random.default_rng(seed)
    n, rests = system.structure.n, seed % 3 == 0
    q0, v0 = vi.project(system, rng.normal(size=n), rng.normal(size=n) * (not rests))
    low = rule is not None or scene == "skate"
    tol = 10 ** rng.uniform(-6 if low else -11, -2)
    duration = 10 ** rng.uniform(-3, 0.7) * (-1 if seed % 5 == 1 else 1)
    return system, dict(q0=q0, v0=v0, duration=duration, t0=0.7, tol=tol)


def told(system, rule, call):
    """The motion, or what it failed of, and what was warned of, in which file."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(system, rule, **call)
        except vi.VarintError as error:
            motion = str(error)
    return motion, [(str(x.message), x.filename) for x in said]


def assert_told_alike(monkeypatch, system, rule, call):
    """As by the way of all other calls; whether the core took it."""
    taken, by_core = [], short_call.short_call

    def watched(*given):
        taken.append(by_core(*given))
        return taken[-1]

    with monkeypatch.context() as patch:
        patch.setattr(short_call, "short_call", watched)
        short, said = told(system, rule, call)
        patch.setattr(short_call, "short_call", lambda *_: None)
        long, said_there = told(system, rule, call)
    assert said == said_there
    if isinstance(long, str):
        assert short == long
        return False
    for name in ("t", "q", "p", "k", "u", "v", "h", "c", "multipliers"):
        assert np.array_equal(getattr(short, name), getattr(long, name), equal_nan=True)
    numbers, other = (
        {**x.stats, "seconds": 0, "backend": x.stats["backend"].split(": ")[1]}
        for x in (short, long)  # the compiler may have come to its end between them
    )
    assert numbers == other and list(short.stats) == list(long.stats)
    assert short.events == long.events
    return type(taken[0]) is vi.Trajectory


def steps_it(system, rule):
    try:
        vi.plan(system, rule)
    except vi.InputError:
        return False
    return True


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scene", SCENES)
def test_the_core_proves_held_motions_as_others_do(monkeypatch, scene, rule):
    if not steps_it(SCENES[scene], rule):
        pytest.skip("no rule for this scene")
    taken = [
        assert_told_alike(monkeypatch, system, rule, call)
        for system, call in (asked(scene, seed, rule) for seed in range(12))
    ]
    assert any(taken)


@pytest.mark.parametrize("scene", SCENES)
def test_the_core_takes_default_calls_of_held_motions(monkeypatch, scene):
    monkeypatch.setattr(module, "_to_tolerance", None)  # the way of all other calls
    system, call = asked(scene, 2)
    call |= dict(duration=0.3, tol=1e-5)
    motion = vi.simulate(system, **call)
    rows = system.structure.velocity_rows
    assert motion.stats["error_estimate"] <= 1e-5 and motion.multipliers.shape[1] <= rows


@pytest.mark.parametrize("scene", ["circle", "sphere", "chain", "skate"])
def test_the_error_is_no_larger_than_what_is_said(scene):
    for seed in range(4):
        system, call = asked(scene, seed)
        call |= dict(duration=1.0, tol=1e-5)
        motion = vi.simulate(system, **call)
        closer = vi.simulate(system, **call | dict(tol=1e-9))
        error = np.abs(motion.q[-1] - closer.q[-1]) / error_scales(system, closer)
        assert error.max() <= motion.stats["error_estimate"] + 1e-9


def test_momenta_along_the_rows_are_another_way_to_the_same_motion():
    system, call = asked("chain", 4)
    call |= dict(duration=0.5, tol=1e-6)
    first = vi.simulate(system, **call)
    start = dict(call, v0=None, p0=first.p[0])
    assert np.abs(vi.simulate(system, **start).q[-1] - first.q[-1]).max() < 1e-5


@pytest.mark.parametrize("off", [1e-13, 1e-11, 1e-7, np.nan])
@pytest.mark.parametrize("what", ["q0", "v0"])
def test_starts_off_their_rows_are_refused_alike(monkeypatch, what, off):
    for scene in ("circle", "chain", "skate"):
        system, call = asked(scene, 2)
        call[what] = call[what] + off * np.sign(call[what])
        assert_told_alike(monkeypatch, system, None, call)


def test_rows_that_depend_on_others_are_told_of_alike(monkeypatch):
    circle = ca.sumsqr(q2) - 1
    twice = vi.System(q2, v2, HEAVY, constraint=ca.vertcat(circle, 2 * circle))
    call = dict(q0=[0.6, -0.8], v0=[0.8, 0.6], duration=0.2)
    assert not assert_told_alike(monkeypatch, twice, None, call)


def test_motions_over_folds_are_told_of_alike(monkeypatch):
    """The linkage is folded flat on its way."""
    left = 0
    for seed in range(20):
        system, call = asked("linkage", seed)
        call |= dict(duration=3.0, tol=1e-4)
        left += not assert_told_alike(monkeypatch, system, None, call)
    assert left


def test_what_is_raised_while_the_core_asks_is_raised(monkeypatch):
    def trigger_on(function, inputs, outputs):
        def raises():
            raise KeyboardInterrupt

        return raises, ()

    monkeypatch.setattr(told_at_starts, "trigger_on", trigger_on)
    afresh = vi.System(q2, v2, HEAVY - 0.1 * q2[0], constraint=ca.sumsqr(q2) - 1)
    with pytest.raises(KeyboardInterrupt):
        vi.simulate(afresh, q0=[1.0, 0.0], v0=[0.0, 0.0], duration=0.1)
