"""Forces that act for less than a step: met however short and weak, or told."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration import hidden


@pytest.mark.parametrize(
    ("height", "width", "when"),
    [(0.18, 3e-4, 11.3), (0.75, 1.5e-3, 6.21), (3.0, 5e-4, 17.9)],
)
def test_a_pulse_however_short_and_weak_is_met(height, width, when):
    """Beside forces of its own size: x'' + x = A exp(−((t − s)/w)²) is a kick A w √π, less the
    part of the moved force in w².
    """
    q, v, t = *vi.coordinates("x"), vi.time()
    kick = height * ca.exp(-(((t - when) / width) ** 2))
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=kick, t=t)
    motion = vi.simulate(system, q0=1.0, v0=0.0, duration=20.0, tol=1e-7)
    impulse = height * width * np.sqrt(np.pi) * np.exp(-(width**2) / 4)  # of sin and cos alike
    true = np.cos(20.0) + impulse * np.sin(20.0 - when)
    assert abs(motion.q[-1, 0] - true) <= 1e-7 * np.ptp(motion.q)


@pytest.mark.long
def test_a_pulse_too_short_for_any_steps_is_told_by_its_size():
    q, v, t = *vi.coordinates("x"), vi.time()
    kick = 10.0 * ca.exp(-(((t - 3.7) / 1e-9) ** 2))
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=kick, t=t)
    impulse = 10.0 * 1e-9 * np.sqrt(np.pi)
    with pytest.warns(UserWarning, match="less than a step"):
        motion = vi.simulate(system, q0=1.0, v0=0.0, duration=20.0, tol=1e-9)
    missed = abs(np.cos(20.0) + impulse * np.sin(16.3) - motion.q[-1, 0]) / np.ptp(motion.q)
    assert missed > 1e-9
    assert missed <= motion.stats["error_estimate"] <= 100 * missed


def test_a_smooth_drive_is_not_searched_for_pulses(monkeypatch):
    q, v, t = *vi.coordinates("x"), vi.time()
    drive = 0.3 * ca.cos(1.2 * t) - 0.2 * v
    system = vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=drive, t=t)
    motion = vi.simulate(system, vi.gauss(8), q0=0.5, v0=0.0, h=0.25, steps=200)
    monkeypatch.setattr(hidden, "_shown", None)
    assert hidden.missed_impulse(system, vi.gauss(8), motion, np.ones(1), 1e-9) == 0


def shaken(kind: int, when: float, width: float) -> vi.System:
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    drive = (
        0.3 * ca.cos(2 * t),
        0.3 * ca.cos(2 * t) + ca.exp(-(((t - when) / width) ** 2)),
        1e-3 * ca.cos(t) / (width + ca.sin(0.3 * (t - when)) ** 2),
        ca.cos(0.1 * q[0] * ca.sin(t) / width),
    )[kind]
    force = ca.vertcat(drive - 0.2 * v[0], -0.1 * ca.norm_2(v) * v[1])
    return vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2 - q[1] ** 4, force=force, t=t)


@pytest.mark.parametrize("kind", range(4))
def test_bounds_of_many_steps_promise_no_more_than_those_of_each(kind):
    """And say so where a drive is smooth, never where a pulse lies between nodes."""
    rule, told = vi.gauss(8), []
    for when, width in ((3.3, 1e-4), (7.1, 1e-2), (9.9, 1.0)):
        scene = shaken(kind, when, width)
        for steps in (100, 400):
            start = {"q0": [0.3, 0.1], "v0": [0.0, 0.2]}
            motion = vi.simulate(scene, rule, **start, h=12.0 / steps, steps=steps)
            every = hidden.Parts(np.arange(steps), np.zeros(steps), np.ones(steps))
            nothing = np.full((steps, 2), 1e-12)
            nodes = np.array(rule.nodes)
            told.append(hidden._smooth_at_once(scene, motion, every, nodes[::4], nothing))
            size, _ = hidden._impulses(scene, motion, every, nodes, np.array(rule.weights))
            usual = np.maximum(size, np.median(size, axis=0))
            hides = hidden._may_hide(scene, motion, every, hidden.BENDS * usual, nothing)
            assert not (told[-1] and hides.any())
    assert any(told) and (kind == 0 or not all(told))


def test_the_core_asks_for_bounds_of_many_steps_first(monkeypatch):
    """Where these suffice, those of each step are not asked for: the scene has none to give."""
    from varint.integration import force_bounds

    system = shaken(0, 0.0, 1.0)
    every = force_bounds.forces_as_data(system)
    assert every is not None and all(every)
    monkeypatch.setattr(hidden, "_may_hide", None)
    motion = vi.simulate(system, vi.gauss(8), q0=[0.3, 0.1], v0=[0.0, 0.2], h=0.1, steps=100)
    assert hidden.missed_impulse(system, vi.gauss(8), motion, np.ones(2), 1e-9) == 0
