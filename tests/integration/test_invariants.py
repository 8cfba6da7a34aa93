"""Symplecticity, reversibility, momentum maps, energy: what a variational integrator must keep."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import (
    COMPOSITIONS,
    GALERKIN,
    cart_pendulum,
    double_pendulum,
    driven_damped,
    henon_heiles,
    pendulum,
)

import varint as vi
from varint.discrete.lagrangian import interval


def _symplectic_defect(step: ca.Function, q0, p0, h) -> float:
    """‖AᵀJA − J‖ of A = ∂(q1, p1)/∂(q0, p0), by exact derivatives through the root finder."""
    n = len(q0)
    q, p = ca.MX.sym("q", n), ca.MX.sym("p", n)
    out = step(q0=q, p0=p, t=0, h=h)
    slope = ca.Function(
        "slope", [q, p], [ca.jacobian(ca.vertcat(out["q1"], out["p1"]), ca.vertcat(q, p))]
    )
    a = np.array(slope(q0, p0))
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    return float(np.abs(a.T @ j @ a - j).max())


@pytest.mark.parametrize("rule", GALERKIN, ids=str)
def test_steps_with_a_configuration_dependent_mass_are_symplectic(rule):
    assert (
        _symplectic_defect(vi.step_function(double_pendulum(), rule), [0.4, -0.9], [1.0, 0.3], 0.05)
        <= 1e-12
    )


@pytest.mark.parametrize("rule", COMPOSITIONS, ids=str)
def test_compositions_are_symplectic(rule):
    assert (
        _symplectic_defect(vi.step_function(henon_heiles(), rule), [0.1, -0.3], [0.2, 0.3], 0.2)
        <= 1e-12
    )


def test_explicit_euler_is_not_symplectic():
    q, p, h, t = (ca.MX.sym(x) for x in "qpht")
    euler = ca.Function(
        "euler", [q, p, t, h], [q + h * p, p - h * ca.sin(q)], ["q0", "p0", "t", "h"], ["q1", "p1"]
    )
    assert _symplectic_defect(euler, [0.4], [1.0], 0.05) > 1e-4


@pytest.mark.parametrize("rule", GALERKIN, ids=str)
def test_implicit_runs_are_reversible(rule):
    system, steps = double_pendulum(), 100
    there = vi.simulate(system, rule, q0=[0.4, -0.9], v0=[1.0, 0.3], h=0.02, steps=steps)
    back = vi.simulate(system, rule, q0=there.q[-1], p0=-there.p[-1], h=0.02, steps=steps)
    np.testing.assert_allclose(back.q[-1], there.q[0], atol=1e-11)
    np.testing.assert_allclose(back.p[-1], -there.p[0], atol=1e-11)


@pytest.mark.parametrize("rule", COMPOSITIONS, ids=str)
def test_compositions_are_reversible_by_a_negative_step(rule):
    there = vi.simulate(henon_heiles(), rule, q0=[0.1, 0.2], v0=[0.3, 0.1], h=0.1, steps=200)
    back = vi.simulate(henon_heiles(), rule, q0=there.q[-1], p0=there.p[-1], h=-0.1, steps=200)
    np.testing.assert_allclose(back.q[-1], there.q[0], atol=1e-12)
    np.testing.assert_allclose(back.t[-1], -20.0)


@pytest.mark.parametrize(
    "rule", [vi.midpoint(), vi.gauss(2), vi.trapezoidal(), vi.lobatto(3)], ids=str
)
def test_the_momentum_of_a_cyclic_coordinate_stays_to_round_off_over_1e5_steps(rule):
    system = cart_pendulum()
    assert system.structure.cyclic == (0,)
    motion = vi.simulate(
        system, rule, q0=[0.0, 1.2], v0=[0.7, 0.0], h=0.02, steps=100_000, save_every=100
    )
    assert np.abs(motion.p[:, 0] - motion.p[0, 0]).max() <= 1e-11


@pytest.mark.parametrize(
    ("build", "rule", "q0", "v0", "h"),
    [
        (double_pendulum, vi.gauss(2), [0.4, -0.3], [0.0, 0.0], 0.0213),
        (double_pendulum, vi.midpoint(), [0.4, -0.3], [0.0, 0.0], 0.0093),
        (double_pendulum, vi.lobatto(3), [0.4, -0.3], [0.0, 0.0], 0.0213),
        (pendulum, vi.composition("blanes-moan4"), [2.0], [0.0], 0.213),
        (pendulum, vi.trapezoidal(), [2.0], [0.0], 0.113),
    ],
    ids=lambda x: getattr(x, "__name__", str(x)),
)
def test_the_energy_has_no_slope_over_1e5_steps(build, rule, q0, v0, h):
    motion = vi.simulate(build(), rule, q0=q0, v0=v0, h=h, steps=100_000, save_every=7)
    change = motion.energy - motion.energy[0]
    windows = np.array([w.mean() for w in np.array_split(change, 40)])
    x = np.arange(40) - 19.5
    slope = (x * windows).sum() / (x**2).sum()
    rest = windows - windows.mean() - slope * x
    noise = np.sqrt((rest**2).sum() / 38 / (x**2).sum())
    round_off = 1e-13 * abs(motion.energy[0]) / 40
    assert abs(slope) <= 4 * noise + round_off
    assert (
        np.abs(change).max()
        <= 50 * np.abs(change[: len(change) // 40]).max() / 40 + np.abs(change).std() * 20
    )


def test_a_method_with_drift_would_fail_the_slope_test():
    """The explicit Euler method on the pendulum gains energy: the windowed slope sees it."""
    q, p, h, energies = 2.0, 0.0, 1e-3, []
    for _ in range(20_000):
        q, p = q + h * p, p - h * np.sin(q)
        energies.append(p**2 / 2 - np.cos(q))
    windows = np.array([w.mean() for w in np.array_split(np.array(energies), 40)])
    x = np.arange(40) - 19.5
    slope = (x * windows).sum() / (x**2).sum()
    rest = windows - windows.mean() - slope * x
    assert abs(slope) > 4 * np.sqrt((rest**2).sum() / 38 / (x**2).sum())


@pytest.mark.parametrize(
    "rule", [vi.midpoint(), vi.gauss(3), vi.trapezoidal(), vi.lobatto(4)], ids=str
)
def test_the_discrete_forces_account_for_every_change_of_momentum(rule):
    """J_N − J_0 = Σ (f⁻ + f⁺)·ξ for the cyclic coordinate, the forces taken at the rule's own
    nodes.
    """
    q, v, t = *vi.coordinates("x", "theta"), vi.time()
    lagrangian = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2 + 9.81 * ca.cos(q[1])
    push = ca.sin(3 * t) * (1 + q[1] ** 2) - 0.2 * v[0] * q[1]
    system = vi.System(q, v, lagrangian, force=ca.vertcat(push, -0.1 * v[1]), t=t)
    motion = vi.simulate(system, rule, q0=[0.0, 1.0], v0=[0.3, 0.0], h=0.05, steps=400)
    one = interval(system, rule)
    h, b = 0.05, ca.DM(rule.weights)
    force = ca.Function("push", [system.q, system.v, system.t], [push])
    forces = ca.vertcat(
        *(
            force(one.q_nodes[:, i], one.v_nodes[:, i], one.t_nodes[i])
            for i in range(len(rule.nodes))
        )
    )
    impulse = ca.Function("impulse", [one.q0, one.dq, one.t, one.h], [one.h * ca.dot(b, forces)])
    path = vi.plan(system, rule).build(system, rule)
    total = 0.0
    for k in range(400):
        start = path.start(motion.q[k], motion.p[k], [], motion.t[k], h, [])
        increments = path.path(start, [], motion.t[k], h, [], ca.DM.ones(4))
        total += float(impulse(motion.q[k], ca.reshape(increments, 2, rule.degree), motion.t[k], h))
    assert abs(motion.p[-1, 0] - motion.p[0, 0] - total) <= 1e-12
    assert abs(total) > 0.01


def test_a_run_backwards_in_time_undoes_friction():
    """With forces the rules stay self-adjoint: −h retraces the path."""
    system = driven_damped()
    there = vi.simulate(system, vi.gauss(2), q0=[0.5, 0.2], v0=[0.1, 0.4], h=0.02, steps=200)
    back = vi.simulate(
        system, vi.gauss(2), q0=there.q[-1], p0=there.p[-1], t0=4.0, h=-0.02, steps=200
    )
    np.testing.assert_allclose(back.q[-1], there.q[0], atol=1e-12)
    np.testing.assert_allclose(back.p[-1], there.p[0], atol=1e-12)
