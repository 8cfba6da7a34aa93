"""Scenes with explicit time: balance of energy, damping by a growing mass, averaging."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from model_runs import FINE, run
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("a")


@pytest.mark.parametrize(
    "factory",
    [
        models.driven_pendulum,
        models.horizontal_pivot,
        models.kapitza_pendulum,
        models.lengthening_pendulum,
    ],
)
def test_the_energy_changes_by_the_explicit_time_dependence_alone(factory):
    model = factory()
    s = model.system
    motion = run(model, duration=200 * model.h)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    times = (motion.t[:-1, None] + model.h * (nodes + 1) / 2).ravel()
    power = motion.at(times).value(-ca.jacobian(s.lagrangian, s.t)).reshape(-1, 8)
    gained = np.concatenate([[0], np.cumsum(power @ weights) * model.h / 2])
    size = np.abs(motion.energy).max() + np.abs(motion.value(s.lagrangian)).max()
    assert np.ptp(motion.energy) > 0.01 * size
    assert np.abs(motion.energy - motion.energy[0] - gained).max() < 1e-12 * size


def test_caldirola_kanai_is_the_oscillator_with_friction_as_a_force():
    model = models.caldirola_kanai()
    q, v = vi.coordinates("x")
    c = vi.Parameters(omega=1.5, gamma=0.4)
    rubbed = vi.System(q, v, (v**2 - c.omega**2 * q**2) / 2, force=-c.gamma * v, params=c)
    a, b = run(model), vi.simulate(rubbed, FINE, **model.start)
    assert np.abs(a.q - b.q).max() < 1e-13
    r = REFERENCE["A10_caldirola_kanai_under"]
    p = np.array(r["reference"]["state"])[:, 2]
    assert np.abs(a.at(r["times"]).p[:, 0] / p - 1).max() < 1e-12


@pytest.mark.parametrize("gamma", [0.4, 3.0, 5.0])
def test_damped_motion_has_its_closed_form_below_at_and_above_critical(gamma):
    model = models.caldirola_kanai(gamma=gamma)
    assert np.abs(run(model, duration=4.0).q - model.exact(np.linspace(0, 4, 201))[0]).max() < 1e-13


def test_the_upright_pendulum_stands_where_the_pivot_shakes_fast_enough():
    g, length, amplitude = 9.81, 1.0, 0.1
    limit = np.sqrt(2 * g * length) / amplitude
    for factor, stands in ((1.15, True), (0.85, False)):
        model = models.kapitza_pendulum(
            theta0=np.pi - 0.05, amplitude=amplitude, Omega=factor * limit
        )
        far = np.abs(run(model, vi.gauss(3), duration=10.0).q - np.pi).max()
        assert (far < 0.5) == stands


def test_the_slow_frequency_of_kapitza_holds_to_second_order_in_the_amplitude():
    def gap(amplitude):
        # over one step of the drive's period P the linear motion about the top is a rotation by ω P
        Omega = 6.0 / amplitude
        model = models.kapitza_pendulum(amplitude=amplitude, Omega=Omega)
        s, period = model.system, 2 * np.pi / Omega
        rule, steps = vi.gauss(6), 40
        flow = vi.step_function(s, rule)
        x = ca.MX.sym("x", 2)
        y = x
        for k in range(steps):
            out = flow(
                q0=y[0], p0=y[1], params=s.default_vector, t=period * k / steps, h=period / steps
            )
            y = ca.vertcat(out["q1"], out["p1"])
        trace = ca.trace(ca.Function("monodromy", [x], [ca.jacobian(y, x)])([np.pi, 0.0]))
        return (
            np.arccos(float(trace) / 2)
            / period
            / models.kapitza_frequency(1.0, 9.81, amplitude, Omega)
            - 1
        )

    gaps = np.abs([gap(0.1), gap(0.05), gap(0.025)])
    assert np.log2(gaps[:-1] / gaps[1:]) == pytest.approx([2, 2], abs=0.15)


def test_energy_over_frequency_of_the_lengthening_pendulum_is_adiabatic():
    model = models.lengthening_pendulum(theta0=0.05, rate=0.02)
    motion = run(model, duration=150.0)
    s, c = model.system, model.system.params
    length = c.length + c.rate * s.t
    swing = c.m * length**2 * s.v**2 / 2 + c.m * c.g * length * (1 - ca.cos(s.q))
    ratio = motion.value(swing * ca.sqrt(length / c.g))
    assert motion.value(length)[-1] == pytest.approx(4.0)
    assert np.abs(ratio / ratio[0] - 1).max() < 0.02
