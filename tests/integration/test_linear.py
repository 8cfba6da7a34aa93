"""Linear scenes: one constant map a step instead of Newton's method."""

import casadi as ca
import numpy as np
import pytest
import scenes

import varint as vi
from varint.integration.steppers.implicit import implicit_stepper
from varint.integration.steppers.linear import is_linear, linear_stepper
from varint.numerics.arrays import call


def gyroscopic(masses=(1.0, 1.0)):
    """Coupled oscillators in a magnetic field, damped, pushed and controlled; mass, stiffness
    and units differ.
    """
    q, v = vi.coordinates("x", "y")
    t, u, c = vi.time(), ca.SX.sym("u"), vi.Parameters(k=1.3)
    potential = q[0] ** 2 + c.k * q[0] * q[1] + 2 * q[1] ** 2 - ca.cos(3 * t) * q[0]
    kinetic = masses[0] * v[0] ** 2 / 2 + 0.3 * v[0] * v[1] + masses[1] * v[1] ** 2 / 2
    lagrangian = kinetic + 0.7 * (q[0] * v[1] - q[1] * v[0]) - potential
    return vi.System(
        q, v, lagrangian, force=ca.vertcat(u - 0.1 * v[0], -0.2 * v[1]), control=u, params=c, t=t
    )


def rolled(stepper, system, rule, steps, h):
    """States of `steps` steps by a stepper, and the worst residual."""
    c, scale, n = system.default_vector, np.ones(2 * system.structure.n), system.structure.n
    u = np.random.default_rng(3).uniform(
        -1, 1, (steps, system.structure.controls * len(rule.nodes))
    )
    q, p = np.array([1.0, -0.5]), np.array([0.3, 0.2])
    x = call(stepper.start, q, p, u[0], np.array([0.2]), np.array([h]), c)[0]
    states = []
    for k in range(steps):
        x = call(stepper.step, x, u[k], np.array([0.2 + k * h]), np.array([h]), c, scale)[0]
        states.append(np.concatenate([x[:n], x[2 * n : 3 * n]]))
    return np.array(states), x[-1]


@pytest.mark.parametrize(
    "rule", (vi.midpoint(), vi.trapezoidal(), vi.gauss(3), vi.lobatto(4)), ids=str
)
@pytest.mark.parametrize("masses", ((1.0, 1.0), (1e6, 1.0)))
def test_the_constant_map_gives_what_newtons_method_gives_to_round_off(rule, masses):
    system = gyroscopic(masses)
    assert vi.plan(system, rule).method == "linear map"
    ours, residual = rolled(linear_stepper(system, rule), system, rule, 300, 0.1)
    newton, _ = rolled(implicit_stepper(system, rule), system, rule, 300, 0.1)
    assert (
        np.abs(ours / np.abs(newton).max(axis=0) - newton / np.abs(newton).max(axis=0)).max()
        < 1e-13
    )
    assert residual < 1e-13


def test_a_linear_scene_keeps_its_quadratic_invariant_by_a_gauss_rule_over_many_steps():
    q, v = vi.coordinates("x", "y")
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 + 0.7 * (q[0] * v[1] - q[1] * v[0]) - q[0] ** 2 - 2 * q[1] ** 2
    )
    motion = vi.simulate(
        system, vi.gauss(2), q0=[1, 0], v0=[0, 1], h=0.3, steps=100_000, backend="interpreted"
    )
    assert motion.stats["plan"].method == "linear map"
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 1e-13


def test_what_is_not_linear_or_too_large_goes_to_newtons_method():
    assert not is_linear(scenes.pendulum(), vi.gauss(2))
    q, v = vi.coordinates(*(f"x{i}" for i in range(20)))
    assert not is_linear(vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q)), vi.gauss(2))
    t = vi.time()
    q, v = vi.coordinates("x")
    assert not is_linear(vi.System(q, v, v**2 / 2 - ca.cos(t) * q**2, t=t), vi.gauss(2))


def test_the_linear_step_is_differentiable_in_step_size_and_parameters():
    system, rule = gyroscopic(), vi.gauss(2)
    step = vi.step_function(system, rule)
    c, h = ca.MX.sym("c"), ca.MX.sym("h")
    after = step(q0=[1, -0.5], p0=[0.3, 0.2], u=ca.DM([[0.1, 0.2]]), t=0.2, h=h, params=c)
    slope = ca.Function(
        "slope", [c, h], [ca.jacobian(ca.vertcat(after["q1"], after["p1"]), ca.vertcat(c, h))]
    )
    value = ca.Function("value", [c, h], [ca.vertcat(after["q1"], after["p1"])])
    e = 1e-5
    by_differences = [
        (value(1.3 + e, 0.1) - value(1.3 - e, 0.1)) / (2 * e),
        (value(1.3, 0.1 + e) - value(1.3, 0.1 - e)) / (2 * e),
    ]
    assert np.abs(np.array(slope(1.3, 0.1) - ca.horzcat(*by_differences))).max() < 1e-8
