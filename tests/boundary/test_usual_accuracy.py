"""Paths for which neither steps nor a tolerance are given: to 1e-9, or with a word."""

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi


def oscillator(**given) -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, (v**2 - q**2) / 2, **given)


@pytest.mark.parametrize("duration", [4.0, 100.0, 200.0])
def test_long_oscillations_are_as_accurate_as_short_ones(duration):
    path = vi.least_action(oscillator(), q0=0.0, q_end=1.0, duration=duration)
    exact = np.sin(path.t) / np.sin(duration)
    assert np.abs(path.q[:, 0] - exact).max() <= 1e-9 * np.ptp(exact)
    assert path.stats["error_estimate"] <= 1e-9


def test_geodesics_on_a_constraint_are_accurate_too():
    q, v = vi.coordinates("x", "y", "z")
    ball = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    path = vi.least_action(ball, q0=[1, 0, 0], q_end=[0, 1, 0], duration=1.0)
    angle = path.t * np.pi / 2
    exact = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    assert np.abs(path.q - exact).max() <= 1e-9
    assert path.stats["error_estimate"] <= 1e-9


@pytest.mark.parametrize("rows", [5, 40])
def test_rows_of_a_table_of_controls_share_the_duration(rows):
    push, q = ca.SX.sym("push"), vi.coordinates("x")
    scene = vi.System(*q, q[1] ** 2 / 2, force=push, control=push)
    u = np.linspace(-1, 2, rows)
    path = vi.least_action(scene, q0=0.0, q_end=1.0, duration=3.0, u=u)
    h = 3.0 / rows
    left = h * (rows - np.arange(rows)) - h / 2  # of a constant push, to the end
    assert path.v[0, 0] == pytest.approx((1 - (u * h * left).sum()) / 3.0, rel=1e-12)


def test_an_accuracy_that_is_not_reached_is_told():
    q, v = vi.coordinates("x")
    # a force of √|q|: no order beyond one and a half
    kicked = vi.System(q, v, v**2 / 2 - 30 * ca.fabs(q) ** 1.5)
    with pytest.warns(UserWarning, match="more than the usual 1e-09"):
        path = vi.least_action(kicked, vi.midpoint(), q0=-0.5, q_end=1.0, duration=1.0)
    assert 1e-9 < path.stats["error_estimate"] < 1e-4


def test_where_no_path_exists_the_search_ends_soon():
    q, v = vi.coordinates("u")
    bratu = vi.System(q, v, v**2 / 2 - 4.0 * ca.exp(q))  # solutions up to 3.5138…
    with pytest.raises(vi.SolverError, match="no path was found") as caught:
        vi.least_action(bratu, q0=0.0, q_end=0.0, duration=1.0)
    assert len(caught.value.iterate) - 1 <= 32
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        below = vi.least_action(
            vi.System(q, v, v**2 / 2 - 2.0 * ca.exp(q)), q0=0.0, q_end=0.0, duration=1.0
        )
    # u = −2 ln(cosh(θ (t − ½) / 2) / cosh(θ / 4)) with θ = 2 cosh(θ / 4), the lower solution
    theta = 2.3575510538774020
    exact = -2 * np.log(np.cosh(theta * (below.t - 0.5) / 2) / np.cosh(theta / 4))
    assert np.abs(below.q[:, 0] - exact).max() < 1e-9


def test_several_paths_leave_out_what_is_none_and_say_so():
    q, v = vi.coordinates("theta")
    pendulum, ends = vi.System(q, v, v**2 / 2 + ca.cos(q)), dict(q0=0.0, q_end=1.0, starts=12)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = vi.paths(pendulum, vi.midpoint(), duration=6.0, steps=6, **ends)
    assert ["left out" in str(one.message) for one in told] == [True, False]
    assert all("6 steps of midpoint() are too few" in str(one.message) for one in told)
    assert all(path.stats["error_estimate"] <= 0.1 for path in found)
    with pytest.raises(vi.SolverError, match="may be none"):
        vi.paths(pendulum, vi.midpoint(), duration=9.0, steps=4, **ends)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        every = vi.paths(pendulum, duration=6.0, **ends)
    assert len(every) == 3
    assert all(path.stats["error_estimate"] <= 1e-9 for path in every)


def test_the_quickest_descent_needs_no_steps():
    model = vi.models.brachistochrone(1.0, 1.0)
    share, deep = np.linspace(0, 1, 30)[:, None], np.sqrt(2.0)
    path = vi.least_action(
        model.system,
        q0=[0, 0],
        q_end=[1, deep],
        duration=vi.free(1.0, 0.01, 100.0),
        guess=np.hstack([share, deep * np.sqrt(share)]),
    )
    radius, turn = vi.models.cycloid(1.0, 1.0)
    assert path.action == pytest.approx(turn * np.sqrt(radius / 9.81), rel=1e-10)
    assert path.stats["error_estimate"] < 1e-8


def test_a_path_that_leans_on_a_bound_needs_no_steps_and_tells_what_it_misses():
    x, v = vi.coordinates("x", "y")
    free = vi.System(x, v, ca.sumsqr(v) / 2)
    ends = dict(q0=[-2, 0], q_end=[2, 0], duration=1.0, guess=[[-2, 0], [0, 1.2], [2, 0]])
    ends |= dict(bounds=[(1, ca.sumsqr(x), None)])
    path = vi.least_action(free, **ends)
    exact = 2 * np.sqrt(3) + np.pi / 3  # two tangents and an arc between them
    assert path.stats["error_estimate"] <= 1e-5
    assert np.sqrt(2 * path.action) == pytest.approx(exact, rel=1e-6)
    with pytest.warns(UserWarning, match="more than the usual 1e-05; give steps="):
        coarse = vi.least_action(free, vi.midpoint(), **ends)
    assert len(coarse) - 1 == 160
    assert np.sqrt(2 * coarse.action) == pytest.approx(exact, rel=1e-3)
