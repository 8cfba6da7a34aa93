"""Differences of coordinates stay together, whatever number they are multiplied by."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.rows import at_many_points


def held_together(stiffness, params: vi.Parameters | None = None) -> vi.System:
    """Two masses on a spring, one of them on a soft one as well, beside something not linear."""
    q, v = vi.coordinates("x", "y")
    soft = ca.sin(q[0] + q[1]) + 0.9 * q[0] ** 2
    lagrangian = ca.sumsqr(v) / 2 - stiffness * (q[0] - q[1]) ** 2 / 2 - soft
    return vi.System(q, v, lagrangian, params=params)


@pytest.mark.parametrize("stiffness", (1e6, 1e8))
def test_a_stiff_spring_does_not_move_the_centre(stiffness):
    """(K + k) x − K y in place of K (x − y) + k x moved it by 7e-9 where 2e-11 was told, for a
    number K; a parameter did not.
    """
    start = {"q0": [0.8, 0.8 - 1e-2 / stiffness**0.5], "v0": [0.3, 0.3], "duration": 2.0}
    c = vi.Parameters(K=stiffness)
    one, other = held_together(stiffness), held_together(c.K, c)
    q = vi.simulate(one, **start).q[-1]
    np.testing.assert_allclose(q, vi.simulate(other, **start).q[-1], rtol=1e-13)


@pytest.mark.parametrize("length", (0.0, 0.1))
def test_springs_pull_both_ends_alike(length):
    """To the last bit, in a row of masses far from the origin."""
    q = ca.SX.sym("q", 4)
    bends = q[1:] - q[:-1] - length
    energy = 880_000.0 * ca.sumsqr(bends) / 2
    pull = at_many_points("pull", [q], ca.SX(0, 1), [ca.gradient(energy, q)])
    random = np.random.default_rng(1)
    places = 1e3 + 0.1 * np.arange(4) + 1e-6 * random.normal(size=(50, 4))
    (found,) = pull(np.empty(0), places)
    assert (found[:, 0] == -880_000.0 * (places[:, 1] - places[:, 0] - length)).all()
    assert (found[:, 3] == 880_000.0 * (places[:, 3] - places[:, 2] - length)).all()
    assert np.abs(found.sum(axis=1)).max() <= 1e-15 * np.abs(found).max()
