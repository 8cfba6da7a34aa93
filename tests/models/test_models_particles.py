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


def test_the_satellite_of_earth_and_moon_is_back_after_its_period():
    model = models.arenstorf()
    arguments = model.start | dict(h=0.5, time_scale="auto", backend="interpreted")
    orbit = vi.simulate(model.system, vi.gauss(8), **arguments)
    assert np.abs(orbit.q[-1] - model.q0).max() < 1e-9
    half = orbit.at(models.ARENSTORF_PERIOD / 2)  # the orbit is its own mirror image in y
    assert abs(half.q[1]) < 1e-10 and abs(half.v[0]) < 1e-9


def test_the_seven_stars_are_where_the_published_solution_has_them():
    r, model = entries("f")["F01_pleiades"], models.pleiades()
    assert (model.q0 == r["initial"]["q"]).all() and (model.v0 == r["initial"]["v"]).all()
    motion = run(model, vi.composition("kahan-li8"), h=3 / 8000)
    assert np.abs(motion.q[-1] - r["reference"]["state"][0]).max() < 1e-7


@pytest.mark.long
def test_the_lightest_of_three_bodies_from_rest_escapes_and_leaves_a_pair():
    model = models.pythagorean_three_body()
    arguments = model.start | dict(h=0.4, duration=70.0, time_scale="auto")
    motion = vi.simulate(model.system, vi.gauss(8), **arguments)
    for name in ("momentum", "angular momentum"):
        assert np.abs(motion.value(model.invariants[name])).max() < 1e-12
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-5
    m = np.array([3.0, 4.0, 5.0])
    q, v = motion.q[-1].reshape(3, 2), motion.v[-1].reshape(3, 2)

    def bound(a, b):  # energy of the relative motion by its reduced mass
        (ma, qa, va), (mb, qb, vb) = (
            (m[i].sum(), m[i] @ q[i] / m[i].sum(), m[i] @ v[i] / m[i].sum()) for i in (a, b)
        )
        return ((va - vb) ** 2).sum() / 2 - (ma + mb) / np.linalg.norm(qa - qb)

    assert bound([1], [2]) < 0 < bound([0], [1, 2])
    near = np.linalg.norm(motion.q[:, 2:4] - motion.q[:, 4:], axis=1)
    assert near.min() < 5e-4 and motion.t[near.argmin()] == pytest.approx(15.83, abs=0.005)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("factory", [models.spring_cluster, models.lennard_jones])
def test_pair_potentials_keep_momenta_in_the_plane_and_in_space_with_a_coarse_rule(factory, d):
    model = factory(d=d) if factory is models.spring_cluster else factory(side=2, d=d)
    motion = run(model, vi.trapezoidal(), duration=400 * model.h)
    assert np.ptp(motion.energy) > 1e-7 * np.abs(motion.energy).max()
    for name in ("momentum", "angular momentum"):
        value = motion.value(model.invariants[name]).reshape(len(motion), -1)
        assert np.abs(value - value[0]).max() < 1e-13
