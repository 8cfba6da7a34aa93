"""What an optimal motion offers: its report, its file, its controls as functions of time."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from control_scenes import (
    U,
    move,
    replay_defect,
    swing_up,
)

import varint as vi


def test_report_names_status_cost_violation_replay_energy_and_momenta(capsys):
    motion = swing_up(steps=30)
    motion.report()
    text = capsys.readouterr().out
    for word in (
        motion.solution.status,
        "cost",
        "violation",
        "replay defect",
        "energy",
        "translation along x",
    ):
        assert word in text
    assert f"{motion.cost:.12g}" in text
    assert motion.solution.history["cost"][-1] == pytest.approx(motion.cost)


def test_saved_solution_comes_back_with_cost_costates_controls_replay_and_report(tmp_path, capsys):
    motion = vi.models.overhead_crane().solve()[0]
    motion.save(tmp_path / "crane.npz")
    again = vi.load(tmp_path / "crane.npz")
    assert (again.cost, again.solution.status, again.solution.iterations) == (
        motion.cost,
        motion.solution.status,
        motion.solution.iterations,
    )
    t = np.linspace(0, motion.duration, 50)
    assert np.array_equal(again.u_at(t), motion.u_at(t))
    assert np.array_equal(again.costates.p, motion.costates.p) and np.array_equal(
        again.costates.q, motion.costates.q
    )
    assert again.solution.active.keys() == motion.solution.active.keys() != set()
    assert replay_defect(again) == replay_defect(motion)
    texts = []
    for one in (motion, again):
        one.report()
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    warm = vi.optimal_phases([replace(vi.models.overhead_crane().phases[0], guess=again)])[0]
    assert warm.cost == pytest.approx(motion.cost, rel=1e-8)
    with pytest.raises(vi.InputError, match="guess=motion"):
        vi.refine(again)


def test_reports_of_motions_that_are_not_linear_point_to_other_minima(capsys):
    """Costs of a swing-up jump with the number of steps, and nothing said where to look."""
    swing_up(steps=12).report()
    assert "multistart looks for them" in capsys.readouterr().out
    move(vi.gauss(2), 5).report()
    assert "multistart" not in capsys.readouterr().out


def test_costates_are_the_same_when_asked_for_later():
    """They belong to the numbers that the problem was solved with, not to those it has by then."""
    q, v = vi.coordinates("x")
    c = vi.Parameters(stiffness=1.0)
    spring = vi.System(q, v, v**2 / 2 - c.stiffness * q**2 / 2, force=U, control=U, params=c)
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    solve = vi.prepare(vi.Phase(spring, vi.gauss(3), 1.0, 5, U**2 + q**4, **ends))

    def solved() -> vi.Trajectory:
        return solve(params=dict(stiffness=3.0), duration=1.2)

    at_once = solved().costates
    motion = solved()
    other = motion.again(params=dict(stiffness=5.0), duration=0.8, end=dict(q=[2]))
    assert np.abs(other.costates.q - at_once.q).max() > 1
    for later in (pickle.loads(pickle.dumps(motion)), motion):
        assert np.array_equal(later.costates.q, at_once.q)
        assert np.array_equal(later.costates.p, at_once.p)
    stiff, h = motion.again(params=dict(stiffness=3.0), start=dict(q=[1e-5])), 1e-5
    slack = motion.again(params=dict(stiffness=3.0), start=dict(q=[-1e-5]))
    assert (stiff.cost - slack.cost) / (2 * h) == pytest.approx(at_once.q[0, 0], rel=1e-6)


def test_part_of_an_optimal_motion_and_times_outside_have_no_controls():
    motion = move(vi.gauss(2), 10)
    with pytest.raises(vi.InputError, match="from 0 to 1"):
        motion.u_at(1.5)
    part = motion[2:5]
    with pytest.raises(vi.InputError, match="optimal_control"):
        part.u_at(0.3)
    assert repr(motion.solution).count("\n") == 0


def test_figure_draws_the_controls_as_functions_of_time():
    motion = move(vi.gauss(2), 3)
    axes = next(x for x in motion.plot().axes if x.get_title() == "Controls")
    t, u = axes.lines[0].get_data()
    assert u == pytest.approx(6 - 12 * t, abs=1e-9)  # the exact control, between the nodes as well
