"""Friction much faster than a step: where a Lobatto rule stops at its own speed, it is said."""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi

A, W = vi.coordinates("angle")
STEEP = 1e-3
HELD = vi.System(A, W, W**2 / 2 - 9.81 * ca.sin(A), force=-3 * ca.tanh(W / STEEP))


def end(rule, h, duration=10.0):
    """Its last three nodes, and what was said."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = vi.simulate(HELD, rule, q0=0.0, v0=0.0, h=h, duration=duration)
    return motion[-3:], [str(x.message) for x in said if "the damping" in str(x.message)]


def creep(angle, held=1.0):
    """The speed at which friction, or a part of it, balances the weight."""
    return -STEEP * np.arctanh(9.81 * np.cos(angle) / (3 * held))


def test_the_inner_node_alone_holds_a_body_at_rest_by_lobatto_3_and_that_is_said():
    """Its weight is 4/6; the outer nodes push against each other."""
    last, said = end(vi.lobatto(3), 0.01, duration=2.5)
    angle = float(last.q[1, 0])
    mean = float(last.q[2, 0] - last.q[0, 0]) / 0.02
    assert mean == pytest.approx(creep(angle, held=4 / 6), rel=0.02)
    assert abs(last.v[1, 0]) > 5 * abs(creep(angle))
    assert len(said) == 1 and "lobatto(4)" in said[0]


@pytest.mark.parametrize(
    ("rule", "h"),
    [(vi.lobatto(4), 0.01), (vi.lobatto(2), 0.01), (vi.gauss(2), 0.01), (vi.lobatto(3), 0.005)],
)
def test_what_the_advice_names_creeps_as_the_friction_says_and_says_nothing(rule, h):
    last, said = end(rule, h)
    assert float(last.v[1, 0]) == pytest.approx(creep(float(last.q[1, 0])), rel=1e-2)
    assert not said


def test_damped_motions_that_are_resolved_are_told_nothing():
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2, force=-0.3 * v)
    fall = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=-2 * v)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for system, h in ((scene, 0.3), (fall, 0.2)):
            for steps in (3, 10, 200):
                vi.simulate(system, vi.lobatto(3), q0=[1.0, 0], v0=[0, 1.0], h=h, steps=steps)
