"""A path's own error: measured, warned of, met on request; paths that wind; ends that are
conjugate. References are independent: Lambert's problem by universal variables, closed forms.
"""

import casadi as ca
import numpy as np
import pytest
from kepler_arcs import eccentric_ends, ellipse_of_about_the_period, kepler, lambert
from scipy.optimize import brentq

import varint as vi


@pytest.mark.parametrize(
    ("e", "forwards", "which", "share"),
    [
        (0.8, True, 0, 0.95),
        (0.8, True, 1, 0.95),
        (0.8, False, 0, 1.05),
        (0.8, False, 1, 0.95),
        (0.9, True, 0, 1.05),
        (0.9, False, 1, 1.05),
        (0.95, True, 0, 0.95),
    ],
)
def test_eccentric_arcs_with_a_whole_turn_are_found_to_the_wanted_error(e, forwards, which, share):
    start, end, duration = eccentric_ends(e, 2.0, -2.2)
    v = lambert(start, end, duration, forwards, 1)[which]
    guess = ellipse_of_about_the_period(start, end, v, duration, forwards, share)
    path = vi.least_action(
        kepler(), q_start=start, q_end=end, duration=duration, guess=guess, steps=60, tol=1e-7
    )
    assert path.stats["error_estimate"] <= 1e-7
    assert np.abs(path.v[0] - v).max() < 1e-6 * np.abs(v).max()
    kinetic = (path.v**2).sum(axis=1).max() / 2
    assert np.ptp(path.energy) < 1e-6 * kinetic
    assert path.sizes.max() > 2 * path.sizes.min()


@pytest.mark.parametrize(
    ("steps", "rule"), [(30, vi.gauss(2)), (60, vi.gauss(3)), (100, vi.composition("yoshida6"))]
)
def test_the_error_estimate_is_the_error(steps, rule):
    start, end, duration = np.array([1.0, 0.0]), np.array([-0.3, 1.1]), 1.3
    [v] = lambert(start, end, duration, True, 0)
    path = vi.least_action(kepler(), rule, q_start=start, q_end=end, duration=duration, steps=steps)
    fine = vi.least_action(
        kepler(), vi.gauss(8), q_start=start, q_end=end, duration=duration, steps=4 * steps
    )
    assert np.abs(fine.v[0] - v).max() < 1e-11
    true = max(
        (np.abs(path.q - fine.q[::4]) / np.ptp(fine.q, axis=0)).max(),
        (np.abs(path.p - fine.p[::4]) * np.ptp(fine.q, axis=0)).max()
        / (np.abs(fine.p) * np.ptp(fine.q, axis=0)).max(),
    )
    assert 0.7 * true < path.stats["error_estimate"] < 1.4 * true


def test_a_path_that_is_none_is_warned_of_and_found_by_tolerance():
    ends = dict(q_start=[1.0, 0.0], q_end=[-0.9, 0.3], duration=3.3)
    with pytest.warns(UserWarning, match=r"16 steps of gauss\(4\) are too few .* tol="):
        spurious = vi.least_action(kepler(), vi.gauss(4), steps=16, **ends)
    assert spurious.stats["error_estimate"] > 0.01
    path = vi.least_action(kepler(), tol=1e-9, **ends)
    exact = lambert(np.array(ends["q_start"]), np.array(ends["q_end"]), 3.3, path.v[0, 1] > 0, 0)
    assert np.abs(path.v[0] - exact[0]).max() < 1e-8


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
def test_tolerances_are_met_with_constraints_controls_and_explicit_time(tol):
    q, v = vi.coordinates("x", "y", "z")
    bead = vi.System(
        q, v, ca.sumsqr(v) / 2 - 4 * q[2], constraint=q[0] ** 2 + q[1] ** 2 / 2 + 3 * q[2] ** 2 - 1
    )
    ends = dict(q_start=[1.0, 0, 0], q_end=[0, 0, np.sqrt(1 / 3)], duration=1.0)
    path = vi.least_action(bead, vi.lobatto(3), tol=tol, steps=4, **ends)
    fine = vi.least_action(bead, vi.lobatto(6), steps=60, **ends)
    assert np.abs(path.p[0] - fine.p[0]).max() < 3 * tol * np.abs(fine.p).max()
    x, w = vi.coordinates("x")
    push, t = ca.SX.sym("push"), vi.time()
    driven = vi.System(
        x, w, w**2 / 2 + ca.cos(3 * x) * (1 + 0.3 * ca.sin(t)), force=push, control=push, t=t
    )
    u = np.linspace(-1, 1, 10)[:, None]
    ends = dict(q_start=0.0, q_end=1.5, duration=2.0, t0=0.4)
    path = vi.least_action(driven, vi.gauss(2), tol=tol, steps=10, u=u, **ends)
    fine = vi.least_action(driven, vi.gauss(6), steps=100, u=np.repeat(u, 10, axis=0), **ends)
    assert np.abs(path.p[0] - fine.p[0]).max() < 3 * tol * np.abs(fine.p).max()


def test_paths_with_steps_of_their_own_have_index_derivatives_and_dense_output(tmp_path):
    start, end, duration = eccentric_ends(0.7, 2.0, -2.2)
    v = lambert(start, end, duration, True, 1)[1]
    guess = ellipse_of_about_the_period(start, end, v, duration, True, 1.0)
    ends = dict(q_start=start, q_end=end, duration=duration, guess=guess)
    path = vi.least_action(kepler(), tol=1e-9, **ends)
    even = vi.least_action(kepler(), vi.gauss(6), steps=300, **ends)
    assert path.sizes is not None and even.sizes is None
    assert path.action == pytest.approx(even.action, rel=1e-9)
    assert path.morse_index == even.morse_index == len(even.conjugate_times) > 0
    assert path.conjugate_times == pytest.approx(even.conjugate_times, rel=1e-6)
    assert np.abs(path.at(even.t[1:-1]).q - even.q[1:-1]).max() < 1e-8
    change, same = vi.action_derivatives(path), vi.action_derivatives(even)
    assert change.action["duration"] == pytest.approx(-path.energy[0], rel=1e-7)
    assert change.p_end["q_end"] == pytest.approx(same.p_end["q_end"], rel=1e-5)
    path.save(tmp_path / "path.npz")
    assert (vi.load(tmp_path / "path.npz").sizes == path.sizes).all()


def test_kilometres_and_seconds_take_the_long_way_round_as_units_of_one_do():
    mu, radius, end = 398600.4418, 7000.0, 42164.0 * np.array([np.cos(1.2), np.sin(1.2)])
    duration = 0.8 * 2 * np.pi * np.sqrt(((radius + 42164.0) / 2) ** 3 / mu)
    angle, r = np.linspace(0, 1.2 - 2 * np.pi, 60), np.linspace(radius, 42164.0, 60)
    arc = r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    [v] = lambert(np.array([radius, 0.0]), end, duration, False, 0, mu)
    second = np.sqrt(radius**3 / mu)
    ends = dict(q_start=[radius, 0.0], q_end=end, duration=duration, guess=arc)
    ones = dict(q_start=[1.0, 0.0], q_end=end / radius, duration=duration / second)
    path = vi.least_action(kepler(mu), tol=1e-7, **ends)
    unit = vi.least_action(kepler(), tol=1e-7, guess=arc / radius, **ones)
    assert np.abs(path.v[0] - v).max() < 1e-6 * np.abs(v).max()
    assert len(path) == len(unit)
    assert unit.v[0] * radius / second == pytest.approx(path.v[0], rel=1e-7)


@pytest.mark.long
def test_first_paths_wind_round_the_origin_in_both_directions():
    start, end, duration = np.array([1.0, 0.0]), np.array([-0.3, 1.1]), 14.0
    found = vi.paths(
        kepler(),
        q_start=start,
        q_end=end,
        duration=duration,
        tol=1e-8,
        starts=3,
        winding={("x", "y"): [-2, -1, 0, 1]},
    )
    exact = {
        (turns, forwards): lambert(start, end, duration, forwards, turns)
        for turns in (0, 1)
        for forwards in (True, False)
    }
    kinds = {
        kind
        for path in found
        for kind, velocities in exact.items()
        if min(np.abs(path.v[0] - v).max() for v in velocities) < 1e-6
    }
    assert kinds == set(exact)


def test_ways_round_the_origin_in_space_lie_in_the_plane_of_the_ends():
    start, end = np.array([1.0, 0.2, 0.1]), np.array([-0.4, 0.9, 0.3])
    found = vi.paths(
        kepler(names="xyz"),
        q_start=start,
        q_end=end,
        duration=4.0,
        tol=1e-7,
        starts=1,
        winding={("x", "y", "z"): [-1, 0]},
    )
    normal = np.cross(start, end)
    turning = [np.cross(path.q[0], path.v[0]) @ normal for path in found]
    assert min(turning) < 0 < max(turning)
    assert max(np.abs(path.q @ normal).max() for path in found) < 1e-6


@pytest.mark.parametrize("key", [("x", "x"), ("x", "y", "z", "x"), ("x", "w")])
def test_names_that_are_no_place_are_refused(key):
    with pytest.raises(vi.InputError, match="winding"):
        vi.paths(
            kepler(names="xyz"),
            q_start=[1, 0, 0],
            q_end=[0, 1, 0],
            duration=1.0,
            steps=9,
            winding={key: [0]},
        )


@pytest.mark.parametrize(("rule", "steps"), [(vi.gauss(4), 40), (vi.gauss(8), 80)], ids=repr)
@pytest.mark.parametrize("bracket", [(0.05, 0.4), (0.5, 1.0)], ids=["unstable", "stable"])
def test_both_catenoids_have_their_exact_area(rule, steps, bracket):
    q, v = vi.coordinates("r")
    film = vi.System(q, v, q * ca.sqrt(1 + v**2))
    waist = brentq(lambda a: a * np.cosh(0.5 / a) - 1, *bracket, xtol=1e-16)
    guess = waist * np.cosh(np.linspace(-0.5, 0.5, 201) / waist)[:, None]
    path = vi.least_action(
        film, rule, q_start=1.0, q_end=1.0, duration=1.0, t0=-0.5, steps=steps, guess=guess
    )
    area = 0.5 * waist + waist**2 * np.sinh(1 / waist) / 2
    assert path.action == pytest.approx(area, rel=1e-13)


def test_light_near_its_speed_limit_has_the_action_of_its_path():
    q, v = vi.coordinates("x")
    charge = vi.System(q, v, -ca.sqrt(1 - v**2) + 3 * q)  # p = 3 t + p0, v = p/√(1 + p²)
    p = np.array([-30.0, 30.0]) + 1.0
    end = (np.sqrt(1 + p[1] ** 2) - np.sqrt(1 + p[0] ** 2)) / 3
    path = vi.least_action(charge, vi.gauss(6), q_start=0.0, q_end=end, duration=20.0, steps=160)
    lorentz = np.sqrt(1 + path.p[:, 0] ** 2)
    assert np.abs(lorentz - lorentz[0] - 3 * path.q[:, 0]).max() < 1e-5
    proper = np.diff(np.arcsinh(p))[0] / 3
    potential = (np.diff(p * np.sqrt(1 + p**2) + np.arcsinh(p))[0] / 6) - 20 * np.sqrt(
        1 + p[0] ** 2
    )
    assert path.action == pytest.approx(-proper + potential, rel=1e-7)


@pytest.mark.parametrize("stages", [2, 3, 4])
@pytest.mark.parametrize(
    "guess",
    [
        [[1, 0, 0], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0.5, 0.7, 0.3], [-0.3, 0.6, 0.1], [-1, 0, 0]],
    ],
    ids=["great circle", "crooked"],
)
def test_antipodes_are_refused_with_constraints_as_without(stages, guess):
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    ends = dict(q_start=[1, 0, 0], q_end=[-1, 0, 0], duration=1.0, steps=20, guess=guess)
    with pytest.raises(vi.SolverError, match="conjugate"):
        vi.least_action(sphere, vi.lobatto(stages), **ends)
    flat = vi.System(
        q, v, ca.sumsqr(v) / 2, constraint=q[0] ** 2 + q[1] ** 2 + q[2] ** 2 / 0.36 - 1
    )
    path = vi.least_action(flat, vi.lobatto(4), **ends)  # over the pole of a spheroid: one path
    assert path.stats["error_estimate"] < 1e-6


def test_an_oscillation_from_rest_to_rest_closes_though_its_end_momenta_vanish():
    q, v = vi.coordinates("x")
    quartic = vi.System(q, v, v**2 / 2 - q**4 / 4)
    guess = np.cos(np.linspace(0, 2 * np.pi, 50))[:, None]
    path = vi.least_action(quartic, vi.gauss(6), periodic=True, energy=0.25, guess=guess, steps=40)
    assert path.duration == pytest.approx(7.416298709205487, rel=1e-11)  # 4 K(1/√2)
    assert path.q[0, 0] == pytest.approx(1.0, rel=1e-11)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(tol=1e-20), "between"),
        (dict(tol="small"), "between"),
        (dict(tol=1e-6, duration=vi.free(1.0, 0.5, 2.0)), "takes steps"),
    ],
    ids=["too small", "no number", "minimised"],
)
def test_tolerances_that_mean_nothing_are_refused(change, message):
    ends = dict(q_start=[1.0, 0.0], q_end=[0.0, 1.0], duration=1.0, steps=5)
    with pytest.raises(vi.InputError, match=message):
        vi.least_action(kepler(), **ends | change)


def test_a_tolerance_out_of_reach_says_so_and_keeps_the_path():
    q, v = vi.coordinates("x")
    # a force of √|q|: no order beyond one and a half
    kicked = vi.System(q, v, v**2 / 2 - 30 * ca.fabs(q) ** 1.5)
    with pytest.raises(vi.SolverError, match="tol=1e-13") as caught:
        vi.least_action(kicked, vi.gauss(1), q_start=-1.0, q_end=2.0, duration=0.7, tol=1e-13)
    assert np.isfinite(caught.value.iterate.q).all()


def round_the_disc(rule, steps):
    """Free motion from one side of a disc to the other, past it."""
    q, v = vi.coordinates("x", "y")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    guess = [[-1, 0.1], [0, 1], [1, 0]]
    bounds = [(0.25, ca.sumsqr(q), ca.inf)]
    ends = dict(q0=[-1, 0.1], q_end=[1, 0], duration=1.0)
    return vi.least_action(free, rule, steps=steps, guess=guess, bounds=bounds, **ends)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.gauss(4)], ids=str)
def test_a_path_that_leans_on_an_obstacle_knows_its_error(rule):
    fine = round_the_disc(rule, 280)
    for steps in (7, 20, 40):
        path = round_the_disc(rule, steps)
        apart = np.abs(path.q - fine.q[:: 280 // steps]) / np.ptp(fine.q, axis=0)
        assert 0.5 * apart.max() < path.stats["error_estimate"] < 4 * apart.max()


def test_a_path_that_leans_on_an_obstacle_keeps_out_of_it_between_its_nodes(tmp_path):
    """Steps from node to node would know nothing of the disc, and lead through it."""
    depth = []
    for steps in (20, 40):
        path = round_the_disc(vi.gauss(2), steps)
        path.save(tmp_path / "path.npz")
        for motion in (path, vi.load(tmp_path / "path.npz")):
            dense = motion.at(np.linspace(0, 1, 501))
            radius = np.linalg.norm(dense.q, axis=1)
            speed = np.linalg.norm(dense.v, axis=1)
            np.testing.assert_allclose(speed, np.linalg.norm(path.v[0]), rtol=0.1)
            np.testing.assert_allclose(motion.at(path.t).q, path.q, atol=1e-14)
        depth.append(0.5 - radius.min())
    assert depth[0] < 4e-4 and depth[1] < 2e-4  # by steps: 1.6e-2 and 4e-3


def test_a_path_of_free_duration_knows_its_error():
    model = vi.models.brachistochrone(2.0, 1.0, 9.81)
    share = np.linspace(0, 1, 30)[:, None]
    deep = np.sqrt(2.0)
    ends = dict(q0=[0, 0], q_end=[2, deep], guess=np.hstack([2 * share, deep * np.sqrt(share)]))
    paths = [
        vi.least_action(
            model.system, vi.gauss(2), steps=steps, duration=vi.free(0.8, 0.01, 9.0), **ends
        )
        for steps in (10, 20, 80)
    ]
    for path in paths[:2]:
        apart = np.abs(path.q - paths[2].q[:: 80 // path.stats["steps"]]).max()
        assert apart < path.stats["error_estimate"] < 1e-4


def test_a_duration_alone_is_a_path_that_tells_its_error():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])
    path = vi.least_action(ball, q_start=[0, 0], q_end=[1, 0], duration=1.0)
    assert path.stats["error_estimate"] <= 1e-9
    exact = np.stack([path.t, 9.81 / 2 * path.t * (1 - path.t)], 1)
    assert np.abs(path.q - exact).max() < 1e-13
