"""What every optimal control keeps: its replay, its costates, and the balances of momentum and
energy.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import (
    cartpole,
    coarse,
    pendulum,
    replay_defect,
    swing,
    swing_up,
)

import varint as vi
from varint.control.balances import energy_balance, momentum_balance

RULES = [vi.midpoint(), vi.gauss(2), vi.gauss(3), vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)]


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("control", ["nodes", "constant"])
@coarse
def test_simulation_with_the_optimal_controls_reproduces_the_optimal_path(rule, control):
    motion = swing(pendulum(9.81), 3.0, 40, rule=rule, control=control)
    assert replay_defect(motion) < 1e-9
    again = vi.simulate(pendulum(9.81), rule, q0=[0], v0=[0], duration=3.0, steps=40, u=motion.u)
    assert np.abs(again.q - motion.q).max() < 1e-9
    assert np.abs(again.p - motion.p).max() < 1e-8


@coarse
def test_control_of_the_midpoint_rule_is_the_closed_form_of_its_costates():
    system, weight = cartpole(), 0.7
    motion = swing_up(vi.midpoint(), 40, weight)
    mu = motion.costates.p
    force_on = np.array([1.0, 0.0])
    expected = -(mu[:-1] + mu[1:]) @ force_on / (4 * weight)
    assert np.abs(expected).max() < 20  # bounds are not active
    assert motion.u[:, 0, 0] == pytest.approx(expected, abs=1e-6)
    assert system.structure.cyclic == (0,)


@pytest.mark.parametrize("rule", [vi.gauss(3), vi.lobatto(3)], ids=str)
def test_costates_are_the_derivatives_of_the_cost(rule):
    start, step = dict(q=np.array([0.3, -0.2]), v=np.array([0.1, 0.4])), 1e-4
    base = swing_up(rule, 30, start=start)
    p = vi.simulate(
        cartpole(), rule, q0=start["q"], v0=start["v"], h=1e-3, steps=1, u=np.zeros((1, 1))
    ).p[0]

    def cost(dq, dp):
        q = start["q"] + dq
        mass = ca.Function("M", [cartpole().q], [cartpole().mass_matrix])
        v = np.linalg.solve(np.array(mass(q)), p + dp)
        return swing_up(rule, 30, start=dict(q=q, v=v), guess=base).cost

    for i in range(2):
        e = step * np.eye(2)[i]
        assert (cost(e, 0) - cost(-e, 0)) / (2 * step) == pytest.approx(
            base.costates.q[0, i], rel=1e-5
        )
        assert (cost(0, e) - cost(0, -e)) / (2 * step) == pytest.approx(
            base.costates.p[0, i], rel=1e-5
        )


def test_momentum_of_a_cyclic_coordinate_changes_by_the_impulse_of_the_force_exactly():
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[1, np.pi], v=[0.7, 0]))
    [(name, gained, impulse)] = momentum_balance(motion, motion.solution.q)
    assert name == "translation along x"
    assert gained == pytest.approx(impulse, abs=1e-11)
    assert abs(gained) > 0.5


@pytest.mark.parametrize("stages", [2, 3])
def test_energy_gained_is_the_work_of_the_controls_to_the_order_of_the_rule(stages):
    defects = []
    for steps in (40, 80):
        gained, work = energy_balance(
            *((m := swing(pendulum(9.81), 3.0, steps, rule=vi.gauss(stages))), m.solution.q)
        )
        defects.append(abs(gained - work))
    assert np.log2(defects[0] / defects[1]) > 2 * stages - 0.4


def test_angular_momentum_of_an_orbit_changes_by_the_torque_integral_only():
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), force=push, control=push)
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=2.0,
        steps=30,
        cost=ca.sumsqr(push),
        start=dict(q=[1, 0], v=[0, 1]),
        end=dict(q=[-1.2, 0.3], v=[None, None]),
        guess=dict(q=lambda t: [np.cos(1.5 * t), np.sin(1.5 * t)]),
    )
    rule, points = motion.rule, motion.solution.q.values
    nodes = np.einsum("ij,kjn->kin", rule.basis, points)
    torque = nodes[..., 0] * motion.u[..., 1] - nodes[..., 1] * motion.u[..., 0]
    gained = (motion.q[:, 0] * motion.p[:, 1] - motion.q[:, 1] * motion.p[:, 0])[[0, -1]]
    assert gained[1] - gained[0] == pytest.approx(
        motion.h * (torque @ np.array(rule.weights)).sum(), abs=1e-11
    )
    [(name, change, impulse)] = momentum_balance(motion, motion.solution.q)
    assert (name, change) == ("rotation about z", pytest.approx(gained[1] - gained[0], abs=1e-12))
    assert impulse == pytest.approx(change, abs=1e-11)
