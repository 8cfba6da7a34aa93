"""Paths between ends whose straight line leads where the constraints have no tangents."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipe

import varint as vi


def on(g) -> vi.System:
    """A particle on g(x, y, z) = 0."""
    q, v = vi.coordinates("x", "y", "z")
    return vi.System(q, v, ca.sumsqr(v) / 2, constraint=g(*ca.vertsplit(q)))


def torus(x, y, z):
    return (ca.sqrt(x**2 + y**2) - 2) ** 2 + z**2 - 1


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 2, -2), (2, -1, 2)])
def test_antipodes_without_a_guess_are_conjugate(axis):
    sphere, start = (
        on(lambda x, y, z: x**2 + y**2 + z**2 - 1),
        np.array(axis) / np.linalg.norm(axis),
    )
    with pytest.raises(vi.SolverError, match="conjugate"):
        vi.least_action(sphere, q_start=start, q_end=-start, duration=1.0, steps=16)


@pytest.mark.parametrize(
    ("g", "start", "length"),
    [
        (lambda x, y, z: x**2 + y**2 + (z / 0.6) ** 2 - 1, (1, 0, 0), 2 * ellipe(0.64)),
        (torus, (1, 0, 0), np.pi),  # round the hole
        (
            lambda x, y, z: ca.vertcat(x**2 + y**2 - 4, z - x),
            (0, 2, 0),
            4 * np.sqrt(2) * ellipe(0.5),
        ),
    ],
    ids=["over a pole of a spheroid", "inside a torus", "half an ellipse"],
)
def test_geodesics_go_round_what_their_ends_lie_across(g, start, length):
    """The action of a free particle is ℓ²/(2 T)."""
    start = np.array(start, dtype=float)
    path = vi.least_action(
        on(g), vi.lobatto(4), q_start=start, q_end=-start, duration=2.0, steps=30
    )
    assert path.action == pytest.approx(length**2 / 4, rel=1e-6)
    assert path.morse_index == 0


def test_a_way_through_a_tube_goes_round_it():
    ends = dict(q_start=[1, 0, 0], q_end=[3, 0, 0], duration=1.0, steps=30)
    path = vi.least_action(on(torus), vi.lobatto(4), **ends)
    assert path.action == pytest.approx(np.pi**2 / 2, rel=1e-6)


def test_a_chain_that_hangs_is_led_to_where_it_stands():
    """Its straight line leads through a chain of no length."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    rods = ca.vertcat(q[0] ** 2 + q[1] ** 2 - 1, (q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2 - 1)
    chain = vi.System(q, v, ca.sumsqr(v) / 2 - q[1] - q[3], constraint=rods)
    ends = dict(q_start=[0, -1, 0, -2], q_end=[0, 1, 0, 2], duration=1.0)
    path = vi.least_action(chain, vi.lobatto(4), steps=40, **ends)
    assert path.stats["error_estimate"] < 1e-6
    assert np.ptp(path.energy) < 1e-5 * path.energy[0]


def test_the_straight_line_is_left_only_where_it_must_be():
    sphere = on(lambda x, y, z: x**2 + y**2 + z**2 - 1)
    almost = np.radians(179.9)
    ends = dict(q_start=[1, 0, 0], q_end=[np.cos(almost), np.sin(almost), 0], duration=1.0)
    path = vi.least_action(sphere, vi.lobatto(4), steps=30, **ends)
    assert path.action == pytest.approx(almost**2 / 2, rel=1e-6)
    assert np.abs(path.q[:, 2]).max() < 1e-9
