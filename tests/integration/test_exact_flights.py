"""Default calls where bodies fly through uniform fields between contacts: two runs and no more."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G, ball, disc_on_table, times
from stopped_runs import assert_same_bytes

import varint as vi
from varint.integration.exact_flights import exact_plan, is_straight

TOLS = [1e-3, 1e-6, 1e-9, 1e-12]


def bounces(restitution: float, t: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """Heights of a ball that falls from 1, and its impacts."""
    fall = np.sqrt(2 / G)
    impacts, speeds = [fall], [restitution * np.sqrt(2 * G)]
    while impacts[-1] < t[-1]:
        impacts.append(impacts[-1] + 2 * speeds[-1] / G)
        speeds.append(restitution * speeds[-1])
    last = np.searchsorted(impacts, t) - 1
    late = t - np.array(impacts)[last]
    heights = np.where(last < 0, 1 - G / 2 * t**2, late * (np.array(speeds)[last] - G / 2 * late))
    return heights, impacts[:-1]


@pytest.mark.parametrize("tol", TOLS)
@pytest.mark.parametrize("restitution", [0.7, 0.9, 1.0])
def test_two_runs_of_a_ball_that_bounces_show_that_it_is_its_closed_form(restitution, tol):
    motion = vi.simulate(ball(restitution), q0=1.0, v0=0.0, duration=2.2, tol=tol)
    heights, impacts = bounces(restitution, motion.t)
    assert motion.stats["runs"] == 2 and motion.stats["error_estimate"] <= tol
    assert np.abs(motion.q[:, 0] - heights).max() < 1e-13
    np.testing.assert_allclose(times(motion), impacts, rtol=1e-14)


def in_a_corner():
    return disc_on_table(G, [1.0, 0.8, 0.7]), {"q0": [0.5, 1.0], "v0": [1.3, 0.0]}


def on_another():
    """Both come to rest, one after the other."""
    q, v = vi.coordinates("a", "b")
    lagrangian = ca.sumsqr(v) / 2 - G * ca.sum1(q)
    gaps = ca.vertcat(q[0], q[1] - q[0] - 0.2)
    return vi.System(q, v, lagrangian, contact=gaps), {"q0": [0.3, 1.0], "v0": [0.0, 0.0]}


@pytest.mark.parametrize("build", [in_a_corner, on_another])
def test_a_default_call_is_the_run_of_as_many_steps_byte_by_byte(build):
    """Whatever is done with memory meanwhile that a change of what holds has used."""
    system, start = build()
    motion = vi.simulate(system, **start, duration=2.0)
    steps = motion.stats["steps"]
    again = vi.simulate(system, **start, h=2.0 / steps, steps=steps)
    assert motion.stats["runs"] == 2 and len(motion.events) >= 2
    assert_same_bytes(motion, again, "v")
    assert motion.events == again.events and motion.active_sets == again.active_sets


def test_what_a_straight_floor_holds_is_exact_and_what_a_round_one_holds_is_not():
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    incline = vi.System(q, v, lagrangian, contact=q[1] - q[0] / 2)
    bowl = vi.System(q, v, lagrangian, contact=q[1] - q[0] ** 2 / 2)
    assert is_straight(incline) and not is_straight(bowl)
    on_incline = vi.simulate(incline, q0=[0, 0], v0=[0, 0], duration=1.0)
    in_bowl = vi.simulate(bowl, q0=[0.5, 0.125], v0=[0, 0], duration=1.0)
    assert on_incline.stats["runs"] == 2 < in_bowl.stats["runs"]
    slides = -G / 2 * np.array([0.4, 0.2])  # sin α (cos α, sin α), tan α = 1/2
    np.testing.assert_allclose(on_incline.q[-1], slides, rtol=1e-13)
    swings = vi.simulate(bowl, vi.lobatto(5), q0=[0.5, 0.125], v0=[0, 0], h=1e-3, steps=1000)
    assert np.abs(in_bowl.q[-1] - swings.q[-1]).max() < 1e-9 * 0.5


def between_discs():
    """Between four discs in a square the last digits grow by some ten times an impact."""
    q, v = vi.coordinates("x", "y")
    centres = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    gaps = [ca.norm_2(q - ca.DM(at)) - 0.95 for at in centres]
    box = [2 - q[0], 2 + q[0], 2 - q[1], 2 + q[1]]
    return vi.System(q, v, ca.sumsqr(v) / 2, contact=ca.vertcat(*gaps, *box), restitution=1.0)


def test_runs_that_impacts_blow_apart_prove_nothing():
    system, start = between_discs(), {"q0": [0.0, 0.01], "v0": [0.31, 0.95]}
    assert exact_plan(system, None) is not None
    few = vi.simulate(system, **start, duration=1.0)
    assert few.stats["runs"] == 2 and few.events
    with pytest.warns(UserWarning, match="out of reach"):
        many = vi.simulate(system, **start, duration=40.0)
    assert many.stats["error_estimate"] > 1e-9


def test_what_impacts_make_of_last_digits_is_told():
    """By motions backwards: what is not back at its start has erred by as much on its way."""
    system, silent = between_discs(), 0
    for angle in np.linspace(0.1, 6.2, 12):
        start = {"q0": [0.02, 0.01], "v0": [np.cos(angle), np.sin(angle)]}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            motion = vi.simulate(system, **start, duration=9.0, tol=1e-7)
            back = vi.simulate(system, q0=motion.q[-1], v0=-motion.v[-1], duration=9.0, tol=1e-7)
        if not said:
            silent += 1
            assert np.abs(back.q[-1] - start["q0"]).max() < 2e-7 * np.abs(motion.q).max()
    assert silent >= 6


@pytest.mark.parametrize("backend", ["native", "interpreted"])
def test_what_touches_at_the_start_and_comes_bounces_there_and_what_rests_holds(backend):
    falls = vi.simulate(ball(0.5), q0=0.0, v0=-2.0, h=0.01, steps=10, backend=backend)
    assert [(e.kind, e.time, e.v_before, e.v_after) for e in falls.events] == [
        ("impact", 0.0, (-2.0,), (1.0,))
    ]
    assert falls.t[0] == 0 and falls.v[0, 0] == 1 and len(falls) == 11
    rests = vi.simulate(ball(0.5), q0=0.0, v0=0.0, h=0.01, steps=10, backend=backend)
    assert not rests.events and [x.holding for x in rests.active_sets] == [(0,)]
    np.testing.assert_allclose(rests.multipliers, G, rtol=1e-14)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"q0": -0.1}, "violates the contacts"),
        ({"q0": np.nan}, "q0"),
        ({"v0": [1.0, 2.0]}, "v0"),
        ({"params": {"e": 1.5}}, "restitution must lie between 0 and 1"),
    ],
)
def test_a_default_call_refuses_what_no_ball_can_do(changes, said):
    q, v = vi.coordinates("y")
    c = vi.Parameters(e=0.5)
    system = vi.System(q, v, v**2 / 2 - G * q, contact=q, restitution=c.e, params=c)
    assert vi.simulate(system, q0=1.0, v0=0.0, duration=1.0).stats["runs"] == 2
    with pytest.raises(vi.InputError, match=said):
        vi.simulate(system, **{"q0": 1.0, "v0": 0.0, "duration": 1.0} | changes)


def test_a_gap_whose_rate_is_no_number_at_the_start_is_refused():
    t = ca.SX.sym("t")
    q, v = vi.coordinates("y")
    system = vi.System(q, v, v**2 / 2 - G * q, contact=q - ca.sqrt(t) / 9, t=t)
    with pytest.raises(vi.InputError, match="not finite at the start"):
        vi.simulate(system, q0=1.0, v0=0.0, duration=1.0)
