"""Profile likelihood: closed forms, bounds, data that do not end an interval."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

Z = 1.959963984540054  # of 95 %


def line(noise: np.ndarray) -> vi.Fit:
    """x = x0 + v0 t, which is linear in all that is unknown."""
    q, v = vi.coordinates("x")
    t = np.linspace(0, 2, len(noise))
    seen = vi.Measurement(q, t, 1 + 0.5 * t + noise, 0.1)
    return vi.fit(
        vi.System(q, v, v**2 / 2), data=seen, unknown=["q0", "v0"], h=0.25, q0=0.0, v0=0.0
    )


@pytest.mark.parametrize("name", ["x(0)", "dx/dt(0)"])
def test_of_a_linear_problem_the_profile_is_the_parabola(name):
    found = line(0.1 * np.random.default_rng(0).normal(size=9))
    told, i = found.profile(name, 0.9), found.names.index(name)
    assert np.allclose(told.interval, found.interval(0.9)[i], rtol=1e-6)
    assert told.linear == pytest.approx(tuple(found.interval(0.9)[i]))
    parabola = ((told.values - found.estimates[i]) / found.sigma[i]) ** 2
    assert len(told.values) > 8 and np.allclose(told.chi_squared, parabola, atol=1e-8)
    slope = found.covariance[:, i] / found.covariance[i, i]  # how the other follows
    path = found.estimates + np.outer(told.values - found.estimates[i], slope)
    assert np.allclose(told.estimates, path, atol=1e-8)


@pytest.mark.parametrize("segments", [1, 3])
def test_the_ends_are_where_the_closed_form_of_a_spring_rises_by_the_level(segments):
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=1.0)
    spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    t = np.linspace(0, 3, 7)
    seen = vi.Measurement(q, t, np.cos(2 * t), 0.3)
    found = vi.fit(
        spring, vi.gauss(6), data=seen, unknown="k", h=0.1, q0=1, v0=0, segments=segments
    )
    told = found.profile(c.k)
    for k in told.interval:
        more = ((np.cos(np.sqrt(k) * t) - np.cos(2 * t)) ** 2).sum() / 0.3**2
        assert more == pytest.approx(Z**2, rel=1e-4)
    low, high = np.abs(np.array(told.interval) - 4.0)
    assert abs(high - low) > 0.02 * low  # the linearised one is symmetric


def saturating(**free) -> vi.Fit:
    """tanh(c) seen once at 0.999 ± 0.01: hardly bounded from above."""
    q, v = vi.coordinates("x")
    c = vi.Parameters(c=1.0)
    seen = vi.Measurement(ca.tanh(c.c) + 0 * q, [0.1], [0.999], 0.01)
    unknown = free or dict(c=3.0)
    return vi.fit(
        vi.System(q, v, v**2 / 2, params=c), data=seen, unknown=unknown, h=0.1, q0=0, v0=0
    )


def test_an_interval_that_the_data_do_not_end_is_infinite_and_a_bound_ends_it():
    told = saturating().profile("c")
    assert told.interval[0] == pytest.approx(np.arctanh(0.999 - 0.01 * Z), rel=1e-4)
    assert told.interval[1] == np.inf
    assert saturating(c=vi.free(3.0, 0.0, 10.0)).profile("c").interval[1] == 10.0
    low, high = saturating(c=vi.free(1.0, 0.0, 2.0)).profile("c").interval  # the bound holds it
    more = (np.tanh([low, 2.0]) - 0.999) ** 2 / 0.01**2
    assert high == 2.0 and more[0] - more[1] == pytest.approx(Z**2, rel=1e-4)


def test_profiles_are_drawn_and_refused_in_words():
    found = line(np.zeros(5))
    told = found.profile("x(0)")
    axes = told.plot().axes[0]
    assert np.array_equal(axes.lines[1].get_ydata(), told.chi_squared)
    assert repr(told).startswith("Profile(x(0)=1, 95 %: ")
    for name, level, words in (("y", 0.95, "one of"), ("x(0)", 1.5, "level")):
        with pytest.raises(vi.InputError, match=words):
            found.profile(name, level)


def test_residuals_are_tested_in_the_order_of_time():
    q, v = vi.coordinates("x")
    t = np.linspace(0, 1, 40)
    mixed = np.random.default_rng(0).permutation(40)
    seen = vi.Measurement(q, t[mixed], np.sin(6 * t)[mixed], 0.5)
    found = vi.fit(vi.System(q, v, v**2 / 2), data=seen, unknown=["q0"], h=0.1, q0=0.0, v0=0.0)
    assert found.whiteness[0][0] > 4 and "NOT white" in found.summary
