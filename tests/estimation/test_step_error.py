"""What a step's own error does to estimates, beside fits with half the step."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi


def spring() -> vi.System:
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=2.0)
    return vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)


def fit_spring(h: float, sigma: float) -> vi.Fit:
    system, t = spring(), np.linspace(0.1, 4, 40)
    seen = vi.Measurement(system.q, t, np.cos(np.sqrt(2.0) * t), sigma=sigma)
    return vi.fit(system, vi.gauss(1), data=seen, unknown="k", h=h, q0=1.0, v0=0.0)


def test_the_midpoint_rule_takes_a_spring_for_as_stiff_as_its_frequency_asks():
    """√k = tan(ω h/2) 2/h is fitted to the frequency ω: half of h moves k by three quarters."""
    h, omega = 0.1, np.sqrt(2.0)
    found = fit_spring(h, 0.5)
    stiffness = [(2 / x * np.tan(omega * x / 2)) ** 2 for x in (h, h / 2)]
    assert found.estimates[0] == pytest.approx(stiffness[0], rel=1e-5)
    assert found.step_shift[0] == pytest.approx(stiffness[1] - stiffness[0], rel=0.01)


def test_a_step_whose_error_shows_is_told_and_one_whose_error_does_not_is_not():
    quiet = fit_spring(0.1, 0.5)
    assert abs(quiet.step_shift[0]) < 0.1 * quiet.sigma[0]
    assert not quiet.step_error and "half of h" not in quiet.summary
    with pytest.warns(UserWarning, match=r"half of h would change k by .* take a smaller h"):
        coarse = fit_spring(0.1, 1e-3)
    assert coarse.step_error in coarse.summary
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit_spring(0.002, 1e-3)


@pytest.mark.parametrize("segments, huber", [(1, None), (3, 1.5)])
def test_half_the_step_moves_all_estimates_as_the_first_order_tells(segments, huber):
    q, v = vi.coordinates("theta")
    u, c = ca.SX.sym("u"), vi.Parameters(g=9.81, d=0.1)
    pendulum = vi.System(q, v, v**2 / 2 + c.g * ca.cos(q), force=u - c.d * v, params=c, control=u)
    nodes = np.array(vi.gauss(2).nodes)

    def pushed(h: float) -> np.ndarray:  # a parabola over the whole run, which both grids have
        t = h * (np.arange(round(2 / h))[:, None] + nodes)
        return (t * (2 - t))[..., None]

    fine = vi.simulate(pendulum, vi.gauss(2), q0=1.0, v0=0.3, h=0.005, steps=400, u=pushed(0.005))
    values = fine.q[10::10, 0] + 1e-3 * np.sin(37.0 * np.arange(40))
    values[7] += 0.5 if huber else 0.0
    seen = vi.Measurement(q, fine.t[10::10], values, sigma=1e-2)
    one, two = (
        vi.fit(
            pendulum,
            vi.gauss(2),
            data=seen,
            unknown=["g", "d", "q0", "v0"],
            h=h,
            q0=1.0,
            v0=0.3,
            u=pushed(h),
            segments=segments,
            huber=huber,
        )
        for h in (0.2, 0.1)
    )
    moved = two.estimates - one.estimates
    assert np.abs(one.step_shift - moved).max() < 0.05 * np.abs(moved).max()
    assert np.abs(moved / one.sigma).max() < 0.1  # and nothing was said
