"""Central forces: the cyclic angle, the radial problem, apsidal angles and periods."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from model_runs import run
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("a")


@pytest.mark.parametrize(
    "potential, constants",
    [
        (lambda r, c: -c.k / r, {"k": 1.0}),
        (lambda r, c: c.k * r**2 / 2, {"k": 2.0}),
        (lambda r, c: c.depth * (1 - ca.exp(1 - r)) ** 2, {"depth": 3.0}),
    ],
)
def test_the_angle_of_any_central_force_is_cyclic_and_its_momentum_kept_by_a_coarse_rule(
    potential, constants
):
    model = models.central_force(potential, constants)
    assert model.system.structure.cyclic == (1,)
    motion = run(model, vi.midpoint(), h=0.1)
    assert np.abs(motion.p[:, 1] - motion.p[0, 1]).max() <= 1e-14


def test_the_reduced_radial_problem_gives_the_radius_of_the_plane_motion():
    plane = models.central_force()
    p_theta = float(run(plane).p[0, 1])
    line = models.radial_motion(p_theta)
    assert np.abs(run(plane).q[:, 0] - run(line).q[:, 0]).max() < 1e-12


def test_polar_and_cartesian_coordinates_describe_the_same_motion():
    cartesian = models.kepler(e=0.6)
    polar = models.central_force(r0=cartesian.q0[0], thetadot0=cartesian.v0[1] / cartesian.q0[0])
    a, b = run(cartesian, duration=20.0), run(polar, duration=20.0)
    r, theta = b.q.T
    assert np.abs(a.q - np.stack([r * np.cos(theta), r * np.sin(theta)], -1)).max() < 1e-11


def test_polar_kepler_motion_meets_the_reference():
    entry = REFERENCE["A01_kepler_e06"]
    times = np.array(entry["times"][:6])
    motion = run(models.central_force(r0=0.4, thetadot0=5.0), h=0.005, duration=20.0).at(times)
    found = np.stack([motion.q[:, 0], motion.v[:, 0]], -1)
    assert np.abs(found - np.array(entry["reference"]["polar"][:6])).max() < 1e-11


def test_apsidal_angle_and_radial_period_of_the_rosette():
    r = REFERENCE["A01_central_k_b"]["reference"]
    assert abs(models.apsidal_angle(0.8, m=1.0, b=0.04) - r["phi_per_radial_period"]) < 1e-14
    assert abs(models.radial_period(r["energy"], m=1.0, k=1.0) - r["radial_period"]) < 1e-14
    motion = run(models.rosette(), duration=r["radial_period"], h=r["radial_period"] / 500)
    assert abs(motion.q[-1, 1] - r["phi_per_radial_period"]) < 1e-12
