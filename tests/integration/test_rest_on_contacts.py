"""Bodies that come to rest on several contacts at once, each of which bounces."""

from __future__ import annotations

from itertools import pairwise, takewhile

import casadi as ca
import numpy as np
import pytest
from contact_scenes import G

import varint as vi

HALF = 0.2, 0.5  # of a block: its width and its height


def block(restitution):
    """Corners of a block over a table."""
    (a, b), (q, v) = HALF, vi.coordinates("x", "y", "th")
    low, high = a * ca.sin(q[2]), b * ca.cos(q[2])
    lagrangian = ca.sumsqr(v[:2]) / 2 + (a * a + b * b) / 6 * v[2] ** 2 - G * q[1]
    gaps = ca.vertcat(q[1] - low - high, q[1] + low - high)
    return vi.System(q, v, lagrangian, contact=gaps, restitution=restitution)


def dropped():
    """Onto a corner, while it slides."""
    a, b = HALF
    return {"q0": [0, a * np.sin(0.2) + b * np.cos(0.2) + 0.05, 0.2], "v0": [0.3, 0, 0]}


def rod(ratio, inertia, restitution):
    """Two points of a rod over a table, all linear."""
    q, v = vi.coordinates("y", "s")
    lagrangian = v[0] ** 2 / 2 + inertia * v[1] ** 2 / 2 - G * q[0]
    gaps = ca.vertcat(q[0] - q[1], q[0] + ratio * q[1])
    return vi.System(q, v, lagrangian, contact=gaps, restitution=restitution)


def groove(slopes, restitution):
    """A point between two slopes."""
    q, v = vi.coordinates("x", "y")
    gaps = ca.vertcat(q[1] - slopes[0] * q[0], q[1] + slopes[1] * q[0])
    lagrangian = ca.sumsqr(v) / 2 - G * q[1]
    return vi.System(q, v, lagrangian, contact=gaps, restitution=restitution)


def plate(legs, restitution):
    """Points of a plate over a table, more of them than it takes to stand."""
    q, v = vi.coordinates("z", "a", "b")
    lagrangian = v[0] ** 2 / 2 + 0.15 * ca.sumsqr(v[1:]) - G * q[0]
    gaps = ca.vertcat(*(q[0] + x * q[1] + y * q[2] for x, y in legs))
    return vi.System(q, v, lagrangian, contact=gaps, restitution=restitution)


def check_events(motion, gained=1e-12):
    """Events in the order of time, none of which gives energy, each going on from the one before
    in a scene that keeps its energy between them.
    """
    events, whole = motion.events, abs(motion.energy[0])
    assert all(one.time <= other.time for one, other in pairwise(events))
    energies = np.array(
        [motion.energy[0], *(x for e in events for x in (e.energy_before, e.energy_after))]
    )
    assert np.diff(energies).max() <= gained * whole
    assert motion.energy.max() <= motion.energy[0] + gained * whole


@pytest.mark.parametrize("restitution", [0.2, 0.3, 0.5, 0.6])
def test_a_block_that_lands_on_a_corner_comes_to_rest_on_both(restitution, recwarn):
    scene = block(restitution)
    runs = [{"steps": n} for n in (32, 64, 100, 256, 1000, 2048, 16384)]
    for options in [*runs, {"steps": 64, "backend": "interpreted"}, {}, {"tol": 1e-3}]:
        motion = vi.simulate(scene, duration=1.0, **dropped(), **options)
        coarse = 4e-9 if len(motion) < 1000 else 1e-13  # the rule's energy while it rocks
        check_events(motion, coarse)
        np.testing.assert_allclose(motion.q[-1], [0.3, HALF[1], 0], atol=1e-12)
        np.testing.assert_allclose(motion.v[-1], [0.3, 0, 0], atol=1e-12)
        np.testing.assert_allclose(motion.energy[-1], 0.045 + G * HALF[1], rtol=1e-13)
        assert len(motion.events) < 400 and motion.active_sets[motion.active_set[-1]].holding == (
            0,
            1,
        )
    assert not recwarn.list


def blows_of_a_rod(ratio, inertia, restitution, start, count):
    """Times and energies of the first blows: parabolas and Newton's law by hand."""
    slopes, inverse = np.array([[1, -1.0], [1, ratio]]), np.diag([1, 1 / inertia])
    q, v, t, found, pull = np.array([0.5, start]), np.zeros(2), 0.0, [], np.array([-G, 0.0])
    while len(found) < count:
        gap, rate = np.maximum(slopes @ q, 0), slopes @ v
        ahead = (rate + np.sqrt(rate**2 + 2 * G * gap)) / G
        hit = int(np.argmin(np.where(ahead > 1e-12, ahead, np.inf)))
        q, v, t = (
            q + v * ahead[hit] + pull * ahead[hit] ** 2 / 2,
            v + pull * ahead[hit],
            t + ahead[hit],
        )
        row = slopes[hit]
        v = v - inverse @ row * (1 + restitution) * (row @ v) / (row @ inverse @ row)
        found.append((t, hit, v @ np.linalg.inv(inverse) @ v / 2 + G * q[0]))
    return found


@pytest.mark.parametrize(
    ("ratio", "inertia", "restitution", "start"),
    [(0.78, 0.97, 0.2, -0.05), (0.7, 1.1, 0.56, -0.015), (0.5, 1.1, 0.3, -0.07)],
)
def test_a_rod_follows_its_blows_by_hand_and_comes_to_rest(
    ratio, inertia, restitution, start, recwarn
):
    scene = rod(ratio, inertia, restitution)
    by_hand = blows_of_a_rod(ratio, inertia, restitution, start, 12)
    for options in ({"steps": 64}, {"steps": 500}, {"h": 1e-3}, {"tol": 1e-3}, {}):
        motion = vi.simulate(scene, q0=[0.5, start], v0=[0, 0], duration=2.0, **options)
        check_events(motion)
        blows = list(takewhile(lambda event: event.kind == "impact", motion.events))
        assert len(blows) >= 6
        for event, (time, contact, energy) in zip(blows, by_hand, strict=False):
            assert event.contact == contact and abs(event.time - time) <= 1e-9
            assert abs(event.energy_after - energy) <= 1e-9 * G
        assert np.abs(motion.q[-1]).max() <= 1e-12 and np.abs(motion.v[-1]).max() <= 1e-12
    assert not recwarn.list


@pytest.mark.parametrize("duration", [2.0, 5.0])
def test_a_point_comes_to_rest_in_an_uneven_groove(duration, recwarn):
    scene = groove((0.5, 0.8), [0.6, 0.3])
    times = []
    for options in ({}, {"steps": 100}, {"steps": 512, "backend": "interpreted"}):
        motion = vi.simulate(scene, q0=[0.3, 1.0], v0=[0, 0], duration=duration, **options)
        check_events(motion)
        assert np.abs(motion.q[-1]).max() <= 1e-12 and np.abs(motion.v[-1]).max() <= 1e-12
        times.append(motion.events[-1].time)
    assert np.ptp(times) <= 1e-4 and not recwarn.list


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
def test_a_plate_with_four_legs_comes_to_rest_on_all(backend, recwarn):
    legs = [(0.6, 0.9), (0.6, -0.9), (-0.6, 0.9), (-0.6, -0.9)]
    for restitution in ([0.01, 0.4, 0.55, 0.5], 0.3):
        scene = plate(legs, restitution)
        for steps in (64, 200):
            start = {"q0": [0.5, 0.08, -0.015], "v0": [0, 0, 0], "duration": 3.0}
            motion = vi.simulate(scene, steps=steps, backend=backend, **start)
            check_events(motion)
            assert np.abs(motion.q[-1]).max() <= 1e-9 and np.abs(motion.v[-1]).max() <= 1e-9
            assert len(motion.events) < 2000
    assert not recwarn.list


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
def test_what_comes_to_hold_is_at_zero_and_no_blow_is_told_late(backend):
    """Gaps that hold have no rest for the step that follows to make up for."""
    motion = vi.simulate(block(0.5), duration=1.0, steps=64, backend=backend, **dropped())
    gaps = motion.value(motion.system.contact)
    for i, number in enumerate(motion.active_set):
        holding = list(motion.active_sets[number].holding)
        assert np.abs(gaps[i, holding]).max(initial=0.0) <= 4e-16
    for event in motion.events:
        if event.kind == "impact":
            assert event.time in motion.t
        assert event.q in [tuple(q) for q in motion.q]


@pytest.mark.parametrize("restitution", [0.13, [0.5, 0.17, 0.13]])
def test_a_stack_that_chatters_to_rest_is_one_in_both_loops(restitution):
    """A rod that falls on a ball that falls on a table."""
    q, v = vi.coordinates("ball", "y", "s")
    gaps = ca.vertcat(q[0], q[1] - q[2] - q[0], q[1] + 0.9 * q[2] - q[0])
    lagrangian = v[0] ** 2 / 2 + v[1] ** 2 / 2 + 0.25 * v[2] ** 2 - G * (q[0] + q[1])
    scene = vi.System(q, v, lagrangian, contact=gaps, restitution=restitution)
    start = {"q0": [0.3, 0.6, 0.0037], "v0": [0, 0, 0], "duration": 1.0, "steps": 200}
    one, other = (vi.simulate(scene, backend=name, **start) for name in ("auto", "interpreted"))
    for motion in (one, other):
        check_events(motion)
        assert np.abs(motion.q[-1]).max() <= 1e-12
    assert [(e.kind, e.contact) for e in one.events] == [(e.kind, e.contact) for e in other.events]
    for a, b in zip(one.events, other.events, strict=True):
        assert abs(a.time - b.time) <= 1e-11
