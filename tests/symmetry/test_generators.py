"""A user's own generator is verified, refused, or completed by its gauge term; tables of them."""

from __future__ import annotations

import casadi as ca
import pytest
from symmetric_scenes import central, gravity

import varint as vi


def test_a_nonlinear_generator_is_verified():
    """Cartesian translation in polar coordinates: ξ = (cos φ, −sin φ/r)."""
    q, v = vi.coordinates("r", "phi")
    free = vi.System(q, v, (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2)
    symmetry = vi.noether(free, [ca.cos(q[1]), -ca.sin(q[1]) / q[0]])
    motion = vi.simulate(free, vi.gauss(4), q0=[1.0, 0.2], v0=[0.1, 0.5], h=0.01, steps=200)
    assert motion.momentum_map(symmetry).drift < 1e-11
    assert symmetry.kept_by(vi.gauss(4)) == "to order 8" and symmetry.name == "nonlinear symmetry"


def test_a_wrong_generator_is_refused_with_its_residual():
    system = central(gravity)
    x, y = ca.vertsplit(system.q)
    with pytest.raises(
        vi.InputError, match=r"no symmetry of the Lagrangian: δL − dK/dt is 1\.0e\+00"
    ):
        vi.noether(system, [1, 0])
    with pytest.raises(vi.InputError, match="no symmetry"):
        vi.noether(system, [-y, (1 + 1e-6) * x])
    assert vi.noether(system, [-y, x]).name == "rotation about z"


def test_a_missing_gauge_term_is_suggested():
    q, v = vi.coordinates("x")
    free = vi.System(q, v, 3 * v**2 / 2)
    with pytest.raises(vi.InputError, match=r"with gauge=\(?3\*x\)? it is one"):
        vi.noether(free, [free.t])
    assert vi.noether(free, [free.t], gauge=3 * q).conserved


def test_the_runge_lenz_vector_is_no_point_symmetry():
    system = central(gravity)
    with pytest.raises(vi.InputError, match="no point symmetries"):
        vi.noether(system, [system.v[0] * system.q[1], 0])


@pytest.mark.parametrize(
    ("xi", "message"),
    [
        ([1, 2, 3], r"shape \(3, 1\)"),
        (["a", "b"], "must be an expression"),
        ([ca.SX.sym("k"), 0], r"depends on \['k'\]"),
    ],
)
def test_input_that_is_no_generator_is_refused(xi, message):
    with pytest.raises(vi.InputError, match=message):
        vi.noether(central(gravity), xi)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(vi.InputError, match="rotation about z"):
        vi.symmetries(central(gravity))["rotation about q"]


def test_tables_print_for_terminals_and_notebooks():
    table = vi.symmetries(central(gravity), vi.gauss(2))
    assert "kept by gauss(2)" in str(table) and "-y p_x + x p_y" in str(table)
    assert "<td>rotation about z</td>" in table._repr_html_()


def test_a_generator_that_does_nothing_is_refused():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2)
    with pytest.raises(vi.InputError, match="the generator is zero"):
        vi.noether(system, [0, 0])
    with pytest.raises(vi.InputError, match="tau must be a number, got 'now'"):
        vi.noether(system, [1, 0], tau="now")
