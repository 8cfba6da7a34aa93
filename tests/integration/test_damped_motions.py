"""Scenes whose dampers are stiff: what they stop at once takes no steps."""

import casadi as ca
import numpy as np
import pytest
from scenes import damped_beam

import varint as vi
from varint.integration.damped_motions import damped_turns, may_be_damped


def line(stiffness: float, damping: float, many: int = 7, bent: float = 0.0) -> vi.System:
    """Springs and dampers in a line of unit masses, held at its left end."""
    q, v = vi.coordinates(*[f"x{i}" for i in range(many)])
    bends, rates = q - ca.vertcat(0, q[:-1]), v - ca.vertcat(0, v[:-1])
    push = -damping * (rates - ca.vertcat(rates[1:], 0))
    energy = stiffness / 2 * ca.sumsqr(bends) + bent * ca.sum1(bends**4)
    return vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=push)


def rates_of(stiffness: float, damping: float, many: int) -> np.ndarray:
    """Of all its modes: λ² + c μ λ + k μ = 0 with μ = 4 sin²((2i − 1) π / (4n + 2))."""
    part = 4 * np.sin((2 * np.arange(many) + 1) * np.pi / (4 * many + 2)) ** 2
    return np.array([np.roots([1, damping * x, stiffness * x]) for x in part])


@pytest.mark.parametrize("damping", (0.0, 0.3, 20.0, 300.0))
def test_what_is_seen_and_what_lasts_are_those_of_the_modes(damping):
    many, stiffness, duration = 7, 100.0, 5.0
    system = line(stiffness, damping)
    rates = rates_of(stiffness, damping, many)
    fastest = np.sqrt(np.abs(rates[:, 0] * rates[:, 1]).max())
    start = np.linspace(0.1, 0.7, many), np.zeros(many), 0.0, system.default_vector
    found = damped_turns(system, *start, duration, 1e-9, fastest)
    if np.abs(rates).max() < 2 * fastest:
        assert found is None
        return
    lasts = np.abs(rates[-rates.real * duration < 20]).max()
    assert found == pytest.approx((lasts * duration, np.abs(rates).max() * duration), rel=1e-6)
    back = damped_turns(system, *start, -duration, 1e-9, fastest)
    assert back == pytest.approx((np.abs(rates).max() * duration,) * 2, rel=1e-6)


def test_what_nobody_sees_takes_no_first_steps():
    """Of 3e4 a second only a part in 1e7 moves: it counts at 1e-9, not at 1e-3."""
    system = line(100.0, 3e4)
    q = np.zeros(7)
    q[-1] = 1e-2
    start = q, np.zeros(7), 0.0, system.default_vector
    coarse, fine = (damped_turns(system, *start, 5.0, tol, 20.0) for tol in (1e-3, 1e-12))
    assert coarse[1] < 1e-3 * fine[1]


def test_small_linear_and_driven_scenes_and_those_without_dampers_are_not_looked_at():
    assert may_be_damped(line(1.0, 1.0, bent=1.0))
    assert not may_be_damped(line(1.0, 1.0, many=6, bent=1.0))
    assert not may_be_damped(line(1.0, 0.0, bent=1.0))
    assert not may_be_damped(line(1.0, 1.0))
    one, t = line(1.0, 1.0, bent=1.0), vi.time()
    force = one.force + ca.vertcat(ca.sin(t), ca.SX(6, 1))
    assert not may_be_damped(vi.System(one.q, one.v, one.lagrangian, force=force, t=t))


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
def test_a_damped_beam_takes_few_steps_and_keeps_the_promise(tol):
    """2,280 steps at 1e-9 before; its first joints move within a tenth of a millisecond."""
    system, still = damped_beam(), np.zeros(10)
    motion = vi.simulate(system, q0=still, v0=still, duration=2.0, tol=tol)
    assert len(motion) < 400 and motion.stats["error_estimate"] <= tol
    last = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=2.0 / 3200, steps=3200)
    scale = np.abs(last.q).max()
    assert np.abs(motion.q[-1] - last.q[-1]).max() < tol * scale
    for k in (1, 2, 5, 12, 30, 60):
        h = motion.t[k] / 400
        early = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=h, steps=400)
        assert np.abs(motion.q[k] - early.q[-1]).max() < tol * scale


def test_an_arm_of_nine_joints_that_is_held_stiffly_takes_few_steps():
    q, v = vi.coordinates(*[f"a{i}" for i in range(9)])
    kinetic, height, vx, vy, y = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(9):
        part, mass = 0.25, 4.0 * 0.7**i
        vx, vy = vx - part * ca.sin(q[i]) * v[i], vy + part * ca.cos(q[i]) * v[i]
        y = y + part * ca.sin(q[i])
        kinetic += mass / 2 * (vx**2 + vy**2) + mass * 0.005 * v[i] ** 2
        height += mass * y
    goal, still = np.linspace(0.3, 0.9, 9), np.zeros(9)
    arm = vi.System(q, v, kinetic - 9.81 * height, force=-300 * (q - goal) - 20 * v)
    motion = vi.simulate(arm, q0=still, v0=still, duration=2.0)
    assert len(motion) < 300 and motion.stats["error_estimate"] <= 1e-9
    fine = vi.simulate(arm, vi.gauss(8), q0=still, v0=still, h=2.0 / 12000, steps=12000)
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < 1e-9


def test_a_spring_that_is_met_late_is_resolved():
    """Steps have grown when a line that sinks in syrup meets a wall that bends sharply."""
    many = 7
    q, v = vi.coordinates(*[f"x{i}" for i in range(many)])
    wall = 0.02 * ca.sum1(ca.exp(40 * (q - 0.5)))
    energy = 50 * ca.sumsqr(q[1:] - q[:-1]) + wall - 3 * ca.sum1(q)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - energy, force=-60 * v)
    still = np.zeros(many)
    for tol in (1e-4, 1e-8):
        motion = vi.simulate(system, q0=still, v0=still, duration=40.0, tol=tol)
        fine = vi.simulate(system, vi.gauss(8), q0=still, v0=still, h=40.0 / 4000, steps=4000)
        at = np.searchsorted(motion.t, 10.0)
        for k in (at, len(motion) - 1):
            there = fine.at([motion.t[k]]).q[0]
            assert np.abs(motion.q[k] - there).max() < tol
