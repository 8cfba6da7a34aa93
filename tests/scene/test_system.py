"""Scenes validate themselves, and their structure is found exactly."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import cart_pendulum, double_pendulum, driven_damped, henon_heiles, pendulum

import varint as vi
from varint.numerics.arrays import DEFINITE, is_definite

q, v = vi.coordinates("x", "y")
free = ca.sumsqr(v) / 2
start = dict(q0=[0, 0], v0=[1, 0], h=0.1, steps=10)


def refused(message: str):
    return pytest.raises(vi.InputError, match=message)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: vi.coordinates(), "given no name"),
        (lambda: vi.coordinates("x", "x"), r"\['x'\] are given more than once"),
        (lambda: vi.coordinates("x", 3), "non-empty strings, got 3"),
        (
            lambda: vi.System(q, v, free + ca.SX.sym("k") * q[0]),
            r"undeclared symbols \['k'\] in the Lagrangian",
        ),
        (lambda: vi.System(q, v, ca.sumsqr(q)), "no velocities"),
        (lambda: vi.System(q, v, v), r"the Lagrangian has shape \(2, 1\)"),
        (
            lambda: vi.System(q, v, free, force=q[0]),
            r"the force has shape \(1, 1\); it must have \(2, 1\)",
        ),
        (
            lambda: vi.System(q, v, free, constraint=v[0]),
            r"constraint may not depend on \['x_dot'\].*nonholonomic=",
        ),
        (
            lambda: vi.System(q, v, free, nonholonomic=q[0] * v[1] - v[0]),
            r"takes the matrix A of the rows .* nonholonomic=ca.jacobian\(rows, v\)",
        ),
        (
            lambda: vi.System(q, v, free - vi.abs(q[0])),
            r"\['abs\(x\)'\] in the Lagrangian: vi.abs and vi.max belong to the costs",
        ),
        (lambda: vi.System(q, v[0], free), "q has 2 and v has 1 components"),
        (lambda: vi.System(q, q, free), r"names \['x', 'y'\] are used for more than one symbol"),
        (lambda: vi.System(ca.MX.sym("q", 2), v, free), "q is an MX"),
        (lambda: vi.System(q, v, ca.MX.sym("L")), "Lagrangian is an MX"),
        (lambda: vi.System(q, v, "L"), "must be a CasADi SX expression, got str"),
        (lambda: vi.System(q + 1, v, free), "q must be SX symbols"),
        (lambda: vi.System(free, q, v), r"q must be SX symbols, got .*System\(q, v, L\)"),
        (
            lambda: vi.System(q, v, free, params=dict(g=1)),
            r"params of a System has the key 'g'; give the symbol itself, \{m: 1.0\}",
        ),
        (
            lambda: vi.System(q, v, free, contact=q[0], restitution=1.5),
            "restitution must lie between 0 and 1",
        ),
        (
            lambda: vi.System(q, v, free, contact=q[0], restitution=[1, 0]),
            r"restitution has shape \(2,\)",
        ),
        (
            lambda: vi.System(q, v, free, contact=q[0], restitution=q[1]),
            r"restitution may not depend on \['y'\]",
        ),
        (
            lambda: vi.System(q, v, free, contact=q[0], restitution=[ca.SX(1), 0.5]),
            r"restitution has shape \(2, 1\)",
        ),
        (lambda: vi.System(q, v, free, restitution=ca.SX(1)), "the system has no contact"),
        (
            lambda: vi.System(q, v, free, contact=q[0], restitution=ca.SX(1.5)),
            "restitution must lie between 0 and 1",
        ),
        (lambda: vi.Parameters(g="heavy"), "parameter 'g' must be a number"),
        (lambda: vi.Parameters(g=np.inf), "parameter 'g' is not finite"),
        (lambda: vi.Parameters(g=1).l, r"unknown parameters \['l'\]; known: \['g'\]"),
    ],
)
def test_a_scene_that_is_no_scene_is_refused(build, message):
    with pytest.raises((vi.InputError, AttributeError), match=message):
        build()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            dict(q0=[0, 0, 0]),
            r"q0 has shape \(3,\); it must be \(2,\), one number for each of \['x', 'y'\]",
        ),
        (dict(q0=[0, np.nan]), r"q0 is not finite in \['y'\]"),
        (dict(q0="here"), "q0 must be 2 numbers"),
        (dict(v0=None), "give v0 .* or p0"),
        (dict(p0=[1, 0]), "give v0 or p0, not both"),
        (dict(duration=1.0), "give two of h, steps, duration; got"),
        (dict(h=None), r"give two of h, steps, duration; got \['steps'\]"),
        (dict(steps=0), "steps must be a whole number, at least 1, got 0"),
        (dict(steps=2.5), "steps must be a whole number"),
        (dict(h=0.0), "h must not be zero"),
        (dict(h=np.inf), "h must be finite"),
        (
            dict(steps=None, duration=1.03),
            r"10.3 steps of h=0.1, not a whole number; give steps=11",
        ),
        (dict(steps=None, duration=-1.0), "different signs"),
        (dict(save_every=0), "save_every must be a whole number"),
        (dict(u=[1, 2]), "u was given, but the system has no control"),
        (dict(params=dict(lenght=1)), r"unknown parameters \['lenght'\]; known: \['g'\]"),
        (dict(params=dict(g=[1, 2])), r"parameter 'g' has shape \(2,\); its default has \(\)"),
        (dict(params=3), "params must be a dictionary"),
    ],
)
def test_a_start_that_is_no_start_is_refused(change, message):
    c = vi.Parameters(g=9.81)
    system = vi.System(q, v, free - c.g * q[1], params=c)
    with refused(message):
        vi.simulate(system, **{**start, **change})


def test_shapes_of_controls_are_explained():
    u = ca.SX.sym("u")
    system = vi.System(q, v, free, force=ca.vertcat(u, 0), control=u)
    with refused(
        r"the system has the controls \['u'\]; give u with shape \(10, 1\), \(10, 2, 1\) or \(1,\)"
    ):
        vi.simulate(system, vi.gauss(2), **start)
    with refused(r"u has shape \(7, 1\); it must have"):
        vi.simulate(system, vi.gauss(2), u=np.zeros((7, 1)), **start)
    with refused("takes one value a step"):
        vi.simulate(system, vi.composition("verlet"), u=np.zeros((10, 2, 1)), **start)


@pytest.mark.parametrize(
    ("build", "reason"),
    [
        (
            double_pendulum,
            "not of the form T.*its mass matrix is not constant; use for example gauss",
        ),
        (driven_damped, "its force depends on the velocities"),
    ],
)
def test_compositions_say_why_they_cannot_step_a_scene(build, reason):
    with refused(reason):
        vi.simulate(build(), vi.composition("yoshida4"), q0=[0, 0], v0=[0, 0], h=0.1, steps=1)


def test_a_singular_mass_matrix_names_the_coordinates_without_inertia():
    system = vi.System(q, v, (v[0] + v[1]) ** 2 / 2 - ca.sumsqr(q))
    with refused(r"singular at the start.*\['x', 'y'\]"):
        vi.simulate(system, vi.gauss(2), **start)


def test_a_start_where_the_lagrangian_is_not_finite_is_refused():
    system = vi.System(q, v, free + 1 / ca.norm_2(q))
    with refused("not finite at the start"):
        vi.simulate(system, vi.gauss(2), **start)


def test_a_rule_must_be_a_rule():
    with refused("rule must be a varint Rule"):
        vi.simulate(pendulum(), "gauss", q0=1, v0=0, h=0.1, steps=1)


def test_structure_of_separable_scenes():
    s = henon_heiles().structure
    assert (s.separable, s.constant_mass, s.diagonal_mass, s.autonomous, s.explicit) == (True,) * 5
    assert (s.linear, s.forced, s.degenerate) == (False,) * 3
    assert s.blocks == ((0, 1),)


def test_structure_of_coupled_scenes():
    s = cart_pendulum().structure
    assert (s.separable, s.constant_mass, s.explicit) == (False,) * 3
    assert s.cyclic == (0,)
    d = driven_damped().structure
    assert (d.autonomous, d.forced, d.force_on_velocity) == (False, True, True)


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_force_that_is_zero_for_any_motion_is_none(zero):
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 + 1 / ca.norm_2(q)
    pulled = vi.System(q, v, lagrangian, force=zero * v)
    half = vi.System(q, v, lagrangian, force=ca.vertcat(zero * v[0], -v[1]))
    free = vi.System(q, v, lagrangian)
    assert pulled.structure == free.structure
    assert pulled.force.shape == (2, 1)
    assert half.structure.forced
    start = dict(q0=[0.1, 0.0], v0=[0.0, 4.0], duration=5.0)
    one, other = vi.simulate(pulled, **start), vi.simulate(free, **start)
    assert np.array_equal(one.q, other.q)


def test_structure_finds_linear_scenes_and_independent_blocks():
    x, w = vi.coordinates("a", "b", "c")
    linear = vi.System(x, w, ca.sumsqr(w) / 2 - x[0] * x[2] - x[1] ** 2, force=-0.1 * w).structure
    assert linear.linear
    assert sorted(linear.blocks) == [(0, 2), (1,)]
    assert not pendulum().structure.linear
    shaken = vi.System(x, w, ca.sumsqr(w) / 2 * (1 + ca.sin(t := vi.time())), t=t).structure
    assert not shaken.linear
    assert not shaken.separable


def test_a_magnetic_term_makes_a_scene_regular_but_not_separable():
    s = vi.System(q, v, free + q[0] * v[1]).structure
    assert (s.separable, s.constant_mass, s.degenerate) == (False, True, False)


def test_a_parameter_in_the_mass_keeps_it_constant():
    c = vi.Parameters(m=2.0)
    assert vi.System(q, v, c.m * free, params=c).structure.explicit


def test_energy_momentum_and_mass_are_expressions():
    system = double_pendulum()
    numbers = ca.Function(
        "f", [system.q, system.v], [system.energy, system.momentum, system.mass_matrix]
    )
    energy, momentum, mass = (np.array(x) for x in numbers([0.3, 0.1], [1.0, 2.0]))
    cos = np.cos(0.2)
    np.testing.assert_allclose(mass, [[2, cos], [cos, 1]])
    np.testing.assert_allclose(momentum[:, 0], [2 + 2 * cos, cos + 2])
    np.testing.assert_allclose(energy, 1 + 2 + 2 * cos - 9.81 * (2 * np.cos(0.3) + np.cos(0.1)))


def test_the_plan_says_what_runs_and_what_is_skipped():
    text = str(vi.plan(pendulum()))
    assert "kick and drift" in text
    assert "skipped  root finding" in text
    words = str(vi.plan(double_pendulum()))
    assert "Newton's method for 2 × 2 unknowns" in words and "all stages iterated" in words
    assert "all stages iterated" not in str(vi.plan(double_pendulum(), vi.lobatto(3)))


def test_a_coefficient_of_restitution_without_a_contact_is_refused():
    q, v = vi.coordinates("x")
    with pytest.raises(
        vi.InputError, match=r"restitution=0.5 was given, but the system has no contact"
    ):
        vi.System(q, v, v**2 / 2, restitution=0.5)


def test_a_matrix_that_is_definite_by_far_has_no_eigenvalue_near_zero():
    rng = np.random.default_rng(3)
    seen = set()
    for smallest in (1e-3, 1e-9, 1e-11, 1e-13, 0.0, -1e-9):
        turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        matrix = turn * np.append(smallest, rng.uniform(0.5, 2, 5)) @ turn.T
        matrix = (matrix + matrix.T) / 2 * np.outer(*2 * [10.0 ** np.arange(-3, 3)])
        size = np.sqrt(np.diag(matrix))
        least = np.linalg.eigvalsh(matrix / np.outer(size, size)).min()
        assert is_definite(matrix) == (least > DEFINITE)
        seen.add(is_definite(matrix))
    assert seen == {True, False}


@pytest.mark.parametrize("entry", [(0, 0), (1, 0), (1, 1)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_matrix_with_an_entry_that_is_no_number_is_not_definite(entry, value):
    matrix = np.eye(3)
    matrix[entry] = matrix[entry[::-1]] = value
    assert not is_definite(matrix)


@pytest.mark.parametrize(
    ("part", "says"),
    [
        (
            lambda q, v: {"contact": q[1] >= 0},
            r"row 0 of the contact is a condition, 0 or 1, .* give the gap",
        ),
        (
            lambda q, v: {"contact": ca.vertcat(q[1], q[0] > 1)},
            r"row 1 of the contact is a condition.*1<x",
        ),
        (lambda q, v: {"constraint": q[1] == q[0]}, r"row 0 of the constraint .* as x - y"),
        (lambda q, v: {"constraint": ca.logic_or(q[0] > 0, q[1] > 0)}, r"row 0 of the constraint"),
        (lambda q, v: {"nonholonomic": v[1] == v[0]}, r"nonholonomic .* give ca.jacobian"),
    ],
)
def test_a_condition_is_no_gap_and_no_constraint(part, says):
    """A body fell through the floor whose gap was y >= 0, without a word."""
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 - 9.81 * q[1]
    with refused(says):
        vi.System(q, v, lagrangian, **part(q, v))


def test_conditions_may_stand_within_gaps_and_forces():
    q, v = vi.coordinates("y")
    step = ca.if_else(q > 0.5, q - 0.25, q / 2)
    scene = vi.System(q, v, v**2 / 2, contact=step, force=-(q > 2))
    assert (scene.structure.contacts, scene.structure.forced) == (1, True)
