"""Charged particles: gauge, Lorentz force, adiabatic invariants, guiding centre."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from model_runs import run
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("a")


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize(
    "factory", [models.uniform_fields, models.magnetic_mirror, models.oscillating_field]
)
def test_a_linear_gauge_function_changes_the_momentum_and_not_the_path(factory, rule):
    slope, rate = np.array([0.4, -0.3, 0.2]), 0.7
    plain, other = factory(), factory(gauge=lambda q, t: ca.dot(slope, q) + rate * t)
    a, b = run(plain, rule, duration=100 * plain.h), run(other, rule, duration=100 * plain.h)
    assert np.abs(a.q - b.q).max() < 2e-13
    assert np.abs(b.p - (a.p - slope)).max() < 1e-12


def wavy(q, t):
    """The χ of the reference entry, with the sign of A → A − ∇χ."""
    x, y, z = ca.vertsplit(q)
    return -(0.3 * x**2 * y + 0.5 * ca.sin(x + 2 * z) + 0.25 * t * y + 0.2 * t**2 * z)


def gauged(gauge) -> models.Model:
    """The particle of the reference entry."""
    r = REFERENCE["A08_gauge"]
    start = dict(q0=r["initial"]["q"], v0=r["initial"]["v"])
    return models.uniform_fields(E=r["params"]["E"], B=r["params"]["B"], gauge=gauge, **start)


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(2), vi.lobatto(3)], ids=str)
def test_a_general_gauge_function_changes_the_path_by_the_order_of_the_rule(rule):
    plain, other = gauged(None), gauged(wavy)

    def gap(steps):
        a, b = (run(m, rule, h=2.0 / steps, duration=2.0) for m in (plain, other))
        return np.abs(a.q - b.q).max()

    gaps = np.array([gap(steps) for steps in (40, 80, 160)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([rule.order] * 2, abs=0.15)


def test_momenta_and_actions_in_two_gauges_meet_the_reference():
    r = REFERENCE["A08_gauge"]
    for k, gauge in enumerate((None, wavy)):
        motion = run(gauged(gauge), h=0.02, duration=2.0)
        assert (
            np.abs(motion.at(r["times"]).p - np.array(r["reference"][f"p_gauge{k}"])).max() < 1e-13
        )
        for t, action in zip(r["times"][1:], r["reference"][f"action_gauge{k}"][1:], strict=True):
            assert abs(motion[: round(t / 0.02) + 1].action - action) < 1e-13


def test_the_electric_field_may_sit_in_the_vector_potential():
    E = np.array([0.2, -0.1, 0.05])
    scalar = models.uniform_fields(E=E, v0=(0.7, 0.4, -0.2))
    temporal = models.uniform_fields(E=E, v0=(0.7, 0.4, -0.2), gauge=lambda q, t: ca.dot(E, q) * t)
    assert not temporal.system.structure.autonomous
    assert np.abs(run(scalar).q - run(temporal).q).max() < 1e-12


@pytest.mark.parametrize("name", ["uniform_fields", "magnetic_mirror", "oscillating_field"])
def test_charges_obey_the_lorentz_force(name):
    model = models.catalogue[name]()
    s = model.system
    q, v, t, c = s.q, s.v, s.t, s.params
    p = s.momentum
    rate = ca.gradient(s.lagrangian, q) - ca.jacobian(p, q) @ v - ca.jacobian(p, t)
    A_field = (p - c.m * v) / c.e
    slope = ca.jacobian(A_field, q)
    B = ca.vertcat(slope[2, 1] - slope[1, 2], slope[0, 2] - slope[2, 0], slope[1, 0] - slope[0, 1])
    phi = ca.substitute(-s.lagrangian / c.e, v, ca.SX.zeros(3))
    E = -ca.gradient(phi, q) - ca.jacobian(A_field, t)
    assert (
        np.abs(run(model, duration=100 * model.h).value(rate - c.e * (E + ca.cross(v, B)))).max()
        < 1e-12
    )


def test_the_orbit_in_the_field_of_inverse_distance_turns_by_the_closed_form():
    r = REFERENCE["A08_field_1_over_r_planar"]["reference"]
    period, angle = models.inverse_distance_period((2.0, 0.0), (0.0, 0.6))
    assert abs(period / r["radial_period"] - 1) < 1e-14
    assert abs(angle / r["phi_per_radial_period"] - 1) < 1e-14


def test_the_magnetic_moment_is_adiabatic():
    mirror = models.magnetic_mirror()
    s = mirror.system
    slow = run(mirror)
    x, y, z = ca.vertsplit(s.q)
    c = s.params
    B = c.B0 * ca.vertcat(-z * x / c.L**2, -z * y / c.L**2, 1 + (z / c.L) ** 2)
    along = ca.dot(s.v, B) / ca.norm_2(B)
    moment = slow.value(c.m * (ca.sumsqr(s.v) - along**2) / (2 * ca.norm_2(B)))
    assert np.ptp(moment) < 0.15 * moment.mean()
    windows = moment[:2000].reshape(10, 200).mean(axis=1)
    assert np.ptp(windows) < 0.02 * moment.mean()


@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
def test_the_guiding_centre_follows_the_particle_to_first_order_in_the_gyroradius():
    def gap(B0):
        radius = 0.6 / B0
        particle = models.magnetic_mirror(q0=(0.1 - radius, 0, 0), B0=B0)
        centre = models.guiding_centre(q0=(0.1, 0, 0), moment=0.18 / B0, B0=B0)
        slow = vi.simulate(centre.system, vi.midpoint(), q0=centre.q0, h=0.02, duration=10.0)
        fast = run(particle, vi.gauss(4), h=0.1 / B0, duration=10.0).at(slow.t)
        difference = np.abs(fast.q - slow.q[:, :3]).max(axis=0)
        assert difference[:2] == pytest.approx([radius] * 2, rel=0.01)
        return difference[2]

    gaps = np.array([gap(B0) for B0 in (20.0, 40.0, 80.0)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([1, 1], abs=0.05)


def test_flux_through_the_orbit_stays_while_the_field_grows():
    model = models.growing_field()
    motion = run(model)
    c = model.system.params
    moment = motion.value(ca.sumsqr(model.system.v) / (c.B0 + c.rate * model.system.t))
    assert motion.value(c.B0 + c.rate * model.system.t)[-1] == pytest.approx(3.0)
    assert np.abs(moment / moment[0] - 1).max() < 0.03
