"""A look ahead in the core sees what the one by CasADi sees."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.look_ahead import look_ahead
from varint.integration.time_transformation import rate_pilot as pilots
from varint.integration.time_transformation.rate_ahead import kinds_of

q1, v1 = vi.coordinates("x")
q2, v2 = vi.coordinates("x", "y")
KEPLER = vi.System(q2, v2, ca.sumsqr(v2) / 2 + 1 / ca.norm_2(q2))
SCENES = {
    "pendulum": (vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1)), [1.0], [0.5]),
    "orbit": (KEPLER, [1.8, 0.0], [0.0, (0.2 / 1.8) ** 0.5]),
    "fall into the centre, astray": (KEPLER, [1.0, 0.0], [0.0, 1e-3]),
    "nothing pulls at the start": (vi.System(q1, v1, v1**2 / 2 - q1**4), [0.0], [1.0]),
    "escape": (KEPLER, [0.1, 0.0], [0.0, 6.0]),
    "from afar": (KEPLER, [-20.0, 0.5], [2.0, 0.0]),
}
BOTH = [(name, flight) for name, (scene, *_) in SCENES.items() for flight in kinds_of(scene)]


@pytest.mark.parametrize("total", [0.3, -2.0, 50.0])
@pytest.mark.parametrize(("scene", "flight"), BOTH)
def test_the_core_sees_the_rates_that_the_pilot_sees(scene, flight, total):
    system, *start = SCENES[scene]
    q, v = np.array(start)
    c = system.default_vector
    pilot = pilots.rate_pilot(system, q, v, 0.0, c, total, total < 0, flight)
    rough = pilots._without_core(system, q, v, c, abs(total), total < 0, flight)
    seen = look_ahead(
        pilots.look_by(system, flight),
        np.concatenate((q, v)),
        c,
        steps=pilots.STEPS,
        angle=pilots.ANGLE,
        backwards=total < 0,
        total=abs(total),
        astray=pilots.ASTRAY,
    )
    glance = pilots.glance(system, q, v, 0.0, c, total, flight)
    assert glance == seen
    if pilot is None:
        assert seen is rough is None
        return
    assert np.allclose(seen, rough, rtol=1e-9)
    assert pilot == (*map(pilots._roughly, rough), flight)
    assert np.allclose(pilot[:4], rough, rtol=2.0**-pilots.BITS)


def test_an_orbit_that_passes_close_takes_steps_that_vary_and_a_rounder_one_does_not():
    for e, varies in ((0.6, False), (0.95, True)):
        start = dict(q0=[1 + e, 0.0], v0=[0.0, ((1 - e) / (1 + e)) ** 0.5])
        motion = vi.simulate(KEPLER, **start, duration=20.0, tol=1e-6)
        assert (motion.fictitious is not None) == varies


def test_a_lattice_begins_with_steps_for_its_own_frequencies():
    """The rate adds up the bonds of a chain; no small motion is faster than two of them."""
    n, duration = 24, 60.0
    q, v = vi.coordinates(*(f"x{i}" for i in range(n)))
    bonds = ca.diff(ca.vertcat(0, q, 0))
    chain = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(bonds) / 2 - ca.sum1(bonds**4) / 4)
    q0 = 0.3 * np.sin(np.pi * np.arange(1, n + 1) / (n + 1))
    rough = vi.simulate(chain, q0=q0, v0=np.zeros(n), duration=duration, tol=1e-3)
    assert len(rough) - 1 < 2 * duration  # of frequencies up to 2: at least half a radian a step
    fine = vi.simulate(chain, vi.gauss(8), q0=q0, v0=np.zeros(n), duration=duration, steps=1000)
    assert np.abs(rough.q[-1] - fine.q[-1]).max() < 1e-3 * np.abs(fine.q).max()
