"""Fits of scenes with quaternions know three numbers of an attitude, not four."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.multibody as mb

INERTIA, SPIN = (0.6, 0.75, 0.5), [0.4, -0.3, 3.0]
ANGLES = np.array([0.3, 0.5, -0.4])  # about z, y, x by turns
TIPS = np.eye(3)


def by_quaternion() -> tuple[mb.Model, tuple[np.ndarray, np.ndarray]]:
    world = mb.Model()
    world.spherical(world, world.body(1.0, (0, 0, 0.3), INERTIA, "top"))
    z, y, x = np.eye(3)[::-1]
    turned = [mb.axis_rotation(axis, a) for axis, a in zip((z, y, x), ANGLES, strict=True)]
    attitude = mb.matrix_quaternion(turned[0] @ turned[1] @ turned[2])
    return world, mb.start_values(world, {"top": attitude}, {"top": SPIN})


def by_angles() -> tuple[mb.Model, tuple[np.ndarray, np.ndarray], ca.Function]:
    """The same top on three hinges, and E with ω = E dα/dt along its axes."""
    world, last = mb.Model(), "world"
    for k, axis in enumerate(np.eye(3)[::-1]):
        whole = world.body(1.0, (0, 0, 0.3), INERTIA, "top") if k == 2 else world.body()
        world.revolute(last, whole, axis, name=f"angle{k}")
        last = whole.name
    frame = world.frame("top")
    omega = ca.mtimes(frame.rotation.T, frame.angular_velocity)
    slope = ca.Function("E", [frame.q], [ca.jacobian(omega, frame.v)])
    return world, (ANGLES, np.linalg.solve(np.array(slope(ANGLES)), SPIN)), slope


def fitted(world: mb.Model, start: tuple, noise: np.ndarray) -> vi.Fit:
    world.symbolic("top.mass")
    rule, h, steps = vi.gauss(3), 0.02, 20
    frames = [world.frame(("top", tip)).position for tip in TIPS]
    motion = vi.simulate(world.system(), rule, q0=start[0], v0=start[1], h=h, steps=steps)
    seen = [
        vi.Measurement(x, motion.t, motion.value(x) + some, sigma=1e-3)
        for x, some in zip(frames, noise, strict=True)
    ]
    given = dict(unknown=["q0", "v0", "top_mass"], h=h, q0=start[0], v0=start[1])
    return vi.fit(world.system(), rule, data=seen, params=dict(top_mass=1.1), **given)


@pytest.mark.filterwarnings("error")
def test_attitude_and_mass_are_found_as_by_three_angles():
    """Same data, two sets of coordinates: one optimum, one covariance of the rotation vector."""
    noise = 1e-3 * np.random.default_rng(4).normal(size=(3, 21, 3))
    ball, start = by_quaternion()
    found = fitted(ball, start, noise)
    hinged, angles, spin_of_rates = by_angles()
    other = fitted(hinged, angles, noise)
    assert found.freedom == other.freedom == 3 * 21 * 3 - 7
    assert np.isclose(found.chi_squared, other.chi_squared, rtol=1e-9)
    assert np.isclose(found.params["top_mass"], other.params["top_mass"], rtol=1e-8)
    sigma = [x.sigma[x.names.index("top_mass")] for x in (found, other)]
    assert np.isclose(*sigma, rtol=1e-6)
    assert np.isclose(np.linalg.norm(found.q0[0]), 1, rtol=1e-14)
    assert abs(found.q0[0] @ found.v0[0]) <= 1e-13
    slope = np.array(spin_of_rates(other.q0[0]))
    at = [other.names.index(f"angle{k}(0)") for k in range(3)]
    wanted = slope @ other.covariance[np.ix_(at, at)] @ slope.T
    assert np.allclose(mb.rotation_covariance(found, "top"), wanted, rtol=1e-5, atol=1e-12)
    quaternion = [found.names.index(f"top_{x}(0)") for x in ("qw", "qx", "qy", "qz")]
    four = found.covariance[np.ix_(quaternion, quaternion)]
    assert np.linalg.matrix_rank(four, tol=1e-9 * four.max()) == 3
    assert abs(four @ found.q0[0]).max() <= 1e-9 * four.max()


def test_a_joint_that_was_not_fitted_is_named():
    ball, (q0, v0) = by_quaternion()
    x = ball.frame(("top", TIPS[0])).position
    motion = vi.simulate(ball.system(), vi.gauss(1), q0=q0, v0=v0, h=0.02, steps=3)
    seen = vi.Measurement(x, motion.t, motion.value(x), sigma=1e-3)
    found = vi.fit(ball.system(), vi.gauss(1), data=seen, unknown=["v0"], h=0.02, q0=q0, v0=v0)
    with pytest.raises(vi.InputError, match="needs 'q0' among its unknowns"):
        mb.rotation_covariance(found, "top")
