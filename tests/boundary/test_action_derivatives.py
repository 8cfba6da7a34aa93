"""Derivatives of the least action with respect to its ends and times."""

import casadi as ca
import numpy as np
import pytest
from references import given_and_exact

import varint as vi


def test_the_actions_derivatives_are_momenta_and_energy_of_the_oscillator():
    given, exact = given_and_exact("b", "B01_action_harmonic")
    c = vi.Parameters(m=given["m"], w=given["w"])
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, c.m / 2 * (v**2 - c.w**2 * q**2), params=c)
    x0, x1 = given["x0"], given["x1"]
    for k, row in enumerate(exact["rows"]):
        duration = row[0]
        path = vi.least_action(
            scene, vi.gauss(6), q_start=x0, q_end=x1, duration=duration, steps=30
        )
        change = vi.action_derivatives(path)
        assert change.action["q_start"] == pytest.approx(
            [exact["dS_dx0_equals_minus_p0"][k]], rel=1e-11
        )
        assert change.action["q_end"] == pytest.approx([exact["dS_dx1_equals_p1"][k]], rel=1e-11)
        assert change.action["duration"] == pytest.approx(
            exact["dS_dT_equals_minus_E"][k], rel=1e-11
        )
        assert change.action["m"] == pytest.approx(path.action / given["m"], rel=1e-12)
        angle, stiff = given["w"] * duration, given["m"] * given["w"]
        assert change.p_end["q_end"] == pytest.approx(stiff / np.tan(angle), rel=1e-10)
        assert change.p_start["q_end"] == pytest.approx(stiff / np.sin(angle), rel=1e-10)
        speed = (
            -given["w"] * (x1 - x0 * np.cos(angle)) * np.cos(angle) / np.sin(angle) ** 2
            + x0 * given["w"]
        )
        assert change.p_start["duration"] == pytest.approx(stiff * speed, rel=1e-10)


def test_derivatives_agree_with_differences_for_a_moving_scene_with_vector_parameters():
    c = vi.Parameters(g=9.81, l=np.array([1.0, 0.7]), A=np.array([[1.0, 0.2], [0.3, 0.5]]))
    q, v, t = *vi.coordinates("a", "b"), vi.time()
    kinetic = (
        c.A[0, 0] * v[0] ** 2 / 2
        + c.A[1, 1] * v[1] ** 2
        + c.A[0, 1] * v[0] * v[1] * ca.cos(q[0] - q[1])
    )
    lagrangian = (
        kinetic
        + c.g * (c.l[0] * ca.cos(q[0]) + c.l[1] * ca.cos(q[1])) * (1 + ca.sin(t) / 3)
        + c.A[1, 0] * q[0]
    )
    scene = vi.System(q, v, lagrangian, params=c, t=t)
    usual = dict(q_start=[0.1, 0.2], q_end=[0.5, -0.3], duration=0.7)

    def solve(name, index, size):
        values = dict(usual, params={})
        kind = values if name in usual else values["params"]
        moved = np.array(usual.get(name, scene.defaults.get(name)), dtype=float)
        moved[index] += size
        kind[name] = moved
        return vi.least_action(scene, vi.gauss(3), t0=0.3, steps=10, **values)

    change = vi.action_derivatives(vi.least_action(scene, vi.gauss(3), t0=0.3, steps=10, **usual))
    for name in (*usual, "g", "l", "A"):
        shape = np.shape(usual.get(name, scene.defaults.get(name)))
        assert change.action[name].shape == shape and change.p_end[name].shape == (2, *shape)
        for index in np.ndindex(*shape):
            ahead, back = (solve(name, index, size) for size in (1e-5, -1e-5))
            assert change.action[name][index] == pytest.approx(
                (ahead.action - back.action) / 2e-5, abs=1e-7
            )
            for node, found in ((0, change.p_start), (-1, change.p_end)):
                column = found[name][(slice(None), *index)]
                assert column == pytest.approx((ahead.p[node] - back.p[node]) / 2e-5, abs=1e-6)


def test_with_forces_end_momenta_have_derivatives_and_the_action_none():
    q, v = vi.coordinates("x")
    dragged = vi.System(q, v, v**2 / 2, force=-0.7 * v)
    path = vi.least_action(dragged, vi.gauss(4), q_start=0.0, q_end=1.0, duration=2.0, steps=20)
    change = vi.action_derivatives(path)
    assert change.action == {}
    assert change.p_start["q_end"] == pytest.approx(0.7 / (1 - np.exp(-1.4)), rel=1e-12)
    assert change.p_end["q_end"] == pytest.approx(0.7 / (np.exp(1.4) - 1), rel=1e-12)
