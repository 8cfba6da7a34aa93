"""What an optimal control problem may hold: explicit time, parameters to choose, bounds along the
path, unequal steps, any units.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import (
    U,
    pendulum,
    replay_defect,
    swing,
)

import varint as vi


def test_time_dependent_scene_and_cost_use_the_times_of_the_nodes():
    q, v = vi.coordinates("x")
    t = vi.time()
    # x'' = cos t + u with u = −cos t free of cost: the cost asks for exactly this control
    system = vi.System(q, v, v**2 / 2 + q * ca.cos(t), force=U, control=U, t=t)
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=2.0,
        steps=10,
        t0=0.7,
        cost=(U + ca.cos(t)) ** 2,
        start=dict(q=[0], v=[1]),
    )
    assert motion.cost == pytest.approx(0, abs=1e-16)
    assert motion.t[[0, -1]] == pytest.approx([0.7, 2.7])
    assert motion.q[:, 0] == pytest.approx(motion.t - 0.7, abs=1e-9)
    assert replay_defect(motion) < 1e-12


def test_optimised_parameter_is_where_the_cost_is_stationary():
    q, v = vi.coordinates("theta")
    c = vi.Parameters(stiffness=1.0, rest=np.zeros(2))
    spring = c.stiffness * (q - c.rest[0]) ** 2 / 2
    system = vi.System(q, v, v**2 / 2 - spring, force=U, control=U, params=c)

    def cost(**given):
        return vi.optimal_control(
            system,
            vi.gauss(3),
            duration=3.0,
            steps=10,
            cost=U**2 + 0.01 * c.stiffness**2,
            start=dict(q=[0], v=[0]),
            end=dict(q=[1], v=[0]),
            params=dict(rest=[0.5, 0.0]) | given,
        )

    best = cost(stiffness=vi.free(1.0, 0.1, 10.0))
    found = float(best.parameters["stiffness"])
    assert 0.2 < found < 9
    assert min(cost(stiffness=found * x).cost for x in (0.99, 1.01)) > best.cost
    assert cost(stiffness=found).cost == pytest.approx(best.cost, rel=1e-9)
    assert replay_defect(best) < 1e-10


def test_path_bounds_on_expressions_hold_where_they_are_declared():
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=push, control=push)
    hole = ca.sumsqr(q - ca.DM([0.5, 0.02]))
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=1.0,
        steps=20,
        cost=ca.sumsqr(push),
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[1, 0], v=[0, 0]),
        bounds=[(0.04, hole, None), (None, ca.sumsqr(push), 100), (None, v[0], 2.0)],
    )
    points = motion.solution.q.values
    assert ((points - [0.5, 0.02]) ** 2).sum(axis=2).min() == pytest.approx(0.04, abs=1e-9)
    assert (motion.u**2).sum(axis=2).max() <= 100 + 1e-8
    assert motion.cost > 12
    assert any("sq" in name or "push" in name or ">=" in name for name in motion.solution.active)


def test_nonuniform_mesh_solves_the_same_problem():
    mesh = np.concatenate([[0], np.cumsum(np.linspace(1, 3, 40))])
    motion = swing(pendulum(9.81), 3.0, 0, mesh=mesh / mesh[-1])
    assert motion.cost == pytest.approx(36.6402890624, rel=1e-7)
    assert replay_defect(motion) < 1e-9
    assert motion.at(motion.t[7]).q == pytest.approx(motion.q[7], abs=1e-12)


def test_scene_in_si_units_converges_like_the_scene_in_natural_units():
    """The orbit transfer of radius 7000 km, in metres, seconds and newtons."""
    mu, r0, mass = 3.986e14, 7e6, 1000.0
    t = np.sqrt(r0**3 / mu)
    q, v = vi.coordinates("r", "phi")
    kinetic = mass * (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    system = vi.System(q, v, kinetic + mass * mu / q[0], force=ca.vertcat(0, q[0] * U), control=U)
    rate = 1.2**-1.5
    motion = vi.optimal_control(
        system,
        vi.gauss(4),
        duration=7.248846379348906 * t,
        steps=40,
        cost=U**2,
        start=dict(q=[r0, 0], v=[0, 1 / t]),
        end=dict(q=[1.2 * r0, 2 * np.pi], v=[0, rate / t]),
    )
    unit = mass * r0 / t**2
    assert motion.cost / (unit**2 * t) == pytest.approx(0.0010650580279977073, rel=1e-8)
    assert motion.solution.iterations < 30
