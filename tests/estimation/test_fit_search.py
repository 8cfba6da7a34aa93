"""Fits from far off, with physical inertias, and what causes directions that stay open."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.estimation.problem import estimation
from varint.estimation.regressor import from_the_data
from varint.estimation.residuals import first_guess, residuals, shooter
from varint.estimation.seen import seen_states
from varint.estimation.segments import guessed_states


def pendulum(damped: bool = True) -> tuple[vi.System, vi.Parameters]:
    q, v = vi.coordinates("theta")
    c = vi.Parameters(m=1.0, length=1.0, g=9.81, friction=0.1, bias=0.0)
    lagrangian = c.m * c.length**2 * v**2 / 2 + c.m * c.g * c.length * ca.cos(q)
    force = -c.friction * v if damped else None
    return vi.System(q, v, lagrangian, force=force, params=c), c


@pytest.mark.parametrize(("g", "friction"), [(1000.0, -1.0), (0.1, 5.0), (40.0, 0.0)])
def test_a_guess_a_hundred_times_too_large_does_no_harm(g, friction):
    system, c = pendulum()
    true = vi.simulate(system, q0=1.0, v0=0.3, h=0.02, steps=300)
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 6, 150))
    angle = 2 * (true.at(t).q[:, 0] + 0.2)  # another scale and a known bias
    for noise, off in ((0.0, 1e-9), (0.01, 0.05)):
        values = angle + noise * rng.normal(size=150)
        seen = vi.Measurement(2 * (system.q + c.bias), t, values, 0.01)
        found = vi.fit(
            system,
            data=seen,
            unknown=dict(g=g, friction=friction, q0=None, v0=None),
            params=dict(bias=0.2),
            h=0.02,
            q0=0.0,
            v0=0.0,
        )
        assert np.abs(found.estimates - [9.81, 0.1, 1.0, 0.3]).max() < off


@pytest.mark.parametrize("guess", [0.02, 0.05, 0.2, 0.4, 3.0, 100.0])
@pytest.mark.parametrize("amplitude", [0.3, 1.0, 2.9])
def test_the_length_of_a_pendulum_is_found_from_any_guess(guess, amplitude):
    """L = ℓ² θ̇²/2 + g ℓ cos θ leaves little of its equations where ℓ is small, which was taken for
    a solution from guesses below a half.
    """
    q, v = vi.coordinates("theta")
    c = vi.Parameters(length=1.0)
    swing = c.length**2 * v**2 / 2 + 9.81 * c.length * ca.cos(q)
    system = vi.System(q, v, swing, params=c)
    times = np.linspace(0, 6, 61)
    true = vi.simulate(system, q0=amplitude, v0=0.0, duration=6.0, at=times)
    angle = true.q[:, 0] + 0.01 * np.random.default_rng(0).normal(size=61)
    seen = vi.Measurement(q, times, angle, 0.01)
    start = [vi.Experiment([seen], q0=amplitude, v0=0.0)]
    unknown = {"length": guess}
    begun = from_the_data(estimation(system, vi.gauss(2), start, unknown, 0.02, None, 1, None))
    assert begun.c == pytest.approx([1.0], rel=0.1)


def test_controls_and_several_coordinates_start_from_the_data_too():
    q, v = vi.coordinates("x", "theta")
    u, c = ca.SX.sym("push"), vi.Parameters(cart=1.0, bob=1.0, drag=0.1)
    kinetic = c.cart * v[0] ** 2 / 2
    kinetic += c.bob * (v[0] ** 2 + 2 * v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2) / 2
    force = ca.vertcat(u - c.drag * v[0], 0)
    cart = vi.System(q, v, kinetic + 9.81 * c.bob * ca.cos(q[1]), force=force, control=u, params=c)
    push = 2 * np.sin(0.1 * np.arange(200))[:, None]
    start = dict(q0=[0.0, 2.0], v0=[0.0, 0.0])
    true = vi.simulate(
        cart, **start, h=0.02, steps=200, u=push, params=dict(cart=1.4, bob=0.3, drag=0.5)
    )
    seen = [vi.Experiment([vi.Measurement(q, true.t[::4], true.q[::4], 0.01)], **start, u=push)]
    unknown = dict(cart=0.01, bob=50.0, drag=-3.0)
    found = vi.fit(cart, data=seen, unknown=unknown, h=0.02)
    assert np.abs(found.estimates - [1.4, 0.3, 0.5]).max() < 1e-9
    rule = vi.plan(cart).rule
    begun = from_the_data(estimation(cart, rule, seen, unknown, 0.02, None, 1, None))
    assert begun is not None and np.abs(begun.c - [1.4, 0.3, 0.5]).max() < 0.02


def test_a_coordinate_is_read_off_any_sensor_that_shows_it_alone():
    system, c = pendulum()
    t = np.array([0.3, 0.1, 0.2])
    values = np.column_stack([3 * t + 0.5, np.sin(t), 4 * t])
    expression = ca.vertcat(3 * system.q + c.bias + c.g, ca.sin(system.q), system.q * system.v)
    rows = [vi.Measurement(expression, t, values), vi.Measurement(-system.v, t, [1.0, np.nan, 3.0])]
    p = estimation(
        system,
        vi.plan(system).rule,
        [vi.Experiment(rows, 0.0, 0.0)],
        ["g"],
        0.1,
        dict(g=0.25, bias=0.25),
        1,
        None,
    )
    angle, rate = seen_states(p, p.motions[0])
    assert np.allclose(angle.t, [0.1, 0.2, 0.3]) and np.allclose(angle.values, angle.t)
    assert np.allclose(rate.t, [0.2, 0.3]) and np.allclose(rate.values, [-3.0, -1.0])


def test_inertias_stay_positive_where_noise_would_have_them_negative():
    q, v = vi.coordinates("a", "b")
    c = vi.Parameters(big=1.0, small=0.2, spring=2.0)
    kinetic = c.big * v[0] ** 2 / 2 + c.small * (v[0] + v[1]) ** 2 / 2 + 0.1 * v[1] ** 2
    system = vi.System(q, v, kinetic - c.spring * q[0] ** 2 / 2 - q[1] ** 2 / 2, params=c)
    start = dict(q0=[0.5, 0.0], v0=[0.0, 1.0])
    true = vi.simulate(system, vi.gauss(2), **start, h=0.05, steps=60, params=dict(small=1e-5))
    noise = 0.02 * np.random.default_rng(1).normal(size=true.q.shape)
    seen = vi.Measurement(q, true.t, true.q + noise, 0.02)
    given = dict(data=seen, h=0.05, **start)
    found = vi.fit(system, vi.gauss(2), unknown=["big", "small"], **given)
    assert found.params["small"] == 0.0 and found.at_bounds == ("small",)
    free = dict(big=None, small=vi.free(0.2, -1.0, 1.0))
    negative = vi.fit(system, vi.gauss(2), unknown=free, **given)
    assert -0.02 < negative.params["small"] < 0  # the bound that is asked for, and M > 0


OPEN = [
    ("m friction", "multiply the Lagrangian and the forces as a whole"),
    ("m length g", "in the Lagrangian and the forces they stand in other combinations only"),
]


@pytest.mark.parametrize(("unknown", "words"), OPEN)
def test_parameters_of_a_pendulum_that_angles_leave_open(unknown, words):
    system, _ = pendulum()
    true = vi.simulate(system, q0=1.0, v0=0.0, h=0.02, steps=200)
    seen = vi.Measurement(system.q, true.t[::5], true.q[::5], 0.01)
    with pytest.warns(UserWarning, match=words):
        found = vi.fit(system, data=seen, unknown=unknown.split(), h=0.02, q0=1.0, v0=0.0)
    assert len(found.unidentifiable) == 1


def test_a_mass_that_drops_out_is_named_with_the_scale_of_the_lagrangian():
    system, _ = pendulum(damped=False)
    true = vi.simulate(system, q0=1.0, v0=0.0, h=0.02, steps=200)
    seen = vi.Measurement(system.q, true.t[::5], true.q[::5], 0.01)
    with pytest.warns(UserWarning, match="m does not show in the data .to multiply the Lagr"):
        vi.fit(system, data=seen, unknown=["m"], h=0.02, q0=1.0, v0=0.0)


def kepler() -> vi.System:
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(mu=1.0)
    return vi.System(q, v, ca.sumsqr(v) / 2 + c.mu / ca.norm_2(q), params=c)


SEEN_OF_KEPLER = [
    (lambda q: ca.atan2(q[1], q[0]), "a change of the units of x, y"),
    (lambda q: ca.norm_2(q), "rotation about z"),
]


@pytest.mark.parametrize(("sensor", "words"), SEEN_OF_KEPLER)
def test_angles_do_not_tell_a_length_and_distances_no_direction(sensor, words):
    system = kepler()
    start = dict(q0=[1.0, 0.0], v0=[0.0, 1.1])
    true = vi.simulate(system, **start, h=0.05, steps=150)
    seen = vi.Measurement(sensor(system.q), true.t[::5], true.value(sensor(system.q))[::5], 0.01)
    with pytest.warns(UserWarning, match=words):
        found = vi.fit(system, data=seen, unknown=["mu", "q0", "v0"], h=0.05, **start)
    assert len(found.unidentifiable) == 1


def test_relative_positions_leave_open_where_and_how_fast_both_move():
    q, v = vi.coordinates("x1", "x2")
    pair = vi.System(q, v, ca.sumsqr(v) / 2 - (q[0] - q[1]) ** 2 / 2)
    start = dict(q0=[1.0, 0.0], v0=[0.0, 1.1])
    true = vi.simulate(pair, **start, h=0.05, steps=100)
    seen = vi.Measurement(q[0] - q[1], true.t[::5], true.q[::5, 0] - true.q[::5, 1], 0.01)
    with pytest.warns(UserWarning):
        found = vi.fit(pair, data=seen, unknown=["q0", "v0"], h=0.05, **start)
    assert any("translation along x" in x for x in found.unidentifiable)
    assert any("Galilean boost" in x for x in found.unidentifiable)
    assert len(found.unidentifiable) == 2


def test_a_start_written_in_parameters_is_as_good_as_an_unknown_one():
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(mu=1.0, apsis=1.0, e=0.1)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + c.mu / ca.norm_2(q), params=c)
    speed = ca.sqrt(c.mu * (1 + c.e) / c.apsis)  # at the periastron
    true = dict(mu=1.2, apsis=0.9, e=0.2)
    start = dict(q0=[0.9, 0.0], v0=[0.0, np.sqrt(1.2 * 1.2 / 0.9)])
    motion = vi.simulate(system, vi.gauss(4), **start, h=0.1, steps=80, params=true)
    seen = vi.Measurement(q, motion.t[::4], motion.q[::4], 1e-3)
    given = dict(data=seen, h=0.1, q0=ca.vertcat(c.apsis, 0), v0=ca.vertcat(0, speed))
    for segments in (1, 3):
        found = vi.fit(
            system, vi.gauss(4), unknown=["mu", "apsis", "e"], segments=segments, **given
        )
        assert np.abs(found.estimates - [1.2, 0.9, 0.2]).max() < 1e-9
    assert np.allclose(found.v0[0], start["v0"], atol=1e-9)
    free = vi.fit(
        system, vi.gauss(4), data=seen, h=0.1, unknown=["mu", "q0", "v0"], q0=[1, 0], v0=[0, 1.1]
    )
    # the same data tell less where directions of the start are free as well
    assert found.sigma[0] < free.sigma[0] and found.freedom == free.freedom + 2
    for change, words in (
        (dict(unknown=["mu", "q0"]), "leave it out"),
        (dict(unknown=["mu"], q0=q), "parameters only"),
        (dict(unknown=["mu"], q0=c.e), "must be 2 expressions"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.fit(system, vi.gauss(4), **(given | change))


def test_derivatives_of_starts_in_parameters_are_those_of_differences():
    q, v = vi.coordinates("x")
    c = vi.Parameters(rate=2.0, reach=0.5)
    # the momentum depends on a parameter, and so does the start
    spring = vi.System(q, v, c.reach * v**2 / 2 - c.rate * ca.cos(q), params=c)
    seen = vi.Measurement(q, [0.1, 0.33, 0.6], [0.1, 0.2, 0.3], 0.1)
    start = [vi.Experiment([seen], ca.sin(c.reach), c.rate * c.reach)]
    p = estimation(spring, vi.gauss(2), start, ["rate", "reach"], 0.1, None, 2, None)
    shoot, z = shooter(p, "interpreted"), guessed_states(p, first_guess(p))
    found = residuals(shoot, z)
    for i in range(p.size):
        e = 1e-5 * np.eye(p.size)[i]
        up, down = residuals(shoot, z + e), residuals(shoot, z - e)
        assert np.allclose((up.r - down.r) / 2e-5, found.of_r[:, i], atol=1e-8)
        assert np.allclose((up.d - down.d) / 2e-5, found.of_d[:, i], atol=1e-8)


def test_bent_valleys_are_followed_with_damped_steps():
    q, v = vi.coordinates("x")
    c = vi.Parameters(a=-1.2, b=1.0)
    still = vi.System(q, v, v**2 / 2, params=c)
    rosenbrock = ca.vertcat(10 * (c.b - c.a**2), 1 - c.a) + 0 * q
    seen = vi.Measurement(rosenbrock, [0.0, 0.1], [[0.0, 0.0], [np.nan, np.nan]])
    found = vi.fit(still, data=seen, unknown=["a", "b"], h=0.1, q0=0.0, v0=0.0)
    assert np.abs(found.estimates - 1).max() < 1e-10 and found.steps < 40


@pytest.mark.parametrize("sensor", [ca.log, ca.sqrt])
def test_a_guess_where_the_sensor_has_no_value_is_told(sensor):
    q, v = vi.coordinates("x")
    c = vi.Parameters(a=-1.0)
    ball = vi.System(q, v, v**2 / 2, params=c)
    seen = vi.Measurement(sensor(c.a) + q, [0.1, 0.2], [1.0, 1.0])
    with pytest.raises(vi.ConvergenceError, match="not a finite number at the first guess"):
        vi.fit(ball, data=seen, unknown=["a"], h=0.1, q0=0.0, v0=0.0)
    found = vi.fit(ball, data=seen, unknown=dict(a=2.0), h=0.1, q0=0.0, v0=0.0)
    assert float(sensor(found.params["a"].item())) == pytest.approx(1.0, rel=1e-9)


def test_a_minimum_that_does_not_meet_the_data_is_told():
    """From p = 0 the frequency 5 is behind a hill: ∫ t sin 5t dt < 0 sends p below zero."""
    x, rate, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(p=0.0)
    drive = (30.0**2 + c.p**2) * ca.sin(c.p * t)
    system = vi.System(x, rate, rate**2 / 2 + 30.0**2 * x**2 / 2 - drive * x, params=c, t=t)
    times = np.linspace(0, 1, 21)
    seen = vi.Measurement(x, times, np.sin(5 * times), 0.05)
    given = dict(data=seen, h=1 / 40, q0=0.0, v0=0.0, segments=8)
    with pytest.warns(UserWarning, match=r"half of the residuals are beyond .* other guesses"):
        wrong = vi.fit(system, vi.gauss(4), unknown=["p", "q0", "v0"], **given)
    assert wrong.estimates[0] < 0 and wrong.misfit in wrong.summary
    right = vi.fit(system, vi.gauss(4), unknown={"p": 4.0, "q0": None, "v0": None}, **given)
    assert right.estimates[0] == pytest.approx(5, abs=1e-3) and not right.misfit


def test_a_period_that_is_far_off_is_found_from_the_first_data():
    """Over five periods guesses of half the period's square end in other minima; over the first one
    there is one. What the sensor sees shows no coordinate by itself.
    """
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=0.5)
    spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    t = np.linspace(0, 30, 60)
    seen = vi.Measurement((q + 0.3) ** 2, t, (np.cos(t) + 0.3) ** 2, sigma=0.01)
    found = vi.fit(spring, vi.gauss(6), data=seen, unknown=["k"], h=0.5, q0=1.0, v0=0.0)
    assert found.params["k"] == pytest.approx(1.0, rel=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("segments", [1, 6])
def test_one_sensor_with_gaps_tells_both_lengths_of_a_double_pendulum_and_its_start(segments):
    """From lengths a quarter off and a start that is off by 0.1."""
    q, v = vi.coordinates("a", "b")
    c = vi.Parameters(l1=1.0, l2=1.0, k=0.0)
    kinetic = ca.sumsqr(c.l1 * v[0]) + c.l2**2 * v[1] ** 2 / 2
    kinetic += c.l1 * c.l2 * v[0] * v[1] * ca.cos(q[0] - q[1])
    height = -2 * c.l1 * ca.cos(q[0]) - c.l2 * ca.cos(q[1])
    force = ca.vertcat(-c.k * v[0], 0)
    system = vi.System(q, v, kinetic - 9.81 * height, force=force, params=c)
    truth = [0.8, 1.2, 0.1, 0.5, -0.4]
    true = vi.simulate(
        system, vi.gauss(4), q0=[0.5, -0.4], v0=[0, 0], h=0.02, steps=400,
        params=dict(zip(("l1", "l2", "k"), truth, strict=False)),
    )  # fmt: skip
    t = np.linspace(0, 8, 150)
    t = t[(t < 3) | (t > 4.5)]
    values = true.at(t).q[:, 1] + 0.005 * np.random.default_rng(3).normal(size=len(t))
    seen = vi.Measurement(q[1], t, values, sigma=0.005)
    unknown, guess = ["l1", "l2", "k", "q0"], dict(q0=[0.6, -0.3], v0=[0, 0])
    given = dict(data=seen, unknown=unknown, h=0.02, segments=segments)
    found = vi.fit(system, vi.gauss(3), **given, **guess)
    assert (np.abs(found.estimates - truth) < 4 * found.sigma).all()
    assert not found.misfit and found.sigma.max() < 0.05
