"""Optimal control of scenes that roll and slide along blades: order 2, replay by the simulation,
closed forms, and the same problem in reduced coordinates.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, replay_defect

import varint as vi

RULES = [vi.midpoint(), vi.trapezoidal()]
PUSH = ca.SX.sym("push", 2)
INERTIA = 0.5


@cache
def skate() -> vi.System:
    """A knife edge pushed along its blade and turned."""
    q, v = vi.coordinates("x", "y", "phi")
    cos, sin = ca.cos(q[2]), ca.sin(q[2])
    kinetic = (ca.sumsqr(v[:2]) + INERTIA * v[2] ** 2) / 2
    force = ca.vertcat(PUSH[0] * cos, PUSH[0] * sin, PUSH[1])
    blade = ca.horzcat(sin, -cos, 0)
    return vi.System(q, v, kinetic, nonholonomic=blade, force=force, control=PUSH)


def aside(t):
    return [np.sin(np.pi * t / 2), t / 2, np.pi / 2 * np.sin(np.pi * t / 2)]


def sideways(rule, steps: int, **given) -> vi.Trajectory:
    """From rest to rest, one unit to the side."""
    given = dict(guess=dict(q=aside), end=dict(q=[0, 1, 0], v=[0, 0, 0])) | given
    cost, rest = ca.sumsqr(PUSH), dict(q0=[0, 0, 0], v0=[0, 0, 0])
    return vi.optimal_control(skate(), rule, duration=2.0, steps=steps, cost=cost, **rest, **given)


@cache
def reduced_cost(steps: int = 60) -> float:
    """The same by Gauss–Legendre collocation of x' = s cos φ, y' = s sin φ, φ' = ω, s' = u,
    ω' = w/I, which has no constraint left.
    """
    x, u = ca.SX.sym("x", 5), ca.SX.sym("u", 2)
    rate = ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), x[4], u[0], u[1] / INERTIA)
    f, rule, h = ca.Function("f", [x, u], [rate]), vi.gauss(3), 2.0 / steps
    x0, k, us = ca.SX.sym("x0", 5), ca.SX.sym("k", 5, 3), ca.SX.sym("us", 2, 3)
    stages = ca.repmat(x0, 1, 3) + h * k @ ca.DM(rule.collocation).T
    rows = ca.vertcat(*(k[:, i] - f(stages[:, i], us[:, i]) for i in range(3)))
    after = x0 + h * k @ ca.DM(rule.weights)
    cost = h * sum(rule.weights[i] * ca.sumsqr(us[:, i]) for i in range(3))
    step = ca.Function("step", [x0, k, us], [rows, after, cost])
    opti = ca.Opti()
    X, K, W = (opti.variable(n, m) for n, m in ((5, steps + 1), (5, 3 * steps), (2, 3 * steps)))
    total = 0
    for i in range(steps):
        part = slice(3 * i, 3 * i + 3)
        rows, after, cost = step(X[:, i], K[:, part], W[:, part])
        opti.subject_to(rows == 0)
        opti.subject_to(X[:, i + 1] == after)
        total += cost
    opti.subject_to(X[:, 0] == 0)
    opti.subject_to(X[:, -1] == ca.DM([0, 1, 0, 0, 0]))
    opti.minimize(total)
    opti.set_initial(X[:3, :], np.array([aside(t) for t in np.linspace(0, 2, steps + 1)]).T)
    opti.solver("ipopt", {"expand": True, "print_time": False}, {"print_level": 0, "tol": 1e-10})
    return float(opti.solve().value(total))


@pytest.mark.parametrize("rule", RULES, ids=str)
@coarse
def test_the_cost_converges_with_order_two_to_that_of_the_reduced_problem(rule):
    errors = [sideways(rule, n).cost - reduced_cost() for n in (20, 40, 80)]
    orders = -np.diff(np.log2(np.abs(errors)))
    assert orders == pytest.approx([2, 2], abs=0.1)
    assert abs(errors[-1]) <= 3e-3 * reduced_cost()


@pytest.mark.parametrize("rule", RULES, ids=str)
@coarse
def test_the_blade_does_not_slip_and_the_simulation_replays_the_path_to_round_off(rule):
    motion = sideways(rule, 40)
    assert replay_defect(motion) <= 1e-12
    assert motion.p == pytest.approx(motion.replay().p, abs=1e-12)
    slip = motion.v[:, 0] * np.sin(motion.q[:, 2]) - motion.v[:, 1] * np.cos(motion.q[:, 2])
    assert np.abs(slip).max() <= 1e-12
    # the reaction is the centripetal one, s φ' across the blade, and does no work
    speed = motion.v[:, 0] * np.cos(motion.q[:, 2]) + motion.v[:, 1] * np.sin(motion.q[:, 2])
    assert motion.multipliers[:, 0] == pytest.approx(-speed * motion.v[:, 2], abs=1e-10)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_straight_ahead_it_is_the_double_integrator_with_its_exact_discrete_cost(angle):
    n, there = 10, [np.cos(angle), np.sin(angle), angle]
    motion = vi.optimal_control(
        skate(),
        vi.midpoint(),
        duration=1.0,
        steps=n,
        cost=ca.sumsqr(PUSH),
        q0=[0, 0, angle],
        v0=[0, 0, 0],
        end=dict(q=there, v=[0, 0, 0]),
    )
    assert motion.cost == pytest.approx(12 * n**2 / (n**2 - 1), rel=1e-10)
    assert np.abs(motion.q[:, 2] - angle).max() <= 1e-9


def test_a_disc_that_rolls_ahead_costs_what_its_inertia_says():
    """Rolling couples x and θ: the torque sees I + m R²; and the heading its own inertia."""
    model = vi.models.rolling_disc()
    s, u = model.system, ca.SX.sym("torque", 2)
    disc = vi.System(
        s.q,
        s.v,
        s.lagrangian,
        nonholonomic=s.nonholonomic,
        force=ca.vertcat(0, 0, u[0], u[1]),
        control=u,
        params=s.params,
    )
    n, still = 10, [0, 0, 0, 0]
    motion = vi.optimal_control(
        disc,
        duration=1.0,
        steps=n,
        cost=ca.sumsqr(u),
        q0=still,
        v0=still,
        end=dict(q=[2.0, 0, 2.0, 0], v=still),
    )
    assert motion.cost == pytest.approx((1.5 * 2.0) ** 2 * 12 * n**2 / (n**2 - 1), rel=1e-9)
    assert replay_defect(motion) <= 1e-12
    spin = vi.optimal_control(
        disc,
        duration=1.0,
        steps=n,
        cost=ca.sumsqr(u),
        q0=still,
        v0=still,
        end=dict(q=[0, 0, 0, 1.0], v=still),
    )
    assert spin.cost == pytest.approx(0.25**2 * 12 * n**2 / (n**2 - 1), rel=1e-9)


@coarse
def test_an_end_that_may_slip_along_nothing_is_free_along_the_blade():
    """End velocities that are not given obey A v = 0."""
    motion = sideways(vi.midpoint(), 30, end=dict(q=[1, 1, None]), guess=None)
    across = motion.v[-1] @ [np.sin(motion.q[-1, 2]), -np.cos(motion.q[-1, 2]), 0]
    assert abs(across) <= 1e-11
    assert replay_defect(motion) <= 1e-12
    free = np.array(motion.solution.costates.p[-1])  # transversality along what is free
    along = np.array([np.cos(motion.q[-1, 2]), np.sin(motion.q[-1, 2]), 0])
    assert free @ along == pytest.approx(0, abs=1e-8)
    assert free[2] == pytest.approx(0, abs=1e-8)


@coarse
def test_holonomic_and_non_holonomic_rows_hold_together():
    """The skate in space, its plane a constraint, moves as the one in the plane."""
    q, v = vi.coordinates("x", "y", "z", "phi")
    cos, sin = ca.cos(q[3]), ca.sin(q[3])
    kinetic = (ca.sumsqr(v[:3]) + INERTIA * v[3] ** 2) / 2
    solid = vi.System(
        q,
        v,
        kinetic - 9.81 * q[2],
        constraint=q[2],
        nonholonomic=ca.horzcat(sin, -cos, 0, 0),
        force=ca.vertcat(PUSH[0] * cos, PUSH[0] * sin, 0, PUSH[1]),
        control=PUSH,
    )
    still = [0, 0, 0, 0]
    space = vi.optimal_control(
        solid,
        duration=2.0,
        steps=20,
        cost=ca.sumsqr(PUSH),
        q0=still,
        v0=still,
        end=dict(q=[0, 1, 0, 0], v=still),
        guess=dict(q=lambda t: [*aside(t)[:2], 0, aside(t)[2]]),
    )
    plane = sideways(vi.trapezoidal(), 20)
    assert space.rule == vi.trapezoidal()
    assert space.cost == pytest.approx(plane.cost, rel=1e-9)
    assert space.q[:, [0, 1, 3]] == pytest.approx(plane.q, abs=1e-7)


@coarse
@pytest.mark.parametrize("ahead", [3, 0])
def test_a_car_is_parked_sideways_from_the_default_start(ahead):
    """Two rows, at both axles: the straight line slips, and no solver leaves it by itself."""
    q, v = vi.coordinates("x", "y", "heading", "steer")
    cos, sin = ca.cos(q[2]), ca.sin(q[2])
    front = ca.horzcat(ca.sin(q[2] + q[3]), -ca.cos(q[2] + q[3]), -2.5 * ca.cos(q[3]), 0)
    car = vi.System(
        q,
        v,
        (ca.sumsqr(v[:3]) + 0.1 * v[3] ** 2) / 2,
        nonholonomic=ca.vertcat(ca.horzcat(sin, -cos, 0, 0), front),
        force=ca.vertcat(PUSH[0] * cos, PUSH[0] * sin, 0, PUSH[1]),
        control=PUSH,
    )
    still = [0, 0, 0, 0]
    park = vi.optimal_control(
        car,
        duration=6.0,
        steps=30,
        cost=ca.sumsqr(PUSH),
        q0=still,
        v0=still,
        end=dict(q=[ahead, 2, 0, 0], v=still),
        bounds=[(-0.6, q[3], 0.6)],
    )
    assert park.solution.success and park.solution.violation <= 1e-9
    assert park.solution.iterations <= 120
    assert replay_defect(park) <= 1e-11
    assert np.abs(park.q[:, 3]).max() <= 0.6 + 1e-9


@coarse
@pytest.mark.parametrize("end", [[0.5, 1, 0, None], [0, 1, 0, None]], ids=str)
def test_of_the_ways_around_the_cheapest_is_taken(end, capsys):
    """A disc rolls sideways: it may turn first, or cut to and fro, for up to seven times as much;
    none of the random starts finds anything cheaper.
    """
    q, v = vi.coordinates("x", "y", "heading", "roll")
    rolls = [
        ca.horzcat(1, 0, 0, -0.3 * ca.cos(q[2])),
        ca.horzcat(0, 1, 0, -0.3 * ca.sin(q[2])),
    ]
    disc = vi.System(
        q,
        v,
        ca.sumsqr(v[:2]) + 0.025 * v[2] ** 2 + 0.045 * v[3] ** 2,
        nonholonomic=ca.vertcat(*rolls),
        force=ca.vertcat(0, 0, PUSH),
        control=PUSH,
    )
    cost, still = ca.sumsqr(PUSH), [0, 0, 0, 0]
    ends = dict(start=dict(q=still, v=still), end=dict(q=end, v=still))
    motion = vi.optimal_control(disc, duration=3.0, steps=30, cost=cost, **ends)
    phase = vi.Phase(disc, None, 3.0, 30, cost, **ends)
    found = vi.multistart(phase, 6, spread=0.5, seed=3)
    assert found[-1].cost > 3 * found[0].cost
    assert motion.cost <= found[0].cost * (1 + 1e-6)
    assert motion.stats["starts"][0] == pytest.approx(motion.cost, rel=1e-12)
    motion.report()
    assert "costs of the minima found near the first start" in capsys.readouterr().out


@coarse
def test_sensitivity_and_other_numbers_know_the_rows():
    motion = sideways(vi.midpoint(), 20)
    found = motion.solution.sensitivity("end.q.y", "duration").cost
    step = 1e-4
    ahead, behind = (motion.again(end=dict(q=[0, 1 + sign * step, 0])).cost for sign in (1.0, -1.0))
    assert found[0] == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)
    longer, shorter = (motion.again(duration=2 + sign * step).cost for sign in (1.0, -1.0))
    assert found[1] == pytest.approx((longer - shorter) / (2 * step), rel=1e-6)


@coarse
def test_refinement_halves_the_steps():
    fine = vi.refine(sideways(vi.midpoint(), 20), 2e-3)
    assert fine.rule == vi.midpoint() and len(fine) > 41
    assert abs(fine.cost / reduced_cost() - 1) <= 2e-3
    assert fine.stats["error"] <= 2e-3 * fine.cost


def test_what_slips_or_has_too_high_an_order_is_refused():
    with pytest.raises(vi.InputError, match=r"velocity violates non-holonomic row 0: A v = -1"):
        sideways(vi.midpoint(), 5, end=dict(q=[0, 1, 0], v=[0, 1, 0]))
    with pytest.raises(vi.InputError, match=r"gauss\(2\) cannot carry non-holonomic"):
        sideways(vi.gauss(2), 5)
    q, v = vi.coordinates("x", "y", "z")
    both = dict(constraint=q[2], nonholonomic=ca.DM([[0, 1, 0]]), control=U)
    scene = vi.System(q, v, ca.sumsqr(v) / 2, force=ca.vertcat(U, 0, 0), **both)
    with pytest.raises(vi.InputError, match="cannot carry constraints"):
        vi.optimal_control(scene, vi.midpoint(), duration=1.0, steps=5, cost=U**2)


@coarse
def test_a_predictive_controller_stays_on_the_blade():
    cost = ca.sumsqr(skate().q[:2] - ca.DM([1, 0])) + ca.sumsqr(skate().v) + ca.sumsqr(PUSH) / 10
    controller = vi.mpc(vi.Phase(skate(), vi.midpoint(), 2.0, 10, cost))
    motion, _ = vi.closed_loop(controller, [0, 0, 0.2], [0, 0, 0], 15)
    assert np.abs(motion.q[-1, 0] - 1) <= 0.3
    with pytest.raises(vi.InputError, match="A v = 0 of non-holonomic row 0"):
        controller([0, 0, 0], [0, 1, 0])
