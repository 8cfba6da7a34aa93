"""Paths of least action within bounds: obstacles, held coordinates, contradictions."""

import pickle

import casadi as ca
import numpy as np
import pytest

import varint as vi


def free_particle():
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2)


def taut(rule, steps):
    """From (−2, 0) to (2, 0) in unit time past the unit disc."""
    scene = free_particle()
    return vi.least_action(
        scene,
        rule,
        q_start=[-2, 0],
        q_end=[2, 0],
        duration=1.0,
        steps=steps,
        guess=[[-2, 0], [0, 1.2], [2, 0]],
        bounds=[(1, ca.sumsqr(scene.q), np.inf)],
    )


def test_a_path_round_an_obstacle_touches_it_with_positive_multiplier_and_no_penetration():
    length = 2 * np.sqrt(3) + np.pi / 3
    path = taut(vi.gauss(1), 400)
    contact = path.solution
    assert path.action == pytest.approx(length**2 / 2, rel=1e-5)
    assert contact.values.min() > 1 - 1e-9
    assert contact.multipliers.min() > -1e-6
    held = contact.touches[:, 0]
    angle = np.arctan2(path.q[held, 1], path.q[held, 0])
    assert np.abs(angle[[0, -1]] - [np.pi / 2 + np.pi / 6, np.pi / 2 - np.pi / 6]).max() < 0.03
    inside = contact.multipliers[held][3:-3, 0]
    assert inside == pytest.approx(length**2 / 2, rel=1e-4)  # v²/R = 2 λ R towards the centre
    assert not held[:100].any() and not held[-100:].any()
    with pytest.raises(vi.InputError, match="leans on its bounds"):
        path.is_minimum  # noqa: B018


def test_the_length_round_an_obstacle_converges_with_order_two():
    exact = (2 * np.sqrt(3) + np.pi / 3) ** 2 / 2
    errors = [abs(taut(vi.gauss(1), n).action - exact) for n in (40, 160, 640)]
    assert np.log(errors[0] / errors[2]) / np.log(16) == pytest.approx(2.0, abs=0.15)


def test_bounds_that_are_not_met_leave_the_stationary_path_alone():
    scene = free_particle()
    ends = dict(q_start=[0, 0], q_end=[1, 2], duration=1.0, steps=10)
    path = vi.least_action(
        scene, vi.gauss(2), bounds=[(-5, scene.q[0], 5), (None, ca.sumsqr(scene.q), 50)], **ends
    )
    assert path.action == pytest.approx(2.5, rel=1e-9)
    assert np.abs(path.solution.multipliers).max() < 1e-7


def test_a_bounded_coordinate_is_held_and_its_multiplier_is_the_force():
    q, v = vi.coordinates("x")
    thrown = vi.System(q, v, v**2 / 2 - 9.81 * q)
    path = vi.least_action(
        thrown, vi.gauss(1), q_start=0.0, q_end=0.0, duration=2.0, steps=200, bounds=[(None, q, 2)]
    )
    assert path.q.max() <= 2 + 1e-9
    held = path.solution.touches[:, 0]
    assert held.sum() > 10
    # leans on the upper bound
    assert path.solution.multipliers[held][3:-3, 0] == pytest.approx(-9.81, rel=1e-6)
    leave = np.sqrt(2 * 2 / 9.81)  # tangent to the ceiling: v = 0 there
    assert abs(path.t[held][0] - leave) < 0.05 and abs(path.t[held][-1] - (2 - leave)) < 0.05


def test_a_minimum_with_constraints_and_bounds_keeps_both():
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    a, b = np.array([np.cos(0.5), np.sin(0.5), 0]), np.array([-np.cos(0.5), np.sin(0.5), 0])
    path = vi.least_action(
        sphere,
        vi.lobatto(3),
        q_start=a,
        q_end=b,
        duration=1.0,
        steps=40,
        guess=[a, [0, 0.8, 0.6], b],
        bounds=[(0.3, q[2] + ca.sumsqr(q[:2]) - q[1] ** 2 - 0.0, None)],
    )
    assert np.abs((path.q**2).sum(axis=1) - 1).max() < 1e-9
    assert path.solution.values[1:-1].min() > 0.3 - 1e-9
    assert path.solution.touches.any()


def test_bounds_that_contradict_each_other_on_the_way_fail_with_ipopts_word():
    q, v, t = *vi.coordinates("x"), vi.time()
    scene = vi.System(q, v, v**2 / 2, t=t)
    with pytest.raises(vi.SolverError, match="contradict") as caught:
        vi.least_action(
            scene,
            vi.gauss(1),
            q_start=0.0,
            q_end=1.0,
            duration=1.0,
            steps=10,
            bounds=[(None, q, 1), (0, q - 10 * t * (1 - t), None)],
        )
    assert caught.value.status == "Infeasible_Problem_Detected"
    assert len(caught.value.iterate) == 11


def leaning():
    """Past the unit disc on its upper side, by 24 steps."""
    scene = free_particle()
    given = dict(q_start=[-2, 0], q_end=[2, 0.1], guess=[[-2, 0], [0, 1.5], [2, 0.1]])
    bounds = [(1, ca.sumsqr(scene.q), None)]
    return vi.least_action(scene, vi.gauss(3), duration=2.0, steps=24, bounds=bounds, **given)


def test_parts_and_copies_of_a_path_that_leans_are_parts_and_copies_of_it(tmp_path):
    path, times = leaning(), np.linspace(0.0, 2.0, 60)
    path.save(tmp_path / "path.npz")
    few, loaded = path[::5], vi.load(tmp_path / "path.npz")
    few.save(tmp_path / "few.npz")
    dense = path.at(times)
    for part in (few, loaded, pickle.loads(pickle.dumps(path)), vi.load(tmp_path / "few.npz")):
        inside = times <= part.t[-1]
        assert np.array_equal(part.at(times[inside]).q, dense.q[inside])
        whole = path[: 5 * (len(part) - 1) + 1] if part.t[-1] < 2 else path
        assert part.action == pytest.approx(whole.action, rel=1e-13)
    assert np.array_equal(dense.at(path.t).q, path.q)
    assert path[:8].action + path[7:].action == pytest.approx(path.action, rel=1e-13)
    t = np.linspace(0.0, 2.0, 20_001)
    speed = np.linalg.norm(path.at(t).v, axis=1)
    assert dense.action == pytest.approx(np.trapezoid(speed**2 / 2, t), rel=1e-6)
    assert path.action == pytest.approx(dense.action, rel=1e-6)


def test_what_needs_a_motion_refuses_a_path_that_leans_in_words():
    path = leaning()
    every = {
        "transition": path.transition_matrix,
        "tangents": lambda: vi.sensitivity(path),
        "adjoints": lambda: vi.gradient(path, terminal_loss=path.system.q[0]),
        "ends": lambda: vi.action_derivatives(path),
        "momenta": path.conserved,
        "sums": lambda: path.sums(path.functions.action),
        "part": path[:6].transition_matrix,
    }
    for call in every.values():
        with pytest.raises(vi.InputError, match="leans on its bounds"):
            call()


@pytest.mark.parametrize("most", [50.0, 6.0, 5.0001])  # x² + y² comes to 5
def test_bounds_that_are_not_met_are_not_leant_on(most):
    scene = free_particle()
    ends = dict(q_start=[0, 0], q_end=[1, 2], duration=1.0, steps=10)
    bounds = [(None, ca.sumsqr(scene.q), most)]
    path = vi.least_action(scene, vi.gauss(2), bounds=bounds, **ends)
    assert not path.solution.touches.any() and not path.solution.multipliers.any()
    assert path.morse_index == 0
    assert path.transition_matrix()[:2, 2:] == pytest.approx(np.eye(2), abs=1e-12)
    slid = vi.System(scene.q, scene.v, scene.lagrangian - 9.81 * scene.q[1])  # up, if it could
    held = vi.least_action(
        slid, vi.gauss(2), bounds=[(None, scene.q[1], 0.0)], **ends | dict(q_end=[1, 0])
    )
    assert held.solution.touches[1:-1].all()
    assert held.solution.multipliers[1:-1] == pytest.approx(-9.81, rel=1e-6)
