"""Inertia tensors that a fit cannot make impossible: any ten numbers are a body's."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.multibody as mb


def triangle(inertia: np.ndarray) -> float:
    """The sum of the two smaller principal moments by the largest: at least 1 for any body."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    return (low + middle) / high


def test_every_ten_numbers_are_a_body_and_every_body_has_its_ten():
    rng = np.random.default_rng(1)
    for _ in range(20):
        theta = rng.normal(size=10)
        mass, com, inertia = mb.rigid_body(theta)
        assert mass > 0 and triangle(inertia) > 1
        assert np.abs(mb.log_cholesky(mass, com, inertia) - theta).max() < 1e-9
        points, weights = rng.normal(size=(5, 3)), rng.uniform(0.1, 1, 5)  # a cloud of masses
        com = weights @ points / weights.sum()
        off = points - com
        second = (off.T * weights) @ off
        cloud = weights.sum(), com, np.trace(second) * np.eye(3) - second
        again = mb.rigid_body(mb.log_cholesky(*cloud))
        assert all(
            np.allclose(a, b, rtol=1e-12, atol=1e-12) for a, b in zip(again, cloud, strict=True)
        )
    symbols = ca.SX.sym("theta", 10)
    found = ca.Function("body", [symbols], list(mb.rigid_body(symbols)))(theta)
    for a, b in zip(found, mb.rigid_body(theta), strict=True):
        assert np.allclose(np.array(a).squeeze(), b, rtol=1e-14)


def test_what_no_body_has_is_refused_in_words():
    for given, words in (
        ((1.0, [0, 0, 0], [1.0, 1.0, 2.5]), "no body has the principal moments"),
        ((0.0, [0, 0, 0], 1.0), "mass must be positive"),
        ((1.0, [0, 0, 0], [-1.0, 1.0, 1.0]), "negative principal moment"),
    ):
        with pytest.raises(vi.InputError, match=words):
            mb.log_cholesky(*given)
    for theta in (np.zeros(9), ca.SX.sym("theta", 9)):
        with pytest.raises(vi.InputError, match="9"):
            mb.rigid_body(theta)


def tumbling(inertia: ca.SX, c: vi.Parameters) -> vi.System:
    """A body on a ball joint at its centre of mass, in Cardan angles, on springs of known rates."""
    q, v = vi.coordinates("a", "b", "c")
    turns = [
        mb.axis_rotation(axis, angle)
        for axis, angle in zip(np.eye(3), ca.vertsplit(q), strict=True)
    ]
    spin, rest = ca.SX.zeros(3), ca.SX.eye(3)
    for axis, turn, rate in reversed(list(zip(np.eye(3), turns, ca.vertsplit(v), strict=True))):
        spin += ca.mtimes(rest.T, ca.DM(axis)) * rate
        rest = ca.mtimes(turn, rest)
    springs = 2 * q[0] ** 2 + 3 * q[1] ** 2 + 4 * q[2] ** 2
    kinetic = ca.dot(spin, ca.mtimes(inertia, spin)) / 2
    return vi.System(q, v, kinetic - springs, params=c)


RUN = dict(q0=[0.3, -0.2, 0.4], v0=[0.5, 1.0, -0.4], h=0.05)


def seen_of(system: vi.System, spread: float, **truth) -> vi.Measurement:
    motion = vi.simulate(system, vi.gauss(2), **RUN, steps=60, params=truth)
    noise = -spread * np.random.default_rng(5).normal(size=(16, 3))
    return vi.Measurement(system.q, motion.t[::4], motion.q[::4] + noise, sigma=max(spread, 1e-3))


@pytest.mark.parametrize("spread", [0.0, 0.02])
def test_a_fit_of_a_full_inertia_finds_a_body(spread):
    true = np.array([[0.9, 0.05, 0.0], [0.05, 0.7, 0.02], [0.0, 0.02, 1.3]])
    theta = mb.log_cholesky(1.0, [0, 0, 0], true)
    c = vi.Parameters(d=[-0.5, -0.4, -0.8], s=[0.0, 0.0, 0.0])
    body = tumbling(mb.rigid_body(ca.vertcat(0.0, c.d, c.s, 0.0, 0.0, 0.0))[2], c)
    data = seen_of(body, spread, d=theta[1:4], s=theta[4:7])
    found = vi.fit(body, vi.gauss(2), data=data, unknown=["d", "s"], **RUN)
    fitted = np.concatenate([[0.0], found.params["d"], found.params["s"], np.zeros(3)])
    inertia = mb.rigid_body(fitted)[2]
    assert triangle(inertia) > 1
    assert np.abs(inertia - true).max() < (0.2 if spread else 1e-8)


def test_moments_that_are_free_are_fitted_by_what_no_body_is():
    true = np.array([[0.9, 0.05, 0.0], [0.05, 0.5, 0.02], [0.0, 0.02, 1.385]])  # almost flat
    assert 1 < triangle(true) < 1.02
    c = vi.Parameters(m=np.diag(true), p=[0.05, 0.0, 0.02])
    rows = [[c.m[0], c.p[0], c.p[1]], [c.p[0], c.m[1], c.p[2]], [c.p[1], c.p[2], c.m[2]]]
    system = tumbling(ca.vertcat(*(ca.horzcat(*row) for row in rows)), c)
    data = seen_of(system, 0.1)
    fitted = vi.fit(system, vi.gauss(2), data=data, unknown=["m", "p"], **RUN).params
    m, p = fitted["m"], fitted["p"]
    found = np.array([[m[0], p[0], p[1]], [p[0], m[1], p[2]], [p[1], p[2], m[2]]])
    assert triangle(found) < 1
    with pytest.raises(vi.InputError, match="no body"):
        mb.log_cholesky(1.0, [0, 0, 0], found)
