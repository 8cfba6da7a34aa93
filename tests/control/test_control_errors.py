"""How far an optimal path is from the motion that its controls cause."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, move, pendulum, swing, swing_up

import varint as vi
from varint.control.replay import error_estimate, in_quarters


def true_error(motion: vi.Trajectory) -> float:
    """The same by an independent method: Runge–Kutta on the equations of motion, 200 steps a
    step.
    """
    s, u = motion.system, motion.solution.u
    kinetic = ca.jtimes(s.momentum, s.q, s.v)
    a = ca.solve(s.mass_matrix, ca.gradient(s.lagrangian, s.q) + s.force - kinetic)
    f = ca.Function("f", [ca.vertcat(s.q, s.v), s.control], [ca.vertcat(s.v, a)])
    n, x, off = s.structure.n, np.concatenate([motion.q[0], motion.v[0]]), 0.0
    fine, extent = 200, np.ptp(motion.q, axis=0)
    y, h, c = ca.SX.sym("y", 2 * n), ca.SX.sym("h"), ca.SX.sym("c", s.control.numel(), 3)
    k1 = f(y, c[:, 0])
    k2 = f(y + h / 2 * k1, c[:, 1])
    k3 = f(y + h / 2 * k2, c[:, 1])
    after = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(y + h * k3, c[:, 2]))
    parts = ca.Function("part", [y, h, c], [after]).mapaccum(fine)
    places = ((np.arange(fine)[:, None] + np.array([0, 0.5, 1 - 1e-12])) / fine).ravel()
    for k in range(len(motion.u)):
        size = u.mesh[k + 1] - u.mesh[k]
        x = parts(x, size * motion.duration / fine, u(u.mesh[k] + size * places).T)[:, -1]
        off = max(off, float((np.abs(x[:n].full().ravel() - motion.q[k + 1]) / extent).max()))
    return off


@coarse
@pytest.mark.parametrize(
    ("rule", "steps", "control"),
    [
        (vi.midpoint(), 20, "nodes"),
        (vi.midpoint(), 60, "constant"),
        (vi.gauss(2), 12, "nodes"),
        (vi.gauss(3), 8, "nodes"),
        (vi.lobatto(3), 15, "nodes"),
        (vi.gauss(2), 25, "constant"),
    ],
    ids=str,
)
def test_estimate_is_the_error_of_the_replayed_controls(rule, steps, control):
    motion = swing(pendulum(9.81), 3.0, steps, rule=rule, control=control)
    assert motion.stats["error_estimate"] == pytest.approx(true_error(motion), rel=0.35)


@coarse
@pytest.mark.parametrize("given", [(vi.gauss(2), 12), (vi.gauss(3), 8)], ids=str)
def test_estimate_of_two_coordinates_is_relative_to_the_range_of_each(given):
    motion = swing_up(*given)
    assert motion.stats["error_estimate"] == pytest.approx(true_error(motion), rel=0.35)


def test_far_too_few_steps_are_warned_of_and_the_report_says_so(capsys):
    """The solver succeeds, the replay on the same mesh agrees, the true end is elsewhere."""
    with pytest.warns(UserWarning, match=r"too coarse.*more steps"):
        motion = swing(pendulum(9.81), 8.0, 8, rule=vi.gauss(2))
    assert motion.solution.success
    assert np.abs(motion.replay().q - motion.q).max() < 1e-6
    assert true_error(motion) > 0.1 and motion.stats["error_estimate"] > 0.1
    motion.report()
    assert "error of the path" in (text := capsys.readouterr().out) and "too coarse" in text
    assert "vi.refine(motion) adds steps" in text
    fine = vi.refine(motion, 1e-3)  # a warning would be an error here
    assert fine.stats["error_estimate"] < 1e-2


def test_phases_are_judged_one_by_one():
    phase = vi.Phase(
        pendulum(9.81), vi.gauss(2), 4.0, 4, U**2, start=dict(q=[0], v=[0]), end=dict(q=[2.0])
    )
    fine = vi.Phase(pendulum(9.81), vi.gauss(4), 1.0, 20, U**2, end=dict(q=[3.0], v=[0]))
    with pytest.warns(UserWarning, match="too coarse"):
        first, second = vi.optimal_phases([phase, fine])
    assert first.stats["error_estimate"] > 1e-2 > 1e-6 > second.stats["error_estimate"]


def test_a_fine_solution_is_silent_and_its_report_shows_the_estimate(capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = swing_up(vi.gauss(4), 40)
    assert 1e-12 < motion.stats["error_estimate"] < 1e-5
    motion.report()
    assert f"{motion.stats['error_estimate']:.1e} of its range" in capsys.readouterr().out


@coarse
def test_estimate_does_not_depend_on_units_or_on_a_mesh_of_unequal_steps():
    mesh = np.concatenate([[0], np.cumsum(np.linspace(1, 3, 12))])
    motion = swing(pendulum(9.81), 3.0, 0, rule=vi.gauss(2), mesh=mesh / mesh[-1])
    assert motion.stats["error_estimate"] == pytest.approx(true_error(motion), rel=0.35)
    small = 1e-5
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, v**2 / 2 - 50 * q**2, force=U, control=U)
    cases = [
        vi.optimal_control(
            spring,
            vi.gauss(2),
            duration=2.0,
            steps=10,
            cost=U**2 / size**2,
            start=dict(q=[0], v=[0]),
            end=dict(q=[size], v=[0]),
        )
        for size in (1.0, small)
    ]
    first, second = (x.stats["error_estimate"] for x in cases)
    assert second == pytest.approx(first, rel=1e-2)


def test_saved_solution_reports_its_estimate(tmp_path, capsys):
    motion = move(vi.gauss(2), 5)
    motion.save(tmp_path / "move.npz")
    vi.load(tmp_path / "move.npz").report()
    assert "error of the path" in capsys.readouterr().out
    assert error_estimate(motion, in_quarters(motion, motion.solution.u)) < 1e-10
