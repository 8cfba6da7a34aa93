"""Test particles: a mass of zero is refused with what to do, and what to do is the exact limit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

M = 0.01
START = dict(q0=[-M, 0, 1 - M, 0, 0.4, 0], v0=[0, -M, 0, 1 - M, 0, 1.5])
Q, V = vi.coordinates("x1", "y1", "x2", "y2", "x", "y")


def field():
    return (1 - M) / ca.norm_2(Q[4:6] - Q[0:2]) + M / ca.norm_2(Q[4:6] - Q[2:4])


def bodies():
    kinetic = ((1 - M) * ca.sumsqr(V[0:2]) + M * ca.sumsqr(V[2:4])) / 2
    return kinetic + M * (1 - M) / ca.norm_2(Q[0:2] - Q[2:4])


def restricted():
    pull = ca.vertcat(ca.SX.zeros(4), ca.gradient(field(), Q[4:6]))
    return vi.System(Q, V, bodies() + ca.sumsqr(V[4:6]) / 2, force=pull)


def with_mass(mass, **more):
    return vi.System(Q, V, bodies() + mass * (ca.sumsqr(V[4:6]) / 2 + field()), **more)


@pytest.mark.parametrize("given", ["number", "parameter"])
def test_a_body_without_mass_is_refused_with_what_to_do(given):
    c = vi.Parameters(m=0.0)
    system = with_mass(0.0) if given == "number" else with_mass(c.m, params=c)
    with pytest.raises(vi.InputError, match=r"mass of \['x', 'y'\] is zero.*unit mass.*force="):
        vi.simulate(system, vi.gauss(2), **START, h=0.05, steps=10)


def test_other_directions_without_inertia_are_no_test_particles():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, (v[0] + v[1]) ** 2 / 2 - ca.sumsqr(q))
    with pytest.raises(vi.InputError, match=r"gives no inertia to .*other coordinates"):
        vi.simulate(system, vi.gauss(2), q0=[1, 0], v0=[0, 0], h=0.1, steps=1)


@pytest.mark.parametrize("rule", [vi.gauss(3), vi.composition("suzuki4")], ids=str)
def test_a_force_on_a_unit_mass_is_the_limit_of_small_masses(rule):
    """Step for step: the difference is the mass itself, times what the motion makes of it."""
    run = dict(h=0.05, steps=200, **START)
    light, none = (vi.simulate(s, rule, **run) for s in (with_mass(1e-9), restricted()))
    assert 1e-12 < np.abs(light.q - none.q).max() < 1e-7
    lighter = vi.simulate(with_mass(1e-12), rule, **run)
    np.testing.assert_allclose(lighter.q, none.q, rtol=0, atol=1e-10)


def test_jacobis_integral_of_a_test_particle_does_not_drift():
    motion = vi.simulate(restricted(), vi.gauss(4), **START, h=0.05, steps=2000)
    jacobi = motion.value(ca.sumsqr(V[4:6]) / 2 - field() - (Q[4] * V[5] - Q[5] * V[4]))
    assert np.abs(jacobi - jacobi[0]).max() < 1e-11
    np.testing.assert_allclose(
        motion.q[:, 2], (1 - M) * np.cos(motion.t), rtol=0, atol=1e-9
    )  # the bodies do not feel it
