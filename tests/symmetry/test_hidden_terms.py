"""What samples cannot see breaks a symmetry all the same: wells, walls and small terms anywhere;
and bodies of any mass.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

SHAPES = {
    "well": lambda x, x0, k: -ca.exp(-k * (x - x0) ** 2),
    "expanded well": lambda x, x0, k: -ca.exp(-k * x**2 + 2 * k * x0 * x - k * x0**2),
    "ramp": lambda x, x0, k: ca.exp(k * (x - x0)),
    "wall": lambda x, x0, k: k * ca.fmax(x - x0, 0) ** 2,
    "step": lambda x, x0, k: k * ca.if_else(x > x0, x - x0, 0) ** 3,
    "bump": lambda x, x0, k: 1 / ca.cosh(k * (x - x0)) ** 2,
    "small": lambda x, x0, k: float(f"{k}e-{x0}") * x**4,
}
# what hides the term, and the symmetries in the plane that survive it
DIRECTIONS = {
    "x": (lambda q: q[0], ["translation along y", "Galilean boost along y"]),
    "r": (lambda q: ca.norm_2(q), ["rotation about z"]),
    "x - y": (
        lambda q: q[0] - q[1],
        ["translation along (1, 1)", "Galilean boost along (1, 1)"],
    ),
}


def names(system: vi.System, **arguments) -> list[str]:
    return [s.name for s in vi.symmetries(system, **arguments)]


def hidden(direction: str, shape: str, rng: np.random.Generator) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A hidden potential with its place and scale drawn over decades, as a user would type them."""
    q, v = vi.coordinates("x", "y")
    x0 = float(f"{10 ** rng.uniform(0.8, 3.5):.2g}")
    x0 = rng.integers(8, 20) if shape == "small" else x0
    k = float(f"{10 ** rng.uniform(-0.5, 1.5):.1g}")
    return q, v, SHAPES[shape](DIRECTIONS[direction][0](q), x0, k)


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_hidden_term_breaks_what_it_breaks_and_nothing_else(shape, direction):
    rng = np.random.default_rng([len(shape), len(direction)])
    for _ in range(3):
        q, v, potential = hidden(direction, shape, rng)
        found = names(vi.System(q, v, ca.sumsqr(v) / 2 - potential))
        assert found == ["time translation", *DIRECTIONS[direction][1]]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_generator_of_ones_own_is_refused_where_a_hidden_term_breaks_it(shape):
    q, v, potential = hidden("x", shape, np.random.default_rng(3))
    system = vi.System(q, v, ca.sumsqr(v) / 2 - potential)
    with pytest.raises(vi.InputError, match="no symmetry of the Lagrangian"):
        vi.noether(system, [1, 0])
    assert vi.noether(system, [0, 1]).tested == "identically"


@pytest.mark.parametrize("shape", SHAPES)
def test_a_hidden_force_breaks_what_it_works_on(shape):
    q, v, push = hidden("x", shape, np.random.default_rng(4))
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=ca.vertcat(push, 0))
    found = vi.symmetries(system)
    assert found["translation along x"].broken_by == ("force",)
    assert not found["translation along y"].broken_by


@pytest.mark.parametrize("size", [1e-6, 1e-9, 1e-12, 1e-15])
def test_a_small_perturbation_breaks_the_rotation(size):
    q, v = vi.coordinates("x", "y")
    round_ = ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2
    assert names(vi.System(q, v, round_ - size * q[0] * q[1])) == ["time translation"]
    assert "rotation about z" in names(vi.System(q, v, round_ - size * ca.sumsqr(q) ** 3))


def nothing(y: ca.SX) -> ca.SX:
    """Zero, but by no rule that the exact test knows."""
    return (ca.log((1 + y**2) ** 2) - 2 * ca.log(1 + y**2)) / 10**6


def test_a_symmetry_that_algebra_cannot_show_is_listed_with_the_size_tested():
    q, v = vi.coordinates("x", "y")
    found = vi.symmetries(vi.System(q, v, ca.sumsqr(v) / 2 - q[0] * nothing(q[1])))
    assert [s.name for s in found] == GALILEI
    along = found["translation along x"]
    assert "points up to" in along.tested and along.name in found.note
    assert found["translation along y"].tested == "identically"


def test_a_well_is_then_looked_for_where_the_constants_of_the_scene_say():
    q, v = vi.coordinates("x", "y")
    well = ca.exp(-4 * (q[0] - 30) ** 2)
    found = names(vi.System(q, v, ca.sumsqr(v) / 2 - q[0] * nothing(q[1]) - well))
    assert found == ["time translation", "translation along y", "Galilean boost along y"]


GALILEI = [
    "time translation",
    "translation along x",
    "translation along y",
    "rotation about z",
    "Galilean boost along x",
    "Galilean boost along y",
]


@pytest.mark.parametrize(
    "masses",
    [
        (1, 1e-20),
        (1, 1e-30),
        (1e-20, 1e-20),
        (1e-30, 3e-30),
        (1, 1e-3, 1e-20),
        (1, 1e-30, 1e-30),
        (1e30, 1, 1e-30),
        (3e-20, 2e-20, 1e-20),
    ],
)
def test_bodies_have_the_galilei_group_whatever_their_masses(masses):
    q, v = vi.coordinates(*(f"{a}{i + 1}" for i in range(len(masses)) for a in "xy"))
    place = [q[2 * i : 2 * i + 2] for i in range(len(masses))]
    lagrangian = sum(
        m * ca.sumsqr(v[2 * i : 2 * i + 2]) / 2
        + sum(m * masses[j] / ca.norm_2(place[i] - place[j]) for j in range(i))
        for i, m in enumerate(masses)
    )
    found = vi.symmetries(vi.System(q, v, lagrangian))
    assert [s.name for s in found] == GALILEI
    assert all(s.tested == "identically" for s in found)


@pytest.mark.parametrize("mass", [1e-20, 1e-30])
def test_a_test_particle_in_the_field_of_a_fixed_centre_turns(mass):
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, mass * (ca.sumsqr(v) / 2 + 1 / ca.norm_2(q)))
    assert names(system) == ["time translation", "rotation about z"]


def test_coordinates_that_do_not_occur_make_no_division_by_zero():
    """A body whose mass is zero is in no term; the others have the whole Galilei group."""
    q, v = vi.coordinates("x0", "y0", "x1", "y1", "x2", "y2")
    L = ca.sumsqr(v[:2]) / 2 + 1e-3 * ca.sumsqr(v[2:4]) / 2 + 1e-3 / ca.norm_2(q[:2] - q[2:4])
    names = [found.name for found in vi.symmetries(vi.System(q, v, L))]
    expected = {"time translation", "translation of x0, x1", "Galilean boost of x0, x1"}
    assert expected <= set(names)


ALONG_Y = ["translation along y", "Galilean boost along y"]


@pytest.mark.parametrize(
    ("step", "kept"),
    [
        (lambda x, y: ca.if_else(x > 1e4, y, 0), []),
        (lambda x, y: ca.sign(x), ALONG_Y),
        (lambda x, y: ca.floor(x) * y, []),
        (lambda x, y: ca.if_else(ca.logic_and(x > 1, x < 2), 3, 0), ALONG_Y),
        (lambda x, y: ca.fmod(x, 2) - x, ALONG_Y),
        (lambda x, y: 1e-6 * ca.if_else(ca.exp(x) > 1e3, 1, 0), ALONG_Y),
        (lambda x, y: ca.if_else(x**2 + y**2 < 4, 1, 0), ["rotation about z"]),
        (
            lambda x, y: ca.sign(x + y),
            ["translation along (-1, 1)", "Galilean boost along (-1, 1)"],
        ),
    ],
)
def test_a_step_breaks_what_leads_across_it(step, kept):
    """It has no slope that a search could see: on either side nothing depends on x."""
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 - step(q[0], q[1]))
    assert names(system) == ["time translation", *kept]
    with pytest.raises(vi.InputError, match=r"L jumps where|no symmetry"):
        vi.noether(system, [1, 0])


def test_a_potential_switched_on_with_a_step_breaks_the_translation_of_time():
    q, v = vi.coordinates("x", "y")
    t = vi.time()
    system = vi.System(q, v, ca.sumsqr(v) / 2 - ca.if_else(t > 1, q[1], 0), t=t)
    assert names(system) == ["translation along x", "Galilean boost along x"]


@pytest.mark.parametrize(
    "potential",
    [
        lambda x, y: ca.if_else(x > 3, 1, 0) + ca.if_else(x <= 3, 1, 0),
        lambda x, y: ca.if_else(x > 3, 0, 0 * x),
    ],
)
def test_conditions_without_a_jump_break_nothing(potential):
    q, v = vi.coordinates("x", "y")
    found = vi.symmetries(vi.System(q, v, ca.sumsqr(v) / 2 - potential(q[0], q[1])))
    assert [s.name for s in found] == GALILEI
    assert not found.note
    assert vi.noether(vi.System(q, v, ca.sumsqr(v) / 2 - potential(q[0], q[1])), [1, 0])
