"""Paths of least action in other units: S/(M L²/T), q/L and t/T do not depend on M, L and T."""

import casadi as ca
import numpy as np
import pytest

import varint as vi

UNITS = [
    (1e-9, 1.0, 1.0),
    (1e9, 1.0, 1.0),
    (1.0, 1e-6, 1.0),
    (1.0, 1e6, 1.0),
    (1.0, 1.0, 1e-6),
    (1.0, 1.0, 1e6),
    (1e9, 1e6, 1e-6),
    (1e-9, 1e-6, 1e6),
    (3e4, 7e-3, 11.0),
]


def disc(mass, length, time):
    """Past a disc, which touches no straight line; a bound of an expression."""
    q, v = vi.coordinates("x", "y")
    ends = dict(q_start=[-2 * length, 0], q_end=[2 * length, 0.1 * length])
    guess = length * np.array([[-2, 0], [0, 1.5], [2, 0.1]])
    bounds = [(length**2, ca.sumsqr(q), None)]
    scene = vi.System(q, v, mass * ca.sumsqr(v) / 2)
    given = dict(duration=2 * time, steps=12, guess=guess, bounds=bounds)
    return vi.least_action(scene, vi.gauss(3), **ends, **given), [length, length]


def throw(mass, length, time):
    """Up to a ceiling and down again: the first path stays where it is."""
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, mass * (v**2 / 2 - 9.81 * length / time**2 * q))
    ends = dict(q_start=0.0, q_end=0.0, duration=2 * time, steps=40)
    return vi.least_action(scene, vi.gauss(1), **ends, bounds=[(None, q, 2 * length)]), [length]


def sphere(mass, length, time):
    """A constraint, and a bound on the way over the pole."""
    q, v = vi.coordinates("x", "y", "z")
    scene = vi.System(q, v, mass * ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - length**2)
    c, s = length * np.cos(0.5), length * np.sin(0.5)
    ends = dict(q_start=[c, s, 0], q_end=[-c, s, 0], duration=time, steps=20)
    guess = [[c, s, 0], [0, 0.8 * length, 0.6 * length], [-c, s, 0]]
    bounds = [(0.3 * length, q[2] + q[0] ** 2 / length, None)]
    return vi.least_action(scene, vi.lobatto(3), **ends, guess=guess, bounds=bounds), [length] * 3


def polar(mass, length, time):
    """An angle beside a length, and a bound of a coordinate alone."""
    q, v = vi.coordinates("r", "phi")
    scene = vi.System(q, v, mass * (v[0] ** 2 + (q[0] * v[1]) ** 2) / 2)
    ends = dict(q_start=[2 * length, 0.0], q_end=[2 * length, 3.0], duration=time, steps=16)
    return vi.least_action(scene, vi.gauss(2), **ends, bounds=[(length, q[0], None)]), [length, 1.0]


def own_time(mass, length, time):
    """A duration that is free: the speed is length/time."""
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, mass * (ca.sumsqr(v) + (length / time) ** 2) / 2)
    ends = dict(q_start=[-2 * length, 0], q_end=[2 * length, 0.1 * length], steps=12)
    guess = length * np.array([[-2, 0], [0, 1.5], [2, 0.1]])
    bounds = [(length**2, ca.sumsqr(q), None)]
    duration = vi.free(3 * time, time, 20 * time)
    given = dict(duration=duration, guess=guess, bounds=bounds)
    return vi.least_action(scene, vi.gauss(2), **ends, **given), [length, length]


@pytest.mark.parametrize("case", [disc, throw, sphere, polar, own_time])
def test_a_path_that_leans_on_bounds_is_the_same_in_all_units(case):
    plain, _ = case(1.0, 1.0, 1.0)
    assert plain.solution.touches.any()
    for mass, length, time in UNITS:
        path, units = case(mass, length, time)
        action = mass * length**2 / time
        assert path.action == pytest.approx(action * plain.action, rel=1e-8, abs=0.0)
        assert path.duration == pytest.approx(time * plain.duration, rel=1e-8, abs=0.0)
        assert np.abs(path.q / units - plain.q).max() < 1e-8
        assert np.array_equal(path.solution.touches, plain.solution.touches)
        if len(set(units)) > 1:
            continue  # no range counts as less than a thousandth of the largest
        error = plain.stats["error_estimate"]
        assert path.stats["error_estimate"] == pytest.approx(error, rel=1e-6)


def test_ends_on_their_bounds_and_beyond_are_told_apart_in_all_units():
    q, v = vi.coordinates("x", "y")
    for length in (1e-6, 1.0, 1e6):
        scene = vi.System(q, v, ca.sumsqr(v) / 2)
        on = length * np.array([np.cos(0.3), np.sin(0.3)])
        given = dict(q_end=[0, 2 * length], duration=1.0, steps=4)
        given["bounds"] = [(length**2, ca.sumsqr(q), None)]
        path = vi.least_action(scene, vi.gauss(2), q_start=on, **given)
        assert np.abs(path.q[0] - on).max() == 0.0
        with pytest.raises(vi.InputError, match="violates the bounds"):
            vi.least_action(scene, vi.gauss(2), q_start=on * (1 - 1e-6), **given)
