"""Noise levels estimated with the motion: closed forms, coverage, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import varint as vi

T = np.linspace(0.1, 8.0, 60)


def free_fall() -> vi.System:
    q, v = vi.coordinates("x")
    c = vi.Parameters(g=9.81)
    return vi.System(q, v, v**2 / 2 - c.g * q, params=c)


def seen(rng: np.random.Generator, true_sigma, **noise) -> vi.Measurement:
    spread = np.broadcast_to(true_sigma, T.shape)
    values = 1.0 + 0.5 * T - 9.81 * T**2 / 2 + spread * rng.normal(size=T.size)
    return vi.Measurement(SCENE.q, T, values, **noise)


SCENE = free_fall()
ASKED = dict(unknown=["g", "q0", "v0"], h=0.5, q0=1.0, v0=0.5)


def test_an_unknown_sigma_is_the_sum_of_squares_by_the_degrees_of_freedom():
    data = seen(np.random.default_rng(1), 0.3, sigma=vi.free(1.0, 0.0, np.inf))
    found = vi.fit(SCENE, vi.gauss(2), data=data, **ASKED)
    # x = x0 + v0 t − g t²/2, which is what the data are fitted by in closed form
    basis = np.column_stack([-(T**2) / 2, np.ones_like(T), T])
    best, squares, _, _ = np.linalg.lstsq(basis, data.values[:, 0], rcond=None)
    wanted = np.sqrt(squares[0] / (len(T) - 3))
    assert found.data[0][0].level == pytest.approx(wanted, rel=1e-8)
    assert np.abs(found.estimates - best).max() < 1e-9
    assert np.allclose(found.covariance, wanted**2 * np.linalg.inv(basis.T @ basis), rtol=1e-7)
    assert found.jitter_sigma[0][0] == pytest.approx(wanted / np.sqrt(2 * (len(T) - 3)), rel=1e-8)
    assert found.chi_squared == pytest.approx(found.freedom, rel=1e-7)
    assert "noise of x: 0." in found.summary


def test_levels_of_two_sensors_are_those_of_largest_restricted_likelihood():
    rng = np.random.default_rng(2)
    errors = 0.1 + 0.1 * rng.random(T.size)
    one = seen(rng, np.hypot(errors, 0.4), sigma=errors, jitter=vi.free(0.1, 0.0, np.inf))
    two = seen(rng, 0.2, sigma=0.2, jitter=vi.free(0.1, 0.0, np.inf))
    found = vi.fit(SCENE, vi.gauss(2), data=[one, two], **ASKED)
    basis = np.column_stack([-(T**2) / 2, np.ones_like(T), T])
    design, y = np.vstack([basis, basis]), np.concatenate([one.values, two.values])[:, 0]

    def likelihood(levels: np.ndarray) -> float:  # Patterson & Thompson 1971
        variance = np.concatenate([errors**2 + levels[0] ** 2, 0.04 + levels[1] ** 2 + 0 * T])
        normal = design.T @ (design / variance[:, None])
        best = np.linalg.solve(normal, design.T @ (y / variance))
        left = y - design @ best
        sign, size = np.linalg.slogdet(normal)
        return -(left**2 / variance + np.log(variance)).sum() / 2 - sign * size / 2

    levels = np.array([m.level for m in found.data[0]])
    for d in (np.array([1e-3, 0]), np.array([0, 1e-3])):
        most, near = likelihood(levels), (likelihood(levels + d), likelihood(np.abs(levels - d)))
        assert most >= max(near) - 1e-12
    assert abs(levels[0] - 0.4) < 3 * found.jitter_sigma[0][0]
    given = vi.fit(SCENE, vi.gauss(2), data=found.data[0], **ASKED)
    assert np.allclose(given.estimates, found.estimates, rtol=1e-9)
    assert np.isnan(given.jitter_sigma[0]).all()


def test_a_jitter_that_the_data_do_not_ask_for_is_zero():
    data = seen(np.random.default_rng(3), 0.1, sigma=0.3, jitter=vi.free(0.5, 0.0, np.inf))
    found = vi.fit(SCENE, vi.gauss(2), data=data, **ASKED)
    assert found.data[0][0].level == 0 and found.jitter_sigma[0][0] == np.inf


def test_noise_that_makes_no_sense_is_refused_in_words():
    free = vi.free(0.1, 0.0, np.inf)
    for noise, words in (
        (dict(sigma=0.0), "sigma must be positive"),
        (dict(sigma=0.0, jitter=vi.free(0.0, 0.0, 1.0)), "sigma must be positive"),
        (dict(jitter=-1.0), "not negative"),
        (dict(jitter=vi.free(0.1, -1.0, 1.0)), "not negative"),
        (dict(jitter=[0.1, 0.2]), "one number"),
        (dict(sigma=free, jitter=free), "cannot both be unknown"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.Measurement(SCENE.q, T, T, **noise)
    data = seen(np.random.default_rng(3), 0.1, sigma=free)
    with pytest.raises(vi.InputError, match="huber"):
        vi.fit(SCENE, vi.gauss(2), data=data, huber=1.5, **ASKED)
