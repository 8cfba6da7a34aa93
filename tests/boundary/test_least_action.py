"""Paths between fixed end points: exact actions, orders, Legendre transforms, constraints,
forces, refusals.
"""

import casadi as ca
import numpy as np
import pytest
from references import given_and_exact
from scenes import double_pendulum, driven_damped, pendulum, slopes
from scipy.integrate import solve_ivp

import varint as vi
from varint.numerics import progress


def oscillator(m=1.0, w=1.0):
    q, v = vi.coordinates("x")
    return vi.System(q, v, m / 2 * (v**2 - w**2 * q**2))


def kepler(mu=1.0, dimensions=3):
    q, v = vi.coordinates(*"xyz"[:dimensions])
    return vi.System(q, v, ca.sumsqr(v) / 2 + mu / ca.norm_2(q))


def test_free_fall_has_its_exact_action_and_velocities():
    given, exact = given_and_exact("b", "B01_action_free_fall")
    q, v = vi.coordinates("x")
    fall = vi.System(q, v, given["m"] * (v**2 / 2 - given["g"] * q))
    path = vi.least_action(
        fall, vi.gauss(4), q_start=given["x0"], q_end=given["x1"], duration=given["T"], steps=5
    )
    assert path.action == pytest.approx(exact["action"], rel=1e-13)
    assert path.v[[0, -1], 0] == pytest.approx([exact["v0"], exact["v1"]], rel=1e-13)
    assert path.is_minimum


def test_a_free_particle_moves_straight_with_the_action_of_half_its_length_squared():
    q, v = vi.coordinates("x", "y")
    path = vi.least_action(
        vi.System(q, v, ca.sumsqr(v) / 2),
        vi.gauss(4),
        q_start=[1, 2],
        q_end=[4, 6],
        duration=2.0,
        steps=7,
    )
    assert path.action == pytest.approx(25 / 4, rel=1e-14)
    assert np.abs(path.v - [1.5, 2.0]).max() < 1e-14


@pytest.mark.parametrize("row", range(4))
def test_the_oscillator_has_its_exact_action_velocities_and_index(row):
    given, exact = given_and_exact("b", "B01_action_harmonic")
    duration, action, v0, v1, index, _ = exact["rows"][row]
    scene = oscillator(given["m"], given["w"])
    path = vi.least_action(
        scene, vi.gauss(4), q_start=given["x0"], q_end=given["x1"], duration=duration, steps=40
    )
    assert path.action == pytest.approx(action, rel=1e-12)
    assert path.v[[0, -1], 0] == pytest.approx([v0, v1], rel=1e-12)
    assert path.morse_index == index


@pytest.mark.parametrize("case", ["curtis_5_2", "curtis_5_3", "molniya_der_0rev"])
def test_lamberts_problem_has_the_velocities_of_the_textbooks(case):
    given, exact = given_and_exact("b", f"B02_lambert_{case}")
    ends = dict(q_start=given["r1"], q_end=given["r2"], duration=given["T"])
    path = vi.least_action(kepler(given["mu"]), vi.gauss(8), steps=60, **ends)
    assert path.action == pytest.approx(exact["action_per_unit_mass"], rel=1e-14)
    for found, wanted, published in zip(
        path.v[[0, -1]],
        (exact["v1"], exact["v2"]),
        (exact["published"]["v1"], exact["published"].get("v2")),
        strict=True,
    ):
        assert np.abs(found - wanted).max() < 1e-13 * np.abs(wanted).max()
        assert published is None or np.abs(found - published).max() < 1e-4


@pytest.mark.parametrize("which", [0, 1])
def test_kepler_arcs_the_short_and_the_long_way_have_their_exact_actions(which):
    given, exact = given_and_exact("b", "B02_lambert_dimensionless")
    r1, r2, wanted = np.array(given["r1"]), np.array(given["r2"]), exact["solutions"][which]
    guess = None if wanted["short_way"] else [r1, -(r1 + r2), r2]
    ends = dict(q_start=r1, q_end=r2, duration=given["T"])
    path = vi.least_action(kepler(), vi.gauss(4), guess=guess, steps=100, **ends)
    assert path.action == pytest.approx(wanted["action"], rel=1e-12)
    assert np.abs(path.v[0] - wanted["v1"]).max() < 1e-11
    assert np.abs(path.at(1.0).q - wanted["midpoint"][:3]).max() < 1e-11
    # the long way passes the point opposite, conjugate to the start out of the plane
    assert path.morse_index == which


@pytest.mark.parametrize(
    ("goal", "duration"), [(np.pi / 2, 1.0), (np.pi / 2, 2.0), (3.0, 2.0), (3.0, 4.0)]
)
def test_the_pendulums_paths_agree_with_an_independent_integrator(goal, duration):
    path = vi.least_action(
        pendulum(), vi.gauss(6), q_start=0.0, q_end=goal, duration=duration, steps=40
    )

    def motion(t, y):
        return [y[1], -np.sin(y[0]), y[1] ** 2 / 2 + np.cos(y[0])]

    end = solve_ivp(
        motion, (0, duration), [0, path.v[0, 0], 0], method="DOP853", rtol=1e-13, atol=1e-14
    ).y[:, -1]
    assert [path.q[-1, 0], path.v[-1, 0], path.action] == pytest.approx(end, rel=1e-11)


RULES = [
    vi.gauss(1),
    vi.gauss(2),
    vi.gauss(3),
    vi.lobatto(2),
    vi.lobatto(3),
    vi.lobatto(4),
    vi.composition("yoshida6"),
]


@pytest.mark.parametrize("rule", RULES, ids=repr)
def test_action_and_end_momenta_have_the_order_of_the_rule(rule):
    _, exact = given_and_exact("b", "B01_pendulum_bvp")
    wanted = exact["solutions"][2]
    first = vi.simulate(pendulum(), vi.gauss(6), q0=0.0, v0=wanted["v0"], h=0.1, steps=100)
    steps, errors = [30, 40, 56, 80, 112, 160, 224], []
    for count in steps:
        path = vi.least_action(
            pendulum(), rule, q_start=0.0, q_end=1.0, duration=10.0, steps=count, guess=first
        )
        errors.append([abs(path.action - wanted["action"]), abs(path.p[0, 0] - wanted["v0"])])
    found = slopes(steps, np.array(errors), 1e-12)
    assert np.abs(found - rule.order).max() < 0.15 * max(1, rule.order / 4), found


@pytest.mark.parametrize("rule", [*RULES, vi.gauss(8), vi.composition("blanes-moan4")], ids=repr)
def test_simulation_from_the_start_momentum_reproduces_the_path_to_round_off(rule):
    path = vi.least_action(pendulum(), rule, q_start=0.3, q_end=-1.0, duration=5.0, steps=50)
    again = vi.simulate(pendulum(), rule, q0=path.q[0], p0=path.p[0], h=path.h, steps=50)
    assert np.abs(again.q - path.q).max() < 1e-13
    assert np.abs(again.p - path.p).max() < 1e-13


def test_the_scenes_own_rule_is_used_where_none_is_given():
    path = vi.least_action(pendulum(), q_start=0.3, q_end=-1.0, duration=5.0, steps=50)
    again = vi.simulate(pendulum(), q0=path.q[0], p0=path.p[0], h=path.h, steps=50)
    assert np.abs(again.q - path.q).max() < 1e-13


def test_paths_with_forces_and_time_solve_the_lagrange_dalembert_problem():
    scene, ends = driven_damped(), dict(q_start=[0.1, 0.4], q_end=[0.6, -0.3])
    path = vi.least_action(scene, vi.gauss(4), duration=2.0, t0=0.7, steps=30, **ends)
    again = vi.simulate(scene, vi.gauss(4), q0=path.q[0], p0=path.p[0], h=path.h, steps=30, t0=0.7)
    assert np.abs(again.q - path.q).max() < 1e-13
    assert np.abs(again.p - path.p).max() < 1e-13
    with pytest.raises(vi.InputError, match="forces"):
        path.morse_index  # noqa: B018


def test_drag_between_two_points_has_its_closed_form():
    q, v = vi.coordinates("x")
    dragged = vi.System(q, v, v**2 / 2, force=-0.7 * v)
    path = vi.least_action(dragged, vi.gauss(4), q_start=0.0, q_end=1.0, duration=2.0, steps=20)
    exact = (1 - np.exp(-0.7 * path.t)) / (1 - np.exp(-1.4))
    assert np.abs(path.q[:, 0] - exact).max() < 1e-13


def test_controls_push_the_path():
    q, v = vi.coordinates("x")
    push = ca.SX.sym("push")
    scene = vi.System(q, v, v**2 / 2, force=push, control=push)
    path = vi.least_action(
        scene, vi.gauss(2), q_start=0.0, q_end=1.0, duration=1.0, steps=8, u=[2.0]
    )
    assert np.abs(path.q[:, 0] - path.t**2).max() < 1e-14


def test_parameters_and_explicit_time_reach_the_path():
    model = vi.models.caldirola_kanai()
    times = np.array([0.0, 3.0])
    ends = model.exact(times)[0]
    path = vi.least_action(
        model.system, vi.gauss(6), q_start=ends[0], q_end=ends[1], duration=3.0, steps=60
    )
    assert np.abs(path.q - model.exact(path.t)[0]).max() < 1e-12
    other = vi.least_action(
        model.system,
        vi.gauss(6),
        q_start=ends[0],
        q_end=ends[1],
        duration=3.0,
        steps=60,
        params={name: 1.1 * value for name, value in model.system.defaults.items()},
    )
    assert np.abs(path.q - other.q).max() > 1e-3


@pytest.mark.parametrize("stages", [3, 4, 5])
def test_great_circles_by_constraint_run_the_short_and_the_long_way(stages):
    given, exact = given_and_exact("b", "B03_geodesic_sphere")
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)

    def place(theta, phi):
        return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])

    a, b = place(given["theta1"], given["phi1"]), place(given["theta2"], given["phi2"])
    rule, tolerance = vi.lobatto(stages), {3: 3e-6, 4: 1e-9, 5: 1e-13}[stages]
    for index, length, guess in (
        (0, exact["length"], None),
        (1, exact["long_way_length"], [a, -3 * (a + b), b]),
    ):
        path = vi.least_action(
            sphere, rule, q_start=a, q_end=b, duration=1.0, steps=20, guess=guess
        )
        assert abs(np.sqrt(2 * path.action) - length) < tolerance
        assert path.morse_index == index
        assert (
            np.abs(path.conjugate_times * length - np.pi * np.ones(index)).max(initial=0.0) < 1e-6
        )
        assert np.abs((path.q**2).sum(axis=1) - 1).max() < 1e-13
        assert np.abs((path.q * path.v).sum(axis=1)).max() < 1e-13  # the hidden constraint G v = 0
        assert path.multipliers[:, 0] == pytest.approx(
            -(length**2) / 2, rel=1e-3 if stages == 3 else 1e-5
        )
        again = vi.simulate(sphere, rule, q0=path.q[0], p0=path.p[0], h=path.h, steps=20)
        assert np.abs(again.q - path.q).max() < 1e-13
    assert (
        np.abs(
            vi.least_action(sphere, vi.lobatto(5), q_start=a, q_end=b, duration=1.0, steps=20)
            .at([0.25, 0.5, 0.75])
            .q
            - exact["points"]
        ).max()
        < 1e-12
    )


def test_twenty_thousand_unknowns_are_solved_and_memory_grows_with_the_steps():
    q, v = vi.coordinates(*"abcd")
    lagrangian = ca.sumsqr(v) / 2 + ca.sum1(ca.cos(q)) + 0.3 * ca.cos(q[0] - q[1]) * v[2] * v[3]
    scene, ends = (
        vi.System(q, v, lagrangian),
        dict(q_start=np.zeros(4), q_end=[1, 2, 0.5, -1], duration=2.0),
    )
    path = vi.least_action(scene, vi.gauss(1), steps=5000, **ends)
    fine = vi.least_action(scene, vi.gauss(4), steps=50, **ends)
    assert np.abs(path.p[0] - fine.p[0]).max() < 1e-6  # midpoint: 1e-7 by its order
    again = vi.simulate(scene, vi.gauss(1), q0=path.q[0], p0=path.p[0], h=path.h, steps=5000)
    assert np.abs(again.q - path.q).max() < 1e-12
    from varint.boundary.stationary import path_equations

    nonzeros = [
        path_equations(scene, vi.gauss(1), n, False, False).linearised.nnz_out(1)
        for n in (500, 1000)
    ]
    assert nonzeros[1] < 2 * nonzeros[0]


def test_newton_alone_fails_where_continuation_in_the_duration_succeeds():
    from varint.boundary.newton import newton
    from varint.boundary.problem import boundary_value_problem, first_path

    ends = dict(q_start=[0.0, 0.0], q_end=[3.0, -2.0], duration=3.0)
    scene, rule = double_pendulum(), vi.gauss(3)
    problem, nodes, window = boundary_value_problem(
        scene,
        rule,
        **ends,
        steps=60,
        t0=0.0,
        guess=None,
        u=None,
        params=None,
        periodic=False,
        symmetry=None,
        energy=None,
    )
    assert not newton(problem, first_path(problem, nodes, window[0])).solved
    path = vi.least_action(scene, rule, steps=60, **ends)
    again = vi.simulate(scene, rule, q0=path.q[0], p0=path.p[0], h=path.h, steps=60)
    assert np.abs(again.q[-1] - ends["q_end"]).max() < 1e-9


def test_end_points_that_cannot_be_joined_give_the_reason_and_the_last_iterate():
    # too little energy to reach the top
    with pytest.raises(vi.SolverError, match="guess") as caught:
        vi.least_action(pendulum(), vi.gauss(2), q_start=0.0, q_end=np.pi, energy=0.5, steps=20)
    assert caught.value.status != "solved"
    assert caught.value.iterate.q.shape == (21, 1)
    assert np.isfinite(caught.value.iterate.q).all()


def test_ends_conjugate_to_each_other_are_refused_with_the_reason():
    with pytest.raises(vi.SolverError, match="conjugate") as caught:
        vi.least_action(oscillator(), vi.gauss(4), q_start=1.0, q_end=1.0, duration=np.pi, steps=40)
    assert caught.value.status == "conjugate end points"


q1, v1 = vi.coordinates("x")
q2, v2 = vi.coordinates("x", "y")
GOOD = dict(q_start=0.0, q_end=1.0, duration=1.0, steps=5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(q_end=[1.0, 2.0]), "q_end has shape"),
        (dict(q_end=None), "give q0 and q_end"),
        (dict(q_end=np.nan), "not finite"),
        (dict(duration=None), "duration of the path, or its energy"),
        (dict(duration=-1.0), "positive"),
        (dict(duration="long"), "duration must be"),
        (dict(duration=1.0, energy=1.0), "not both"),
        (dict(duration=None, energy=-10.0), "below the potential"),
        (dict(steps=0), "steps"),
        (dict(steps=2.5), "steps"),
        (dict(guess=np.zeros((3, 2))), "guess has shape"),
        (dict(guess="left"), "guess must be"),
        (dict(periodic=True), "no end points"),
        (dict(periodic=True, q_start=None, q_end=None), "needs a guess"),
        (dict(symmetry=[[1.0]]), "periodic=True"),
        (
            dict(periodic=True, q_start=None, q_end=None, guess=[[0.0], [1.0]], symmetry=np.eye(2)),
            "symmetry has shape",
        ),
        (dict(params=dict(mass=1.0)), "unknown parameters"),
        (dict(rule="gauss"), "rule must be"),
        (dict(u=[1.0]), "no control"),
        (dict(bounds=[(0, v1, 1)]), "velocities"),
        (dict(bounds=[(0.5, q1, 1)]), "violates the bounds"),
        (dict(bounds=[(1, q1, 0)]), "contradict"),
        (dict(bounds=[(0, q2, 1)]), "depends on"),
        (dict(bounds=[(0, q1, 1)], rule=vi.composition("verlet")), "between its nodes"),
    ],
    ids=lambda x: None if isinstance(x, str) else "-".join(x),
)
def test_input_that_is_no_problem_is_refused_with_a_remedy(change, message):
    scene = vi.System(q1, v1, (v1**2 - q1**2) / 2)
    with pytest.raises(vi.InputError, match=message):
        vi.least_action(scene, **GOOD | change)


def test_scenes_without_an_action_principle_between_ends_are_refused():
    ends = dict(q_start=[1.0, 0.0], q_end=[0.0, 1.0], duration=1.0, steps=5)
    kinetic = ca.sumsqr(v2) / 2
    circle = vi.System(q2, v2, kinetic, constraint=ca.sumsqr(q2) - 1)
    with pytest.raises(vi.InputError, match=r"q_end .* off the constraint: row 0"):
        vi.least_action(circle, **ends | dict(q_end=[0.0, 1.1]))
    with pytest.raises(vi.InputError, match="constraints"):
        vi.least_action(circle, vi.gauss(2), **ends)
    with pytest.raises(vi.InputError, match="degenerate"):
        vi.least_action(vi.System(q2, v2, q2[0] * v2[1] - ca.sumsqr(q2)), **ends)
    with pytest.raises(vi.InputError, match="non-holonomic"):
        vi.least_action(vi.System(q2, v2, kinetic, nonholonomic=ca.horzcat(q2[1], 1)), **ends)
    with pytest.raises(vi.InputError, match="bounds="):
        vi.least_action(vi.System(q2, v2, kinetic, contact=q2[0]), **ends)
    with pytest.raises(vi.InputError, match="free duration"):
        vi.least_action(
            vi.System(q2, v2, kinetic, force=-v2), **ends | dict(duration=vi.free(1.0, 0.1, 2.0))
        )
    with pytest.raises(vi.InputError, match="not finite along the first path"):
        through = dict(q_end=[-1.0, 0.0], guess=[[1.0, 0.0], [-1.0, 0.0]])
        vi.least_action(kepler(dimensions=2), **ends | through)


def test_a_guess_through_a_singular_point_of_a_bound_is_told_in_words_without_a_dump(capfd):
    q, v = vi.coordinates("x", "y")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    ends = dict(q_start=[-2, 0], q_end=[2, 0], duration=1.0, steps=60)
    with pytest.raises(vi.SolverError, match="singular point of L, of the cost or of a bound"):
        vi.least_action(free, vi.gauss(2), bounds=[(1.0, ca.norm_2(q), None)], **ends)
    printed = capfd.readouterr()
    assert not printed.out and not printed.err


@pytest.mark.parametrize("place", [0.0, 5.0])
@pytest.mark.parametrize("hardening", [0.0, 1e-3])
def test_what_is_thrown_straight_up_and_caught_where_it_began_has_a_path(place, hardening):
    q, v = vi.coordinates("x")
    height = q - place
    throw = vi.System(q, v, v**2 / 2 - 9.81 * height - hardening * height**4)
    path = vi.least_action(throw, vi.gauss(2), q_start=place, q_end=place, duration=2.0, steps=50)
    again = vi.simulate(throw, vi.gauss(2), q0=place, v0=path.v[0], h=path.h, steps=50)
    np.testing.assert_allclose(again.q, path.q, atol=1e-12)
    assert path.q.max() - place > 3
    if not hardening:
        assert path.v[0, 0] == pytest.approx(9.81, rel=1e-13)


def test_a_metric_that_is_no_expression_is_refused():
    q, v = vi.coordinates("x")
    for wrong in ("a", object(), ca.MX.sym("m")):
        with pytest.raises(vi.InputError, match="metric"):
            vi.geodesic(q, v, wrong)
        with pytest.raises(vi.InputError, match=r"^q "):
            vi.geodesic(wrong, v, q)


def test_a_long_search_is_told_where_someone_watches(capsys, monkeypatch):
    monkeypatch.setattr(progress, "SILENCE", 1e-3)
    vi.least_action(pendulum(), q0=0.0, q_end=1.0, duration=3.0)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress, "_is_watched", lambda: True)
    vi.least_action(pendulum(), q0=0.0, q_end=1.1, duration=3.1)
    assert "looking for a path of least action: 0 s" in capsys.readouterr().err
