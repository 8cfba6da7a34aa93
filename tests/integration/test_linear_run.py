"""Runs of linear scenes by the powers of one map."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import varint as vi
from varint.integration.linear_run import TOLD, is_one_map
from varint.numerics.linear_maps import TOGETHER, gauss_change, orbit

q3, v3 = vi.coordinates("x", "y", "z")
M, E, B = 9.109e-31, 1.602e-19, 1.0
TRAP = vi.System(
    q3,
    v3,
    M * ca.sumsqr(v3) / 2
    - E * B / 2 * (q3[0] * v3[1] - q3[1] * v3[0])
    - E * 2e5 * (q3[2] ** 2 - (q3[0] ** 2 + q3[1] ** 2) / 2)
    + E * 0.3 * q3[2],
)


def of_trap(q0, v0, time: float) -> np.ndarray:
    """The exact place: m x'' = −e B y' + k x/2, m y'' = e B x' + k y/2, m z'' = −k z + e 0.3, with
    velocities in the unit of places.
    """
    w, k, g = E * B / M, E * 4e5 / M, E * 0.3 / M
    a = np.zeros((7, 7))
    a[:3, 3:6] = np.eye(3) * w
    a[3, 4], a[4, 3] = -w, w
    a[3, 0], a[4, 1], a[5, 2] = k / 2 / w, k / 2 / w, -k / w
    a[5, 6] = g / w
    x = np.array([*q0, *(np.array(v0) / w), 1.0])
    return (expm(a * time) @ x)[:3]


@pytest.mark.parametrize("steps", [1, 5, TOGETHER - 1, TOGETHER, TOGETHER + 1, 4999])
def test_powers_of_the_map_are_its_steps(steps):
    a = np.array([[0.0, 0.7, 0.1], [-0.6, 0.0, 0.2], [0.0, 0.0, 0.0]])
    change, x = gauss_change(a, 4), np.array([1.0, -0.5, 1.0])
    found = orbit(change, x, steps)
    assert found.shape == (steps + 1, 3)
    for k in range(steps):
        assert np.abs(found[k] + change @ found[k] - found[k + 1]).max() < 1e-11
    assert np.array_equal(found[0], x)


def test_the_map_is_that_of_gauss_collocation():
    a = np.random.default_rng(1).normal(size=(5, 5))
    assert np.allclose(gauss_change(a, 1), np.linalg.solve(np.eye(5) - a / 2, a), atol=1e-14)
    assert np.allclose(gauss_change(a, 8) + np.eye(5), expm(a), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backwards", [False, True])
def test_an_electron_in_a_trap_goes_round_often(backwards):
    q0, v0, time = [1e-5, 0.0, 1e-4], [1e5, 2e4, 0.0], -3e-8 if backwards else 3e-8
    motion = vi.simulate(TRAP, q0=q0, v0=v0, duration=time)
    assert "one linear map a step" in motion.stats["backend"]
    error = np.abs(motion.q[-1] - of_trap(q0, v0, time)).max() / np.abs(motion.q).max()
    assert error < motion.stats["error_estimate"] + 1e-11  # of expm
    assert motion.stats["error_estimate"] < 1e-9
    grid = {"duration": time, "steps": motion.stats["steps"], "rule": motion.rule}
    by_steps = vi.simulate(TRAP, q0=q0, v0=v0, **grid)
    scale = np.abs(by_steps.q).max(axis=0)
    assert (np.abs(motion.q - by_steps.q) / scale).max() < 1e-10
    assert (np.abs(motion.p - by_steps.p) / np.abs(by_steps.p).max(axis=0)).max() < 1e-10


def test_powers_of_the_map_are_what_the_core_steps_by():
    start = {"q0": [1e-5, 0.0, 1e-4], "v0": [1e5, 2e4, 0.0]}
    motion = vi.simulate(TRAP, **start, duration=3e-8)
    size = np.ptp(motion.q, axis=0)
    by_powers = vi.simulate(TRAP, **start, duration=3e-8, scale=size)
    assert by_powers.stats["backend"] == TOLD != motion.stats["backend"]
    few, many = motion.stats["steps"], by_powers.stats["steps"]
    both = math.gcd(few, many)
    assert both > 1
    apart = by_powers.q[:: many // both] - motion.q[:: few // both]
    assert (np.abs(apart) / size).max() < 1e-9  # both are asked for


def test_a_short_fall_takes_the_map_and_is_exact_but_for_round_off():
    q, v = vi.coordinates("x", "z")
    fall = vi.System(q, v, 0.3 * ca.sumsqr(v) / 2 - 0.3 * 9.81 * q[1])
    motion = vi.simulate(fall, q0=[0.0, 2.0], v0=[10.0, 12.0], duration=2.4)
    exact = np.stack((10 * motion.t, 2 + 12 * motion.t - 9.81 / 2 * motion.t**2), axis=1)
    assert "one linear map a step" in motion.stats["backend"]
    assert np.abs(motion.q - exact).max() < 1e-13 < motion.stats["error_estimate"] < 1e-9
    with_more = vi.simulate(fall, q0=[0.0, 2.0], v0=[10.0, 12.0], duration=2.4, save_every=2)
    assert np.array_equal(with_more.q, motion.q[::2])  # the long way decides alike


def test_what_no_single_map_steps_is_left_to_others():
    q, v = vi.coordinates("x")
    t = vi.time()
    spring = v**2 / 2 - q**2 / 2
    assert is_one_map(vi.System(q, v, spring), vi.gauss(4))
    assert not is_one_map(vi.System(q, v, spring), vi.composition("blanes-moan4"))
    assert not is_one_map(vi.System(q, v, spring), vi.lobatto(4))
    assert not is_one_map(vi.System(q, v, spring, force=-0.1 * v), vi.gauss(4))
    assert not is_one_map(vi.System(q, v, spring + q * ca.cos(t), t=t), vi.gauss(4))
    assert not is_one_map(vi.System(q, v, spring - q**4), vi.gauss(4))


@pytest.mark.parametrize("duration", [200.0, 5000.0])
def test_masses_on_a_spring_that_drift_are_told_no_more_exactly_than_round_off_lets_them(duration):
    q, v = vi.coordinates("x", "y")
    k, m, M = 0.7, 1.3, 0.45
    system = vi.System(q, v, (m * v[0] ** 2 + M * v[1] ** 2) / 2 - k * (q[0] - q[1]) ** 2 / 2)
    motion = vi.simulate(system, q0=[0.3, -0.2], v0=[0.11, 0.37], duration=duration)
    w = np.sqrt(k * (1 / m + 1 / M))
    middle = (m * 0.3 - M * 0.2 + (m * 0.11 + M * 0.37) * motion.t) / (m + M)
    apart = 0.5 * np.cos(w * motion.t) - 0.26 / w * np.sin(w * motion.t)
    exact = np.stack((middle + M / (m + M) * apart, middle - m / (m + M) * apart), axis=1)
    error = np.abs(motion.q - exact).max() / np.abs(exact).max()
    assert "one linear map a step" in motion.stats["backend"]
    assert error < motion.stats["error_estimate"] < 1e-9
