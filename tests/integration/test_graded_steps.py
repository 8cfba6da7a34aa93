"""Steps grow where a motion settles, and its error is what was asked for all the same."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from both_gears import require_same_bytes

import varint as vi
from varint.integration.graded_steps import TURNED, stage_looks


def pendulum():
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-v)


def disguised():
    """x = sinh q is a damped oscillator."""
    q, v = vi.coordinates("q")
    x, speed = ca.sinh(q), ca.cosh(q) * v
    force = -0.4 * speed * ca.cosh(q)
    return vi.System(q, v, speed**2 / 2 - 4 * x**2 / 2, force=force)


def disguised_exactly(t, q0):
    w = np.sqrt(4 - 0.04)
    x = np.sinh(q0) * np.exp(-0.2 * t) * (np.cos(w * t) + 0.2 / w * np.sin(w * t))
    return np.arcsinh(x)


def settled(system=None, duration=60.0, **more):
    asked = {"q0": 1.0, "v0": 0.0, "duration": duration, "tol": 1e-6} | more
    return vi.simulate(system or pendulum(), **asked)


@pytest.mark.parametrize("tol", (1e-3, 1e-5, 1e-7, 1e-9))
@pytest.mark.parametrize("duration", (120.0, 200.0))
def test_errors_stay_below_what_was_asked_for(tol, duration):
    motion = settled(disguised(), duration, tol=tol)
    assert motion.sizes is not None
    exact = disguised_exactly(motion.t, 1.0)
    error = np.abs(motion.q[:, 0] - exact).max() / np.ptp(exact)
    assert error <= motion.stats["error_estimate"] <= tol


@pytest.mark.parametrize("t0", (0.0, 3.5))
@pytest.mark.parametrize("duration", (60.0, 61.3))
def test_times_go_on_and_end_where_they_should(t0, duration):
    motion = settled(duration=duration, t0=t0)
    sizes = np.diff(motion.t)
    assert motion.t[0] == t0 and motion.t[-1] == t0 + duration
    assert (sizes > 0).all() and (np.diff(sizes) >= -1e-9).all()
    assert sizes[-1] > 1.5 * sizes[0]
    assert np.array_equal(motion.sizes, sizes)
    assert motion.h == pytest.approx(duration / (len(motion) - 1))
    assert sizes[-1] * np.sqrt(9.81) <= TURNED * 1.0001
    assert np.array_equal(motion.k, np.arange(len(motion)))


def test_rest_costs_few_steps():
    """Twice the duration, all of it at rest: fewer steps are added than the beginning takes."""
    short, long = settled(duration=40.0), settled(duration=80.0)
    equal = settled(duration=80.0, events={"never": vi.coordinates("theta")[0] - 50})
    added = len(long) - len(short)
    assert equal.sizes is None
    assert added <= 0.6 * (len(equal) - 1) / 2


def test_nodes_are_the_same_as_data_and_compiled(monkeypatch):
    require_same_bytes(monkeypatch, pendulum(), [1.0], [0.0], 60.0, 1e-6, 188.0)


def test_the_longer_way_takes_the_same_steps():
    short, shown = settled(), settled(progress=True)
    assert short.sizes is not None
    for name in ("t", "q", "p", "v", "sizes", "k"):
        assert getattr(short, name).tobytes() == getattr(shown, name).tobytes()
    assert short.stats["error_estimate"] == shown.stats["error_estimate"]
    assert short.stats["runs"] == shown.stats["runs"]


def test_what_is_asked_for_between_nodes_is_found_there():
    times = np.linspace(0.0, 60.0, 301)
    motion = settled(disguised(), at=times, tol=1e-8)
    exact = disguised_exactly(times, 1.0)
    assert np.array_equal(motion.t, times)
    assert np.abs(motion.q[:, 0] - exact).max() <= 1e-8 * np.ptp(exact)
    whole = settled(disguised(), tol=1e-8)
    assert np.abs(whole.at(times).q[:, 0] - exact).max() <= 1e-8 * np.ptp(exact)


def test_events_are_found_along_equal_steps():
    q, _ = vi.coordinates("theta")
    motion = settled(events={"down": q})
    assert motion.sizes is None and len(motion.events) > 10


def test_a_graded_motion_can_be_kept(tmp_path):
    motion = settled()
    motion.save(tmp_path / "motion.npz")
    again = vi.load(tmp_path / "motion.npz")
    assert np.array_equal(again.t, motion.t) and np.array_equal(again.sizes, motion.sizes)


@pytest.mark.parametrize("width", (0.1, 0.3, 1.0))
@pytest.mark.parametrize("place", (8.0, 14.0, 23.0))
def test_what_acts_at_a_place_is_not_passed_over(width, place):
    """One coordinate has settled when the other, which goes on all the time, comes to a bump."""
    q, v = vi.coordinates("x", "s")
    bump = ca.exp(-(((q[1] - place) / width) ** 2))
    force = ca.vertcat(0.5 * bump - 2.0 * v[0], 0.0)
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - 8 * q[0] ** 2, force=force)
    asked = {"q0": [1.0, 0.0], "v0": [0.0, 1.0], "duration": 40.0}
    motion = vi.simulate(scene, **asked, tol=1e-6)
    fine = vi.simulate(scene, vi.gauss(8), **asked, steps=4000)
    off = np.abs(motion.q[-1] - fine.q[-1]) / np.ptp(fine.q, axis=0)
    assert off.max() <= 1e-6


@pytest.mark.parametrize("above", (1e-3, 1e-6, 1e-9))
@pytest.mark.parametrize("damping", (0.3, 1.0, 3.0))
def test_a_motion_that_leaves_an_unstable_rest_has_not_settled(above, damping):
    """It slides down to a saddle, seems to stay there, and falls off to one side."""
    q, v = vi.coordinates("x", "y")
    hill = ca.sumsqr(v) / 2 - (q[0] ** 2 - 1) ** 2 - 3 * q[1] ** 2
    scene = vi.System(q, v, hill, force=-damping * v)
    asked = {"q0": [above, 1.0], "v0": [0.0, 0.0], "duration": 40.0}
    motion = vi.simulate(scene, **asked, tol=1e-6)
    fine = vi.simulate(scene, vi.gauss(8), **asked, steps=2000)
    assert abs(motion.q[-1, 0] - 1) < 0.2
    assert np.abs(motion.q[-1] - fine.q[-1]).max() <= 1e-6


def test_a_pulse_after_rest_is_not_missed():
    q, v, t = *vi.coordinates("x"), vi.time()
    push = ca.exp(-(((t - 50.0) / 0.1) ** 2))
    scene = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=push - v, t=t)
    asked = {"q0": 1.0, "v0": 0.0, "duration": 52.0}
    motion = vi.simulate(scene, **asked, tol=1e-6)
    fine = vi.simulate(scene, vi.gauss(8), **asked, steps=8000)
    assert motion.sizes is None
    assert abs(motion.q[-1, 0] - fine.q[-1, 0]) <= 1e-6 * np.ptp(fine.q)


def test_looks_show_the_highest_coefficients():
    """Those of a polynomial of the highest degree, and nothing of lower ones."""
    looks, rule = stage_looks(pendulum(), vi.gauss(8)), vi.gauss(8)
    x, b = 2 * np.array(rule.nodes) - 1, np.array(rule.weights)
    assert looks.counts[:2] == (1, 8)
    for degree in range(8):
        values = b * np.polynomial.legendre.Legendre.basis(degree)(x)
        seen = looks.heights @ values
        assert seen == pytest.approx([float(degree == 6), float(degree == 7)], abs=1e-13)
