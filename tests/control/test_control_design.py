"""Parameters as unknowns of an optimum: closed forms of the design and of how it changes."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

G = 9.81


def lift(way: float = 2.0, duration: float = 1.5, load: float = 3.0, **given) -> vi.Trajectory:
    """A load with a counterweight over a pulley, lifted from rest to rest with least ∫ u² dt."""
    q, v = vi.coordinates("height")
    u, c = ca.SX.sym("pull"), vi.Parameters(load=1.0, counter=1.0)
    lagrangian = (c.load + c.counter) * v**2 / 2 - (c.load - c.counter) * G * q
    system = vi.System(q, v, lagrangian, force=u, control=u, params=c)
    return vi.optimal_control(
        system,
        duration=duration,
        steps=4,
        cost=u**2,
        start=dict(q=[0], v=[0]),
        end=dict(q=[way], v=[0]),
        params=dict(load=load, counter=given.pop("counter", vi.free(0.1, 0.0, 50.0))),
        **given,
    )


def counterweight(way: float, duration: float, load: float) -> float:
    """The least of (M + m)² 12 d²/T³ + (M − m)² g² T."""
    move, hold = 12 * way**2 / duration**3, G**2 * duration
    return load * (hold - move) / (hold + move)


def test_the_counterweight_that_lifts_with_least_effort():
    motion = lift()
    best = counterweight(2.0, 1.5, 3.0)
    assert motion.parameters["counter"] == pytest.approx(best, rel=1e-9)
    cost = (3 + best) ** 2 * 12 * 4 / 1.5**3 + (3 - best) ** 2 * G**2 * 1.5
    assert motion.cost == pytest.approx(cost, rel=1e-10)
    assert str(motion.solution.second_order).startswith("strict minimum")


def test_the_best_design_changes_with_what_is_given_as_its_closed_form_does():
    found = lift().solution.sensitivity("end.q.height", "duration", "load")
    given, step = np.array([2.0, 1.5, 3.0]), 1e-5
    for k in range(3):
        e = step * np.eye(3)[k]
        slope = (counterweight(*(given + e)) - counterweight(*(given - e))) / (2 * step)
        assert found.parameters[1, k] == pytest.approx(slope, rel=1e-7)
        costs = [lift(*(given + sign * e)).cost for sign in (1, -1)]
        assert found.cost[k] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-6)
    above, below = lift(load=3 + step), lift(load=3 - step)
    assert np.abs(found.u[..., 0, 2] - (above.u - below.u)[..., 0] / (2 * step)).max() < 1e-5
    assert found.parameters[0].tolist() == [0, 0, 1]  # what was given changes with itself


@pytest.mark.parametrize("guess", [1e-3, 0.0, 49.0])
def test_a_design_is_found_from_far_and_kept_in_its_bounds(guess):
    best = counterweight(2.0, 1.5, 3.0)
    motion = lift(counter=vi.free(guess, 0.0, 50.0))
    assert motion.parameters["counter"] == pytest.approx(best, rel=1e-8)
    held = lift(counter=vi.free(0.0, 0.0, 1.0))
    assert held.parameters["counter"] == pytest.approx(1.0, rel=1e-7)
    fixed = lift(counter=1.0)
    assert held.cost == pytest.approx(fixed.cost, rel=1e-7)


def test_the_spring_that_swings_by_itself_and_the_angle_that_throws_farthest():
    q, v = vi.coordinates("x")
    u, c = ca.SX.sym("push"), vi.Parameters(mass=2.0, rate=1.0)
    system = vi.System(q, v, c.mass * v**2 / 2 - c.rate * q**2 / 2, force=u, control=u, params=c)
    swing = vi.optimal_control(
        system,
        vi.gauss(4),
        duration=0.8,
        steps=8,
        cost=u**2,
        start=dict(q=[1], v=[0]),
        end=dict(q=[-1], v=[0]),
        params=dict(rate=vi.free(5.0, 0.0, 1e3)),
    )
    best = 2 * (np.pi / 0.8) ** 2  # half a period, no push
    assert swing.parameters["rate"] == pytest.approx(best, rel=1e-8) and swing.cost < 1e-10
    slope = swing.solution.sensitivity("mass", "duration").parameters[1]
    assert slope == pytest.approx([best / 2, -2 * best / 0.8], rel=1e-6)
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(angle=0.5, speed=12.0)
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - G * q[1], params=c)
    thrown = v - c.speed * ca.vertcat(ca.cos(c.angle), ca.sin(c.angle))
    throw = vi.optimal_control(
        ball,
        duration=vi.free(1.0, 0.1, 5.0),
        steps=4,
        terminal_cost=-q[0],
        start=dict(q=[0, 3.0], bounds=[(0, thrown[0], 0), (0, thrown[1], 0)]),
        end=dict(q=[None, 0.0]),
        params=dict(angle=vi.free(0.5, 0.0, 1.5)),
    )
    speed, height = 12.0, 3.0
    best = np.arctan(speed / np.sqrt(speed**2 + 2 * G * height))
    assert throw.parameters["angle"] == pytest.approx(best, rel=1e-7)
    assert throw.q[-1, 0] == pytest.approx(speed / G * np.sqrt(speed**2 + 2 * G * height))
