"""Runs to a wanted accuracy that end at a zero cost what it takes to get there, whatever duration
was given beyond it.
"""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import varint as vi
from varint.integration.events.crossings import crossing_search, find_crossings, parse_watch
from varint.integration.events.first_crossing import find_first

Q, V = vi.coordinates("theta")
PENDULUM = vi.System(Q, V, V**2 / 2 + 9.81 * ca.cos(Q))
QUARTER = ellipk(np.sin(0.5) ** 2) / np.sqrt(9.81)  # of a period, from 1 rad


def end(duration, until=Q, **more):
    return vi.simulate(PENDULUM, q0=1.0, v0=0.0, duration=duration, until=until, **more)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_end_and_the_steps_to_it_do_not_depend_on_a_duration_far_beyond(direction):
    far, farther = end(direction * 1e3), end(direction * 1e6)
    assert abs(far.t[-1] - direction * QUARTER) < 1e-9 > far.stats["error_estimate"]
    assert (far.t[-1], far.stats["steps"]) == (farther.t[-1], farther.stats["steps"])


@pytest.mark.parametrize("late", [0.3, 20.0, 390.0])
def test_ends_in_any_piece_are_found(late):
    motion, whole = end(400.0, PENDULUM.t - late), vi.simulate(PENDULUM, q0=1, v0=0, duration=late)
    assert abs(motion.t[-1] - late) < 1e-12 * late
    assert abs(motion.q[-1] - whole.q[-1]) < 2e-9


def test_a_run_without_the_end_lasts_its_duration():
    motion = end(100.0, Q - 1.5)
    assert abs(motion.t[-1] - 100.0) < 1e-12 and motion.stats["error_estimate"] < 1e-9


def test_events_and_a_checkpoint_go_as_far(tmp_path):
    """Both runs, the chosen and the kept one, end at the same zero."""
    asked = dict(until=(Q, 1), events={"zero": Q, "turn": V}, checkpoint=tmp_path / "run")
    motion, again = end(1e4, **asked), end(1e4, **asked)
    assert abs(motion.t[-1] - 3 * QUARTER) < 1e-8
    assert [e.kind for e in motion.events] == ["zero", "turn", "zero"]
    assert np.array_equal(motion.q, again.q) and motion.t[-1] == again.t[-1]


@pytest.mark.parametrize("before", [0, 3, 1000])
def test_the_first_zero_is_that_of_the_whole_motion(before):
    """Windows of nodes, of any size, with the first zero anywhere in them."""
    motion = vi.simulate(PENDULUM, vi.gauss(4), q0=1.0, v0=0.0, h=0.02, steps=400)
    for level, direction in ((0.99999, 0), (0.3, 1), (-0.9, 0), (-0.99999999, 1), (1.1, 0)):
        search = crossing_search(PENDULUM, parse_watch("zero", (Q - level, direction)))
        every = find_crossings(search, motion, {})
        first = find_first(None, search, motion, {}, before)
        count = len(first.jump)
        assert count >= min(1, len(every.jump))
        assert np.array_equal(first.before.node, every.before.node[:count])
        assert np.allclose(first.after.t, every.after.t[:count], rtol=0, atol=1e-13)


DRAG = vi.coordinates("x", "y")


@pytest.mark.parametrize("duration", [3.0, 20.0, 100.0, 3000.0])
def test_an_end_within_the_first_step_is_no_end_that_two_runs_agree_on(duration):
    """No small motion tells of a time scale: any duration's first steps may pass the end, which
    each run then reaches by the very same shorter step from the start.
    """
    y, speed = DRAG[0][1], ca.norm_2(DRAG[1])
    thrown = vi.System(*DRAG, speed**2 / 2 - 9.81 * y, force=-0.1 * speed * DRAG[1])
    motion = vi.simulate(thrown, q0=[0, 0.1], v0=[20, 25], duration=duration, until=(y, -1))
    found = solve_ivp(
        lambda t, w: [*w[2:], *(-0.1 * np.hypot(*w[2:]) * w[2:] - [0, 9.81])],
        (0, 2.6),
        [0, 0.1, 20, 25],
        "DOP853",
        rtol=1e-13,
        atol=1e-13,
        dense_output=True,
    )
    assert np.abs(found.sol(motion.t[-1])[:2] - motion.q[-1]).max() < 2e-8
    assert motion.stats["error_estimate"] < 1e-9


@pytest.mark.parametrize("duration", [0.5, 30.0, 3000.0, 1e5])
def test_nor_is_one_between_switches_of_the_forces(duration):
    """Quadratic drag and dry friction, d(v²/2)/dx = −v²/2 − 1/10."""
    slowed = vi.System(Q, V, V**2 / 2, force=-0.5 * V * ca.fabs(V) - 0.1 * ca.sign(V))
    motion = vi.simulate(slowed, q0=0.0, v0=50.0, duration=duration, until=Q - 3)
    assert motion.v[-1, 0] == pytest.approx(np.sqrt(2500.2 * np.exp(-3) - 0.2), rel=1e-8)
    speeds = np.arctan(np.array([50.0, motion.v[-1, 0]]) * np.sqrt(5))
    assert motion.t[-1] == pytest.approx(-np.diff(speeds)[0] / np.sqrt(0.05), rel=1e-8)
