"""Equilibria and relative equilibria against closed forms and published positions."""

import casadi as ca
import numpy as np
import pytest
from orbit_scenes import double_pendulum_held
from references import entries

import varint as vi
from varint import orbits
from varint.numerics.archive import read_archive, write_archive

EARTH_MOON = 0.01215058560962404


@pytest.fixture(scope="module")
def satellite():
    return vi.models.restricted_three_body().system


def euler_points(mu):
    """x of L1, L2, L3: roots of Euler's quintics for the distance from the nearer body."""
    inner = [1, -(3 - mu), 3 - 2 * mu, -mu, 2 * mu, -mu]
    outer = [1, 3 - mu, 3 - 2 * mu, -mu, -2 * mu, -mu]
    far = [1, 2 + mu, 1 + 2 * mu, -(1 - mu), -2 * (1 - mu), -(1 - mu)]
    real = [
        [x.real for x in np.roots(p) if abs(x.imag) < 1e-9 and x.real > 0][-1]
        for p in (inner, outer, far)
    ]
    return 1 - mu - real[0], 1 - mu + real[1], -mu - real[2]


def test_the_points_of_earth_and_moon_lie_where_they_are_published(satellite):
    near = [[0.8, 0, 0], [1.2, 0, 0], [-1.1, 0, 0], [0.5, 0.8, 0], [0.5, -0.8, 0]]
    found = orbits.equilibria(satellite, near, params=dict(mu=EARTH_MOON))
    at = np.array([one.q for one in found])
    printed = entries("orbits")["points of Earth and Moon"]["reference"]
    assert np.abs(at[:, :2] - list(printed.values())).max() < 4e-15
    assert np.abs(at[:3, 0] - euler_points(EARTH_MOON)).max() < 1e-13
    assert np.abs(at[3] - [0.5 - EARTH_MOON, np.sqrt(0.75), 0]).max() < 1e-14
    words = [x.split(":")[0] for x in found.verdicts]
    assert words == ["unstable"] * 3 + ["linearly stable"] * 2


@pytest.mark.parametrize("mu, calm", [(0.0385, True), (0.0386, False)])
def test_the_triangle_points_turn_unstable_at_rouths_mass_ratio(satellite, mu, calm):
    # 27 μ (1 − μ) = 1: μ = 0.0385209
    [point] = orbits.equilibria(satellite, [0.5, 0.86, 0], params=dict(mu=mu))
    modes = orbits.normal_modes(satellite, point)
    assert modes.verdict.startswith("linearly stable" if calm else "unstable")
    s = np.sqrt(np.roots([1, 1, 27 / 4 * mu * (1 - mu)]).astype(complex))
    flat = modes.exponents[np.abs(modes.shapes[:, 2]) < 0.5]
    for one in flat:
        assert np.abs(np.array([s, -s, s.conj(), -s.conj()]) - one).min() < 1e-10


def test_a_box_holds_every_equilibrium_once():
    system = vi.models.double_pendulum().system
    box = {"theta1": (-0.5, 3.5), "theta2": (-0.5, 3.5)}
    found = orbits.equilibria(system, box=box, starts=40)
    at = {tuple(np.round(one.q / np.pi, 9) + 0.0) for one in found}
    assert at == {(0, 0), (1, 0), (0, 1), (1, 1)}
    assert [one.energy for one in found] == sorted(one.energy for one in found)
    assert found.verdicts[0].startswith("stable") and found.verdicts[3].startswith("unstable")


def test_reactions_carry_the_weight():
    [hung] = orbits.equilibria(double_pendulum_held(), [0.1, -0.9, 0.0, -2.1])
    assert np.abs(hung.q - [0, -1, 0, -2]).max() < 1e-14
    # λ times the gradient of |r|² − 1: the upper rod holds two weights, the lower one one
    assert np.abs(2 * hung.multipliers + [2 * 9.81, 9.81]).max() < 1e-12


def test_a_bead_on_a_turning_hoop_leaves_the_bottom():
    q, v = vi.coordinates("theta")
    c = vi.Parameters(Omega=4.0, g=9.81)
    hoop = vi.System(q, v, (v**2 + c.Omega**2 * ca.sin(q) ** 2) / 2 + c.g * ca.cos(q), params=c)
    found = orbits.equilibria(hoop, [[0.01], [1.0]])
    bottom, side = (next(x for x in found if bool(x.q[0] > 0.1) is high) for high in (False, True))
    assert side.q[0] == pytest.approx(np.arccos(9.81 / 16), rel=1e-14)
    assert [orbits.normal_modes(hoop, x).verdict.split(":")[0] for x in (bottom, side)] == [
        "unstable",
        "stable",
    ]
    slow = orbits.equilibria(hoop, [0.1], params=dict(Omega=2.0))
    assert slow.verdicts[0].startswith("stable")


def test_the_table_prints_and_shows_in_notebooks():
    found = orbits.equilibria(vi.models.pendulum().system, [[0.1], [3.0]])
    assert str(found).splitlines()[1].startswith("0") and "unstable" in str(found)
    assert found._repr_html_().count("<tr>") == 3


def test_what_cannot_rest_is_refused():
    q, v = vi.coordinates("x")
    fall = vi.System(q, v, v**2 / 2 - 9.81 * q)
    with pytest.raises(vi.ConvergenceError, match="no equilibrium was found"):
        orbits.equilibria(fall, [0.0])
    t = vi.time()
    shaken = vi.System(q, v, v**2 / 2 - q**2 / 2 + q * ca.cos(t), t=t)
    with pytest.raises(vi.InputError, match="depends on time"):
        orbits.equilibria(shaken, [0.0])
    spring = vi.System(q, v, (v**2 - q**2) / 2)
    for wrong, words in (
        (dict(), "give guess="),
        (dict(guess=[0.0, 1.0]), "shape"),
        (dict(box={"y": (0, 1)}), "the coordinates are"),
        (dict(box=[[1.0, 0.0]]), "lower bound above"),
        (dict(box=[[1.0, 1.0]]), "is a point"),
        (dict(box=[[1.0, 0.0, 2.0]]), "must be"),
    ):
        with pytest.raises(vi.InputError, match=words):
            orbits.equilibria(spring, **wrong)
    with pytest.raises(vi.InputError, match="does not rest"):
        orbits.normal_modes(vi.models.pendulum().system, [1.0])


def test_a_conical_pendulum_is_a_relative_equilibrium():
    system = vi.models.spherical_pendulum_cartesian().system
    turn = vi.symmetries(system)["rotation about z"]
    start = [0.8, 0.0, -0.6]
    [cone] = orbits.relative_equilibria(system, turn, start, rate=4.0)
    low = 9.81 / 16  # cos θ = g / (ℓ Ω²)
    assert np.abs(cone.q - [np.sqrt(1 - low**2), 0, -low]).max() < 1e-13
    # small oscillations of the angle: ω² = Ω² (1 + 3 cos² θ)
    modes = orbits.normal_modes(cone.system, cone)
    assert modes.frequencies == pytest.approx([4 * np.sqrt(1 + 3 * low**2)], rel=1e-12)
    assert modes.verdict.startswith("stable") and modes.neutral == 0
    momentum = 4.0 * (1 - low**2)
    [again] = orbits.relative_equilibria(system, turn, start, momentum=momentum)
    assert float(again.parameters["rate"]) == pytest.approx(4.0, rel=1e-12)


@pytest.mark.parametrize("rate", [3.5, 5.0, 6.0, 8.0])
def test_fast_cones_are_found_not_the_rest_below(rate):
    """Newton's method without the rod's reaction at the start came to the pendulum that hangs."""
    system = vi.models.spherical_pendulum_cartesian().system
    turn = vi.symmetries(system)["rotation about z"]
    [cone] = orbits.relative_equilibria(system, turn, [0.8, 0.0, -0.6], rate=rate)
    assert cone.q[2] == pytest.approx(-9.81 / rate**2, rel=1e-12)


def test_lagranges_triangle_turns_rigidly_and_needs_one_large_mass():
    model = vi.models.lagrange_triangle()
    q0 = np.array([0.0, 0.0, 1.0, 0.0, 0.5, np.sqrt(0.75)])
    turn = vi.symmetries(model.system)["rotation about z"]
    words = []
    for m in ([1.0, 0.01, 0.01], [1.0, 1.0, 1.0]):
        m = np.array(m)
        centre = np.tile(m @ q0.reshape(3, 2) / m.sum(), 3)
        rate = np.sqrt(m.sum())  # Ω² = G M / a³
        [one] = orbits.relative_equilibria(
            model.system, turn, q0 - centre + 1e-3, rate=rate, params=dict(m=m)
        )
        bodies = one.q.reshape(3, 2)
        sides = [np.linalg.norm(bodies[i] - bodies[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
        assert sides == pytest.approx([1.0] * 3, rel=1e-11)
        words.append(orbits.normal_modes(one.system, one).verdict.split(":")[0])
    # Routh: 27 (m1 m2 + m2 m3 + m3 m1) < (m1 + m2 + m3)²
    assert words == ["linearly stable", "unstable"]


def test_frames_of_symmetries_that_do_not_suit_are_refused():
    q, v = vi.coordinates("x", "y")
    planet = vi.System(q, v, v.T @ v / 2 + 1 / (q.T @ q) ** 0.5)
    found = vi.symmetries(planet)
    with pytest.raises(vi.InputError, match="moves nothing in space"):
        orbits.corotating(planet, found["time translation"], 1.0)
    with pytest.raises(vi.InputError, match="one of this system"):
        orbits.corotating(planet, "rotation", 1.0)
    with pytest.raises(vi.InputError, match="give rate="):
        orbits.relative_equilibria(planet, found["rotation about z"], [1.0, 0.0])


def test_where_coordinates_describe_no_motions_is_told():
    """Euler's angles of a top that stands upright: a relative equilibrium with a singular mass."""
    q, v = vi.coordinates("phi", "theta", "psi")
    turning = (v[1] ** 2 + v[0] ** 2 * ca.sin(q[1]) ** 2) / 2
    spin = 0.3 * (v[2] + v[0] * ca.cos(q[1])) ** 2
    top = vi.System(q, v, turning + spin - 2 * ca.cos(q[1]))
    turn = vi.symmetries(top)["cyclic coordinate phi"]
    with pytest.warns(UserWarning, match="another one than was meant"):  # none is near the guess
        found = vi.orbits.relative_equilibria(top, turn, [0.0, 0.7, 0.0], rate=1.5)
    assert abs(np.sin(found[0].q[1])) < 1e-9
    assert "unknown: the coordinates describe no motions" in str(found)
    with pytest.raises(vi.InputError, match=r"mass matrix is singular at phi=.*Cartesian"):
        assert found.modes
    steady = vi.orbits.relative_equilibria(top, turn, [0.0, 2.2, 0.0], rate=3.0)
    assert np.cos(steady[0].q[1]) == pytest.approx(-2 / (0.4 * 9), rel=1e-12)


def tied() -> vi.System:
    """Two masses, one on an ellipse, the other on a rod below it."""
    q, v = vi.coordinates("x", "y", "X", "Y")
    c = vi.Parameters(g=9.81)
    rows = ca.vertcat(q[0] ** 2 / 4 + q[1] ** 2 - 1, ca.sumsqr(q[2:] - q[:2]) - 0.25)
    lagrangian = ca.sumsqr(v) / 2 - c.g * (q[1] + q[3])
    return vi.System(q, v, lagrangian, constraint=rows, params=c)


def test_equilibria_and_their_modes_are_saved_and_loaded(tmp_path):
    guesses = [[0.1, -1, 0, -1.5], [0.1, -1, 0, -0.5]]
    found = vi.orbits.equilibria(tied(), guesses, params=dict(g=4.0))
    found.save(tmp_path / "rest.npz")
    again = vi.load(tmp_path / "rest.npz")
    assert str(again) == str(found) and len(again) == 2
    for one, other in zip(again, found, strict=True):
        for name in ("q", "multipliers", "c"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
        assert one.residual == other.residual and one.energy == other.energy
    modes = vi.orbits.normal_modes(found[0].system, found[0])
    modes.save(tmp_path / "modes.npz")
    loaded = vi.load(tmp_path / "modes.npz")
    assert str(loaded) == str(modes) and np.array_equal(loaded.exponents, modes.exponents)


def test_torn_files_of_equilibria_are_refused(tmp_path):
    vi.orbits.equilibria(tied(), [0.1, -1, 0, -1.5]).save(tmp_path / "rest.npz")
    header, arrays = read_archive(tmp_path / "rest.npz", "equilibria")
    for change in (
        dict(q=arrays["q"][:, :-1]),
        dict(c=np.nan * arrays["c"]),
        dict(multipliers=np.zeros((2, 2))),
        {name: x[:0] for name, x in arrays.items()},
    ):
        with (tmp_path / "torn.npz").open("wb") as file:
            write_archive(file, header, arrays | change, compress=True)
        with pytest.raises(vi.InputError):
            vi.load(tmp_path / "torn.npz")


@pytest.mark.parametrize("box", [(-1, 1), (-2, 1), (-0.5, 3), (-10, 10)])
def test_places_without_stiffness_are_one_and_never_called_stable(box):
    """Newton's method comes near them, to some stiffness of either sign."""
    q, v = vi.coordinates("x")
    cube = q**3 - 3 * q**2 + 3 * q - 1  # (x − 1)³, where last digits decide
    for potential in (q**3 / 3, -(q**3) / 3, 5 * q**3, q**5, q**6, cube):
        found = orbits.equilibria(vi.System(q, v, v**2 / 2 - potential), box=[box], starts=30)
        assert [words.split(":")[0] for words in found.verdicts] == ["neutral"]
    soft = vi.System(q, v, v**2 / 2 - q**3 - 1e-6 * q**2)
    words = [x.split(":")[0] for x in orbits.equilibria(soft, box=[box], starts=30).verdicts]
    assert sorted(words) == ["stable", "unstable"]


def test_lines_of_equilibria_are_given_once():
    q, v = vi.coordinates("x", "y")
    free = orbits.equilibria(vi.System(q, v, ca.sumsqr(v) / 2), box=[(-1, 1), (-1, 1)])
    assert [x.split(":")[0] for x in free.verdicts] == ["neutral"]
    flat = vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 - q[1] ** 4)
    assert len(orbits.equilibria(flat, box=[(-1, 1), (-1, 1)])) == 1
    cart = ca.sumsqr(v) / 2 + v[0] * v[1] * ca.cos(q[1]) / 2 + ca.cos(q[1])
    found = orbits.equilibria(vi.System(q, v, cart), box=[(-1, 1), (-1, 4)])
    assert np.round(found[0].q[1], 9) == 0 and np.round(found[1].q[1], 9) == round(np.pi, 9)
    assert [x.split(":")[0] for x in found.verdicts] == ["stable", "unstable"]


def plane(potential):
    """Unit mass in a plane, under the potential of (x, y)."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential(*ca.vertsplit(q)))


@pytest.mark.parametrize(
    "potential, count, along",
    [
        (lambda x, y: (x**2 + y**2 - 1) ** 2, 2, ("x", "y")),  # the ring, and its centre
        (lambda x, y: (y - x**2) ** 2, 1, ("x", "y")),  # a bent valley
        (lambda x, y: x**4 - x**2, 3, ("y",)),  # a bead that nothing pushes along y
        (lambda x, y: x**3 + y**2, 1, ()),  # no stiffness, and alone
        (lambda x, y: (x**2 + y**2 - 1) ** 2 * ((x - 4) ** 2 + y**2 - 1) ** 2, 5, ("x", "y")),
    ],
)
def test_equilibria_that_fill_a_curve_are_given_once_and_say_so(potential, count, along):
    """They were listed one by one: 97 of a ring, 64 of a valley."""
    found = vi.orbits.equilibria(plane(potential), box=[(-2, 6), (-2, 2)])
    assert len(found) == count and found.goes_on[0] == along
    assert (f"one of many, which go on along {', '.join(along)}" in str(found)) == bool(along)


def test_an_equilibrium_near_a_guess_says_that_it_is_one_of_many():
    found = vi.orbits.equilibria(plane(lambda x, y: (y - x**2) ** 2), [0.5, 0.5])
    assert found.goes_on == (("x", "y"),)
    assert vi.orbits.equilibria(plane(lambda x, y: x**2 + y**2), [0.5, 0.5]).goes_on == ((),)
