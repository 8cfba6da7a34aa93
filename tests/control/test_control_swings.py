"""Controls that swing from node to node where only their mean matters: found, said, cured."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, move, particle, swing_up

import varint as vi
from varint.control.swings import swinging_controls

LIMITS = [(-1, U, 1), (None, particle().v, 1)]


def hurried(rule, steps, **given) -> vi.Trajectory:
    """3 m from rest to rest in least time, force and speed at most 1: the time is 4."""
    given = dict(cost=0, terminal_cost=particle().t, bounds=LIMITS, end=dict(q=[3], v=[0])) | given
    return move(rule, steps, vi.free(3, 0.1, 20), **given)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.gauss(3), vi.gauss(4), vi.lobatto(3)], ids=str)
def test_swings_on_a_speed_limit_are_reported_with_cures_that_work(rule, capsys):
    motion = hurried(rule, 30)
    found = swinging_controls(motion.solution.u)
    motion.report()
    said = capsys.readouterr().out
    assert ("swings" in said) == bool(found)
    if found:
        assert 'control="constant"' in said
        times = motion.duration * found[0]
        assert 0.7 < times.min() < times.max() < 3.3  # the arc at full speed: 1 to 3
    cured = hurried(rule, 30, control="constant")
    assert not swinging_controls(cured.solution.u)
    assert cured.duration == pytest.approx(4, abs=0.01)


def test_a_cost_on_the_rate_of_the_force_cures_swings_too():
    q, v = vi.coordinates("x", "force")
    pull = ca.SX.sym("pull")
    force = ca.vertcat(q[1], pull)
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=force, control=pull)
    motion = vi.optimal_control(
        system,
        vi.gauss(2),
        duration=vi.free(3, 0.1, 20),
        steps=30,
        cost=1 + 1e-3 * v[1] ** 2 + 1e-5 * pull**2,
        start=dict(q=[0, None], v=[0, None]),
        end=dict(q=[3, None], v=[0, None]),
        bounds=[(-1, q[1], 1), (None, v[0], 1)],
    )
    rising = np.diff(motion.q[:, 1])
    turns = rising[:-1] * rising[1:] < -1e-8
    assert turns.sum() <= 2
    assert motion.duration == pytest.approx(4, abs=0.05)


def test_the_two_point_gauss_rule_swings():
    assert swinging_controls(hurried(vi.gauss(2), 30).solution.u)


def test_only_the_control_that_swings_is_named(capsys):
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("along"), ca.SX.sym("across")
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=ca.vertcat(*push), control=ca.vertcat(*push))
    motion = vi.optimal_control(
        system,
        vi.gauss(2),
        duration=vi.free(3, 0.1, 20),
        steps=30,
        cost=1 + 1e-3 * push[1] ** 2,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[3, 1], v=[0, 0]),
        bounds=[(-1, push[0], 1), (None, v[0], 1)],
    )
    assert list(swinging_controls(motion.solution.u)) == [0]
    motion.report()
    assert "along goes up and down" in (said := capsys.readouterr().out)
    assert "across goes" not in said


def test_switches_and_smooth_controls_do_not_swing(capsys):
    bang = hurried(vi.gauss(3), 21, bounds=LIMITS[:1])  # a switch in the middle of a step
    smooth = swing_up(vi.gauss(3), 40)
    for motion in (bang, smooth):
        assert not swinging_controls(motion.solution.u)
        motion.report()
    assert "swings" not in capsys.readouterr().out
    assert bang.duration == pytest.approx(2 * np.sqrt(3), rel=1e-3)


def slow(steps, **given) -> vi.Trajectory:
    """10 m from rest to rest in least time, force at most 1 and speed at most 0.3."""
    own = dict(cost=0, terminal_cost=particle().t, end=dict(q=[10], v=[0])) | given
    limits = [(-1, U, 1), (-0.3, particle().v, 0.3)]
    return move(vi.gauss(2), steps, vi.free(50, 0.1, 100), bounds=limits, **own)


def test_a_speed_limit_that_is_passed_between_the_nodes_is_told(capsys):
    """As much of the range of the speeds as their integrals say, exact for linear forces."""
    with pytest.warns(UserWarning, match="_dot goes beyond its bound by 0.3 of its range"):
        motion = slow(20)
    (part,) = motion.stats["beyond"].values()
    h, u = motion.duration / 20, motion.solution.u
    quarters = np.arange(4)[:, None] / 4
    pairs = (quarters + (0.5 + np.array([-1, 1]) / 12**0.5) / 4).ravel()  # Gauss nodes of each
    gained = u.within_steps(pairs).reshape(-1, 2).mean(axis=1) * h / 4
    speeds = np.append(0, np.cumsum(gained))
    assert speeds[::4] == pytest.approx(motion.v[:, 0], abs=1e-6)
    assert part == pytest.approx((speeds.max() - 0.3) / np.ptp(speeds), rel=1e-6)
    assert motion.v.max() < 0.3 + 1e-6
    motion.report()
    assert "beyond a bound" in capsys.readouterr().out


def test_a_speed_limit_that_is_kept_between_the_nodes_is_not_told(capsys):
    motion = slow(20, control="constant")
    motion.report()
    assert "beyond" not in motion.stats and "beyond a bound" not in capsys.readouterr().out
