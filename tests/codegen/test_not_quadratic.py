"""Lagrangians that are not quadratic in v in the compiled loops."""

import casadi as ca
import numpy as np
import pytest
from references import end_by_dop853

import varint as vi
from varint.codegen.cache import compiler


def gyrating() -> vi.System:
    """A relativistic charge, m = c = 1, in B = 2 along z."""
    q, v = vi.coordinates("x", "y", "z")
    return vi.System(q, v, -ca.sqrt(1 - ca.sumsqr(v)) + q[0] * v[1] - q[1] * v[0])


def orbiting() -> vi.System:
    """A relativistic planet, with friction and a push."""
    q, v = vi.coordinates("x", "y")
    t, u = vi.time(), ca.SX.sym("u")
    lagrangian = -ca.sqrt(1 - ca.sumsqr(v)) + 1 / ca.norm_2(q)
    force = ca.vertcat(u * ca.cos(t), -0.01 * v[1])
    return vi.System(q, v, lagrangian, force=force, control=u, t=t)


def stiffening() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 + v**4 / 4 - q**2 / 2)


PUSHES = np.sin(np.arange(60) / 5)[:, None] / 50
SCENES = {
    "gyrating": (gyrating, {"q0": [1.0, 0, 0], "v0": [0, 0.9, 0.1]}),
    "orbiting": (orbiting, {"q0": [3.0, 0], "v0": [0, 0.5], "u": PUSHES}),
    "stiffening": (stiffening, {"q0": 1.0, "v0": 0.5}),
}
RULES = [vi.midpoint(), vi.gauss(3), vi.lobatto(3)]


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("scene", SCENES)
def test_native_steps_are_the_interpreted_ones(scene, rule):
    make, start = SCENES[scene]
    run = {**start, "h": 0.05, "steps": 60}
    native, interpreted = (
        vi.simulate(make(), rule, **run, backend=backend) for backend in ("native", "interpreted")
    )
    method = "Gauss" if rule == vi.gauss(3) else "Newton"
    assert native.stats["backend"].startswith(f"native: {method}")
    for name in ("q", "p", "v"):
        one, other = getattr(native, name), getattr(interpreted, name)
        assert np.abs(one - other).max() < 1e-13 * max(np.abs(other).max(), 1)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("scene", ("orbiting", "stiffening"))
def test_both_gears_give_the_same_bytes(scene):
    make, start = SCENES[scene]
    low, high = (
        vi.simulate(make(), vi.gauss(2), **start, h=0.05, steps=60, backend=backend)
        for backend in ("native", "compiled")
    )
    for name in ("q", "p", "v"):
        assert getattr(low, name).tobytes() == getattr(high, name).tobytes()


@pytest.mark.parametrize("rest", (1e-2, 1e-4, 1e-6))
def test_velocities_belong_to_the_momenta_close_to_the_speed_of_light(rest):
    """p = γ v + A(q) at every node, 1 − v² found to the round-off of v; save_every changes no q."""
    start = {"q0": [1.0, 0, 0], "v0": [0, np.sqrt(1 - rest), 0]}
    gamma = 1 / np.sqrt(rest)
    run = {**start, "h": 0.01, "steps": 210}
    motion = vi.simulate(gyrating(), vi.gauss(4), **run, backend="native")
    x, y, _ = motion.q.T
    kinetic = motion.p - np.stack([-y, x, 0 * x], axis=1)
    expected = kinetic / np.sqrt(1 + (kinetic**2).sum(1))[:, None]
    assert np.abs(motion.v - expected).max() < 4e-16 + 4e-16 * gamma
    some = vi.simulate(gyrating(), vi.gauss(4), **run, save_every=7, backend="native")
    assert some.q.tobytes() == motion.q[some.k].tobytes()


def test_a_relativistic_charge_goes_round_with_the_frequency_of_its_energy():
    """ω = B/γ on a circle of radius γ v/B: the closed form."""
    speed = 0.8
    gamma = 1 / np.sqrt(1 - speed**2)
    start = {"q0": [0.0, 0, 0], "v0": [speed, 0, 0.0]}
    motion = vi.simulate(gyrating(), vi.gauss(6), **start, h=0.1, steps=400, backend="native")
    angle, radius = 2 / gamma * motion.t, gamma * speed / 2
    exact = radius * np.stack([np.sin(angle), np.cos(angle) - 1, 0 * angle], axis=1)
    assert np.abs(motion.q - exact).max() < 1e-11


def test_constraints_on_such_a_scene_stay_interpreted():
    q, v = vi.coordinates("x", "y")
    held = vi.System(q, v, -ca.sqrt(1 - ca.sumsqr(v)), constraint=ca.sumsqr(q) - 1)
    motion = vi.simulate(held, vi.lobatto(3), q0=[1, 0], v0=[0, 0.5], h=0.05, steps=10)
    assert motion.stats["backend"] == "interpreted"
    assert np.abs((motion.q**2).sum(1) - 1).max() < 1e-14


@pytest.mark.parametrize("tol", (1e-6, 1e-9, 1e-11))
def test_a_call_with_a_duration_alone_proves_its_error_in_the_core(tol, monkeypatch):
    """The circle in closed form; no run of Python's is asked for, and velocities come with it."""

    def refused(*_):
        raise AssertionError("the core did not prove it")

    monkeypatch.setattr("varint.integration.tolerance.by_plain_trials", refused)
    speed = 0.8
    gamma = 1 / np.sqrt(1 - speed**2)
    start = {"q0": [0.0, 0, 0], "v0": [speed, 0, 0.0]}
    motion = vi.simulate(gyrating(), **start, duration=40.0, tol=tol)
    angle, radius = 2 / gamma * motion.t, gamma * speed / 2
    exact = radius * np.stack([np.sin(angle), np.cos(angle) - 1, 0 * angle], axis=1)
    error = np.abs(motion.q - exact).max() / (2 * radius)
    assert error < motion.stats["error_estimate"] <= tol
    moving = speed * np.stack([np.cos(angle), -np.sin(angle), 0 * angle], axis=1)
    assert np.abs(motion.__dict__["v"] - moving).max() < 10 * tol


def test_the_stages_go_over_to_newtons_method_where_inertia_magnifies_round_off():
    """p = r v/√(1 + v²) hardly depends on v = 40: r = cosh to the round-off of the start."""
    q, v = vi.coordinates("r")
    film, slope = vi.System(q, v, q * ca.sqrt(1 + v**2)), 40.0
    run = {"q0": np.sqrt(1 + slope**2), "v0": slope, "h": 0.01, "steps": 50}
    motion = vi.simulate(film, vi.gauss(8), **run, backend="native")
    exact = np.cosh(np.arcsinh(slope) + motion.t)
    assert np.abs(motion.q[:, 0] / exact - 1).max() < 1e-11
    assert motion.stats["residual"] < 1e-14


@pytest.mark.parametrize("seed", (8, 15, 42, 56, 84))
def test_a_metric_that_depends_on_directions_needs_no_rest(seed):
    """Randers' F² is not defined at rest; changes of forces come one evaluation after those of
    velocities, which was taken for divergence.
    """
    q, v = vi.coordinates("x", "y")
    length = ca.norm_2(v) + 0.3 * ca.cos(q[1]) * v[0]
    system = vi.System(q, v, length**2 / 2 - 0.1 * q[0] * q[1])
    random = np.random.default_rng(0)
    for _ in range(seed + 1):
        q0, v0, duration = random.normal(size=2), random.normal(size=2), random.uniform(0.1, 2)
    motion = vi.simulate(system, q0=q0, v0=v0, duration=duration)
    error = np.abs(motion.q[-1] - end_by_dop853(system, q0, v0, duration)).max()
    assert error < 1e-9 * np.abs(motion.q).max() and motion.stats["steps"] < 100
    stepped = vi.simulate(system, q0=q0, v0=v0, duration=duration, steps=30)
    assert np.abs(stepped.v[0] - v0).max() < 1e-13  # found from the momentum


def test_round_off_of_a_rest_energy_ends_iterations():
    """A relativistic charge in a magnetic bottle: c² of rest energy left changes of a few last
    digits, at which single steps of every run failed.
    """
    q, v = vi.coordinates("x", "y", "z")
    c, field = 14.74, 11.1 * (1 + (q[2] / 1.508) ** 2)
    lagrangian = -(c**2) * ca.sqrt(1 - ca.sumsqr(v) / c**2) + field * (q[0] * v[1] - q[1] * v[0])
    system = vi.System(q, v, lagrangian)
    start = [-0.106, -0.772, -0.179], [-0.055, 0.168, -0.984]
    exact = end_by_dop853(system, *start, 5.1)
    for tol in (1e-5, 1e-9):
        motion = vi.simulate(system, q0=start[0], v0=start[1], duration=5.1, tol=tol)
        error = np.abs(motion.q[-1] - exact).max()
        assert error < tol * np.abs(motion.q).max() and motion.stats["steps"] <= 4096
