"""Runs of linear scenes with forces or explicit time, whose steps are one map of x = (q, p) and one
of what drives it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import varint as vi
import varint.integration.short_call as short_call
from varint.codegen.driven import has_driven_map, is_driven, native_driven, polynomials
from varint.codegen.kernel import run_loop
from varint.integration.error_scale import error_scales
from varint.integration.linear_run import runs_driven

q3, v3 = vi.coordinates("x", "y", "z")
t = vi.time()
MASS = np.array([[3e3, 20.0, 0.0], [20.0, 2.0, 0.1], [0.0, 0.1, 5e-2]])
SPRING = np.array([[9e3, -30.0, 0.0], [-30.0, 40.0, -1.0], [0.0, -1.0, 2.0]])
FRICTION = np.diag([200.0, 0.4, 0.0])
GYRO = np.array([[0.0, 12.0, 0.0], [-12.0, 0.0, 0.3], [0.0, -0.3, 0.0]])
RATE = 2.3


def shaken() -> vi.System:
    """Springs, friction and gyroscopic forces, driven by a force, a moving frame and gravity."""
    wind = v3[1] * ca.sin(RATE * t)
    lagrangian = ca.bilin(MASS, v3, v3) / 2 - ca.bilin(SPRING, q3, q3) / 2 + wind - 0.2 * q3[2]
    push = ca.vertcat(50 * ca.cos(RATE * t), 0, 0)
    return vi.System(q3, v3, lagrangian, force=push - (FRICTION + GYRO) @ v3, t=t)


def exact(q0: np.ndarray, v0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """By the matrix exponential of (q, v, cos, sin, 1): M v' = −K q − (D + G) v + drive, where the
    wind adds −d/dt sin to the second row.
    """
    a, inverse = np.zeros((9, 9)), np.linalg.inv(MASS)
    a[:3, 3:6], a[3:6, :3] = np.eye(3), -inverse @ SPRING
    a[3:6, 3:6] = -inverse @ (FRICTION + GYRO)
    a[3:6, 6] = inverse @ np.array([50.0, -RATE, 0.0])
    a[3:6, 8] = inverse @ np.array([0.0, 0.0, -0.2])
    a[6, 7], a[7, 6] = -RATE, RATE
    x = np.array([*q0, *v0, 1.0, 0.0, 1.0])
    return np.array([(expm(a * time) @ x)[:3] for time in times])


@pytest.mark.parametrize("stages", [1, 2, 3, 8])
def test_polynomials_are_those_of_the_stages(stages):
    rule, z = vi.gauss(stages), 0.7
    c, b, k = np.array(rule.nodes), np.array(rule.weights), np.arange(stages)
    a = np.linalg.solve((c[:, None] ** k).T, (c[:, None] ** (k + 1) / (k + 1)).T).T
    left, odd, of = (x @ z ** np.arange(stages + 1) for x in polynomials(rule))
    row = np.linalg.solve((np.eye(stages) - z * a).T, b)
    assert of / left == pytest.approx(row, rel=1e-11)
    assert odd / left == pytest.approx(z * row.sum(), rel=1e-11)
    assert left == pytest.approx(np.linalg.det(np.eye(stages) - z * a), rel=1e-11)


@pytest.mark.parametrize("h", [0.3, -0.05])
@pytest.mark.parametrize("stages", [1, 4, 8])
def test_a_step_is_that_of_gauss_collocation(stages, h):
    scene, rule, steps = shaken(), vi.gauss(stages), 21
    q0, v0 = np.array([0.1, -0.2, 0.3]), np.array([0.0, 0.5, -1.0])
    motion = vi.simulate(scene, rule, q0=q0, v0=v0, h=h, steps=steps, t0=0.4)
    kernel = native_driven(scene, rule)
    how = {"t0": 0.4, "h": h, "steps": steps, "save_every": 1, "u": None}
    found = run_loop(kernel, motion.q[0], motion.p[0], motion.c, **how)
    for k, nodes in enumerate((motion.q, motion.p)):
        scale = np.abs(nodes).max(axis=0)
        assert (np.abs(found.rows[:, k] - nodes) / scale).max() < 3e-13
    first = run_loop(kernel, motion.q[0], motion.p[0], motion.c, **how | {"steps": 8})
    rest = how | {"steps": steps - 8, "first": 8, "carry": first.carry}
    second = run_loop(kernel, first.last[:3], first.last[3:6], motion.c, **rest)
    assert (np.abs(second.rows[-1, 0] - motion.q[-1]) / np.abs(motion.q).max(axis=0)).max() < 3e-13


@pytest.mark.parametrize("stages", [1, 2, 5, 8])
@pytest.mark.parametrize("steps", [1, 8, 19])
def test_steps_that_controls_drive_are_those_of_gauss_collocation(stages, steps):
    free, u = shaken(), ca.SX.sym("u", 2)
    force = free.force + ca.vertcat(0, u[0] * u[1], ca.sin(u[1] + t))
    scene = vi.System(q3, v3, free.lagrangian, force=force, control=u, t=t)
    rule, rng = vi.gauss(stages), np.random.default_rng(stages)
    given = rng.uniform(-2, 2, (steps, stages, 2))
    asked = {"t0": 0.4, "h": 0.05, "steps": steps}
    start = {"q0": [0.3, 0.1, -0.2], "v0": [0.1, -0.4, 2.0]}
    motion = vi.simulate(scene, rule, **start, **asked, u=given)
    kernel = native_driven(scene, rule)
    assert (kernel.controls, kernel.nodes) == (2, stages)
    found = run_loop(kernel, motion.q[0], motion.p[0], motion.c, **asked, u=given)
    for k, nodes in enumerate((motion.q, motion.p)):
        scale = np.abs(nodes).max(axis=0)
        assert (np.abs(found.rows[:, k] - nodes) / scale).max() < 3e-13


@pytest.mark.parametrize("tol", [1e-4, 1e-9, 1e-12])
@pytest.mark.parametrize("at_rest", [True, False])
@pytest.mark.parametrize("duration", [0.5, 20.0, -2.0])
def test_estimates_stay_above_errors(duration, at_rest, tol):
    scene = shaken()
    q0, v0 = (np.zeros(3), np.zeros(3)) if at_rest else (np.ones(3), np.array([0.0, 2.0, -1.0]))
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=duration, tol=tol)
    assert tol < 1e-9 or "one linear map" in motion.stats["backend"]
    error = (np.abs(motion.q - exact(q0, v0, motion.t)) / error_scales(scene, motion)).max()
    assert error <= motion.stats["error_estimate"] + 1e-13 and motion.stats["error_estimate"] <= tol


def test_a_loop_that_is_asked_for_is_taken():
    how = {"q0": [0.1, 0, 0], "v0": [0, 0, 0], "duration": 2.0}
    motion = vi.simulate(shaken(), **how)
    asked = vi.simulate(shaken(), **how, backend="native")
    assert "one linear map" in motion.stats["backend"]
    assert "one linear map" not in asked.stats["backend"]
    gap = np.abs(motion.q[-1] - asked.q[-1]) / error_scales(shaken(), motion)
    assert gap.max() < 2e-9


def test_the_first_parts_show_the_work_on_what_is_at_rest(monkeypatch):
    """Its power is zero at the first node, and large between it and the next one."""
    monkeypatch.setattr(short_call, "looked_at", lambda *_: pytest.fail("a closer look"))
    q, v = vi.coordinates("body", "wheel")
    road = 0.05 * ca.sin(8 * t)
    spring = 2e4 * (q[0] - q[1]) ** 2 / 2 + 2e5 * (q[1] - road) ** 2 / 2
    push = 1500 * (v[1] - v[0])
    lagrangian = 1200 * v[0] ** 2 / 2 + 40 * v[1] ** 2 / 2 - spring
    scene = vi.System(q, v, lagrangian, force=ca.vertcat(push, -push), t=t)
    motion = vi.simulate(scene, q0=[0.1, 0], v0=[0, 0], duration=10.0)
    assert motion.stats["error_estimate"] <= 1e-9


@pytest.mark.parametrize("tol", [1e-11, 1e-9])
def test_what_drifts_counts_the_round_off_of_the_map(tol):
    """A free chain whose middle is pushed to and fro: what a map makes of it adds up as steps²."""
    n, k = 6, 1.7
    q, v = vi.coordinates(*[f"x{i}" for i in range(n)])
    lagrangian = v[0] ** 2 / 2 + 11 * ca.sumsqr(v[1:]) / 2 - k / 2 * ca.sumsqr(q[1:] - q[:-1])
    push = ca.vertcat(ca.sin(1.3 * t), ca.SX.zeros(n - 1))
    scene = vi.System(q, v, lagrangian, force=push, t=t)
    q0, v0, duration = np.linspace(0, 1, n), np.linspace(0.1, 0.3, n), 3000.0
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=duration, tol=tol)
    assert ("one linear map" in motion.stats["backend"]) == (tol == 1e-9)
    mass = np.array([1.0] + [11.0] * (n - 1))
    apart = np.diff(np.eye(n), axis=0)
    squares, ways = np.linalg.eigh(k * (apart.T @ apart) / np.sqrt(np.outer(mass, mass)))
    rates = np.sqrt(np.maximum(squares, 0))
    x, y = (ways.T @ (np.sqrt(mass) * z) for z in (q0, v0))
    push = ways[0] / np.sqrt(mass[0])
    modes = np.empty(n)
    modes[0] = x[0] + y[0] * duration + push[0] * (duration / 1.3 - np.sin(1.3 * duration) / 1.69)
    w, forced = rates[1:], push[1:] / (squares[1:] - 1.69)
    modes[1:] = x[1:] * np.cos(w * duration) + (y[1:] - 1.3 * forced) * np.sin(w * duration) / w
    modes[1:] += forced * np.sin(1.3 * duration)
    error = np.abs(motion.q[-1] - ways @ modes / np.sqrt(mass)) / np.ptp(motion.q, axis=0)
    assert error.max() <= motion.stats["error_estimate"] + 2e-12  # of the closed form
    assert motion.stats["error_estimate"] <= tol


def test_what_no_constant_map_steps_is_left_to_others():
    q, v = vi.coordinates("x")
    spring = v**2 / 2 - q**2 / 2
    assert runs_driven(vi.System(q, v, spring, force=-0.1 * v))
    assert runs_driven(vi.System(q, v, spring + q * ca.cos(t), t=t))
    assert is_driven(vi.System(q, v, spring)) and not runs_driven(vi.System(q, v, spring))
    assert not runs_driven(vi.System(q, v, spring - q**2 * ca.cos(t), t=t))
    assert not runs_driven(vi.System(q, v, (1 + 0.1 * ca.sin(t)) * spring, t=t))
    assert not runs_driven(vi.System(q, v, spring, force=-(v**3)))
    assert not runs_driven(vi.System(q, v, spring, force=ca.sign(ca.sin(t)), t=t))
    u = ca.SX.sym("u")
    pushed = vi.System(q, v, spring, force=3 * u - 0.1 * v, control=u)
    assert is_driven(pushed) and not runs_driven(pushed)  # by what is told of the time alone
    assert not is_driven(vi.System(q, v, spring, force=-u * v, control=u))
    free = vi.System(q, v, spring, force=-0.1 * v)
    assert has_driven_map(free, vi.gauss(3)) and not has_driven_map(free, vi.lobatto(4))
