"""What is seen ahead of the start says whether steps vary, and with how many equal ones to begin;
errors that arise late are not taken for early ones that have grown.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.round_off import GROWS, MAGNIFIED, growth_of, magnified
from varint.integration.small_motions import angles_turned
from varint.integration.time_transformation.rate_ahead import NOTHING, seen_ahead

q1, v1 = vi.coordinates("z")
q2, v2 = vi.coordinates("x", "y")
R = ca.norm_2(q2)
SITNIKOV = vi.System(q1, v1, v1**2 / 2 + 1 / ca.sqrt(q1**2 + 0.25)), [1.0], [0.2], 40.0
YUKAWA = vi.System(q2, v2, ca.sumsqr(v2) / 2 + ca.exp(-R / 5) / R), [1.5, 0.0], [0.0, 0.6], 40.0
KEPLER = vi.System(q2, v2, ca.sumsqr(v2) / 2 + 1 / R)
COLLISION = vi.System(q2, v2, ca.sumsqr(v2) / 2 - 4 * (R**-12 - R**-6))


def ahead(scene, q0, v0, duration):
    return seen_ahead(scene, np.array(q0 + v0), 0.0, scene.default_vector, duration)


def pericentre(e):
    return [1 - e, 0.0], [0.0, ((1 + e) / (1 - e)) ** 0.5]


@pytest.mark.parametrize("case", (SITNIKOV, YUKAWA), ids=("sitnikov", "pair"))
def test_two_runs_are_enough_where_the_start_is_calm(case):
    scene, q0, v0, duration = case
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=duration)
    closer = vi.simulate(scene, q0=q0, v0=v0, duration=duration, tol=1e-12)
    assert motion.fictitious is None and motion.stats["runs"] == 2
    error = np.abs(motion.q[-1] - closer.q[-1]).max() / np.abs(closer.q).max()
    assert error < motion.stats["error_estimate"] <= 1e-9


@pytest.mark.parametrize("progress", (None, True))
def test_a_collision_is_over_with_two_runs(progress):
    start = {"q0": [-20.0, 0.4], "v0": [3.0, 0.0], "duration": 20.0, "progress": progress}
    motion = vi.simulate(COLLISION, **start)
    closer = vi.simulate(COLLISION, **start, tol=1e-12)
    assert motion.fictitious is not None and motion.stats["runs"] == 2
    assert np.abs(motion.q[-1] - closer.q[-1]).max() < 20 * motion.stats["error_estimate"]


def test_errors_that_arise_late_have_not_grown():
    assert growth_of(1e-6, 1e-15) > GROWS
    assert growth_of(1e-6, 1e-15, made=4e-7) < GROWS
    assert growth_of(1e-2, 1e-15, made=4e-7) > GROWS  # an encounter that magnifies what it makes


def test_the_rounding_of_the_start_may_be_magnified_by_more():
    late = 1e-6, 1e-15, 4e-7  # an encounter
    assert growth_of(*late) < GROWS < magnified(*late) < MAGNIFIED * growth_of(*late) * 1.01
    early = 1e-6, 1e-7, 1e-9  # a regular motion
    assert magnified(*early) == growth_of(1e-6, 1e-7)


def test_steps_that_follow_the_rate_are_for_flights_and_uneven_orbits():
    for e, duration, varies in ((0.6, 7.0, False), (0.9, 600.0, True), (0.97, 7.0, True)):
        seen = ahead(KEPLER, *pericentre(e), duration)
        assert (seen.pilot is not None) == varies
        assert seen.frequency == 0  # nowhere is it faster than at the start
    seen = ahead(KEPLER, [1.6, 0.0], [0.0, 0.5], 7.0)
    assert seen.pilot is None and seen.frequency > 0
    seen = ahead(COLLISION, [-20.0, 0.4], [3.0, 0.0], 20.0)
    assert seen.pilot is not None and seen.pilot.flight


@pytest.mark.parametrize("tol", (1e-3, 1e-6, 1e-9))
def test_a_run_that_goes_astray_tells_of_an_encounter_that_nothing_showed(tol):
    """An orbit that grows long and thin only after many turns, of unlike masses to either side."""
    scene = vi.System(q2, v2, 0.6 * v2[0] ** 2 + v2[1] ** 2 / 2 + 1 / R)
    asked = {"q0": [1.0, 0.0], "v0": [0.0, 0.9], "duration": 100.0}
    assert ahead(scene, asked["q0"], asked["v0"], 100.0).pilot is None
    motion = vi.simulate(scene, **asked, tol=tol)
    closer = vi.simulate(scene, vi.gauss(8), **asked, time_scale="auto", h=0.2)
    assert motion.fictitious is not None and motion.stats["runs"] <= 4
    error = np.abs(motion.q[-1] - closer.q[-1]).max() / np.abs(closer.q).max()
    assert error < motion.stats["error_estimate"] <= tol
    long = vi.simulate(scene, **asked, tol=tol, progress=True)
    assert long.q.tobytes() == motion.q.tobytes()


def test_a_look_that_leaps_over_the_motion_tells_nothing():
    assert ahead(YUKAWA[0], [60.0, 0.0], [0.0, 0.1], 1.0) == NOTHING


def test_first_steps_are_for_what_is_seen_where_the_start_tells_of_nothing_as_fast():
    assert angles_turned(-10.0, 1.0, 5.0) == (10.0, 50.0)
    assert angles_turned(10.0, 1.0, 1.5) == (10.0, 15.0)
    assert angles_turned(10.0, 1.0, 1.2) == (10.0, 10.0)
    assert angles_turned(10.0, None, 3.0) == (0.0, 30.0)


def test_first_steps_of_a_spherical_pendulum_are_short_enough_for_its_pole():
    """It turns 1.6 times as fast there as at the start, by which a first run is lost."""
    q, v = vi.coordinates("theta", "phi")
    lagrangian = (v[0] ** 2 + (ca.sin(q[0]) * v[1]) ** 2) / 2 + 9.81 * ca.cos(q[0])
    system, start = vi.System(q, v, lagrangian), {"q0": [1.0, 0.0], "v0": [0.0, 2.0]}
    closer = vi.simulate(system, vi.gauss(8), **start, duration=10.0, steps=400)
    for tol in (1e-3, 1e-6):
        motion = vi.simulate(system, **start, duration=10.0, tol=tol)
        assert motion.stats["runs"] == 2
        assert np.abs(motion.q[-1] - closer.q[-1]).max() <= tol


def test_a_field_that_vanishes_on_the_way_is_not_followed():
    """Its relative change has no bound there, where the look ahead stays for good."""
    q, v = vi.coordinates("x", "y")
    reversal = ca.sumsqr(v) / 2 + (2 * ca.tanh(q[0]) * q[0] + q[0] ** 2 / 2) * v[1]
    start = {"q0": [0.2, 0.0], "v0": [0.8, 0.3], "duration": 40.0}
    system = vi.System(q, v, reversal)
    motion = vi.simulate(system, **start)
    finer = vi.simulate(system, vi.gauss(8), **start, steps=1000)
    assert motion.fictitious is None
    off = np.abs(motion.q - finer.at(motion.t).q).max() / np.abs(motion.q).max()
    assert off < motion.stats["error_estimate"] < 1e-9
