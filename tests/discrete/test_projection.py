"""`project`: the foot of the perpendicular, wherever there is one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi


def conic(q: ca.SX, a: float, sign: int) -> ca.SX:
    return q[0] ** 2 + sign * a * q[1] ** 2 - 1


def ellipsoid(q: ca.SX, a: float) -> ca.SX:
    return q[0] ** 2 + a * q[1] ** 2 + np.sqrt(a) * q[2] ** 2 - 1


def curve_in_space(q: ca.SX, a: float) -> ca.SX:
    return ca.vertcat(conic(q, a, 1), q[2] - ca.sin(q[0]))


SURFACES = {
    "ellipse": (2, lambda q, a: conic(q, a, 1)),
    "hyperbola": (2, lambda q, a: conic(q, a, -1)),
    "ellipsoid": (3, ellipsoid),
    "curve in space": (3, curve_in_space),
}


@pytest.mark.parametrize("a", [0.01, 0.5, 1.0, 5.0, 100.0, 400.0])
@pytest.mark.parametrize("name", SURFACES)
def test_no_point_is_refused_and_each_comes_to_its_foot(name, a):
    n, surface = SURFACES[name]
    names = ("x", "y", "z")[:n]
    q, v = vi.coordinates(*names)
    mass = np.array([1.0, 3.0, 0.2])[:n]
    system = vi.System(q, v, ca.dot(mass, v**2) / 2, constraint=surface(q, a))
    slope = ca.Function("slope", [q], [system.constraint, ca.jacobian(system.constraint, q)])
    rng = np.random.default_rng(3)
    for _ in range(25):
        away = rng.normal(size=n) * 10 ** rng.uniform(-1.5, 1.5)
        foot, _ = vi.project(system, away)
        g, rows = (np.asarray(x) for x in slope(foot))
        assert np.abs(g).max() < 1e-11 * max(np.abs(rows).max(), 1)
        left = mass * (away - foot)
        lam = np.linalg.lstsq(rows.T, left, rcond=None)[0]
        size = np.abs(mass).max() * max(np.abs(away).max(), np.abs(foot).max())
        assert np.abs(left - rows.T @ lam).max() < 1e-10 * size


def test_the_foot_is_the_nearest_point_of_an_ellipse():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=conic(q, 4.0, 1))
    angle = np.linspace(0, 2 * np.pi, 100_001)
    curve = np.stack([np.cos(angle), np.sin(angle) / 2], axis=1)
    for away in ([3.0, 2.0], [0.9, 0.1], [-0.2, 5.0], [0.5, 0.55]):
        foot, _ = vi.project(system, away)
        nearest = np.linalg.norm(curve - away, axis=1).min()
        assert np.linalg.norm(foot - away) < nearest + 1e-8


def test_where_gradients_vanish_a_way_is_found_all_the_same():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    foot, _ = vi.project(system, [0.0, 0.0])
    assert np.linalg.norm(foot) == pytest.approx(1.0, abs=1e-12)


def test_a_mass_that_is_not_finite_is_refused():
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 + ca.sin(ca.sqrt(v[0])) - q[0]
    rolling = vi.System(q, v, lagrangian, nonholonomic=ca.horzcat(q[0], q[0]))
    with pytest.raises(vi.InputError, match=r"mass matrix .* is not finite at q0"):
        vi.project(rolling, [0.0, 0.0], [0.0, 0.0])


def test_rows_that_cannot_hold_are_still_refused():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) + 1)
    with pytest.raises(vi.InputError, match="no configuration near"):
        vi.project(system, [0.3, 0.4])


@pytest.mark.parametrize(
    "row, q0",
    [
        (lambda q: q[1] / q[0], [2.2250738585072014e-308, 0.0]),
        (lambda q: q[1] / q[0] - 4.49423e307, [2.2250738585072014e-308, 1.0]),
    ],
)
def test_rows_whose_slopes_are_not_finite_are_refused(row, q0):
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, 1e-20 * (ca.dot(v, v) / 2 - q[0]), constraint=row(q))
    with pytest.raises(vi.InputError, match="not finite or too large"):
        vi.project(scene, q0, [0.0, 0.0])


def test_a_root_at_its_end_is_come_to_from_within():
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.dot(v, v) / 2 - q[0], constraint=ca.sqrt(q[0]))
    foot, _ = vi.project(scene, [0.0, 0.0], [0.0, 0.0])
    assert 0 <= foot[0] < 1e-30
