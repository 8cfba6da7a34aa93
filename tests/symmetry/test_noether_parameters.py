"""Symmetries whose coefficients depend on the parameters, and those that only combinations of
symmetries of L keep.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

C = vi.Parameters(m1=1.0, m2=2.5, k=1.3, d=0.4)


def kept(system: vi.System, **arguments) -> list[vi.Symmetry] | list:
    return [s for s in vi.symmetries(system, **arguments) if s.conserved]


def generator(symmetry, q, **parameters) -> np.ndarray:
    """ξ at q and t = 0, for these parameter values."""
    s = symmetry.system
    c = [parameters.get(name, float(default)) for name, default in s.defaults.items()]
    return np.array(ca.Function("xi", [s.q, s.t, s.c], [symmetry.xi])(q, 0, c)).ravel()


# coefficients of the invariant direction, as functions of the parameters, and whether they are
# recognised in print
DIRECTIONS = {
    "sum": (lambda c: c.m1 + c.m2, lambda c: 1, True),
    "ratio of sums": (lambda c: c.m1 + c.m2, lambda c: c.m1 - c.k, True),
    "reduced mass": (lambda c: c.m1 * c.m2, lambda c: c.m1 + c.m2, True),
    "square root": (lambda c: ca.sqrt(c.m1 + c.d), lambda c: ca.sqrt(c.m2), True),
    "sine and cosine": (lambda c: ca.sin(c.k), lambda c: ca.cos(c.k), False),
    "logarithm": (lambda c: ca.log(1 + c.m1**3), lambda c: c.m2, False),
}


@pytest.mark.parametrize(("up", "down", "known"), DIRECTIONS.values(), ids=DIRECTIONS)
def test_any_function_of_the_parameters_may_be_a_coefficient(up, down, known):
    """V(a down − b up) is the same all along (up, down)."""
    q, v = vi.coordinates("a", "b")
    system = vi.System(
        q,
        v,
        (C.m1 * v[0] ** 2 + C.m2 * v[1] ** 2) / 2 + ca.cos(q[0] * down(C) - q[1] * up(C)),
        params=C,
    )
    found = vi.symmetries(system)
    assert [s.name for s in found] == [
        "time translation",
        "translation of a, b",
        "boost of a, b",
    ] and not found.note
    value = ca.Function("direction", [C.m1, C.m2, C.k, C.d], [up(C), down(C)])
    for values in (dict(m1=1.0, m2=2.5, k=1.3, d=0.4), dict(m1=0.3, m2=1.1, k=0.8, d=2.0)):
        xi = generator(found[1], [0.0, 0.0], **values)
        wanted = [float(x) for x in value(*values.values())]
        assert xi[0] * wanted[1] == pytest.approx(xi[1] * wanted[0], rel=1e-11)
    assert ("f(" not in found[1].generator) == known
    motion = vi.simulate(
        system,
        vi.gauss(2),
        q0=[0.3, 1],
        v0=[0.1, 0.2],
        h=0.05,
        steps=500,
        params=dict(m1=0.7, k=0.9),
    )
    for symmetry in found:
        assert not symmetry.tau.is_zero() or motion.momentum_map(symmetry).drift < 1e-13


def test_rotations_may_have_such_coefficients_too():
    q, v = vi.coordinates("a", "b")
    inertia = C.m1 + C.d
    well = (inertia * q[0] ** 2 + C.m2 * q[1] ** 2) ** 2
    system = vi.System(q, v, (inertia * v[0] ** 2 + C.m2 * v[1] ** 2) / 2 - C.k * well, params=C)
    turn = vi.symmetries(system)[1]
    assert "m2/(m1+d)" in turn.generator
    xi = generator(turn, [0.3, 0.4], m1=0.7, d=0.1, m2=5.0)
    assert xi[0] / xi[1] == pytest.approx(-5.0 * 0.4 / (0.8 * 0.3), rel=1e-12)


def test_crossed_fields_turn_in_a_frame_that_moves():
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.5, B=2.0, E=0.3)
    field = c.B * (q[0] * v[1] - q[1] * v[0]) / 2 + c.E * q[0]
    turn = vi.symmetries(vi.System(q, v, c.m * ca.sumsqr(v) / 2 + field, params=c))[-1]
    assert turn.name == "rotation about z in a moving frame" and "E/B" in turn.generator


# ---- combinations that the whole scene keeps


def bead(slope=0.75, **arguments) -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=q[1] + slope * q[0] - 1, **arguments
    )


def test_a_bead_on_a_slope_keeps_the_translation_along_it():
    names = [s.name for s in kept(bead())]
    assert names == [
        "time translation",
        "translation along (1, -0.75)",
        "Galilean boost along (1, -0.75)",
    ]
    motion = vi.simulate(bead(), q0=[0, 1], v0=[0.4, -0.3], h=0.01, steps=2000)
    conserved = motion.conserved()
    assert [m.symmetry.name for m in conserved if m.symmetry.conserved] == names
    assert max(m.drift for m in conserved if m.exact) < 3e-13


def test_its_slope_may_be_a_parameter():
    c = vi.Parameters(slope=0.75)
    along = kept(bead(c.slope, params=c))[1]
    for slope in (0.75, -2.0):
        xi = generator(along, [0.2, 0.4], slope=slope)
        assert xi[1] / xi[0] == pytest.approx(-slope, rel=1e-12)


def test_what_is_kept_but_not_recognised_is_counted_and_found_at_given_values():
    c = vi.Parameters(angle=0.4)
    system = bead(ca.tan(c.angle), params=c)
    assert (
        "the scene keeps 2 combinations that depend on the parameters: give params={}"
        in vi.symmetries(system).note
    )
    assert len(kept(system, params={})) == 3


def test_a_ring_about_a_point_keeps_the_rotation_about_it():
    q, v = vi.coordinates("x", "y")
    ring = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q - ca.DM([1, 2])) - 1)
    assert [s.name for s in kept(ring)] == ["time translation", "rotation about z through (1, 2)"]


def test_a_rod_between_two_free_bodies_keeps_the_galilei_algebra():
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    kinetic = ca.sumsqr(v[:2]) / 2 + ca.sumsqr(v[2:])
    found = [
        s.name for s in kept(vi.System(q, v, kinetic, constraint=ca.sumsqr(q[:2] - q[2:]) - 1))
    ]
    shifts = [f"{what} along {a}" for what in ("translation", "Galilean boost") for a in "xy"]
    assert set(found) >= {"time translation", "rotation about z", *shifts} and len(found) == 7
    pinned = vi.System(
        q, v, kinetic, constraint=ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[:2] - q[2:]) - 1)
    )
    assert [s.name for s in kept(pinned)] == ["time translation", "rotation about z"]


def test_a_force_along_one_direction_and_an_inclined_wall_keep_what_lies_across():
    q, v = vi.coordinates("x", "y")
    drag = vi.System(q, v, ca.sumsqr(v) / 2, force=-(v[0] + v[1]) * ca.vertcat(1, 1))
    assert [s.name for s in kept(drag)] == [
        "translation along (1, -1)",
        "Galilean boost along (1, -1)",
    ]
    wall = vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], contact=q[1] - 0.3 * q[0], restitution=0.9
    )
    names = [s.name for s in kept(wall)]
    assert names == ["translation along (1, 0.3)", "Galilean boost along (1, 0.3)"]
    motion = vi.simulate(wall, q0=[0, 1], v0=[0.2, 0], h=0.01, steps=150)
    assert motion.events and all(motion.conserved()[name].drift < 1e-13 for name in names)


def test_a_long_chain_lists_what_is_recognisable_and_counts_the_rest():
    found = vi.symmetries(vi.models.chain_rods(6).system)
    assert [s.name for s in found if s.conserved] == ["time translation"]
    assert (
        "more of L alone: linear ones that the rest of the scene breaks" in found.note
        and len(found) < 30
    )


def test_coefficients_of_singular_equations_end_the_search_in_no_error():
    """A field that oscillates evenly: some coefficients solve equations that are singular for all
    parameters.
    """
    found = vi.symmetries(vi.models.oscillating_field().system)
    assert {f"translation along {x}" for x in "xyz"} <= {s.name for s in found}
    assert "give params={}" in found.note
    assert all(s.conserved for s in found)
