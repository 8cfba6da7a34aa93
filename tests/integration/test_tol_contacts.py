"""What `tol` promises, and costs, where bodies swing or slide from one contact to the next."""

import math

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, times

import varint as vi


def pendulum_at_a_wall():
    q, v = vi.coordinates("theta")
    system = vi.System(q, v, v**2 / 2 + G * ca.cos(q), contact=q + 0.5, restitution=0.8)
    return system, {"q0": [1.0], "v0": [0.0], "duration": 5.0}


def of_model(model):
    return model.system, {"q0": model.q0, "v0": model.v0, "duration": model.duration}


def slack_string():
    return of_model(vi.models.slack_string())


def slide_off_sphere():
    return of_model(vi.models.slide_off_sphere())


def falling_ladder():
    return of_model(vi.models.falling_ladder())


@pytest.mark.parametrize("tol", [1e-4, 1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize(
    "build", [pendulum_at_a_wall, slack_string, slide_off_sphere, falling_ladder]
)
def test_nodes_and_impacts_are_as_near_to_those_of_a_finer_run_as_tol_says(build, tol):
    system, start = build()
    motion = vi.simulate(system, **start, tol=tol)
    steps, more = motion.stats["steps"], 8
    fine = vi.simulate(system, vi.lobatto(5), **start, steps=more * steps)
    grids = [
        [int(np.argmax(run.k == k)) for k in range(0, every * steps + 1, every)]
        for run, every in ((motion, 1), (fine, more))
    ]
    apart = np.abs(motion.q[grids[0]] - fine.q[grids[1]])
    assert apart.max() < motion.stats["error_estimate"] * np.abs(motion.q).max()
    assert motion.stats["error_estimate"] <= tol
    assert [e.contact for e in motion.events] == [e.contact for e in fine.events]
    assert np.abs(times(motion) - times(fine)).max() < tol * start["duration"]


def test_runs_leap_to_the_steps_that_the_order_asks_for():
    """Doubled each time they would be more."""
    system, start = pendulum_at_a_wall()
    stats = vi.simulate(system, **start, tol=1e-11).stats
    assert stats["runs"] <= math.log2(stats["steps"] / 8) - 1


def test_runs_that_do_not_come_together_by_the_order_of_the_rule_do_not_leap():
    """Over a floor whose waves are as short as a step the first runs tell nothing of it."""
    q, v = vi.coordinates("x", "y")
    gaps = ca.vertcat(q[1] - 0.2 * ca.cos(3 * q[0]), 4 - ca.sumsqr(q - ca.DM([0, 1])))
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    system = vi.System(q, v, lagrangian, force=-0.1 * v, contact=gaps, restitution=0.9)
    start = {"q0": [0.1, 1.0], "v0": [1.0, 0.0], "duration": 4.0}
    motion = vi.simulate(system, **start, tol=1e-9)
    steps = motion.stats["steps"]
    assert motion.stats["runs"] >= math.log2(steps / 8) + 1
    fine = vi.simulate(system, **start, steps=16 * steps)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < 1e-9
    assert len(motion.events) == len(fine.events) > 5


def ball_on_floor(y, v):
    return vi.System(y, v, v**2 / 2 - G * y, contact=y, restitution=0.5)


def spring_against_a_stop(y, v):
    return vi.System(y, v, v**2 / 2 - (y + 1) ** 2 / 2, contact=y)


def bead_held_at_zero(y, v):
    return vi.System(y, v, v**2 / 2 - (y + 1) ** 2 / 2, constraint=y)


@pytest.mark.parametrize("build", [ball_on_floor, spring_against_a_stop, bead_held_at_zero])
def test_what_is_held_at_zero_all_along_is_known_at_once(build):
    """Its places are 1e-47, a last digit of what forces would make of them: measured by a range as
    small, errors were 2e13, after 524,288 steps, or were looked for without an end.
    """
    motion = vi.simulate(build(*vi.coordinates("y")), q0=0.0, v0=0.0, duration=3.0)  # no warning
    assert np.abs(motion.q).max() < 1e-30 and not motion.p.any()
    assert motion.stats["error_estimate"] <= 1e-9 and motion.stats["steps"] <= 64


@pytest.mark.parametrize("size", [1e-3, 1e-9])
def test_small_bounces_are_no_rest(size):
    """Theorem: lengths a times as large, in times √a as long, are the same motion of a ball."""
    ball = ball_on_floor(*vi.coordinates("y"))
    large = vi.simulate(ball, q0=1.0, v0=0.0, duration=1.0)
    small = vi.simulate(ball, q0=size, v0=0.0, duration=math.sqrt(size))
    assert small.q[-1] / size == pytest.approx(large.q[-1], rel=1e-8)
    assert [e.kind for e in small.events] == [e.kind for e in large.events]
