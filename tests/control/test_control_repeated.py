"""Refinement to a tolerance, phases with impacts, model predictive control, feedback gains."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import (
    REFERENCE,
    U,
    cartpole,
    coarse,
    move,
    particle,
    pendulum,
    replay_defect,
    swing,
    swing_up,
)

import varint as vi
from varint.control.lqr import linearise

SWING_UP = REFERENCE["D02_cartpole_kelly"]["reference"]["J_int_u2"]


def test_refinement_reaches_the_tolerance_and_its_estimate_is_the_true_error():
    rough = swing_up(vi.gauss(2), 30, guess=swing_up())
    fine = vi.refine(rough, 1e-9)
    assert abs(fine.cost - SWING_UP) <= 1e-9 * SWING_UP
    assert abs(fine.cost - SWING_UP) <= fine.stats["error"] <= 1e-9 * SWING_UP
    # each round's estimate is that of the solution it judges: effectivity 1 once the mesh resolves
    # the motion
    first, *middle, _ = fine.stats["rounds"]
    assert first[0] == "gauss(2)"
    for _, steps, cost, estimate in middle:
        if steps > 40:
            assert estimate >= 0.9 * abs(cost - SWING_UP)
    assert replay_defect(fine) < 1e-9


def test_refinement_raises_the_order_where_the_motion_is_smooth():
    rough = swing(pendulum(9.81), 3.0, 30, rule=vi.gauss(2))
    fine = vi.refine(rough, 1e-11)
    assert fine.rule.order > 4
    assert fine.cost == pytest.approx(
        swing(pendulum(9.81), 3.0, 60, rule=vi.gauss(5)).cost, rel=1e-11
    )


@pytest.mark.parametrize("row", [1, 2])
def test_refinement_splits_the_steps_where_a_bound_is_entered(row):
    bound, cost = REFERENCE["D01_bryson_denham"]["reference"]["rows"][row]
    rough = move(
        vi.gauss(2),
        7,
        cost=U**2 / 2,
        start=dict(q=[0], v=[1]),
        end=dict(q=[0], v=[-1]),
        bounds=[(None, particle().q, bound)],
    )
    fine = vi.refine(rough, 1e-7)
    assert fine.cost == pytest.approx(cost, rel=1e-7)
    sizes = np.diff(fine.solution.mesh)
    assert sizes.max() / sizes.min() > 1.9


def test_refinement_closes_in_on_a_switching_time():
    x0, v0, duration, switch, _ = REFERENCE["D01_min_time_double_integrator"]["reference"]["rows"][
        1
    ]
    rough = move(
        vi.gauss(2),
        10,
        vi.free(3, 0.1, 20),
        cost=1,
        start=dict(q=[x0], v=[v0]),
        end=dict(q=[0], v=[0]),
        bounds=[(-1, U, 1)],
    )
    fine = vi.refine(rough, 1e-7)
    assert abs(rough.duration - duration) > 1e-4
    assert fine.duration == pytest.approx(duration, rel=1e-7)
    smallest = np.argmin(np.diff(fine.t))
    assert fine.t[smallest] == pytest.approx(switch, abs=0.2)
    assert replay_defect(fine) < 1e-9


@coarse
def test_refinement_that_cannot_reach_its_tolerance_says_so():
    with pytest.raises(vi.SolverError, match="rounds") as error:
        vi.refine(swing_up(vi.midpoint(), 20), 1e-12, rounds=2)
    assert error.value.iterate.cost > 0
    with pytest.raises(vi.InputError, match="positive"):
        vi.refine(swing_up(), 0)
    rest = vi.simulate(pendulum(), q0=0, v0=0, h=0.1, steps=2, u=np.zeros((2, 1)))
    with pytest.raises(vi.InputError, match="optimal_control"):
        vi.refine(rest)
    with pytest.raises(vi.InputError, match="optimal_control"):
        rest.report()


def test_bouncing_ball_rises_to_the_height_that_restitution_leaves():
    q, v = vi.coordinates("y")
    ball = vi.System(q, v, v**2 / 2 - 9.81 * q)
    free = vi.free(0.4, 0.01, 5)
    phases = [
        vi.Phase(ball, vi.gauss(2), free, 4, start=dict(q=[1], v=[0])),
        vi.Phase(ball, vi.gauss(2), free, 4, end=dict(v=[0])),
    ]
    fall, rise = vi.optimal_phases(phases, [vi.Link(0, 1, contact=q, restitution=0.5)])
    time = np.sqrt(2 / 9.81)
    assert [fall.duration, rise.duration] == pytest.approx([time, 0.5 * time], rel=1e-12)
    assert rise.q[-1, 0] == pytest.approx(0.25, abs=1e-12)
    assert rise.p[0, 0] == pytest.approx(-0.5 * fall.p[-1, 0], rel=1e-12)


def _walker():
    """Two legs on a hip: hip position, stance and swing leg from the downward vertical; hip and
    ankle torque.
    """
    torque = ca.SX.sym("torque", 2)
    q, v = vi.coordinates("x", "y", "stance", "swing")

    def along(angle, part):
        return q[:2] + part * ca.vertcat(ca.sin(angle), -ca.cos(angle))

    lagrangian = 0
    for mass, place in ((10, q[:2]), (5, along(q[2], 0.5)), (5, along(q[3], 0.5))):
        lagrangian += mass / 2 * ca.sumsqr(ca.jtimes(place, q, v)) - mass * 9.81 * place[1]
    force = ca.vertcat(0, 0, torque[1] - torque[0], torque[0])
    system = vi.System(q, v, lagrangian, constraint=along(q[2], 1), force=force, control=torque)
    return system, along(q[3], 1), torque


def test_periodic_walk_repeats_itself_after_the_impact_and_the_change_of_legs():
    system, foot, torque = _walker()
    q, lean = system.q, np.arcsin(0.25)

    def guess(t):
        angle = lean * (1 - t / 0.4)
        return [-np.sin(angle), np.cos(angle), angle, -angle]

    phase = vi.Phase(
        system,
        vi.lobatto(3),
        vi.free(0.8, 0.3, 1.5),
        20,
        ca.sumsqr(torque),
        guess=dict(q=guess),
        end=dict(bounds=[(0.5, foot[0], 0.5)]),
    )
    swap = ca.vertcat(q[0] - foot[0], q[1] - foot[1], q[3], q[2])
    step = vi.Link(0, 0, contact=foot[1], sticks=foot[0], relabel=swap, time=False)
    [walk] = vi.optimal_phases([phase], [step])
    old, new = walk.q[-1], walk.q[0]
    assert new[2:] == pytest.approx(old[[3, 2]], abs=1e-10)
    assert new[0] - old[0] == pytest.approx(-0.5, abs=1e-10)
    assert np.abs(walk.value(system.constraint)).max() < 1e-10
    # the impact takes momentum along the foot only, and costs energy that the torques give back
    f = ca.Function("f", [q, system.v], [ca.jacobian(foot, q), system.momentum])
    normal, before = (np.array(x) for x in f(old, walk.v[-1]))
    back = walk.v[0][[0, 1, 3, 2]]  # the new frame rests on the foot that has just stopped
    after = np.array(f(old, back)[1])
    impulse = np.linalg.lstsq(normal.T, after - before, rcond=None)[0]
    assert normal.T @ impulse == pytest.approx(after - before, abs=1e-8)
    assert np.array(normal) @ back == pytest.approx(0, abs=1e-9)
    assert walk.energy[0] < walk.energy[-1] - 1e-3
    assert walk.cost < 30


def test_links_that_cannot_work_are_refused():
    phase = vi.Phase(particle(), vi.gauss(2), 1.0, 4, U**2)
    other = vi.Phase(cartpole(), vi.gauss(2), 1.0, 4, U**2)
    with pytest.raises(vi.InputError, match="equally many"):
        vi.optimal_phases([phase, other])
    with pytest.raises(vi.InputError, match="there are 2"):
        vi.optimal_phases([phase, phase], [vi.Link(0, 2)])
    with pytest.raises(vi.InputError, match="between 0 and 1"):
        vi.optimal_phases([phase, phase], [vi.Link(0, 1, contact=particle().q, restitution=2)])
    with pytest.raises(vi.InputError, match=r"list of varint\.Phase"):
        vi.optimal_phases([particle()])


def _balance() -> vi.Phase:
    s = cartpole()
    q, v = s.q, s.v
    cost = 10 * q[0] ** 2 + 20 * (1 + ca.cos(q[1])) + 0.1 * ca.sumsqr(v) + 0.01 * U**2
    return vi.Phase(
        s, vi.gauss(2), 1.0, 20, cost, bounds=[(-20, U, 20)], guess=dict(q=[[0.0, np.pi]] * 2)
    )


def test_predictive_control_balances_the_pole_against_pushes_and_starts_warm():
    controller = vi.mpc(_balance())
    pushes = np.zeros((60, 2))
    pushes[15] = [0.4, 0.05]
    motion, plans = vi.closed_loop(controller, [0.5, np.pi - 0.3], [0, 0], 60, disturbance=pushes)
    assert [motion.q[-1, 0], np.cos(motion.q[-1, 1])] == pytest.approx([0, -1], abs=0.02)
    assert np.abs(motion.u).max() <= 20 + 1e-9
    assert np.median([plan.solution.iterations for plan in plans[1:]]) <= 8
    for k in (0, 20):  # the plan's first step is what the plant did, unless pushed
        assert plans[k].q[1] == pytest.approx(motion.q[k + 1], abs=1e-9)


def test_predictive_control_answers_like_a_fresh_optimal_control():
    from dataclasses import replace

    phase, state = _balance(), dict(q=[0.2, np.pi + 0.2], v=[0.1, -0.3])
    controller = vi.mpc(phase)
    first = controller([0.25, np.pi + 0.25], [0.1, -0.3])
    fresh = vi.optimal_phases([replace(phase, start=state)])[0]
    assert controller(**state).cost == pytest.approx(fresh.cost, rel=1e-9)
    assert controller(**state, previous=first).cost == pytest.approx(fresh.cost, rel=1e-8)


def test_predictive_control_refuses_a_given_start_and_states_of_the_wrong_shape():
    from dataclasses import replace

    with pytest.raises(vi.InputError, match="leave start"):
        vi.mpc(replace(_balance(), start=dict(q=[0, 0])))
    with pytest.raises(vi.InputError, match="must be"):
        vi.mpc(_balance())([0.0], [0.0, 0.0])


def test_linearised_steps_are_symplectic_and_match_differences():
    motion = swing_up(vi.gauss(3), 20)
    A, B = linearise(motion)
    J = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    assert max(np.abs(a.T @ J @ a - J).max() for a in A) < 1e-11
    k, e = 7, 1e-6

    def ends(du):
        u = motion.u[k : k + 1] + du
        m = vi.simulate(
            cartpole(), vi.gauss(3), q0=motion.q[k], p0=motion.p[k], h=motion.h, steps=1, u=u
        )
        return np.concatenate([m.q[-1], m.p[-1]])

    assert B[k][:, 0] == pytest.approx((ends(e) - ends(-e)) / (2 * e), abs=1e-8)


def test_gains_of_the_double_integrator_tend_to_the_closed_form():
    reference = REFERENCE["D01_lqr_double_integrator"]["reference"]
    errors = []
    for steps in (2000, 4000):
        rest = vi.simulate(
            particle(), vi.gauss(2), q0=0, v0=0, duration=20.0, steps=steps, u=np.zeros((steps, 1))
        )
        errors.append(np.abs(vi.lqr(rest, np.eye(2), np.eye(1))[0, 0] - reference["K"]).max())
    assert errors[1] < 0.006
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.1)


def test_gains_keep_the_swing_up_from_a_wrong_start():
    plan = swing_up(vi.gauss(3), 60)
    gains = vi.lqr(plan, np.diag([10.0, 10, 1, 1]), 0.1 * np.eye(1), 100 * np.eye(4))

    def run(feedback):
        q, p = plan.q[0] + [0.02, 0.02], plan.p[0]
        for k in range(60):
            change = (
                -gains[k] @ np.concatenate([q - plan.q[k], p - plan.p[k]])
                if feedback
                else np.zeros(1)
            )
            u = plan.u[k : k + 1] + change
            one = vi.simulate(cartpole(), vi.gauss(3), q0=q, p0=p, h=plan.h, steps=1, u=u)
            q, p = one.q[-1], one.p[-1]
        return np.abs(q - plan.q[-1]).max()

    assert run(True) < 0.1 * run(False)


@coarse
def test_gains_refuse_what_makes_no_sense():
    motion = swing_up(vi.gauss(2), 10)
    with pytest.raises(vi.InputError, match="symmetric matrix"):
        vi.lqr(motion, np.eye(3), np.eye(1))
    with pytest.raises(vi.InputError, match="positive definite"):
        vi.lqr(motion, np.eye(4), -np.eye(1))
    with pytest.raises(vi.InputError, match="every node"):
        vi.lqr(motion[::2], np.eye(4), np.eye(1))


@coarse
def test_refinement_of_phases_is_shared_and_its_estimate_covers_the_true_error():
    """A swing-up that coasts before the motor starts; the whole, of one phase, is the reference."""
    scene, off = pendulum(9.81), dict(q=[0], v=[0])
    phases = [
        vi.Phase(scene, vi.gauss(2), 1.0, 4, 0.2 * U**2, start=off),
        vi.Phase(scene, vi.gauss(2), 2.0, 8, U**2, end=dict(q=[np.pi], v=[0])),
    ]
    exact = sum(
        x.cost for x in vi.optimal_phases([replace(x, rule=vi.gauss(6), steps=40) for x in phases])
    )
    rough = vi.optimal_phases(phases)
    fine = vi.refine(rough, 1e-9)
    true, claimed = abs(fine[0].solution.total_cost - exact), fine[0].stats["error"]
    assert len(fine) == 2 and fine[1].t[0] == fine[0].t[-1] == 1.0
    assert true <= claimed <= 1e-9 * exact
    for _, _, cost, estimate in fine[0].stats["rounds"][:-1]:
        assert estimate == pytest.approx(abs(cost - exact), rel=0.2)
    assert max(map(replay_defect, fine)) < 1e-9


def test_refinement_keeps_the_links_of_a_walk():
    model = vi.models.walker(steps=8)
    fine = vi.refine(model.solve(), 1e-6)
    [best] = vi.optimal_phases(
        [replace(model.phases[0], rule=vi.lobatto(5), steps=20)], model.links
    )
    assert abs(fine[0].cost - best.cost) <= fine[0].stats["error"] <= 1e-6 * best.cost


def test_refinement_refuses_some_of_the_phases():
    legs = vi.models.fastest_transfer().solve()
    for some in (legs[0], legs[::-1], []):
        with pytest.raises(vi.InputError, match="all"):
            vi.refine(some)


def test_closed_loops_and_multistarts_refuse_what_they_cannot_do():
    q, v = particle().q, particle().v
    ahead = vi.Phase(particle(), vi.gauss(2), 3.0, 15, q**2 + v**2 + U**2, bounds=[(-1, U, 1)])
    controller = vi.mpc(ahead)
    for change, message in (
        (dict(steps=0), "at least 1"),
        (dict(steps=10, disturbance=np.zeros((3, 1))), r"\(10, 1\)"),
        (dict(steps=2, disturbance=np.full((2, 1), np.nan)), "finite"),
    ):
        with pytest.raises(vi.InputError, match=message):
            vi.closed_loop(controller, [1.0], [0.0], **change)
    with pytest.raises(vi.InputError, match="last answer"):
        controller([1.0], [0.0], previous=move(vi.gauss(2), 5))
    with pytest.raises(vi.InputError, match=r"one varint\.Phase"):
        vi.multistart([ahead])
    with pytest.raises(vi.InputError, match="list of guesses"):
        vi.multistart(ahead, "many")
    with pytest.raises(vi.InputError, match=r"varint\.Link"):
        vi.optimal_phases([ahead], [3])
