"""What loops of Newton's method are told at a start is one list of operations, or a few."""

import numpy as np
import pytest

import varint as vi
from varint.discrete.legendre import velocity_function
from varint.discrete.scales import opening_function, scale_function
from varint.numerics.arrays import call, over_columns

NAMES = (
    "pendulum",
    "double_pendulum",
    "driven_pendulum",
    "lengthening_pendulum",
    "uniform_fields",
    "cart_pole",
    "pendulum_cartesian",
    "double_atwood",
    "chain_rods",
    "four_bar",
    "knife_edge",
    "lotka_volterra",
    "catenary",
    "toda_chain",
)


@pytest.mark.parametrize("name", NAMES)
def test_sizes_and_velocities_are_the_numbers_of_their_own_functions(name):
    system = getattr(vi.models, name)().system
    n, random = system.structure.n, np.random.default_rng(1)
    controls = system.structure.controls
    for size in 10.0 ** np.arange(-3, 4):
        q, p = random.normal(size=n), size * random.normal(size=n)
        u, t, h = random.normal(size=controls), random.normal(size=1), random.normal(size=1)
        c = system.default_vector
        sizes = call(scale_function(system), q, p, u, t, h, c)[0]
        velocity = call(velocity_function(system), q, p, t, c)[0]
        told = call(opening_function(system), q, p, u, t, h, c)[0]
        np.testing.assert_array_equal(told, np.concatenate([sizes, velocity]))
        rows = q[None], p[None], u[None], t[None], h[None]
        assert over_columns(opening_function(system), *rows, c)[0].tobytes() == told.tobytes()


def test_what_is_done_is_not_simplified_and_others_are_again():
    pendulum = vi.models.pendulum().system
    assert opening_function(pendulum).is_a("SXFunction")
    assert not opening_function(vi.models.pendulum_cartesian().system).is_a("SXFunction")
    q = pendulum.q
    assert (q - q).is_zero()
