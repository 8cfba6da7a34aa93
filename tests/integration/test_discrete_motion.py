"""Rules on the two scenes whose discrete motion is known in closed form."""

from __future__ import annotations

import numpy as np
from references import entries

import varint as vi

REFERENCE = entries("a")


def test_discrete_free_fall_is_exact_at_the_nodes():
    r = REFERENCE["A13_discrete_free_fall"]
    q, v = vi.coordinates("x")
    fall = vi.System(q, v, v**2 / 2 - 9.81 * q)
    for rule in (vi.midpoint(), vi.trapezoidal()):
        motion = vi.simulate(fall, rule, q0=0.0, v0=3.0, h=0.1, steps=5)
        assert np.abs(motion.q[:, 0] - r["reference"]["q_nodes_0_to_5"]).max() < 1e-15
        assert np.abs(motion.p[:, 0] - r["reference"]["p_nodes"]).max() < 1e-14
        assert (
            abs(motion[:2].action - r["reference"]["L_d_midpoint_or_trapezoidal_first_step"])
            < 1e-15
        )


def test_discrete_oscillators_have_their_known_motion():
    entry = REFERENCE["A13_discrete_oscillator"]["reference"]
    r = entry["results"] | entry
    q, v = vi.coordinates("x")
    oscillator = vi.System(q, v, (v**2 - 1.3**2 * q**2) / 2)
    for rule, name in ((vi.trapezoidal(), "stoermer_verlet"), (vi.midpoint(), "implicit_midpoint")):
        states = next(value for key, value in r.items() if key.startswith(name))
        motion = vi.simulate(oscillator, rule, q0=0.7, p0=-0.2, h=0.1, steps=100)
        for k in (10, 100):
            found = np.array([motion.q[k, 0], motion.p[k, 0]])
            assert np.abs(found - states[f"state_after_{k}"]).max() < 1e-14
    verlet = vi.simulate(oscillator, vi.trapezoidal(), q0=0.7, p0=-0.2, h=0.1, steps=1000)
    modified = verlet.p**2 / 2 + 1.3**2 * (1 - 1.3**2 * 0.1**2 / 4) * verlet.q**2 / 2
    assert np.abs(modified - r["verlet_modified_energy"]).max() < 1e-15
    for stages, angle, _ in r["gauss_collocation_angle_per_step"]:
        motion = vi.simulate(oscillator, vi.gauss(stages), q0=1.0, p0=0.0, h=0.1, steps=1)
        assert abs(np.arctan2(-motion.p[1, 0] / 1.3, motion.q[1, 0]) - angle) < 3e-16
