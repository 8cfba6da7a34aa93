"""Kinetic energies like v⁴, whose mass 3 v² is zero at rest, where no velocity is told by p."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

Q, V = vi.coordinates("x")


@pytest.mark.parametrize("backend", ["native", "compiled", "interpreted"])
@pytest.mark.parametrize("rule", [vi.gauss(4), vi.lobatto(3)], ids=str)
def test_a_free_fall_of_quartic_kinetic_energy_is_the_closed_form(rule, backend):
    fall = vi.System(Q, V, V**4 / 4 - Q)  # p = v³ = p0 − t
    motion = vi.simulate(fall, rule, q0=0.0, v0=2.0, h=0.1, steps=30, backend=backend)
    t = motion.t
    exact = 0.75 * (16 - (8 - t) ** (4 / 3))
    np.testing.assert_allclose(motion.p[:, 0], 8 - t, rtol=1e-13)
    np.testing.assert_allclose(motion.v[:, 0], (8 - t) ** (1 / 3), rtol=1e-12)
    np.testing.assert_allclose(motion.q[:, 0], exact, atol=1e-6)


def test_the_default_call_follows_it_to_its_tolerance():
    fall = vi.System(Q, V, V**4 / 4 - Q)
    motion = vi.simulate(fall, q0=0.0, v0=2.0, duration=3.0)
    assert abs(motion.q[-1, 0] - 0.75 * (16 - 5 ** (4 / 3))) < 1e-9


def test_two_directions_are_told_apart_by_their_momenta():
    q, v = vi.coordinates("x", "y")
    scene = vi.System(q, v, ca.sumsqr(v) ** 2 / 4 - ca.sumsqr(q) / 2)
    for v0 in ([1.0, 0.5], [-1e-2, 3e-3], [30.0, -20.0]):
        motion = vi.simulate(scene, q0=[1, 0], v0=v0, h=1e-4 * np.hypot(*v0) ** 3, steps=1)
        np.testing.assert_allclose(motion.v[0], v0, rtol=1e-12)


def test_at_rest_it_is_refused_in_words():
    with pytest.raises(vi.InputError, match="zero at the start velocities"):
        vi.simulate(vi.System(Q, V, V**4 / 4 - Q), q0=0.0, v0=0.0, duration=1.0)
