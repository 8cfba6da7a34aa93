"""Elements: round trips to round-off for all conics, constant along Kepler's motions; encounters
and collisions located with the rule's accuracy.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

RNG = np.random.default_rng(5)
COUNT = 2000
KINDS = {
    "ellipses": (RNG.uniform(0, 0.9, COUNT), RNG.uniform(0.1, 30, COUNT), np.pi),
    "all but circles": (RNG.uniform(0, 1e-12, COUNT), np.ones(COUNT), np.pi),
    "all but flat": (RNG.uniform(0, 0.5, COUNT), np.ones(COUNT), 1e-10),
    "hyperbolas": (RNG.uniform(1.05, 4, COUNT), -RNG.uniform(0.1, 30, COUNT), np.pi),
}


@pytest.mark.parametrize("kind", KINDS)
def test_elements_make_a_round_trip_to_round_off(kind):
    e, a, tilt = KINDS[kind]
    inclination = tilt * RNG.uniform(0, 1, COUNT)
    node, pericentre = RNG.uniform(0, 2 * np.pi, (2, COUNT))
    mean = RNG.uniform(-8, 8, COUNT) if kind == "hyperbolas" else RNG.uniform(0, 6.28, COUNT)
    given = (a, e, inclination, node, pericentre, mean)
    r, v = vi.orbits.kepler_state(*given, mu=1.3)
    found = vi.orbits.kepler_elements(r, v, 1.3)
    again = vi.orbits.kepler_state(*found, mu=1.3)
    for x, y in zip((r, v), again, strict=True):
        far = np.linalg.norm(x - y, axis=-1) / np.linalg.norm(x, axis=-1)
        assert far.max() < 1e-14
    assert np.abs(found.a / a - 1).max() < 4e-14 and np.abs(found.e - e).max() < 1e-14
    assert np.abs(np.sin((found.inclination - inclination) / 2)).max() < 1e-14
    if kind in ("ellipses", "hyperbolas"):
        well = (e > 0.1) & (np.sin(inclination) > 0.1)
        for one, other in ((found.node, node), (found.pericentre, pericentre)):
            assert np.abs(np.sin((one - other)[well] / 2)).max() < 1e-13


def test_keplers_elements_are_constant_and_the_mean_anomaly_grows_evenly():
    model = vi.models.two_body(e=0.5)
    motion = vi.simulate(model.system, vi.gauss(8), **model.start)
    found = vi.orbits.osculating_elements(motion)
    for constant in (found.a, found.e, found.inclination, np.exp(1j * found.pericentre)):
        assert np.abs(constant - constant[0]).max() < 1e-11
    mean = np.unwrap(found.mean_anomaly[:, 0])
    rate = np.polyfit(motion.t, mean, 1)[0]
    assert rate == pytest.approx(found.mean_motion[0, 0], rel=1e-11)
    assert found.period[0, 0] == pytest.approx(2 * np.pi / rate, rel=1e-11)


def test_a_model_of_the_planets_has_the_elements_that_it_is_made_of():
    from varint.models.planets import PLANETS

    model = vi.models.solar_system()
    motion = vi.simulate(model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=5.0, steps=1)
    names = ["Sun", *PLANETS]
    found = vi.orbits.osculating_elements(motion, names=names)
    for i, (_, a, e, inclination, longitude, pericentre, _) in enumerate(PLANETS.values()):
        assert found.a[0, i] == pytest.approx(a, rel=1e-13)
        assert found.e[0, i] == pytest.approx(e, abs=1e-14)
        assert np.degrees(found.inclination[0, i]) == pytest.approx(abs(inclination), abs=1e-11)
        for have, want in (
            (found.mean_longitude, longitude),
            (found.longitude_of_pericentre, pericentre),
        ):
            off = np.degrees(have[0, i]) - want
            assert abs((off + 180) % 360 - 180) < 1e-9
    assert found.of("Earth").a.shape == (2,) and found.centre == "Sun"
    assert np.abs(model.system.momentum.numel()) == 27


@pytest.mark.long
def test_eight_planets_keep_their_axes_for_1e8_days(tmp_path):
    """While Jupiter and Saturn exchange eccentricity every 55,000 years or so."""
    model = vi.models.solar_system()
    motion = vi.simulate(
        model.system,
        vi.gauss(8),
        q0=model.q0,
        v0=model.v0,
        h=20.0,
        steps=5_000_000,
        save_every=2000,
        checkpoint=tmp_path / "planets",
    )
    found = vi.orbits.jacobi_elements(motion)
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 1e-10
    assert (np.ptp(found.a, axis=0) < 0.02 * found.a[0]).all()
    exchanged = found.of("6").e, found.of("7").e
    assert np.ptp(exchanged[1]) > 0.06 and np.corrcoef(*exchanged)[0, 1] < -0.9
    saturn = vi.orbits.naff(found.t, exchanged[1], 3)
    slow = saturn.frequencies[saturn.frequencies > 0][0]
    assert 45_000 < 2 * np.pi / slow / 365.25 < 65_000


def test_jacobis_elements_of_a_hierarchy_are_kepler_orbits_about_what_is_inside():
    """Three bodies, the outer one far away: its orbit about the centre of the pair is steady."""
    inner = vi.orbits.kepler_state(1.0, 0.1, mu=2.0)
    outer = vi.orbits.kepler_state(200.0, 0.2, mean_anomaly=1.0, mu=2.5)
    q0 = np.array([-inner[0] / 2, inner[0] / 2, outer[0]])[:, :2].ravel()
    v0 = np.array([-inner[1] / 2, inner[1] / 2, outer[1]])[:, :2].ravel()
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
    c, places = vi.Parameters(m=[1.0, 1.0, 0.5], G=1.0), ca.vertsplit(q, 2)
    kinetic = sum(c.m[i] * ca.sumsqr(w) / 2 for i, w in enumerate(ca.vertsplit(v, 2)))
    pull = sum(
        c.G * c.m[i] * c.m[j] / ca.norm_2(places[i] - places[j])
        for i, j in ((0, 1), (0, 2), (1, 2))
    )
    system = vi.System(q, v, kinetic + pull, params=c)
    motion = vi.simulate(system, vi.gauss(8), q0=q0, v0=v0, h=0.2, steps=500)
    found = vi.orbits.jacobi_elements(motion, order=["1", "2", "3"])
    assert found.names == ("2", "3") and np.allclose(found.mu, [2.0, 2.5])
    assert np.allclose(found.of("3").a, 200.0, rtol=1e-4)
    about_one = vi.orbits.osculating_elements(motion, centre="1").of("3").a
    assert np.ptp(about_one) > 100 * np.ptp(found.of("3").a)


def test_test_particles_cost_no_pairs_and_have_elements_like_any_body():
    """Two asteroids without mass: their elements about the Sun, Jupiter's orbit untouched."""
    q, v = vi.coordinates(*(f"{x}{i}" for i in range(1, 5) for x in "xy"))
    c, places = vi.Parameters(m=[1.0, 1e-3, 0.0, 0.0], G=1.0), ca.vertsplit(q, 2)
    kinetic = sum(c.m[i] * ca.sumsqr(w) / 2 for i, w in enumerate(ca.vertsplit(v, 2)))
    pull = sum(
        c.G * c.m[i] * c.m[j] / ca.norm_2(places[i] - places[j]) for i in range(4) for j in range(i)
    )
    light = vi.massless_limit(vi.System(q, v, kinetic + pull, params=c), c.m[2:])
    assert not ca.depends_on(light.force[4:6], q[6:])  # nothing between the two
    states = [vi.orbits.kepler_state(a, 0.05, mean_anomaly=a, mu=1.001) for a in (1.0, 0.3, 0.45)]
    q0 = np.concatenate([[0, 0], *(r[:2] for r, _ in states)])
    v0 = np.concatenate([[0, 0], *(w[:2] for _, w in states)])
    motion = vi.simulate(light, vi.gauss(8), q0=q0, v0=v0, h=0.05, steps=2000)
    found = vi.orbits.osculating_elements(motion)
    assert np.ptp(found.of("2").a) < 1e-11
    assert 1e-5 < np.ptp(found.of("3").a) < 1e-2 < np.ptp(found.of("3").mean_anomaly)


def flyby() -> vi.System:
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    apart = ca.norm_2(q[:2] - q[2:])
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / apart)


def test_an_encounter_is_as_near_and_as_fast_as_its_hyperbola():
    """Two unit masses: μ = 2, pericentre q = |a| (e − 1), speed √(μ (2/q + 1/|a|))."""
    a, e = -1.5, 1.2
    r, w = vi.orbits.kepler_state(a, e, mean_anomaly=-6.0, mu=2.0)
    q0, v0 = np.append(-r[:2], r[:2]) / 2, np.append(-w[:2], w[:2]) / 2
    system = flyby()
    options = dict(q0=q0, v0=v0, h=0.02, steps=1000)
    watched = vi.orbits.approaches(system, 1.0)
    motion = vi.simulate(system, vi.gauss(8), **options, save_every=500, events=watched)
    found = vi.orbits.encounters(motion, 1.0)
    nearest = -a * (e - 1)
    rate = np.sqrt(2.0 / abs(a) ** 3)
    assert found.pairs == ("1–2",) and found.distance[0] == pytest.approx(nearest, rel=1e-9)
    assert found.speed[0] == pytest.approx(np.sqrt(2 * (2 / nearest + 1 / 1.5)), rel=1e-9)
    assert found.t[0] == pytest.approx(6.0 / rate, abs=1e-9)
    assert found.left[0] - found.t[0] == pytest.approx(found.t[0] - found.entered[0], abs=1e-8)
    assert "1–2" in str(found) and len(found) == 1


@pytest.mark.parametrize("save_every", [1, 100])
def test_encounters_of_runs_that_watched_for_none_are_those_of_runs_that_did(save_every):
    """They came out as none, whatever the run had met."""
    model = vi.models.pythagorean_three_body()
    run = dict(q0=model.q0, v0=model.v0, h=5e-4, duration=4.0, save_every=save_every)
    watched = vi.orbits.approaches(model.system, 0.2)
    told = vi.orbits.encounters(vi.simulate(model.system, vi.gauss(8), **run, events=watched), 0.2)
    found = vi.orbits.encounters(vi.simulate(model.system, vi.gauss(8), **run), 0.2)
    assert found.pairs == told.pairs == ("2–3", "2–3")
    for name in ("entered", "left", "t", "distance", "speed"):
        assert getattr(found, name) == pytest.approx(getattr(told, name), rel=1e-9)


def test_a_collision_ends_the_run_where_the_surfaces_touch():
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    q0, v0 = [0, 0, 3, 0, 0, 7], [1, 0, 0, 0, 0, 0]
    for radii, touch in ((0.5, 2.0), ([0.25, 0.5, 1.0], 2.25)):
        motion = vi.simulate(
            free,
            vi.gauss(2),
            q0=q0,
            v0=v0,
            h=0.3,
            steps=20,
            until=(vi.orbits.collisions(free, radii), -1),
        )
        assert motion.t[-1] == pytest.approx(touch, abs=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda m: vi.orbits.osculating_elements(m),
        lambda m: vi.orbits.megno(m),
        lambda m: vi.orbits.sali(m),
        lambda m: vi.orbits.lyapunov_spectrum(m, 2),
        lambda m: vi.orbits.frequencies(m, m.system.q[0], 3),
        lambda m: vi.orbits.poincare_section(m, m.system.q[1], show=m.system.q[:2].elements()),
        lambda m: vi.orbits.frequency_map([m], [m.system.q[0], m.system.q[1]]),
        lambda m: vi.orbits.encounters(m, 0.1),
    ],
)
def test_results_come_back_from_their_files_and_draw_themselves(make, tmp_path):
    model = vi.models.two_body(e=0.5)
    start = dict(q0=model.q0, v0=model.v0, h=model.h, steps=300)
    result = make(vi.simulate(model.system, vi.gauss(6), **start))
    result.save(tmp_path / "one")
    again = vi.load(tmp_path / "one.npz")
    assert type(again) is type(result)
    for name, value in vars(result).items():
        one, other = np.asarray(value), np.asarray(getattr(again, name))
        assert one.shape == other.shape, name
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name
    if hasattr(result, "plot"):
        result.plot()


def test_a_file_that_is_not_whole_is_refused(tmp_path):
    from varint.numerics.archive import write_archive

    for header, words in (
        ({"kind": "Nothing"}, "known"),
        ({"kind": "Megno", "words": {}}, "t of Megno is missing"),
        ({"kind": "Alignment", "words": {"count": "two"}}, "missing"),
    ):
        with (tmp_path / "x.npz").open("wb") as file:
            write_archive(file, {"format": "varint orbits 1"} | header, {}, compress=False)
        with pytest.raises(vi.InputError, match=words):
            vi.load(tmp_path / "x.npz")


def test_bad_input_is_refused_in_words():
    model = vi.models.two_body()
    motion = vi.simulate(model.system, vi.gauss(4), q0=model.q0, v0=model.v0, h=0.1, steps=2)
    spring = vi.models.henon_heiles()
    other = vi.simulate(spring.system, q0=spring.q0, v0=spring.v0, h=0.1, steps=2)
    angle = vi.models.pendulum()
    turning = vi.simulate(angle.system, q0=angle.q0, v0=angle.v0, h=0.1, steps=2)
    elements = vi.orbits.osculating_elements
    for work, words in (
        (lambda: elements(turning), "bodies of this scene are not known"),
        (lambda: elements(other), "two bodies"),
        (lambda: elements(motion, masses=[1, 2, 3]), "masses must be 2"),
        (lambda: elements(motion, centre="sun"), "unknown centre"),
        (lambda: elements(motion, G=-1.0), "G must be a positive"),
        (lambda: elements(motion, names=["a"]), "names must be 2"),
        (lambda: elements(motion).of("9"), "unknown body"),
        (lambda: vi.orbits.jacobi_elements(motion, order=["1"]), "every body once"),
        (lambda: vi.orbits.kepler_elements([1, 0, 0], [1, 0, 0], 1.0), "along a line"),
        (lambda: vi.orbits.kepler_elements([1, 0, 0], [0, 2**0.5, 0], 1.0), "parabola"),
        (lambda: vi.orbits.kepler_elements([1, 0, 0], [0, 1, 0], -1.0), "mu must be positive"),
        (lambda: vi.orbits.kepler_state(1.0, 1.5, mu=1.0), "ellipses have"),
        (lambda: vi.orbits.approaches(model.system, -1.0), "positive"),
        (lambda: vi.orbits.approaches(model.system, 0.0), "positive distance"),
        (lambda: vi.orbits.collisions(angle.system, 1.0), "bodies of this scene"),
    ):
        with pytest.raises(vi.InputError, match=words):
            work()
