"""Families of orbits against closed forms; folds and branch points where they belong."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from orbit_scenes import duffing, pendulum

import varint as vi
from varint import orbits
from varint.numerics.archive import read_archive, write_archive
from varint.orbits.bifurcations import Bifurcation
from varint.orbits.continuation import Curve, Direction


def duffing_period(energy):
    """4 ∫ dφ / √(1 + ½ A² (1 + cos² φ)) over a quarter, by the arithmetic-geometric mean."""
    top = -1 + np.sqrt(1 + 4 * energy)  # A²
    a, b = np.sqrt(1 + top), np.sqrt(1 + top / 2)
    for _ in range(12):
        a, b = (a + b) / 2, np.sqrt(a * b)
    return 2 * np.pi / a


@pytest.fixture(scope="module")
def backbone():
    first = orbits.normal_modes(duffing(), [0.0]).orbit(0)
    return orbits.family(first, to=5.0)


def test_duffings_backbone_is_that_of_elliptic_integrals(backbone):
    assert backbone[-1].energy == pytest.approx(5.0, rel=1e-13)
    assert len(backbone) > 10 and backbone.stable.all()
    for one in backbone:
        assert one.period == pytest.approx(duffing_period(one.energy), rel=1e-12)
    assert (np.diff(backbone.energies) > 0).all() and not backbone.bifurcations


def test_keplers_third_law_along_a_family():
    model = vi.models.kepler()
    k = float(model.system.defaults.get("k", 1.0))
    first = orbits.periodic(model.system, ([1.0, 0.0], [0.0, 1.1]), period=8.9, steps=160)
    found = orbits.family(first, "energy", to=0.5 * first.energy, longest=0.3)
    half_axis = -k / (2 * found.energies)
    constant = found.periods / half_axis**1.5
    assert np.ptp(found.energies) > 0.1
    assert np.abs(constant / (2 * np.pi) - 1).max() < 1e-12


@pytest.mark.long
def test_keplers_third_law_by_steps_of_the_familys_own_choice():
    """From a narrower ellipse, whose perihelion coarse steps would turn."""
    model = vi.models.kepler()
    k = float(model.system.defaults.get("k", 1.0))
    own = orbits.family(
        orbits.periodic(model.system, (model.q0, model.v0), period=2 * np.pi),
        to=-0.2,
        bifurcations=False,
    )
    third = own.periods / (2 * np.pi * (-k / (2 * own.energies)) ** 1.5)
    assert np.abs(third - 1).max() < 1e-12


def test_a_parameter_is_varied_at_held_energy():
    first = orbits.periodic(pendulum(), ([1.5], [0.0]), period=7.4, energy=0.0)
    found = orbits.family(first, "length", hold="energy", to=3.0)
    # E = 0 is a release from the height of the pivot, whatever the length
    exact = vi.models.pendulum_period(np.pi / 2, 1.0) * np.sqrt(found.values)
    assert np.abs(found.periods / exact - 1).max() < 1e-12
    assert found.values[-1] == 3.0 and found.parameter("g")[-1] == 1.0
    shorter = orbits.family(first, "length", hold="period", to=0.5)
    assert np.ptp(shorter.periods) < 1e-12 and np.ptp(shorter.energies) > 0.1


def test_families_end_at_the_equilibrium_to_which_their_orbits_shrink():
    """Two wells, off the origin: small orbits of the period 2π/√(2k) where it is held, from either
    side; of Kepler's circles, that shrink, too, there is no end.
    """
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=1.0)
    wells = vi.System(q, v, v**2 / 2 - c.k * (q**2 - 1) ** 2 / 4, params=c)
    first = orbits.periodic(wells, ([1.3], [0.0]), period=4.7, energy=0.69**2 / 4)
    held = orbits.family(first, along="k", increasing=False)
    assert held.ended == "where its orbits shrink to an equilibrium"
    assert held.values[-1] == pytest.approx((2 * np.pi / first.period) ** 2 / 2, rel=1e-6)
    assert not held.bifurcations
    free = orbits.family(first, increasing=False)
    assert free.ended == held.ended and len(free) < 60
    assert free.periods[-1] == pytest.approx(np.pi * np.sqrt(2), rel=1e-5)
    q, v = vi.coordinates("x", "y")
    planet = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    circle = orbits.periodic(planet, ([1.0, 0.0], [0.0, 1.0]), period=2 * np.pi)
    small = orbits.family(circle, to=-1000.0, most=110, bifurcations=False)
    assert small[-1].energy == pytest.approx(-1000.0)


@pytest.mark.long
def test_a_fold_in_the_period_is_located():
    # ½ x² − ¼ x⁴ + ⅙ x⁶ softens and then hardens: T has a maximum
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2 + q**4 / 4 - q**6 / 6)
    first = orbits.normal_modes(system, [0.0]).orbit(0, 0.05)
    found = orbits.family(first, "period", most=40)
    [fold] = [one for one in found.bifurcations if one.kind == "fold in period"]

    def period(top):
        phi = (np.arange(400) + 0.5) * np.pi / 800  # x = A sin φ, midpoints: spectral
        x = top * np.sin(phi)
        ratio = 1 - (top**2 + x**2) / 2 + (top**4 + top**2 * x**2 + x**4) / 3
        return 4 * np.pi / 800 * (1 / np.sqrt(ratio)).sum()

    squares = np.roots([1 / 6, -1 / 4, 1 / 2, -fold.orbit.energy])
    [top] = [np.sqrt(x.real) for x in squares if abs(x.imag) < 1e-9]
    assert fold.orbit.period == pytest.approx(period(top), rel=1e-13)
    # a parabola through the largest of close ones
    a = top + 1e-3 * np.arange(-1, 2)
    below, here, above = (period(x) for x in a)
    best = top + 1e-3 * (below - above) / (2 * (below - 2 * here + above))
    assert below < here > above and abs(best - top) < 1e-5
    assert fold.orbit.energy > found.energies[0]
    with pytest.raises(vi.InputError, match="nothing branches off"):
        fold.branch()


@pytest.fixture(scope="module")
def lyapunov():
    system = vi.models.restricted_three_body().system
    [point] = orbits.equilibria(system, [0.84, 0.0, 0.0])
    modes = orbits.normal_modes(system, point)
    flat = int(np.argmin(np.abs(modes.shapes[:, 2]) + 10 * (modes.frequencies == 0)))
    return orbits.family(modes.orbit(flat, 5e-3), to=-1.57)


@pytest.mark.long
def test_halo_orbits_branch_off_the_planar_family(lyapunov):
    [point] = lyapunov.bifurcations
    assert point.kind == "branch point"
    assert np.abs(point.orbit.floquet.multipliers - 1).min() < 1e-3
    assert np.abs(point.orbit.motion.q[:, 2]).max() < 1e-9
    # JPL, three-body periodic orbits: halo orbits about L1 of Earth and Moon begin at C = 3.1744
    assert -2 * point.value == pytest.approx(3.1744, abs=1e-4)
    halo = point.branch()
    assert np.abs(halo.motion.q[:, 2]).max() > 1e-3
    assert halo.error_estimate < 1e-11
    mirror = point.branch(sign=-1)
    assert mirror.energy == pytest.approx(halo.energy, rel=1e-9)
    further = orbits.family(halo, most=12, bifurcations=False)
    heights = [np.abs(one.motion.q[:, 2]).max() for one in further]
    assert heights[-1] > 3 * heights[0]


@pytest.mark.long
def test_a_bouncing_weight_begins_to_swing_at_a_period_doubling(tmp_path):
    model = vi.models.spring_pendulum()
    system = model.system
    k = dict(k=36.0)  # bouncing more than twice as fast as swinging
    [rest] = orbits.equilibria(system, [0.0, -1.3], params=k)
    start = [0.0, float(rest.q[1]) - 0.12]
    bounce = orbits.periodic(system, (start, [0.0, 0.0]), period=2 * np.pi / 6, params=k)
    found = orbits.family(bounce, "k", hold="energy", to=24.0)
    doublings = [one for one in found.bifurcations if one.kind == "period doubling"]
    assert len(doublings) == 1 and 29.43 < doublings[0].value < 36  # 3 m g / ℓ, and where it began
    assert np.abs(doublings[0].orbit.floquet.multipliers + 1).max() < 1e-3
    assert found[0].floquet.stable and not found[-1].floquet.stable
    swinging = doublings[0].branch()
    found.save(tmp_path / "found.npz")
    [again] = [
        x for x in vi.load(tmp_path / "found.npz").bifurcations if x.kind == doublings[0].kind
    ]
    assert again.branch().period == pytest.approx(swinging.period, rel=1e-12)
    assert swinging.period == pytest.approx(2 * doublings[0].orbit.period, rel=1e-2)
    assert np.abs(swinging.motion.q[:, 0]).max() > 1e-3
    assert np.abs(bounce.motion.q[:, 0]).max() < 1e-12


def test_families_are_saved_and_loaded(backbone, tmp_path):
    backbone.save(tmp_path / "backbone")
    again = vi.load(tmp_path / "backbone.npz")
    assert (again.periods == backbone.periods).all() and again.along == "energy"
    assert (again[3].motion.q == backbone[3].motion.q).all()
    assert again.bifurcations == () and len(again) == len(backbone)
    backbone[-1].save(tmp_path / "one.npz")
    one = vi.load(tmp_path / "one.npz")
    assert one.period == backbone[-1].period and one.integrals == backbone[-1].integrals
    assert str(one) == str(backbone[-1])


def test_what_was_met_is_saved_with_a_family(backbone, tmp_path):
    curve, orbit = Curve("energy", None, None, 0.0), backbone[4]
    tangent = Direction(0.1 * orbit.at.x, -0.3, 0.0)
    met = Bifurcation("branch point", orbit, orbit.energy, tangent, curve)
    replace(backbone, bifurcations=(met,)).save(tmp_path / "family.npz")
    found = vi.load(tmp_path / "family.npz")
    [one] = found.bifurcations
    assert len(found) == len(backbone)
    assert (one.kind, one.value, repr(one.curve)) == (met.kind, met.value, repr(met.curve))
    assert (one.tangent.x == tangent.x).all() and one.tangent.period == -0.3
    assert (one.orbit.at.x == orbit.at.x).all() and repr(one) == repr(met)
    header, arrays = read_archive(tmp_path / "family.npz", "orbit")
    wrong = header["met"][0]
    for torn in (
        dict(met=header["met"] * 99),
        dict(met=[wrong | {"curve": wrong["curve"] | {"index": 7}}]),
        dict(met=[wrong | {"value": "much"}]),
    ):
        with (tmp_path / "torn.npz").open("wb") as file:
            write_archive(file, header | torn, arrays, compress=True)
        with pytest.raises(vi.InputError):
            vi.load(tmp_path / "torn.npz")


def test_torn_files_are_refused(backbone, tmp_path):
    backbone[0].save(tmp_path / "one.npz")
    header, arrays = read_archive(tmp_path / "one.npz", "orbit")
    for change in (
        dict(arrays=dict(arrays, orbit_0=arrays["orbit_0"][:-1])),
        dict(arrays=dict(arrays, orbit_0=np.nan * arrays["orbit_0"])),
        dict(header=header | {"kind": "spiral"}),
        dict(header=header | {"orbits": [{"segments": -1, "each": 3}]}),
        dict(header=header | {"orbits": []}),
    ):
        given = dict(header=header, arrays=arrays) | change
        with (tmp_path / "torn.npz").open("wb") as file:
            write_archive(file, given["header"], given["arrays"], compress=True)
        with pytest.raises(vi.InputError):
            vi.load(tmp_path / "torn.npz")


def test_figures_show_what_varies_where_the_period_is_held():
    """Kepler's circles of one period in fields of different strength, and a spring that is driven
    at one frequency with different strengths: the period drew a level line.
    """
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(k=1.0)
    planet = vi.System(q, v, ca.sumsqr(v) / 2 + c.k / ca.norm_2(q), params=c)
    circle = orbits.periodic(planet, ([1.0, 0.0], [0.0, 1.0]), period=2 * np.pi)
    held = orbits.family(circle, along="k", to=2.0, bifurcations=False)
    drawn = held.plot().axes[0]
    assert drawn.get_ylabel() == "energy $H$" and np.ptp(held.energies) > 0.1
    low, high = drawn.get_ylim()
    assert low < held.energies.min() and held.energies.max() < high
    q, v, t = *vi.coordinates("x"), vi.time()
    f = vi.Parameters(f=1.0)
    spring = vi.System(q, v, v**2 / 2 - 2 * q**2, force=f.f * ca.cos(t) - v / 10, params=f, t=t)
    forced = orbits.periodic(spring, ([0.3], [0.0]), period=2 * np.pi)
    wider = orbits.family(forced, along="f", to=2.0, bifurcations=False)
    assert wider.plot().axes[0].get_ylabel() == "largest range"


def test_figures_show_the_family_and_its_orbits(backbone):
    axes = backbone.plot().axes
    assert axes[0].get_ylabel() == "period $T$" and len(axes[1].lines) > 5
    axes = backbone[-1].plot().axes
    assert len(axes) == 2 and axes[1].get_aspect() == 1.0
    for one in (backbone, backbone[0]):
        assert str(one) and "<table>" in one._repr_html_()


@pytest.mark.long
def test_figures_show_bifurcations_and_multipliers(lyapunov):
    axes = lyapunov.plot().axes
    assert any(line.get_label() == "branch point" for line in axes[0].lines)
    axes = lyapunov[-1].plot().axes
    assert len(axes) == 3 and "further out" in axes[-1].get_title()
    assert lyapunov[0].floquet.plot().axes[0].get_aspect() == 1.0


def test_what_is_no_family_is_refused(backbone):
    first = backbone[0]
    for change, words in (
        (dict(along="mu"), "neither 'energy' nor 'period'"),
        (dict(step=0.0), "must be positive"),
        (dict(most=1), "at least 2"),
    ):
        with pytest.raises(vi.InputError, match=words):
            orbits.family(first, **change)
    with pytest.raises(vi.InputError, match="takes an Orbit"):
        orbits.family("orbit")
    q, v = vi.coordinates("x")
    cycle = vi.System(q, v, (v**2 - q**2) / 2, force=(1 - q**2) * v)
    found = orbits.periodic(cycle, ([2.0], [0.1]), period=6.5)
    with pytest.raises(vi.InputError, match="does not conserve"):
        orbits.family(found)
    assert ca.SX(1).is_one()


@pytest.mark.long
def test_a_driven_spring_folds_over():
    q, v = vi.coordinates("x")
    t, c = vi.time(), vi.Parameters(F=0.1, gamma=0.1)
    lagrangian = (v**2 - q**2 - q**4 / 2) / 2 + c.F * q * ca.cos(1.2 * t)
    driven = vi.System(q, v, lagrangian, force=-c.gamma * v, t=t, params=c)
    first = orbits.periodic(driven, ([0.1], [0.0]), period=2 * np.pi / 1.2)
    found = orbits.family(first, "F", to=0.3)
    folds = [one for one in found.bifurcations if one.kind == "fold in F"]
    assert len(folds) == 2 and found.values[-1] == 0.3
    for one in folds:
        assert np.abs(one.orbit.floquet.multipliers - 1).min() < 1e-6
        assert np.prod(one.orbit.floquet.multipliers).real == pytest.approx(
            np.exp(-0.1 * one.orbit.period), rel=1e-10
        )
    assert folds[0].value > folds[1].value  # between them the response has three branches
    assert found[0].floquet.stable and found[-1].floquet.stable and not found.stable.all()


@pytest.mark.long
def test_the_straight_orbit_of_henon_and_heiles_bifurcates_where_it_is_published():
    system = vi.models.henon_heiles().system
    first = orbits.periodic(system, ([0.0, 0.3], [0.0, 0.0]), period=6.3, energy=0.04)
    found = orbits.family(first, to=0.1655)
    # Brack, Foundations of Physics 31 (2001) 209: A5 and A6 at these parts of the saddles' energy
    passes = [6 * one.value for one in found.bifurcations if one.kind == "branch point"]
    assert passes[:2] == pytest.approx([0.969309, 0.986709], abs=6e-7)
    assert np.abs(found[-1].motion.q[:, 0]).max() < 1e-9


def test_orbits_are_drawn_as_curves_between_their_nodes():
    q, v = vi.coordinates("x", "y")
    hill = ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2 - q[0] ** 2 * q[1] + q[1] ** 3 / 3
    bowl = vi.System(q, v, hill)
    orbit = orbits.periodic(bowl, ([0.0, 0.45], [0.3, 0.0]), period=6.0, energy=1 / 8)
    x, y = np.array(orbit.plot().axes[0].lines[0].get_data())
    chords = np.diff(np.array([x, y]), axis=1)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(chords[1], chords[0]))))
    assert len(x) > 400 and turned.max() < 0.05
    near = orbit.motion.at(orbit.motion.t[0] + orbit.period * np.array([0.31, 0.77])).q
    apart = [np.hypot(x - a, y - b).min() for a, b in near]
    assert max(apart) < 0.5 * np.hypot(*chords).max()
