"""The core's decisions in one call are those of `run_twice`, number by number."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import two_runs
from varint.codegen.two_runs import NOT_PROVED, NOT_SHORT
from varint.integration import short_call
from varint.integration import simulate as module
from varint.integration.plain_start import rooms
from varint.integration.plain_trials import by_plain_trials, plain_motion
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.short_trials import by_short_trials
from varint.integration.small_motions import small_motions_at_start
from varint.integration.time_transformation import rate_ahead
from varint.scene.alike import first_alike

q1, v1 = vi.coordinates("theta")
q2, v2 = vi.coordinates("x", "y")
PAIRS = (0, 2), (0, 4), (2, 4)
PENDULUM = vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1))
KEPLER = vi.System(q2, v2, ca.sumsqr(v2) / 2 + 1 / ca.norm_2(q2))
CART = vi.System(
    q2, v2, v2[0] ** 2 + v2[1] ** 2 / 2 + v2[0] * v2[1] * ca.cos(q2[1]) + ca.cos(q2[1])
)
FALLING = vi.System(q2, v2, (v2[0] ** 2 + q2[0] ** 2 * v2[1] ** 2) / 2 - (q2[0] - 2) ** 2)
DOUBLE = vi.System(
    q2,
    v2,
    v2[0] ** 2
    + v2[1] ** 2 / 2
    + v2[0] * v2[1] * ca.cos(q2[0] - q2[1])
    + 9.81 * (2 * ca.cos(q2[0]) + ca.cos(q2[1])),
)
RELATIVISTIC = vi.System(q1, v1, -ca.sqrt(1 - v1**2) - q1**2 / 2)
t1 = vi.time()
DRIVEN = vi.System(q1, v1, v1**2 / 2 - q1**4 / 4, force=ca.cos(t1) - 0.1 * v1, t=t1)
q6, v6 = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
CHARGES = vi.System(
    q6, v6, ca.sumsqr(v6) / 2 - sum(1 / ca.norm_2(q6[i : i + 2] - q6[j : j + 2]) for i, j in PAIRS)
)
POLES = vi.models.spherical_pendulum()
CASES = {
    "pendulum": (PENDULUM, [2.0], [0.0], 30.0),
    "one that rests": (PENDULUM, [1e-9], [0.0], 3.0),
    "a moment from rest": (PENDULUM, [1.0], [0.0], 1e-3),
    "orbit": (KEPLER, [0.5, 0.0], [0.0, 3**0.5], 60.0),
    "backwards": (KEPLER, [0.5, 0.0], [0.0, 3**0.5], -20.0),
    "cart": (CART, [0.0, 1.0], [0.1, 0.0], 20.0),
    "polar": (FALLING, [1.5, 0.0], [0.0, 1.0], 15.0),
    "long enough for a part": (KEPLER, [0.5, 0.0], [0.0, 3**0.5], 380.0),
    "lost in its first part": (KEPLER, [0.1, 0.0], [0.0, 19**0.5], 40.0),
    "chaotic": (DOUBLE, [2.0, 1.0], [0.1, -0.3], 9.0),
    "at rest and chaotic": (DOUBLE, [2.0, 1.5], [0.0, 0.0], 9.0),
    "an encounter": (CHARGES, [-10, 0.1, 10, 0, 0, 8.0], [2.0, 0, -2, 0, 0, -1.5], 30.0),
    "hardly contracting": (POLES.system, POLES.q0, POLES.v0, 100.0),
}

TURNED = 36_000.0, 36_000.0


def inertia(system, problem):
    return small_motions_at_start(system, problem.q0, problem.p0, problem.t0, problem.c)[1]


@pytest.mark.parametrize("tol", [1e-3, 1e-7, 1e-11])
@pytest.mark.parametrize("case", CASES)
def test_the_core_decides_as_python_does(case, tol):
    system, q0, v0, duration = CASES[case]
    asked = Start(np.array(q0), np.array(v0), t0=0.5), RunOptions(steps=1, duration=duration)
    rule, turned = vi.gauss(4), (4.0 * abs(duration), 5.0 * abs(duration))
    problem = initial_value_problem(system, rule, *asked)
    found = by_short_trials(
        system, rule, problem, inertia(system, problem), tol, turned, "auto", 0.0
    )
    other = by_plain_trials(system, rule, problem, tol, turned, None, "auto")
    if other is None or other.estimate > tol:
        assert found in (NOT_PROVED, NOT_SHORT)
        return
    motion = plain_motion(system, rule, other.run, 0.0)
    assert (found.steps, found.runs, found.estimate) == (other.steps, other.runs, other.estimate)
    for name in "tqpku":
        assert np.array_equal(getattr(found.motion, name), getattr(motion, name))
    for name in ("iterations", "residual", "steps"):
        assert found.motion.stats[name] == motion.stats[name]


def test_round_off_of_an_encounter_is_no_reason_for_more_steps(monkeypatch):
    monkeypatch.setattr(rate_ahead, "IN_FLIGHT", (np.inf, np.inf))
    system, q0, v0, duration = CASES["an encounter"]
    motion = vi.simulate(system, q0=q0, v0=v0, duration=duration, tol=1e-9)
    assert motion.fictitious is None
    steps = motion.stats["steps"]
    closer = vi.simulate(system, q0=q0, v0=v0, duration=duration, tol=1e-12)
    error = np.abs(motion.q[-1] - closer.q[-1]).max() / np.abs(closer.q).max()
    assert error < motion.stats["error_estimate"] <= 1e-9
    rough = vi.simulate(
        system, rule=motion.rule, q0=q0, v0=v0, h=duration / (steps // 2), steps=steps // 2
    )
    assert np.abs(rough.q[-1] - closer.q[-1]).max() > 1e-9 * np.abs(closer.q).max()


@pytest.mark.parametrize("angle", (0.01, 1.0, 2.0, 3.1))
@pytest.mark.parametrize("duration", (1e-4, 1e-3, 1e-2))
def test_two_runs_prove_a_moment_from_rest(angle, duration):
    """Where energies differ by their last digits alone, which are large beside what moves."""
    motion = vi.simulate(PENDULUM, q0=[angle], v0=[0.0], duration=duration)
    t, pull = motion.t, -9.81 * np.sin(angle)
    fallen = pull * t**2 / 2 * (1 - 9.81 * np.cos(angle) * t**2 / 12)  # to t⁴
    next_term = 9.81**3 * duration**6 / 100
    error = np.abs(motion.q[:, 0] - angle - fallen).max() - next_term
    size = max(np.ptp(motion.q), np.finfo(float).eps)
    assert motion.stats["runs"] == 2
    assert error <= motion.stats["error_estimate"] * size + np.spacing(angle)


def test_a_long_run_is_left_to_a_loop_that_can_be_stopped():
    asked = Start([0.5, 0.0], [0.0, 3**0.5]), RunOptions(steps=1, duration=1e6)
    problem = initial_value_problem(KEPLER, vi.gauss(8), *asked)
    found = by_short_trials(
        KEPLER, vi.gauss(8), problem, inertia(KEPLER, problem), 1e-9, (8e6, 8e6), "auto", 0.0
    )
    assert found == NOT_SHORT


def test_a_compiled_loop_does_longer_runs_at_once_and_ends_where_others_do():
    asked = Start([0.5, 0.0], [0.0, 3**0.5]), RunOptions(steps=1, duration=12_000.0)
    problem = initial_value_problem(KEPLER, vi.gauss(8), *asked)
    way = KEPLER, vi.gauss(8), problem, inertia(KEPLER, problem), 1e-3, TURNED
    assert by_short_trials(*way, "native", 0.0) == NOT_SHORT
    found = by_short_trials(*way, "compiled", 0.0)
    other = by_plain_trials(KEPLER, vi.gauss(8), problem, 1e-3, TURNED, None, "native")
    motion = plain_motion(KEPLER, vi.gauss(8), other.run, 0.0)
    assert (found.steps, found.runs, found.estimate) == (other.steps, other.runs, other.estimate)
    assert np.array_equal(found.motion.q, motion.q) and np.array_equal(found.motion.p, motion.p)


def test_a_step_that_cannot_be_solved_is_not_taken_for_a_proof():
    free = vi.System(q1, v1, v1**2 / 2 - ca.log(1 - q1))
    asked = Start([0.9], [3.0]), RunOptions(steps=1, duration=50.0)
    problem = initial_value_problem(free, vi.gauss(4), *asked)
    found = by_short_trials(free, vi.gauss(4), problem, np.ones(1), 1e-6, (50.0, 50.0), "auto", 0.0)
    assert found == NOT_PROVED


@pytest.mark.parametrize("tol", [1e-4, 1e-9])
@pytest.mark.parametrize("case", [name for name in CASES if name != "one that rests"])
def test_a_call_that_asks_for_no_more_gives_what_the_long_way_gives(monkeypatch, case, tol):
    system, q0, v0, duration = CASES[case]
    asked = dict(q0=q0, v0=v0, duration=duration, tol=tol, t0=0.5)
    short = vi.simulate(system, **asked)
    monkeypatch.setattr(short_call, "short_call", lambda *_: None)
    long = vi.simulate(system, **asked)
    for name in "tqpkuhc":
        assert np.array_equal(getattr(short, name), getattr(long, name))
    told, other = (
        {**motion.stats, "seconds": 0, "backend": motion.stats["backend"].split(": ")[1]}
        for motion in (short, long)  # the compiler may have come to its end between them
    )
    assert told == other
    fields = "system rule origin functions active_sets active_set events sizes"
    for name in fields.split():
        assert getattr(short, name) == getattr(long, name)
    assert np.array_equal(short.energy, long.energy)


@pytest.mark.parametrize("system", [PENDULUM, RELATIVISTIC, DRIVEN])
def test_nodes_that_do_not_fit_into_their_room_are_the_same(monkeypatch, system):
    asked = dict(q0=0.7, v0=0.3, duration=20.0)
    known = rooms(first_alike(system), True)
    short = vi.simulate(system, **asked)
    used = list(known)
    known.clear()
    monkeypatch.setattr(two_runs, "ROOM", 2)
    other = vi.simulate(system, **asked)
    known[:] = used
    for name in "tqpkv":
        assert np.array_equal(getattr(short, name), getattr(other, name))


@pytest.mark.parametrize("case", ["pendulum", "cart", "polar", "chaotic"])
def test_momenta_are_as_good_a_start_as_velocities(monkeypatch, case):
    system, q0, _, duration = CASES[case]
    asked = dict(q0=q0, p0=[1.1, 0.3][: len(q0)], duration=duration / 3, tol=1e-6)
    with monkeypatch.context() as patch:
        patch.setattr(module, "_to_tolerance", None)  # the way of all other calls
        short = vi.simulate(system, **asked)
    monkeypatch.setattr(short_call, "short_call", lambda *_: None)
    long = vi.simulate(system, **asked)
    for name in "tqpkuhc":
        assert np.array_equal(getattr(short, name), getattr(long, name))
    for name in ("error_estimate", "iterations", "runs", "rule"):
        assert short.stats[name] == long.stats[name]


def test_starts_one_after_the_other_and_one_within_another_have_memory_of_their_own():
    first = vi.simulate(PENDULUM, q0=1.0, v0=0.0, duration=5.0, tol=1e-6)
    kept = first.q.copy()
    with ThreadPoolExecutor(2) as pool:
        starts = [0.5, 1.0, 1.5, 2.0] * 5
        found = list(
            pool.map(lambda x: vi.simulate(PENDULUM, q0=x, v0=0.0, duration=5.0, tol=1e-6), starts)
        )
    assert np.array_equal(first.q, kept)
    for x, motion in zip(starts, found, strict=True):
        again = vi.simulate(PENDULUM, q0=x, v0=0.0, duration=5.0, tol=1e-6)
        assert np.array_equal(motion.q, again.q)
