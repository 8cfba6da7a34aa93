"""Lines between few nodes: the motion itself, not a polygon."""

from __future__ import annotations

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest

import varint as vi
from varint.drawing.curves import MARKED, SMOOTH, curve_of, marks_of


def spring(**asked):
    q, v = vi.coordinates("x")
    return vi.simulate(vi.System(q, v, v**2 / 2 - q**2 / 2), q0=1.0, v0=0.0, **asked)


def test_the_default_calls_line_is_the_motion_between_its_few_nodes():
    motion = spring(duration=7.0)
    assert len(motion) <= MARKED
    axes = motion.plot().axes
    (line,), (portrait, *_) = axes[0].lines, axes[1].lines
    t, x = line.get_data()
    assert len(t) >= SMOOTH and np.abs(x - np.cos(t)).max() < 1e-9
    assert np.abs(np.hypot(*portrait.get_data()) - 1).max() < 1e-9
    nodes = line.get_markevery()
    np.testing.assert_array_equal(t[nodes], motion.t)
    np.testing.assert_array_equal(x[nodes], motion.q[:, 0])
    plt.close("all")


def test_expressions_are_drawn_between_nodes_too():
    figure = spring(duration=10.0).plot({"product": vi.coordinates("x")[0] * ca.SX.sym("x_dot")})
    t, x = figure.axes[0].lines[0].get_data()
    assert np.abs(x + np.cos(t) * np.sin(t)).max() < 1e-9
    plt.close(figure)


def test_long_runs_are_drawn_by_their_nodes():
    motion = spring(h=0.01, steps=SMOOTH)
    assert curve_of(motion) is motion and not marks_of(motion, motion.t)


@pytest.mark.parametrize("h", [0.1, -0.1])
def test_a_line_jumps_where_its_motion_does(h):
    """A ball between its bounces: parabolas that end on the floor."""
    q, v = vi.coordinates("y")
    ball = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=1.0)
    curve = curve_of(vi.simulate(ball, q0=0.5, v0=0.0, h=h, steps=50))
    since = (np.abs(curve.t) + 1) % 2 - 1  # from the last highest point
    assert np.abs(curve.q[:, 0] - (0.5 - since**2 / 2)).max() < 1e-12


@pytest.mark.parametrize("asked", [{"duration": 2.0}, {"h": 1e-3, "steps": 2000}])
def test_a_phase_portrait_comes_to_the_wall_and_jumps_there(asked):
    """p² = 2 (E − q) all the way between two impacts, and upright lines at the wall, also where
    the nodes are those that are asked for.
    """
    q, v = vi.coordinates("y")
    ball = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=0.8)
    motion = vi.simulate(ball, q0=0.5, v0=0.0, **asked)
    apart = motion[[k for k in range(len(motion)) if motion.q[k, 0] > 1e-9]]
    for drawn in (motion, apart):
        figure = drawn.plot()
        x, p = figure.axes[1].lines[0].get_data()
        energy, jumps = x + p**2 / 2, np.flatnonzero((p[:-1] < 0) & (p[1:] > 0))
        assert len(motion.events) == len(jumps) == 1
        assert np.abs(x[[*jumps, *(jumps + 1)]]).max() < 1e-12
        assert np.abs(energy - np.where(np.arange(len(x)) <= jumps[0], 0.5, 0.32)).max() < 1e-9
        t, height = figure.axes[0].lines[0].get_data()
        assert (np.diff(t) >= 0).all()
        since = np.where(t > 1, t - 1.8, t)
        assert np.abs(height - np.where(t > 1, 0.32, 0.5) + since**2 / 2).max() < 1e-9
        nodes = figure.axes[0].lines[0].get_markevery()
        assert nodes is None or np.array_equal(t[nodes], drawn.t)
        plt.close(figure)
