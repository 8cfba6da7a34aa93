"""Many bodies: choreography, published momenta, momenta under pair potentials."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from model_runs import run
from references import entries

import varint as vi
from varint import models

REFERENCE = entries("c")


def test_bodies_of_the_figure_eight_follow_each_other():
    model = models.figure_eight()
    motion = run(model)
    third = motion[200]
    places = model.q0.reshape(3, 2)
    assert np.abs(third.q.reshape(3, 2) - np.roll(places, -1, axis=0)).max() < 1e-11
    assert np.abs(motion.q[-1] - model.q0).max() < 1e-11


def test_the_sun_and_planets_have_the_published_momenta():
    r = REFERENCE["C_outer_solar_system"]["reference"]
    model = models.outer_solar_system()
    s = model.system
    values = ca.Function(
        "kept", [s.q, s.v, s.c], [model.invariants[k] for k in ("momentum", "angular momentum")]
    )
    momentum, turning = (x.full()[:, 0] for x in values(model.q0, model.v0, s.default_vector))
    assert np.abs(momentum - r["P"]).max() < 1e-20
    assert np.abs(turning - r["L"]).max() < 1e-18


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("factory", [models.spring_cluster, models.lennard_jones])
def test_pair_potentials_keep_momenta_in_the_plane_and_in_space_with_a_coarse_rule(factory, d):
    model = factory(d=d) if factory is models.spring_cluster else factory(side=2, d=d)
    motion = run(model, vi.trapezoidal(), duration=400 * model.h)
    assert np.ptp(motion.energy) > 1e-7 * np.abs(motion.energy).max()
    for name in ("momentum", "angular momentum"):
        value = motion.value(model.invariants[name]).reshape(len(motion), -1)
        assert np.abs(value - value[0]).max() < 1e-13
