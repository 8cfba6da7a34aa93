"""Default calls of motions that constraint rows hold and forces act on are proved by the core."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration import short_call
from varint.integration import simulate as module
from varint.integration.error_scale import error_scales
from varint.integration.gears import newton
from varint.integration.short_scenes import loop_of

q2, v2 = vi.coordinates("x", "y")
q3, v3 = vi.coordinates("angle", "tilt", "slide")
q4, v4 = vi.coordinates("x1", "y1", "x2", "y2")
t, drag = vi.time(), ca.SX.sym("drag")
HEAVY, CIRCLE = ca.sumsqr(v2) / 2 - 9.81 * q2[1], ca.sumsqr(q2) - 1
FALLING = ca.sumsqr(v4) / 2 - 9.81 * (q4[1] + q4[3])
RODS = ca.vertcat(ca.sumsqr(q4[:2]) - 1, ca.sumsqr(q4[2:] - q4[:2]) - 0.25)
CRANK = ca.vertcat(ca.cos(q3[0]) + 2.5 * ca.cos(q3[1]) - q3[2], ca.sin(q3[0]) - 2.5 * ca.sin(q3[1]))
MOVING = 0.75 * v3[0] ** 2 + 0.3 * v3[1] ** 2 + 0.35 * v3[2] ** 2
SCENES = {
    "circle": vi.System(q2, v2, HEAVY, constraint=CIRCLE, force=-0.3 * v2),
    "circle, with a parameter": vi.System(
        q2,
        v2,
        HEAVY,
        constraint=CIRCLE,
        force=-drag * v2 * ca.sqrt(ca.sumsqr(v2) + 0.01),
        params={drag: 0.4},
    ),
    "circle, swayed": vi.System(
        q2, v2, HEAVY, constraint=CIRCLE, force=ca.vertcat(2 * ca.cos(3 * t), 0) - 0.1 * v2, t=t
    ),
    "circle, pulled": vi.System(q2, v2, HEAVY - ca.sin(2 * t) * q2[0], constraint=CIRCLE, t=t),
    "circle, sticky": vi.System(q2, v2, HEAVY, constraint=CIRCLE, force=-30 * v2),
    "chain": vi.System(q4, v4, FALLING, constraint=RODS, force=-0.2 * v4),
    "crank": vi.System(
        q3, v3, MOVING, constraint=CRANK, force=ca.vertcat(2 - 0.3 * v3[0], 0, -0.2 * v3[2])
    ),
    "skate": vi.System(
        q3,
        v3,
        ca.sumsqr(v3) / 2 - q3[0],
        nonholonomic=ca.horzcat(ca.sin(q3[2]), -ca.cos(q3[2]), 0),
        force=-0.1 * v3,
    ),
}


def asked(scene, seed):
    system, rng = SCENES[scene], np.random.default_rng(seed)
    n, rests = system.structure.n, seed % 3 == 0
    q0, v0 = vi.project(system, rng.normal(size=n), rng.normal(size=n) * (not rests))
    tol = 10 ** rng.uniform(-4 if scene == "skate" else -11, -2)
    duration = 10 ** rng.uniform(-2, 0.0 if scene == "skate" else 0.7)
    return system, dict(q0=q0, v0=v0, duration=duration, t0=0.7, tol=tol)


@pytest.mark.parametrize("scene", SCENES)
def test_the_core_takes_default_calls_of_held_motions_over_forces(monkeypatch, scene):
    monkeypatch.setattr(module, "_to_tolerance", None)  # the way of all other calls
    system, call = asked(scene, 2)
    call |= dict(duration=0.3, tol=1e-4)
    motion = vi.simulate(system, **call)
    rows = system.structure.velocity_rows
    assert motion.stats["error_estimate"] <= 1e-4 and motion.multipliers.shape[1] <= rows


@pytest.mark.parametrize("scene", SCENES)
def test_the_error_is_no_larger_than_what_was_asked_for(scene):
    for seed in range(12):
        system, call = asked(scene, seed)
        motion = vi.simulate(system, **call)
        steps, parts = motion.stats["steps"], 64 if scene == "skate" else 12
        start = {name: call[name] for name in ("q0", "v0", "t0", "duration")}
        rule = None if scene == "skate" else vi.lobatto(5)
        closer = vi.simulate(system, rule, steps=parts * steps, save_every=parts, **start)
        error = (np.abs(motion.q - closer.q) / error_scales(system, closer)).max()
        assert error <= call["tol"] and motion.stats["error_estimate"] <= call["tol"]


@pytest.mark.parametrize("scene", ["circle", "circle, swayed", "chain"])
def test_bytes_are_the_same_when_the_loop_is_compiled(scene):
    system, call = asked(scene, 4)
    call |= dict(duration=0.5, tol=1e-6)
    low = vi.simulate(system, **call)
    rule = next(x for x in map(vi.lobatto, (3, 5, 7)) if str(x) == low.stats["rule"])
    loop_of(system, rule).gears.high[:] = [newton().compiled(system, rule)]
    high = vi.simulate(system, **call)
    assert high.stats["backend"].startswith("compiled")
    for name in ("t", "q", "p", "v", "multipliers"):
        assert np.array_equal(getattr(low, name), getattr(high, name))
    for name in ("steps", "runs", "error_estimate", "iterations"):
        assert low.stats[name] == high.stats[name]


def test_work_of_forces_is_what_the_energy_loses():
    """By the velocities that the loop has solved for, the start's included."""
    system, call = asked("crank", 5)
    motion = vi.simulate(system, **call | dict(duration=1.0, tol=1e-9))
    power = motion.value(ca.dot(system.force, system.v))
    given = (power[1:] + power[:-1]) / 2 @ np.diff(motion.t)
    changed = motion.energy[-1] - motion.energy[0]
    assert abs(given - changed) < 0.05 * max(np.abs(power).max(), abs(changed))


def test_a_pulse_that_two_runs_pass_over_is_found():
    pulse = 40 * ca.exp(-(((t - 0.431) / 2e-3) ** 2))
    system = vi.System(q2, v2, HEAVY, constraint=CIRCLE, force=ca.vertcat(pulse, 0), t=t)
    start = dict(q0=[0.0, -1.0], v0=[0.0, 0.0], duration=1.0)
    motion = vi.simulate(system, **start, tol=1e-5)
    closer = vi.simulate(system, vi.lobatto(3), **start, steps=20000)
    assert np.abs(motion.q[-1] - closer.q[-1]).max() < 1e-5


def test_rows_that_depend_on_others_are_told_of():
    twice = ca.vertcat(CIRCLE, 2 * CIRCLE)
    system = vi.System(q2, v2, HEAVY, constraint=twice, force=-0.1 * v2)
    with pytest.warns(UserWarning, match="redundant|depend"):
        vi.simulate(system, q0=[0.6, -0.8], v0=[0.8, 0.6], duration=0.2)


def test_a_motion_over_a_fold_is_left_to_those_who_watch_for_folds(monkeypatch):
    """A linkage that is folded flat on its way."""
    bars = ca.vertcat(RODS[0], ca.sumsqr(q4[2:] - q4[:2]) - 4)
    bars = ca.vertcat(bars, ca.sumsqr(q4[2:] - ca.DM([2, 0])) - 1)
    system = vi.System(q4, v4, FALLING, constraint=bars, force=-0.01 * v4)
    rng, left, by_core = np.random.default_rng(3), [], short_call.short_call

    def watched(*given):
        left.append(by_core(*given))
        return left[-1]

    monkeypatch.setattr(short_call, "short_call", watched)
    for _ in range(8):
        q0, v0 = vi.project(system, rng.normal(size=4), rng.normal(size=4))
        try:
            vi.simulate(system, q0=q0, v0=v0, duration=3.0, tol=1e-4)
        except vi.VarintError:
            assert left[-1] is None
    assert None in left
