"""Answers that say how good they are: sensitivities, the second-order check, contradictions."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, move, particle, pendulum, swing

import varint as vi

STEP = 1e-4


def varied(solve, name: str, at: float):
    """Central differences of cost, path and controls of problems solved anew."""
    above, below = solve(**{name: at + STEP}), solve(**{name: at - STEP})
    return [(x - y) / (2 * STEP) for x, y in zip(parts(above), parts(below), strict=True)]


def parts(motion: vi.Trajectory) -> list:
    return [np.array(motion.cost), motion.q, motion.u]


def derivative(motion: vi.Trajectory, name: str) -> list:
    found = motion.solution.sensitivity(name)
    return [found.cost[0], found.q[..., 0], found.u[..., 0]]


def close(found, expected, tolerance: float) -> None:
    for x, y in zip(found, expected, strict=True):
        assert np.abs(x - y).max() <= tolerance * max(1.0, np.abs(y).max())


def test_least_effort_is_12_d2_over_T3_and_so_are_its_derivatives():
    d, T = 1.3, 0.8
    motion = move(vi.gauss(2), 5, T, end=dict(q=[d], v=[0]))
    found = motion.solution.sensitivity("end.q.x", "start.q.x", "duration", "start.v.x", "t0")
    slope = 24 * d / T**3
    assert found.cost == pytest.approx(
        [slope, -slope, -36 * d**2 / T**4, -12 * d / T**2, 0], rel=1e-10, abs=1e-10
    )
    # q = d (3 s² − 2 s³) and u = d (6 − 12 s) / T² with s = t / T
    s = np.linspace(0, 1, 6)
    assert found.q[:, 0, 0] == pytest.approx(3 * s**2 - 2 * s**3, abs=1e-12)
    at = (np.arange(5)[:, None] + np.array(vi.gauss(2).nodes)) / 5
    assert found.u[..., 0, 0] == pytest.approx((6 - 12 * at) / T**2, rel=1e-10)
    assert found.u[..., 0, 2] == pytest.approx(-2 * d * (6 - 12 * at) / T**3, rel=1e-9)
    assert found.duration.tolist() == [0, 0, 1, 0, 0]


def cart_with_parameters(**given) -> vi.Trajectory:
    """A pushed cart with a pendulum, its masses parameters, the push limited so that it matters."""
    c, (q, v) = CART
    lagrangian = (
        (1 + c.m) * v[0] ** 2 / 2
        + c.m * ca.cos(q[1]) * v[0] * v[1]
        + c.m * v[1] ** 2 / 2
        + 9.81 * c.m * ca.cos(q[1])
    )
    push = dict(force=ca.vertcat(U, 0), control=U, params=c)
    system = SCENE.setdefault("cart", vi.System(q, v, lagrangian, **push))
    limit, end = given.pop("limit", LIMIT), given.pop("end", 1.0)
    duration, speed = given.pop("duration", 2.5), given.pop("speed", 0.0)
    return vi.optimal_control(
        system,
        vi.gauss(2),
        duration=duration,
        steps=12,
        cost=U**2 + q[1] ** 2,
        q0=[0, 0],
        v0=[speed, 0],
        end=dict(q=[end, 0], v=[0, 0]),
        bounds=[(-limit, U, limit)],
        params=given,
    )


CART = vi.Parameters(m=0.3), vi.coordinates("x", "theta")
LIMIT = 1.0
SCENE: dict[str, vi.System] = {}


@coarse
@pytest.mark.parametrize(
    ("name", "argument", "at"),
    [
        ("m", "m", 0.3),
        ("end.q.x", "end", 1.0),
        ("start.v.x", "speed", 0.0),
        ("duration", "duration", 2.5),
        ("u <= 1", "limit", LIMIT),
    ],
)
def test_derivatives_are_those_of_problems_solved_anew_with_controls_at_their_limits(
    name, argument, at
):
    motion = cart_with_parameters()
    assert motion.solution.active
    found, expected = derivative(motion, name), varied(cart_with_parameters, argument, at)
    if argument == "limit":  # both limits move
        found = [x - y for x, y in zip(found, derivative(motion, "u >= -1"), strict=True)]
    close(found, expected, 1e-6)


def test_what_is_free_changes_with_what_is_given():
    """Least time plus effort: T² = 6 d for ∫ (u² + 1) dt, so dT/dd = T / (2 d), J = 4 T / 3."""
    d = 0.7
    motion = move(vi.gauss(2), 5, vi.free(1.5, 0.1, 9), cost=U**2 + 1, end=dict(q=[d], v=[0]))
    found = motion.solution.sensitivity("end.q.x")
    T = np.sqrt(6 * d)
    assert motion.duration == pytest.approx(T, rel=1e-9)
    assert found.duration == pytest.approx([T / (2 * d)], rel=1e-8)
    assert found.cost == pytest.approx([4 / 3 * T / (2 * d)], rel=1e-8)


def test_a_start_momentum_and_phases_have_derivatives_too():
    system = particle()
    first = vi.Phase(system, vi.gauss(2), 0.5, 3, U**2, q0=[0], p0=[0.2])
    second = vi.Phase(system, vi.gauss(2), 0.5, 3, U**2, end=dict(q=[1], v=[0]))
    motions = vi.optimal_phases([first, second])
    start = motions[0].solution.sensitivity("start.p.x", "duration")
    # J = 12 d²/T³ − 12 d v/T² + 4 v²/T of one motion in both phases together
    v, d, T = 0.2, 1.0, 1.0
    assert start.cost[0] == pytest.approx(-12 * d / T**2 + 8 * v / T, rel=1e-9)
    by_duration = -36 * d**2 / T**4 + 24 * d * v / T**3 - 4 * v**2 / T**2
    assert start.cost[1] == pytest.approx(by_duration, rel=1e-9)
    assert motions[1].solution.sensitivity("end.q.x").cost[0] == pytest.approx(
        24 - 12 * v, rel=1e-9
    )


def test_the_price_of_a_limit_is_the_derivative_of_the_least_time():
    """T = 2 √(d / limit): d/d limit = −T / (2 limit), half of it from either limit."""
    motion = move(vi.gauss(2), 10, vi.free(1, 0.1, 10), cost=1, bounds=[(-1, U, 1)])
    found = motion.solution.sensitivity("u <= 1", "u >= -1", "end.q.x")
    assert found.cost == pytest.approx([-0.5, 0.5, 1.0], rel=1e-8)


def test_a_prompt_shows_a_line():
    rest = dict(start=dict(q=[0], v=[0]), end=dict(q=[1.3], v=[0]))
    prepared = vi.prepare(vi.Phase(particle(), vi.gauss(2), 0.8, 5, U**2, **rest))
    assert re.fullmatch(r"Prepared\(gauss\(2\) × 5, \d+ unknowns\)", repr(prepared))
    found = prepared().solution.sensitivity("duration")
    assert repr(found) == f"Sensitivity(cost by duration {-36 * 1.3**2 / 0.8**4:.6g})"


def test_names_that_were_not_given_are_refused():
    motion = move(vi.gauss(2), 5)
    with pytest.raises(vi.InputError, match=r"does not know \['mass'\].*'end.q.x'"):
        motion.solution.sensitivity("mass")


def test_a_solution_from_a_file_has_lost_its_problem(tmp_path):
    move(vi.gauss(2), 5).save(tmp_path / "move.npz")
    again = vi.load(tmp_path / "move.npz")
    with pytest.raises(vi.InputError, match="does not hold its problem"):
        again.solution.sensitivity()
    with pytest.raises(vi.InputError, match="does not hold its problem"):
        _ = again.solution.second_order
    again.report()


CLAMPED = 4.730040744862704  # cos x cosh x = 1: where a clamped beam loses its stability


def beam(x: float) -> vi.Trajectory:
    """∫ u² − x⁴ q² over a motion that begins and ends at rest in the same place."""
    q = particle().q
    return move(vi.gauss(4), 12, cost=U**2 - x**4 * q**2, end=dict(q=[0], v=[0]))


@pytest.mark.parametrize(
    ("x", "kind"),
    [
        (4.6, "strict minimum"),
        (4.725, "strict minimum"),
        (4.735, "saddle point"),
        (5, "saddle point"),
    ],
)
def test_rest_is_a_minimum_up_to_the_conjugate_point_and_a_saddle_beyond(x, kind):
    found = beam(x).solution.second_order
    assert found.kind == kind
    assert found.names[0].startswith("u (0.00")
    if kind == "strict minimum" or x < 4.8:  # the least of all curvatures; a saddle's to its sign
        assert found.curvature == pytest.approx(2 * (1 - (x / CLAMPED) ** 4), rel=1e-4)


def test_controls_that_share_a_task_are_a_flat_direction():
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u", 2)
    cart = vi.System(q, v, v**2 / 2, force=u[0] + u[1], control=u)
    motion = vi.optimal_control(
        cart,
        vi.gauss(2),
        duration=1,
        steps=5,
        cost=(u[0] + u[1]) ** 2,
        q0=0,
        v0=0,
        end=dict(q=[1], v=[0]),
    )
    found = motion.solution.second_order
    assert found.kind == "flat direction"
    assert sorted(re.sub(r" \(.*", "", name) for name in found.names) == ["u_0", "u_1"]
    sensitivity = motion.solution.sensitivity("end.q.x")
    assert sensitivity.cost == pytest.approx([24], rel=1e-8)
    with pytest.raises(vi.SolverError, match="not determined"):
        _ = sensitivity.u


def test_a_coordinate_that_nothing_holds_is_a_flat_direction():
    """Where the motion takes place does not matter: it may be shifted along x."""
    motion = move(vi.gauss(2), 5, start=dict(v=[0]), end=dict(periodic=[1.0]))
    found = motion.solution.second_order
    assert found.kind == "flat direction" and found.names[0].startswith("x (0 … 1)")


def test_limits_that_determine_everything_leave_nothing_to_vary():
    motion = move(vi.gauss(2), 10, vi.free(1, 0.1, 10), cost=1, bounds=[(-1, U, 1)])
    assert motion.solution.second_order.kind == "determined by its active bounds"


def test_the_report_says_whether_it_is_a_minimum(capsys):
    swing(pendulum(), 3.0, 12).report()
    assert "second order         strict minimum; least curvature" in capsys.readouterr().out


def test_the_nearest_motion_names_the_condition_that_fails_and_those_in_its_way():
    """|u| ≤ 1 leads from rest to rest over T² / 4 at most."""
    with pytest.raises(vi.SolverError, match="contradict each other") as caught:
        move(vi.gauss(3), 10, bounds=[(-1, U, 1)])
    found = caught.value.contradiction
    ((name, size, _),) = found.broken
    assert name == "end.q.x = 1" and size == pytest.approx(-0.75, abs=1e-6)
    opposed = dict(found.opposed)
    assert {"u in -1 … 1", "start.q.x = 0", "start.v.x = 0", "end.v.x = 0"} == set(opposed)
    assert opposed["u in -1 … 1"][0] < 0.05 and opposed["u in -1 … 1"][1] > 0.95


def test_a_bound_on_the_path_that_cannot_be_kept_is_named_with_its_times():
    """Nobody gets past x = 0.5 from 0 to 1."""
    x = particle().q
    with pytest.raises(vi.SolverError) as caught:
        move(vi.gauss(2), 8, bounds=[(0.1, (x - 0.5) ** 2, None), (-9, U, 9)])
    name, size, (begin, end) = caught.value.contradiction.broken[0]
    assert name == "sq((x-0.5)) >= 0.1" and -0.1 - 1e-6 <= size < 0 and 0 < begin <= end < 1


def test_a_callback_sees_every_iterate_and_can_stop():
    seen: list = []
    limited = dict(bounds=[(-5, U, 5)])
    motion = move(vi.gauss(2), 6, callback=lambda *iterate: seen.append(iterate), **limited)
    assert [k for k, *_ in seen] == list(range(motion.solution.iterations + 1))
    assert seen[-1][1] == pytest.approx(motion.cost) and seen[-1][2] < 1e-9
    assert seen[-1][3].q == pytest.approx(motion.q)
    with pytest.warns(UserWarning, match="stopped on request"):
        early = move(vi.gauss(2), 6, callback=lambda k, *_: k == 3, **limited)
    assert early.solution.iterations == 3


def test_an_error_in_a_callback_is_the_callers():
    def fails(*_):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        move(vi.gauss(2), 6, callback=fails)
    with pytest.raises(vi.InputError, match="callback must be a function"):
        move(vi.gauss(2), 6, callback=3)
    with pytest.raises(vi.InputError, match="solver='fatrop'"):
        move(vi.gauss(2), 6, callback=print, solver="fatrop")


def round_a_disc(**more):
    """The line between the ends passes under the middle of a disc: two ways round, of which the
    one above is longer.
    """
    q, v = vi.coordinates("x", "y")
    force = ca.SX.sym("F", 2)
    return vi.optimal_control(
        vi.System(q, v, ca.sumsqr(v) / 2, force=force, control=force),
        duration=2.0,
        steps=40,
        cost=ca.sumsqr(force),
        start=dict(q=[-2, 0], v=[0, 0]),
        end=dict(q=[2, 0], v=[0, 0]),
        bounds=[(1, q[0] ** 2 + (q[1] - 0.2) ** 2, None)],
        **more,
    )


def test_a_saddle_is_told_unasked_and_the_way_out_leads_to_less():
    with pytest.warns(UserWarning, match=r"saddle point, no minimum.*guess=.*multistart"):
        saddle = round_a_disc()
    assert saddle.solution.second_order.kind == "saddle point"
    below = round_a_disc(guess=dict(q=[[-2, 0], [0, -1.2], [2, 0]]))
    assert below.cost < 0.7 * saddle.cost


def test_the_second_order_test_is_not_made_where_the_solver_met_no_negative_curvature():
    assert "second_order" not in vars(swing(pendulum(), 3.0, 12).solution)
