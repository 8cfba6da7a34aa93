"""Moving-horizon estimates are the Kalman filter's where scenes are linear, and know their spread
where they are not.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

H = 0.1


def oscillators(damping: float) -> vi.System:
    """Two masses on springs, one pushed, with friction."""
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("push")
    lagrangian = (v[0] ** 2 + 2 * v[1] ** 2 - 3 * q[0] ** 2 - (q[0] - q[1]) ** 2) / 2
    force = ca.vertcat(u, 0) - damping * v
    return vi.System(q, v, lagrangian, force=force, control=u)


def linear_map(system: vi.System, rule: vi.Rule) -> tuple[np.ndarray, np.ndarray]:
    """F and B of x' = F x + B u, from the step itself."""
    step = vi.step_function(system, rule)

    def ends(x: np.ndarray, u: float) -> np.ndarray:
        controls = np.full((1, len(rule.nodes)), u)
        out = step(q0=x[:2], p0=x[2:], u=controls, t=0, h=H)
        return np.array(ca.vertcat(out["q1"], out["p1"])).ravel()

    return np.column_stack([ends(e, 0.0) for e in np.eye(4)]), ends(np.zeros(4), 1.0)


def kalman(f, b, look, q, r, x, p, y, u):
    """Means and covariances of (q, p) after every measurement."""
    means, covariances = [], []
    for k, value in enumerate(y):
        if k:
            x, p = f @ x + b * u[k - 1], f @ p @ f.T + q
        there = np.isfinite(value)
        seen = look[there]
        gain = p @ seen.T @ np.linalg.inv(seen @ p @ seen.T + r[np.ix_(there, there)])
        x, p = x + gain @ (value[there] - seen @ x), p - gain @ seen @ p
        means.append(x)
        covariances.append(p)
    return np.array(means), np.array(covariances)


@pytest.mark.parametrize("horizon", [40, 3, 1])
@pytest.mark.parametrize("disturbance", [[0.05, 0.02], [0.0, 0.03], 0.0])
def test_of_a_linear_scene_it_is_the_kalman_filter(horizon, disturbance):
    system, rule, rng = oscillators(0.3), vi.gauss(2), np.random.default_rng(1)
    f, b = linear_map(system, rule)
    masses, spread = np.array([1.0, 1.0, 1.0, 2.0]), np.array([0.5, 0.4, 0.3, 0.2])
    u, y = np.sin(np.arange(24)), rng.normal(size=(25, 2))
    y[5] = np.nan
    y[9, 1] = np.nan
    look = np.array([[1.0, 0, 0, 0], [1.0, -1.0, 0, 0.25]])  # x; x − y + v_y / 2
    noise = np.diag(np.concatenate([[0, 0], np.broadcast_to(disturbance, 2)]) ** 2)
    sensors = np.diag([0.1**2, 0.2**2])
    start = np.array([0.2, -0.1, 0.3, 0.4])
    means, covariances = kalman(
        f, b, look, noise, sensors, start * masses, np.diag((spread * masses) ** 2), y, u
    )
    q, v = system.q, system.v
    estimator = vi.mhe(
        system,
        rule,
        h=H,
        horizon=horizon,
        measured=ca.vertcat(q[0], q[0] - q[1] + v[1] / 2),
        sigma=[0.1, 0.2],
        q0=start[:2],
        v0=start[2:],
        start_sigma=spread,
        disturbance=disturbance,
    )
    estimate = None
    for k, value in enumerate(y):
        estimate = estimator(value, None if k == 0 else u[k - 1 : k], estimate)
        found = np.concatenate([estimate.q, estimate.v]) * masses
        assert np.abs(found - means[k]).max() < 1e-9
        kept = estimate.covariance * np.outer(masses, masses)
        assert np.abs(kept - covariances[k]).max() < 1e-9
    assert len(estimate.times) == min(horizon, 24) + 1
    assert estimate.t == pytest.approx(24 * H) and estimate.steps <= 3


def pendulum() -> tuple[vi.System, vi.Parameters]:
    q, v = vi.coordinates("theta")
    c = vi.Parameters(g=9.81)
    return vi.System(q, v, v**2 / 2 + c.g * ca.cos(q), params=c), c


def test_from_nothing_the_speed_of_a_pendulum_is_found_and_its_spread_is_right():
    system, _ = pendulum()
    rng, h, misses = np.random.default_rng(5), 0.05, []
    estimator = vi.mhe(
        system, h=h, horizon=8, measured=system.q, sigma=0.02, q0=0, v0=0, disturbance=0.02
    )
    q, v, estimate = 2.5, 0.0, None
    for k in range(120):
        if k:
            moved = vi.simulate(system, q0=q, v0=v, h=h, steps=1)
            q, v = moved.q[-1, 0], moved.v[-1, 0] + 0.02 * rng.normal()
        estimate = estimator(q + 0.02 * rng.normal(), previous=estimate)
        if k == 0:
            assert estimate.covariance[0, 0] == pytest.approx(0.02**2, rel=1e-9)
            assert np.isinf(estimate.covariance[1, 1])
        elif k >= 10:
            off = np.array([estimate.q[0] - q, estimate.v[0] - v])
            misses.append(off @ np.linalg.solve(estimate.covariance, off))
    # squares of two standardised errors, which go together over some ten steps
    assert 1.0 < np.mean(misses) < 3.5
    assert repr(estimate).startswith("Estimate(t=5.95: ")


def test_a_parameter_is_learnt_on_the_way_and_stays_in_its_bounds():
    system, c = pendulum()
    true = vi.simulate(system, q0=1.0, v0=0.0, h=0.05, steps=100)
    given = dict(h=0.05, horizon=6, measured=system.q, sigma=0.01, q0=0.9, v0=0.1)
    free = vi.mhe(system, **given, unknown=[c.g], priors=dict(g=(7.0, 3.0)))
    held = vi.mhe(system, **given, unknown=dict(g=vi.free(8.0, 5.0, 9.0)))
    first = second = None
    for angle in true.q[:, 0]:
        first, second = free(angle, previous=first), held(angle, previous=second)
    assert first.params["g"] == pytest.approx(9.81, abs=0.01)
    assert abs(first.params["g"] - 9.81) < 3 * first.sigma_params["g"] < 0.2
    assert abs(first.v[0] - true.v[-1, 0]) < 0.01
    assert second.params["g"] == 9.0


def test_a_horizon_bears_outliers_with_hubers_loss():
    system, _ = pendulum()
    true = vi.simulate(system, q0=1.0, v0=0.0, h=0.05, steps=60)
    seen = true.q[:, 0] + 0.01 * np.random.default_rng(0).normal(size=61)
    seen[[20, 33, 58]] += 1.0
    off = []
    for huber in (1.5, None):
        estimator = vi.mhe(
            system,
            h=0.05,
            horizon=10,
            measured=system.q,
            sigma=0.01,
            q0=1,
            v0=0,
            disturbance=0.01,
            huber=huber,
        )
        estimate = None
        for angle in seen:
            estimate = estimator(angle, previous=estimate)
        off.append(abs(estimate.q[0] - true.q[-1, 0]))
    assert off[0] < 0.02 < off[1]


@pytest.mark.parametrize("disturbance", [0.0, np.array([0.03, 0.05])], ids=["none", "some"])
@pytest.mark.parametrize("horizon", [20, 2])
def test_two_masses_on_one_rod_are_estimated_as_the_one_body_that_they_are(horizon, disturbance):
    """x − y = ½ for masses 1 and 2: momenta added along the constraint are s (1, 2), of length
    s √(1/σ_x² + 4/σ_y²) in σ, and 3 s together.
    """
    rule, rng = vi.lobatto(2), np.random.default_rng(4)
    q, v = vi.coordinates("x", "y")
    potential = 1.5 * q[0] ** 2 + 0.5 * (q[1] - 0.1) ** 2
    kinetic = (v[0] ** 2 + 2 * v[1] ** 2) / 2
    rod = vi.System(q, v, kinetic - potential, constraint=q[0] - q[1] - 0.5)
    x, w = vi.coordinates("x")
    body = vi.System(x, w, 3 * w**2 / 2 - 1.5 * x**2 - 0.5 * (x - 0.6) ** 2)
    of_body = 0.0
    if np.any(disturbance):
        of_body = 3 / np.sqrt((np.array([1, 2]) ** 2 / disturbance**2).sum())
    y = np.sin(0.3 * np.arange(16)) + 0.1 * rng.normal(size=16)
    given = dict(h=H, horizon=horizon, sigma=0.1)
    one = vi.mhe(
        rod, rule, measured=q[1], q0=[0.7, 0.2], v0=[0, 0], disturbance=disturbance, **given
    )
    two = vi.mhe(body, rule, measured=x - 0.5, q0=0.7, v0=0, disturbance=of_body, **given)
    found = wanted = None
    for value in y:
        found, wanted = one(value, previous=found), two(value, previous=wanted)
    assert found.q[0] - found.q[1] == pytest.approx(0.5, abs=1e-12)
    assert found.v[0] == pytest.approx(found.v[1], abs=1e-12)
    assert found.q[0] == pytest.approx(wanted.q[0], abs=1e-9)
    assert found.v[0] == pytest.approx(wanted.v[0], abs=1e-9)
    along = np.ix_([0, 2], [0, 2])
    assert np.allclose(found.covariance[along], wanted.covariance, rtol=1e-7)


def test_a_pendulum_on_a_circle_is_found_from_its_shadow():
    model, rule = vi.models.pendulum_cartesian(), vi.lobatto(3)
    true = vi.simulate(model.system, rule, q0=model.q0, v0=model.v0, h=0.05, steps=9)
    x = model.system.q[0]
    guess = dict(q0=true.q[0] + [0.0, 1e-3], v0=[0.1, 0.0])
    look = vi.mhe(model.system, rule, h=0.05, horizon=5, measured=x, sigma=1e-3, **guess)
    estimate = None
    for k, value in enumerate(true.q[:, 0]):
        estimate = look(value, previous=estimate)
        if k > 2:
            off = np.hstack([estimate.q - true.q[k], estimate.v - true.v[k]])
            assert np.abs(off).max() < 1e-8
    c = vi.Parameters(length=1.0)
    q, v = vi.coordinates("x", "y")
    rope = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - c.length**2, params=c)
    given = dict(h=0.1, horizon=3, measured=q[0], sigma=0.1, q0=[1, 0], v0=[0, 1])
    with pytest.raises(vi.InputError, match=r"constraints depend on.*length"):
        vi.mhe(rope, unknown=["length"], **given)
    with pytest.raises(vi.InputError, match="all coordinates or for none"):
        vi.mhe(rope, disturbance=[0.1, 0.0], **given)


def test_what_is_no_estimator_is_refused_in_words():
    system, _ = pendulum()
    good = dict(h=0.1, horizon=5, measured=system.q, sigma=0.1, q0=0.0, v0=0.0)
    estimator = vi.mhe(system, **good)
    estimate = estimator(0.1)
    for change, words in (
        (dict(h=-1.0), "h must be positive"),
        (dict(horizon=0), "horizon"),
        (dict(sigma=0.0), "sigma must be a positive"),
        (dict(sigma=[0.1, 0.1]), "1 of them"),
        (dict(disturbance=-1.0), "disturbance"),
        (dict(start_sigma=[1.0]), "start_sigma"),
        (dict(unknown=["q0"]), "leave"),
        (dict(unknown=["mass"]), "which the scene has not"),
        (dict(huber=0.0), "huber"),
        (dict(measured=ca.SX.sym("z")), "unknown symbols"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.mhe(system, **(good | change))
    for arguments, words in (
        (([1.0, 2.0],), "1 numbers"),
        ((0.1, 1.0), "leave u out"),
        ((0.1, 1.0, estimate), "no control"),
        ((0.1, None, "last"), "last answer"),
        ((0.1, None, vi.mhe(system, **good)(0.1)), "last answer"),
    ):
        with pytest.raises(vi.InputError, match=words):
            estimator(*arguments)
    ball = vi.models.bouncing_ball()
    with pytest.raises(vi.InputError, match="contacts"):
        vi.mhe(ball.system, **(good | dict(measured=ball.system.q, q0=ball.q0, v0=ball.v0)))


def test_a_parameter_that_few_data_leave_open_does_not_end_the_estimates():
    """After two measurements a mass follows noise to its bounds; the steps there are damped."""
    q, v = vi.coordinates("x", "phi")
    u = ca.SX.sym("u")
    c = vi.Parameters(m=0.5)
    kinetic = (2 + c.m) * v[0] ** 2 / 2 + c.m * v[1] ** 2 / 2 + c.m * v[0] * v[1] * ca.cos(q[1])
    lagrangian = kinetic + 9.81 * c.m * ca.cos(q[1])
    crane = vi.System(q, v, lagrangian, force=ca.vertcat(u, 0), control=u, params=c)
    push = 2 * np.random.default_rng(1).normal(size=(6, 1))
    run = dict(q0=[0.2, 0.5], v0=[0.1, 0.0], h=0.04, steps=6, u=push, params=dict(m=0.8))
    true = vi.simulate(crane, vi.gauss(2), **run)
    given = dict(measured=q, sigma=0.01, q0=[0.0, 0.0], v0=[0.0, 0.0], h=0.04, horizon=25)
    look = vi.mhe(crane, vi.gauss(2), **given, unknown=dict(m=vi.free(0.5, 0.1, 3.0)))
    for seed in (0, 4):
        noise, estimate = 0.01 * np.random.default_rng(seed).normal(size=(7, 2)), None
        for k, y in enumerate(true.q + noise):
            estimate = look(y, None if k == 0 else push[k - 1], estimate)
        assert 0.1 <= estimate.params["m"] <= 3.0
        assert np.abs(estimate.q - true.q[-1]).max() < 0.06
