"""Paths that go the way of their first path: as often round, on the same side. References:
Lambert's problem by universal variables, and simulation of the start that was found.
"""

import warnings
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from kepler_arcs import circling, kepler, lambert, random_arc, swept

import varint as vi
from varint.boundary.by_duration import of_duration
from varint.boundary.divided_steps import split_steps, with_steps
from varint.boundary.iterate import with_duration
from varint.boundary.moving_newton import fresh, of_any_duration, of_its_duration
from varint.boundary.moving_nodes import even_nodes, lengths, moving_path
from varint.boundary.newton import newton
from varint.boundary.problem import boundary_value_problem, first_path
from varint.boundary.search import Found, _has_stayed
from varint.boundary.winding import goes_as, other_way, singular_places, with_ways_compared


def problem_of(system, rule, start, end, duration, guess):
    problem, nodes, _ = boundary_value_problem(
        system,
        rule,
        q_start=start,
        q_end=end,
        duration=duration,
        steps=4,
        t0=0.0,
        guess=guess,
        u=None,
        params=None,
        periodic=False,
        symmetry=None,
        energy=None,
    )
    return problem, nodes


def nearest(path, start, end, duration, angle, turns):
    """How far the start's velocity is from the nearest of Lambert's, relative to it."""
    every = lambert(start, end, duration, angle > 0, turns)
    return min(np.abs(path.v[0] - v).max() / np.abs(v).max() for v in every)


def is_found(seed, least, most, turns):
    """Whether a circling path leads to a motion that goes round as it does; another says so."""
    start, end, duration, angle = random_arc(seed, least, most, turns)
    guess = circling(start, end, angle)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        path = vi.least_action(
            kepler(), q_start=start, q_end=end, duration=duration, guess=guess, tol=1e-7
        )
    goes_round = abs(swept(path.q) - angle) <= 1e-6
    assert [str(x.message)[:25] for x in told] == ["the path goes another way"] * (not goes_round)
    assert path.stats["error_estimate"] <= 1e-7
    kinetic = (path.v**2).sum(axis=1).max() / 2
    assert np.ptp(path.energy) < 1e-6 * kinetic
    if not goes_round:
        return False
    assert nearest(path, start, end, duration, angle, int(abs(angle) / (2 * np.pi))) < 1e-5
    return True


def test_eccentric_arcs_with_a_whole_turn_are_found_from_circles():
    assert is_found(0, 0.8, 0.95, 1)


@pytest.mark.parametrize("seed", [0, 1])
def test_nearly_straight_arcs_go_round_the_centre_as_their_first_path(seed):
    assert is_found(seed, 0.95, 0.999, 0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "least", "most", "turns"),
    [(215, 0.95, 0.999, 0), (206, 0.8, 0.95, 1), (210, 0.8, 0.95, 1), (207, 0.988, 0.999, 1)],
)
def test_arcs_are_looked_for_from_several_durations(seed, least, most, turns):
    """The first motions found are too coarse, or there is none: another duration leads on."""
    assert is_found(seed, least, most, turns)


@pytest.mark.long
@pytest.mark.parametrize(
    ("least", "most", "turns", "share"), [(0.8, 0.95, 1, 0.95), (0.95, 0.999, 0, 0.9)]
)
def test_random_arcs_are_found_nearly_always(least, most, turns, share):
    found = [is_found(seed, least, most, turns) for seed in range(100, 130)]
    assert np.mean(found) >= share


@pytest.mark.long
def test_a_disturbed_orbit_goes_round_as_its_first_path():
    q, v = vi.coordinates("x", "y")
    r = ca.norm_2(q)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / r + 0.002 / r**3 + 0.02 * q[0])
    start, end, duration, angle = random_arc(0, 0.7, 0.8, 1)
    path = vi.least_action(
        system,
        q_start=start,
        q_end=end,
        duration=duration,
        guess=circling(start, end, angle),
        tol=1e-7,
    )
    assert swept(path.q) == pytest.approx(angle, abs=1e-6)
    run = vi.simulate(system, q0=path.q[0], v0=path.v[0], duration=path.duration, tol=1e-10)
    assert np.abs(run.q[-1] - end).max() < 1e-5


def test_both_paths_of_a_number_of_turns_are_found_with_their_winding():
    start, end, duration = np.array([1.0, 0.0]), np.array([-0.3, 1.1]), 14.0
    found = vi.paths(
        kepler(),
        q_start=start,
        q_end=end,
        duration=duration,
        tol=1e-6,
        starts=1,
        winding={("x", "y"): [-2]},
    )
    assert [path.stats["winding"] for path in found] == [{("x", "y"): -2}] * 2
    for v in lambert(start, end, duration, False, 1):
        assert min(np.abs(path.v[0] - v).max() for path in found) < 1e-5
    for path in found:
        assert path.stats["error_estimate"] <= 1e-6
        # the action is that of the path itself: ∫ L dt by another rule
        run = vi.simulate(kepler(), q0=path.q[0], v0=path.v[0], duration=duration, tol=1e-9)
        assert path.action == pytest.approx(run.action, rel=1e-5)


def an_arc():
    """A moving path that is stationary, its problem, and the duration."""
    start, end, duration, angle = random_arc(4, 0.5, 0.6, 0)
    guess = circling(start, end, angle)
    problem, nodes = problem_of(kepler(), vi.gauss(4), start, end, duration, guess)
    motion = of_any_duration(problem, moving_path(problem, nodes, duration, 30))
    return problem, next(of_duration(problem, motion, duration)), duration


def test_nodes_that_move_are_even_and_their_path_is_the_one_of_fixed_nodes():
    problem, path, duration = an_arc()
    assert path.iterate.duration == pytest.approx(duration, rel=1e-14)
    length = lengths(problem, path, path.scales)
    assert np.ptp(np.log(length)) < 1e-6
    assert path.sizes.max() > 1.5 * path.sizes.min()
    fixed = newton(even_nodes(problem, path), path.iterate)
    assert fixed.solved
    assert np.abs(fixed.iterate.points - path.iterate.points).max() < 1e-9


def test_other_scales_spread_the_nodes_anew_and_keep_the_path():
    problem, path, duration = an_arc()
    stale = path.scales * np.array([1, 1, 2, 2, 1])
    moved = of_its_duration(problem, type(path)(path.iterate, path.sizes, stale))
    again = fresh(problem, moved)
    assert again is not None and fresh(problem, again) is None
    t = [np.append(0, np.cumsum(one.sizes)) for one in (path, again)]
    assert np.abs(t[0] - t[1]).max() < 2e-2 * duration
    assert np.abs(again.iterate.momenta - path.iterate.momenta).max() < 1e-5


def test_families_turn_back_where_there_is_no_shorter_path():
    """With a turn there are two paths of a duration, or none."""
    start, end = np.array([1.0, 0.0]), np.array([-0.3, 1.1])
    angle = np.arctan2(end[1], end[0]) + 2 * np.pi
    problem, nodes = problem_of(
        kepler(), vi.gauss(4), start, end, 12.0, circling(start, end, angle)
    )
    motion = of_any_duration(problem, moving_path(problem, nodes, 12.0, 50))
    slow, fast = of_duration(problem, motion, 12.0)
    exact = lambert(start, end, 12.0, True, 1)
    for path in (slow, fast):
        v = path.iterate.momenta[0]
        assert min(np.abs(abs(v) - abs(u)).max() for u in exact) < 1e-4
    assert np.abs(slow.iterate.points - fast.iterate.points).max() > 0.1
    short = with_duration(slow.iterate, 4.0)  # less than the least time of a turn
    assert of_its_duration(problem, type(slow)(short, slow.sizes / 3, slow.scales)) is None
    assert list(of_duration(problem, slow, 4.0)) == []


def test_a_path_that_goes_another_way_than_its_guess_says_so():
    """Where the path goes as the guess does nothing is said: warnings are errors here."""
    system, s = kepler(), np.linspace(0, 1, 41)
    angle = 1.0
    start, end = np.array([1.0, 0.0]), np.array([np.cos(angle), np.sin(angle)])
    there = np.stack([np.cos(angle * s), np.sin(angle * s)], axis=1)
    back = np.stack([np.cos((angle - 2 * np.pi) * s), np.sin((angle - 2 * np.pi) * s)], axis=1)
    run = dict(q_start=start, q_end=end, tol=1e-6)
    one = vi.least_action(system, guess=there, duration=1.0, **run)
    assert one.stats["winding"] == one.stats["winding_of_guess"] == {("x", "y"): 0}
    two = vi.least_action(system, guess=back, duration=2 * np.pi - 1.0, **run)
    assert two.stats["winding"] == two.stats["winding_of_guess"] == {("x", "y"): -1}
    for path, guess, told in ((one, back, "0 whole turns, the guess -1"), (two, there, "-1")):
        other = with_ways_compared(path, guess)
        assert other.action == path.action and told in other_way(other)


def test_a_path_stays_near_the_one_on_steps_of_which_its_own_are_parts():
    """What leaps to another path while it is refined is not the one that was found."""
    start, end, duration = np.array([1.0, 0.0]), np.array([-0.3, 1.1]), 2.0
    there = circling(start, end, np.arctan2(end[1], end[0]))
    back = circling(start, end, np.arctan2(end[1], end[0]) - 2 * np.pi)
    near, paths = [], []
    for guess in (there, back):
        problem, nodes = problem_of(kepler(), vi.gauss(4), start, end, duration, guess)
        mesh = with_steps(problem, np.full(problem.steps, 8))
        outcome = newton(mesh, first_path(mesh, nodes, duration))
        assert outcome.solved
        near.append((mesh, outcome.iterate))
        finer, split = split_steps(mesh, outcome.iterate, np.arange(mesh.steps) % 3 + 1)
        paths.append(Found(finer, newton(finer, split), 0.0))
        assert goes_as(kepler(), outcome.iterate.points, guess)
    assert not goes_as(kepler(), near[0][1].points, back)
    for i, one in enumerate(paths):
        assert [_has_stayed(one, *x) for x in near] == [i == 0, i == 1]
    lost = replace(paths[0].outcome, status="lost")
    assert not _has_stayed(paths[0]._replace(outcome=lost), *near[0])


def test_places_are_those_where_the_scene_is_singular():
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    apart = ca.norm_2(q[2:] - q[:2])
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / apart)
    assert [names for names, _ in singular_places(system)] == [("x2-x1", "y2-y1")]
    soft = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.sqrt(apart**2 + 1e-6))
    assert singular_places(soft) == []


@pytest.mark.parametrize("aside", [0.0, 1e-6, 1e-3, -1e-3])
def test_lines_through_a_centre_are_bent_to_their_side(aside):
    end = np.array([-1.2, aside])
    path = vi.least_action(kepler(), q0=[1.0, 0.0], q_end=end, duration=3.0)
    assert path.stats["error_estimate"] <= 1e-9
    assert np.sign(path.q[len(path) // 2, 1]) == (-1 if aside < 0 else 1)
    motion = vi.simulate(kepler(), q0=path.q[0], v0=path.v[0], duration=3.0, tol=1e-11)
    assert motion.q[-1] == pytest.approx(end, abs=1e-8)


def test_bodies_that_change_places_pass_each_other():
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    two = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q[:2] - q[2:]))
    path = vi.least_action(two, q0=[1, 0, -1, 0], q_end=[-1, 0, 1, 0], duration=3.0)
    assert path.stats["error_estimate"] <= 1e-9
    assert np.linalg.norm(path.q[:, :2] - path.q[:, 2:], axis=1).min() > 0.5
