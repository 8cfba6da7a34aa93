"""Noether's theorem: which symmetries are found."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from symmetric_scenes import central, gravity, particles, spring

import varint as vi
from varint.models import spring_cluster, two_body


def names(system: vi.System, **arguments) -> list[str]:
    return [s.name for s in vi.symmetries(system, **arguments)]


GALILEI_2D = [
    "time translation",
    "translation along x",
    "translation along y",
    "rotation about z",
    "Galilean boost along x",
    "Galilean boost along y",
]
GALILEI_3D = [
    "time translation",
    *(f"translation along {a}" for a in "xyz"),
    *(f"rotation about {a}" for a in "xyz"),
    *(f"Galilean boost along {a}" for a in "xyz"),
]


@pytest.mark.parametrize(
    ("axes", "expected"),
    [
        ("x", ["time translation", "translation along x", "Galilean boost along x"]),
        ("xy", GALILEI_2D),
        ("xyz", GALILEI_3D),
    ],
)
@pytest.mark.parametrize(
    "masses", [None, [1.0, 2.5, 0.3], [1.0, 1e-3, 1e-8]], ids=["equal", "distinct", "planets"]
)
def test_bodies_have_exactly_the_galilei_algebra(axes, expected, masses):
    assert names(particles(3, axes, gravity, masses)) == expected


def test_the_masses_may_be_parameters():
    assert names(two_body().system) == GALILEI_2D
    assert names(spring_cluster().system) == GALILEI_3D


def test_ten_bodies_in_space_have_ten_symmetries():
    assert names(particles(10, "xyz", gravity, np.linspace(1, 2, 10))) == GALILEI_3D


@pytest.mark.parametrize(("count", "axes"), [(2, "xy"), (3, "xy"), (3, "xyz"), (4, "x")])
def test_equal_springs_add_the_rotations_of_all_relative_coordinates(count, axes):
    d = len(axes)
    # the relative motion is an isotropic oscillator in so many dimensions
    internal = (count - 1) * d
    expected = 1 + 2 * d + internal * (internal - 1) // 2
    found = vi.symmetries(particles(count, axes, spring))
    assert len(found) == expected
    assert set({"x": GALILEI_2D[:2], "xy": GALILEI_2D, "xyz": GALILEI_3D}[axes]) <= {
        s.name for s in found
    }


def test_the_rotation_of_the_centre_of_mass_is_said_to_follow_from_the_others():
    assert "1 more conserve functions of these" in vi.symmetries(particles(3, "xy", gravity)).note


def test_kepler_has_time_and_rotation_only():
    assert names(central(gravity)) == ["time translation", "rotation about z"]
    assert len(names(central(gravity, "xyz"))) == 4


def test_a_displaced_centre_is_named():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q - ca.DM([1, -0.5])))
    assert names(system) == ["time translation", "rotation about z through (1, -0.5)"]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_the_isotropic_oscillator_has_the_rotations_of_its_dimension(n):
    q, v = vi.coordinates(*(f"q{i}" for i in range(n)))
    assert (
        len(vi.symmetries(vi.System(q, v, (ca.sumsqr(v) - ca.sumsqr(q)) / 2)))
        == 1 + n * (n - 1) // 2
    )


def test_the_anisotropic_oscillator_has_time_only():
    q, v = vi.coordinates("x", "y")
    assert names(vi.System(q, v, (ca.sumsqr(v) - q[0] ** 2 - 2 * q[1] ** 2) / 2)) == [
        "time translation"
    ]


def test_symmetries_of_special_parameter_values_are_found_at_these_values_only():
    q, v = vi.coordinates("x", "y")
    k = vi.Parameters(kx=1.0, ky=1.0)
    system = vi.System(q, v, (ca.sumsqr(v) - k.kx * q[0] ** 2 - k.ky * q[1] ** 2) / 2, params=k)
    general = vi.symmetries(system)
    assert [s.name for s in general] == ["time translation"]
    assert "1 more at the default parameters" in general.note
    assert names(system, params={}) == ["time translation", "rotation about z"]
    assert names(system, params=dict(kx=2.0)) == ["time translation"]


def test_unequal_masses_rotate_with_coefficients_that_are_functions_of_the_parameters():
    q, v = vi.coordinates("a", "b")
    c = vi.Parameters(m=1.0, M=2.0)
    system = vi.System(
        q,
        v,
        (c.m * v[0] ** 2 + c.M * v[1] ** 2) / 2 - (c.m * q[0] ** 2 + c.M * q[1] ** 2) ** 2,
        params=c,
    )
    turn = vi.symmetries(system)[1]
    value = ca.Function("xi", [q, c.m, c.M], [turn.xi])
    for m, big in ((1.0, 2.0), (0.7, 5.0)):
        xi = np.array(value([0.3, 0.4], m, big)).ravel()
        assert xi[0] / xi[1] == pytest.approx(-big * 0.4 / (m * 0.3), rel=1e-12)


def test_a_pendulum_on_a_cart_conserves_the_momentum_along_the_rail():
    system = vi.models.sliding_support().system
    found = vi.symmetries(system)
    assert [s.name for s in found] == ["time translation", "translation along X"]
    difference = ca.Function(
        "d", [system.q, system.v, system.c], [found[1].quantity - system.momentum[0]]
    )
    assert float(difference([0.3, 0.7], [1.1, -0.4], system.default_vector)) == 0


@pytest.mark.parametrize("gauge", ["symmetric", "landau"])
def test_a_uniform_magnetic_field_has_two_translations_with_gauge_and_a_rotation(gauge):
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.5, e=0.8, B=2.0)
    vector_potential = {"symmetric": (q[0] * v[1] - q[1] * v[0]) / 2, "landau": q[0] * v[1]}[gauge]
    system = vi.System(q, v, c.m * ca.sumsqr(v) / 2 + c.e * c.B * vector_potential, params=c)
    found = vi.symmetries(system)
    assert len(found) == 4
    guiding_centre = {0: c.m * v[0] - c.e * c.B * q[1], 1: c.m * v[1] + c.e * c.B * q[0]}
    for axis, name in enumerate("xy"):
        mine = next(s for s in found if s.name.endswith(f"translation along {name}"))
        f = ca.Function("d", [q, v, system.c], [mine.quantity - guiding_centre[axis]])
        assert abs(float(f([0.3, -0.7], [1.1, 0.4], [1.5, 0.8, 2.0]))) < 1e-14
    assert found[3].name == "rotation about z"
    assert any(s.name.startswith("magnetic") for s in found)


def test_uniform_gravity_keeps_the_translation_along_it_with_a_gauge_term_in_time():
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=2.0, g=9.81)
    found = vi.symmetries(vi.System(q, v, c.m * ca.sumsqr(v) / 2 - c.m * c.g * q[1], params=c))
    fall = found["translation along y"]
    t = fall.system.t
    assert (
        float(ca.Function("d", [t, fall.system.c], [fall.gauge + c.m * c.g * t])(0.7, [2.0, 9.81]))
        == 0
    )
    assert len(found) == 5


def test_a_rotating_frame_keeps_time_and_its_rotation():
    """Its translations turn with the frame, ξ = (cos Ωt, −sin Ωt): not affine in t with constant
    coefficients.
    """
    found = vi.symmetries(vi.models.turntable().system)
    assert [s.name for s in found] == ["time translation", "rotation about z"]


def test_a_rotating_potential_has_the_jacobi_integral():
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    c = vi.Parameters(Omega=0.7)
    a, b = ca.cos(c.Omega * t), ca.sin(c.Omega * t)
    x, y = a * q[0] + b * q[1], a * q[1] - b * q[0]
    system = vi.System(q, v, ca.sumsqr(v) / 2 - x**4 - x * y**2, params=c, t=t)
    (jacobi,) = vi.symmetries(system)
    expected = system.energy - c.Omega * (q[0] * v[1] - q[1] * v[0])
    f = ca.Function("d", [q, v, t, system.c], [jacobi.quantity - expected])
    assert abs(float(f([0.3, 0.4], [-1.0, 0.2], 0.6, 1.3))) < 1e-14


def test_the_damped_oscillator_of_caldirola_and_kanai_has_its_time_dependent_integral():
    system = vi.models.caldirola_kanai().system
    (found,) = vi.symmetries(system)
    assert not found.tau.is_zero() and not found.xi.is_zero() and found.conserved


def test_scalings_are_no_symmetries():
    q, v = vi.coordinates("x")
    assert names(vi.System(q, v, v**2 / 2 - 1 / q**2)) == ["time translation"]


@pytest.mark.parametrize(
    "lagrangian",
    [
        lambda q, v: -ca.sqrt(1 - ca.sumsqr(v)) + 1 / ca.norm_2(q),
        lambda q, v: ca.sumsqr(v) / 2 - ca.log(q[0]) * q[1],
        lambda q, v: ca.sumsqr(v) / 2 - ca.sqrt(q[0] - 0.5) - ca.acos(q[1] / 10),
    ],
    ids=["relativistic", "logarithm", "root"],
)
def test_points_outside_the_domain_are_drawn_again(lagrangian):
    q, v = vi.coordinates("x", "y")
    assert "time translation" in names(vi.System(q, v, lagrangian(q, v)))


def test_a_scene_that_is_defined_nowhere_near_the_origin_asks_for_a_point():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - ca.sqrt(q - 100))
    with pytest.raises(vi.InputError, match="near="):
        vi.symmetries(system)
    assert names(system, near=[130.0]) == ["time translation"]


def test_two_hundred_sites_are_searched_particle_by_particle_and_the_table_says_so():
    q, v = vi.coordinates(*(f"x{i}" for i in range(200)))
    found = vi.symmetries(vi.System(q, v, ca.sumsqr(v) / 2 - ca.sum1(ca.exp(q[:-1] - q[1:]))))
    assert [s.name for s in found] == [
        "time translation",
        "translation along x",
        "Galilean boost along x",
    ]
    assert "200 coordinates: of linear generators only those within single particles" in str(found)


def test_a_particle_apart_from_many_others_has_a_rotation_of_its_own():
    count = 15
    q, v = vi.coordinates(*(f"{a}{i}" for i in range(count) for a in "xyz"))
    r = ca.reshape(q, 3, count)
    chain = sum(ca.exp(-ca.sumsqr(r[:, i] - r[:, i + 1])) for i in range(count - 2))
    found = names(vi.System(q, v, ca.sumsqr(v) / 2 - chain - ca.sumsqr(r[:, -1]) ** 2))
    # time; translations, rotations and boosts of the chain, rotations of the one
    assert len(found) == 1 + 3 + 3 + 3 + 3
    assert all(f"rotation about {a}" in found for a in "xyz")


def test_uncoupled_pairs_of_many_coordinates_rotate_each():
    q, v = vi.coordinates(*(f"s{i}" for i in range(48)))
    wells = sum((i + 1) * ca.sumsqr(q[2 * i : 2 * i + 2]) ** 2 for i in range(24))
    found = names(vi.System(q, v, ca.sumsqr(v) / 2 - wells))
    assert found == [
        "time translation",
        *(f"rotation of s{2 * i} and s{2 * i + 1}" for i in range(24)),
    ]
