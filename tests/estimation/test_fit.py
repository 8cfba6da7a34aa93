"""Fits recover what made the data, with the spread that theory gives them, and say in words what
the data leave open.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.estimation.problem import estimation
from varint.estimation.residuals import first_guess, residuals, shooter
from varint.estimation.segments import guessed_states
from varint.numerics import progress


def pendulum(**names: float) -> tuple[vi.System, vi.Parameters]:
    """L = I v²/2 + W cos θ, with a sensor's bias."""
    q, v = vi.coordinates("theta")
    c = vi.Parameters(**{"inertia": 1.0, "weight": 9.81, "bias": 0.0} | names)
    return vi.System(q, v, c.inertia * v**2 / 2 + c.weight * ca.cos(q), params=c), c


def truth(system: vi.System, steps: int = 300, **given) -> vi.Trajectory:
    return vi.simulate(system, **({"q0": 1.0, "v0": 0.3, "h": 0.01, "steps": steps} | given))


def oscillator() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - 4 * q**2 / 2)


@pytest.mark.parametrize("segments", [1, 4])
def test_data_without_noise_give_back_what_made_them(segments):
    system, c = pendulum()
    true = truth(system, params=dict(weight=8.0))
    t = np.random.default_rng(0).uniform(0, 3, 60)  # hardly any of them a node
    seen = vi.Measurement(system.q + c.bias, t, true.at(t).q[:, 0] + 0.1, sigma=1e-3)
    found = vi.fit(
        system,
        data=seen,
        unknown=["weight", "bias", "q0", "v0"],
        h=0.01,
        q0=0.8,
        v0=0.0,
        segments=segments,
    )
    assert found.converged and not found.unidentifiable and not found.at_bounds
    assert found.names == ("weight", "bias", "theta(0)", "dtheta/dt(0)")
    assert np.abs(found.estimates - [8.0, 0.1, 1.0, 0.3]).max() < 1e-10
    assert found.params["weight"] == pytest.approx(8.0, abs=1e-10)
    assert np.abs(found.trajectories[0].q - true.q).max() < 1e-9
    assert np.abs(found.trajectories[0].v - true.v).max() < 1e-9


def test_several_experiments_with_gaps_and_controls_share_their_parameters():
    q, v = vi.coordinates("x", "theta")
    u, c = ca.SX.sym("push"), vi.Parameters(m=1.0, g=9.81, drag=0.1)
    kinetic = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + c.m * v[1] ** 2
    force = ca.vertcat(u - c.drag * v[0], 0)
    cart = vi.System(q, v, kinetic + c.g * ca.cos(q[1]), force=force, control=u, params=c)
    rule, experiments = vi.gauss(2), []
    for k, theta in enumerate((0.5, -0.9)):
        push = np.sin(np.arange(40 * 2).reshape(40, 2, 1) + k)  # a value at each node of the rule
        start = dict(q0=[0.0, theta], v0=[0.1, 0.0])
        true = vi.simulate(
            cart, rule, **start, h=0.05, steps=40, u=push, params=dict(m=1.2, g=9.5, drag=0.3)
        )
        # half a step has controls of the polynomial through those of the whole
        t = np.linspace(0.025, 1.975, 30)
        values = true.at(t).q
        values[::7, 0] = np.nan
        seen = vi.Measurement(q, t, values, sigma=[0.01, 0.001])
        experiments.append(vi.Experiment([seen], **start, u=push))
    found = vi.fit(cart, rule, data=experiments, unknown=["m", c.g, "drag"], h=0.05)
    assert np.abs(found.estimates - [1.2, 9.5, 0.3]).max() < 1e-10
    assert len(found.trajectories) == len(found.q0) == 2
    missing = np.isnan(found.residuals[0][0])
    assert missing[::7, 0].all() and missing.sum() == 5
    assert found.freedom == 2 * (60 - 5) - 3


def test_the_covariance_of_an_oscillator_is_cramer_and_raos():
    system = oscillator()
    t = np.linspace(0.05, 4.0, 50)
    sigma = 0.02
    seen = vi.Measurement(system.q, t, np.cos(2 * t), sigma)
    found = vi.fit(system, vi.gauss(8), data=seen, unknown=["q0", "v0"], h=0.1, q0=0.7, v0=0.1)
    slope = np.column_stack([np.cos(2 * t), np.sin(2 * t) / 2])
    bound = sigma**2 * np.linalg.inv(slope.T @ slope)
    assert np.abs(found.covariance - bound).max() < 1e-10 * np.abs(bound).max()
    assert np.allclose(found.sigma**2, np.diag(bound), rtol=1e-10)
    assert found.correlation[0, 1] == pytest.approx(
        bound[0, 1] / np.sqrt(bound[0, 0] * bound[1, 1])
    )
    wide = found.interval(0.6826894921370859) - found.estimates[:, None]
    assert np.allclose(wide, np.outer(found.sigma, [-1, 1]), rtol=1e-9)


@pytest.mark.long
def test_intervals_of_95_percent_hold_the_truth_in_95_percent_of_experiments():
    system, _ = pendulum()
    true = truth(system, steps=100)
    t, rng, inside = np.linspace(0.1, 1.0, 15), np.random.default_rng(4), []
    exact = true.at(t).q[:, 0]
    for _ in range(2000):
        seen = vi.Measurement(system.q, t, exact + 0.01 * rng.normal(size=15), 0.01)
        found = vi.fit(system, data=seen, unknown=["weight", "q0", "v0"], h=0.05, q0=1.0, v0=0.3)
        low, high = found.interval().T
        inside.append((low <= [9.81, 1.0, 0.3]) & (high >= [9.81, 1.0, 0.3]))
    assert (np.abs(np.mean(inside, axis=0) - 0.95) < 0.02).all()


def test_what_the_data_do_not_tell_apart_is_named_with_the_symmetry_behind_it():
    system, _ = pendulum()
    true = truth(system)
    seen = vi.Measurement(system.q, true.t[::10], true.q[::10, 0], 1e-3)
    with pytest.warns(UserWarning, match="inertia and weight are not told apart"):
        found = vi.fit(
            system, data=seen, unknown=dict(inertia=1.1, weight=9.0), h=0.01, q0=1.0, v0=0.3
        )
    [sentence] = found.unidentifiable
    assert "+1" in sentence and "multiply the Lagrangian" in sentence
    assert np.isinf(found.sigma).all() and np.isnan(found.correlation).all()
    assert found.params["weight"] / found.params["inertia"] == pytest.approx(9.81, rel=1e-10)
    assert "not told" in found.summary and "open: inertia" in found.summary


def test_a_parameter_that_nothing_depends_on_does_not_show():
    system, _ = pendulum()
    true = truth(system)
    seen = vi.Measurement(system.q, true.t[::10], true.q[::10, 0], 1e-3)
    with pytest.warns(UserWarning, match="bias does not show in the data$"):
        found = vi.fit(system, data=seen, unknown=["weight", "bias"], h=0.01, q0=1.0, v0=0.3)
    assert found.sigma[0] < 0.01 and np.isinf(found.sigma[1])


def bock() -> tuple[vi.System, vi.Measurement]:
    """ẍ = μ² x − (μ² + p²) sin p t, with sin πt at p = π and neighbours that part as e^{60 t}."""
    x, rate, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(p=0.0, mu=60.0)
    drive = (c.mu**2 + c.p**2) * ca.sin(c.p * t)
    system = vi.System(x, rate, rate**2 / 2 + c.mu**2 * x**2 / 2 - drive * x, params=c, t=t)
    times = np.linspace(0, 1, 21)
    noise = 0.05 * np.random.default_rng(1).normal(size=21)
    return system, vi.Measurement(x, times, np.sin(np.pi * times) + noise, 0.05)


def test_bocks_unstable_problem_converges_from_far_where_single_shooting_fails():
    system, seen = bock()
    given = dict(data=seen, unknown=["p", "q0", "v0"], h=1 / 40, q0=0.0, v0=0.0)
    with pytest.raises(vi.SolverError, match="more segments"):
        vi.fit(system, vi.gauss(4), **given)
    found = vi.fit(system, vi.gauss(4), **given, segments=8)
    low, high = found.interval()[0]
    assert low < np.pi < high and found.sigma[0] < 0.05
    motion = found.trajectories[0]
    assert np.abs(motion.q[:, 0] - np.sin(np.pi * motion.t)).max() < 0.1
    assert 0.3 < found.chi_squared / found.freedom < 2
    assert abs(found.whiteness[0][0]) < 2


def test_outliers_matter_little_to_hubers_loss():
    system, _ = pendulum()
    true = truth(system)
    values = true.q[::10, 0].copy()
    values[[4, 17]] += 1.0
    given = dict(data=vi.Measurement(system.q, true.t[::10], values, 0.01), unknown=["weight"])
    start = dict(h=0.01, q0=1.0, v0=0.3)
    robust = vi.fit(system, **given, **start, huber=1.5)
    squares = vi.fit(system, **given, **start)
    off, far = (abs(x.params["weight"] - 9.81) for x in (robust, squares))
    assert off < 0.2 * far


def test_bounds_hold_and_are_told():
    system, _ = pendulum()
    true = truth(system)
    seen = vi.Measurement(system.q, true.t[::10], true.q[::10, 0], 1e-3)
    tight = {"weight": vi.free(8.0, 5.0, 9.0), "q0": None}
    with pytest.warns(UserWarning, match="the data are not met.* the bounds of weight"):
        found = vi.fit(system, data=seen, unknown=tight, h=0.01, q0=1.0, v0=0.3)
    assert found.params["weight"] == 9.0 and found.at_bounds == ("weight",)
    assert "at a bound: weight" in found.summary
    free = vi.fit(
        system, data=seen, unknown={"weight": vi.free(8.0, 5.0, 12.0)}, h=0.01, q0=1.0, v0=0.3
    )
    assert free.params["weight"] == pytest.approx(9.81, rel=1e-10) and not free.at_bounds


def test_a_prior_weighs_as_a_measurement_of_the_parameter():
    q, v = vi.coordinates("x")
    c = vi.Parameters(speed=1.0, start=0.0)
    system = vi.System(q, v, v**2 / 2, params=c)  # x = 2 t, seen from `start`, once
    seen = vi.Measurement(q - c.start, [1.0], [2.0], 0.3)
    found = vi.fit(
        system, data=seen, unknown=["start"], priors={c.start: (0.4, 0.4)}, h=0.5, q0=0.0, v0=2.0
    )
    assert found.params["start"] == pytest.approx(0.4 * 0.09 / (0.09 + 0.16))
    assert found.sigma[0] == pytest.approx(1 / np.sqrt(1 / 0.09 + 1 / 0.16))


def test_derivatives_of_residuals_and_gaps_are_those_of_differences():
    system, c = pendulum()
    seen = vi.Measurement(
        ca.vertcat(system.q + c.bias, system.v), [0.0, 0.013, 0.2], np.ones((3, 2))
    )
    start = [vi.Experiment([seen], 1.0, 0.3), vi.Experiment([seen], 0.5, 0.1, t0=-0.1)]
    p = estimation(system, vi.gauss(2), start, ["weight", "bias", "q0", "v0"], 0.02, None, 3, None)
    for backend in ("interpreted", "compiled"):
        shoot, z = shooter(p, backend), guessed_states(p, first_guess(p))
        found = residuals(shoot, z)
        for i in range(p.size):
            e = np.zeros(p.size)
            e[i] = 1e-5
            up, down = residuals(shoot, z + e), residuals(shoot, z - e)
            assert np.allclose((up.r - down.r) / 2e-5, found.of_r[:, i], atol=1e-8)
            assert np.allclose((up.d - down.d) / 2e-5, found.of_d[:, i], atol=1e-8)


def test_a_fit_is_drawn_and_reported(capsys):
    system, _ = pendulum()
    true = truth(system)
    noise = 0.01 * np.random.default_rng(2).normal(size=31)
    seen = vi.Measurement(system.q, true.t[::10], true.q[::10, 0] + noise, 0.01)
    wave = true.q[::10, 0] + 0.03 * np.sin(5 * true.t[::10])  # another sensor, that swings itself
    other = vi.Measurement(system.q, true.t[::10], wave, 1.0)
    found = vi.fit(system, data=[seen, other], unknown=["weight"], h=0.01, q0=1.0, v0=0.3)
    found.report()
    out = capsys.readouterr().out
    assert "converged after" in out and "95 %" in out and "NOT white" in out and ": white" in out
    figure = found.plot()
    assert len(figure.axes) == 4
    measured = figure.axes[0].lines[1].get_ydata()
    assert np.array_equal(measured, seen.values[:, 0])


def test_constrained_scenes_are_fitted_from_a_start_on_their_constraints():
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(g=9.81)
    rod = vi.System(q, v, ca.sumsqr(v) / 2 - c.g * q[1], constraint=ca.sumsqr(q) - 1, params=c)
    start = dict(q0=[0.6, -0.8], v0=[0.8, 0.6])
    true = vi.simulate(rod, vi.lobatto(3), **start, h=0.02, steps=60, params=dict(g=9.0))
    seen = vi.Measurement(q, true.t[::6], true.q[::6], 1e-3)
    found = vi.fit(rod, vi.lobatto(3), data=seen, unknown=["g"], h=0.02, **start)
    assert found.params["g"] == pytest.approx(9.0, rel=1e-10)
    with pytest.raises(vi.InputError, match="constraints"):
        vi.fit(rod, vi.lobatto(3), data=seen, unknown=["g", "q0"], h=0.02, **start)


def test_what_is_no_estimation_problem_is_refused_in_words():
    system, _ = pendulum()
    q = system.q
    seen = vi.Measurement(q, [0.1, 0.2], [1.0, 1.0])
    good = dict(data=seen, unknown=["weight"], h=0.01, q0=1.0, v0=0.0)
    one = vi.Experiment([seen], 1.0, 0.0)
    for change, words in (
        (dict(unknown=["mass"]), "which the scene has not"),
        (dict(unknown=[]), "nothing to be found"),
        (dict(unknown=dict(weight=[1.0, 2.0])), "2 numbers, not 1"),
        (dict(h=0.0), "h must be positive"),
        (dict(q0=None), "q0 and v0"),
        (dict(t0=0.15), "before the start"),
        (dict(data=[]), "Measurements"),
        (dict(data=[one, seen]), "the ones or the others"),
        (dict(data=[one]), "leave them out"),
        (dict(huber=-1.0), "huber"),
        (dict(segments=0), "segments"),
        (dict(priors=dict(weight=3.0)), r"\(mean, sigma\)"),
        (dict(backend="fast"), "backend"),
        (dict(data=vi.Measurement(ca.SX.sym("z"), [0.1], [1.0])), "unknown symbols"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.fit(system, **(good | change))
    for t, values, sigma in (
        ([0.1], [1.0, 2.0], 1.0),
        ([np.nan], [1.0], 1.0),
        ([0.1], [1.0], 0.0),
        ([0.1, 0.2], np.ones((2, 3)), np.ones(2)[None, :, None]),
    ):
        with pytest.raises(vi.InputError):
            vi.Measurement(q, t, values, sigma)
    with pytest.raises(vi.InputError, match="level"):
        vi.fit(system, **good).interval(2.0)


def test_a_long_fit_is_told_where_someone_watches(capsys, monkeypatch):
    system, _ = pendulum()
    true = truth(system)
    seen = vi.Measurement(system.q, true.t, true.q[:, 0], sigma=1e-3)
    given = dict(data=[seen], unknown=["weight"], q0=1.0, v0=0.3)
    monkeypatch.setattr(progress, "SILENCE", 1e-3)
    vi.fit(system, **given)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress, "_is_watched", lambda: True)
    vi.fit(system, **given)
    assert "fitting: 0 s" in capsys.readouterr().err
