"""Pendulums: periods, small swings, and one as a special case of another."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from model_runs import run
from references import entries

from varint import models

REFERENCE = entries("a")


def test_periods_of_pendulums():
    for name in ("A04_inclined_axis_30deg", "A04_inclined_axis_horizontal"):
        r = REFERENCE[name]["reference"]
        assert abs(models.pendulum_period(2.5, r["omega0"]) / r["libration_period"] - 1) < 1e-14
    for name in ("A02_cart_pendulum_large", "A02_cart_pendulum_rest"):
        p, theta0 = REFERENCE[name]["params"], REFERENCE[name]["initial"]["q"][1]
        period = models.sliding_support_period(theta0, M=p["M"], m=p["m"], length=p["l"], g=p["g"])
        assert abs(period / REFERENCE[name]["reference"]["period_theta"] - 1) < 1e-14
    p, r = (
        REFERENCE["A03_bead_rotating_hoop"]["params"],
        REFERENCE["A03_bead_rotating_hoop"]["reference"],
    )
    assert (
        abs(models.rotating_hoop_period(0.6, p["R"], p["Omega"], p["g"]) / r["period"] - 1) < 1e-14
    )


def test_the_sliding_support_obeys_its_second_equation():
    model = models.sliding_support()
    s = model.system
    rates = ca.solve(
        s.mass_matrix, ca.gradient(s.lagrangian, s.q) - ca.jacobian(s.momentum, s.q) @ s.v
    )
    c = s.params
    law = rates[0] * ca.cos(s.q[1]) + c.length * rates[1] + c.g * ca.sin(s.q[1])
    assert np.abs(run(model).value(law)).max() < 1e-12


def test_small_swings_of_a_chain_have_laguerre_frequencies():
    model = models.chain_pendulum(links=6)
    s = model.system
    stiffness = -ca.hessian(s.lagrangian, s.q)[0]
    matrices = ca.Function("linear", [s.q, s.v, s.c], [s.mass_matrix, stiffness])
    mass, stiff = (x.full() for x in matrices(0, 0, s.default_vector))
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiff)).real)
    assert squares / (6 * 9.81) == pytest.approx(
        np.polynomial.laguerre.lagroots([0] * 6 + [1]), rel=1e-12
    )


def test_a_chain_of_two_links_is_the_double_pendulum():
    chain = models.chain_pendulum(links=2)
    double = models.double_pendulum(theta=(0.5, 0.5), m=(0.5, 0.5), length=(0.5, 0.5))
    assert np.abs(run(chain).q - run(double, h=chain.h, duration=chain.duration).q).max() < 1e-11
