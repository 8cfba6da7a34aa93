"""Multipliers against published ones and closed forms; those of integrals are told apart."""

import numpy as np
import pytest
from orbit_scenes import springs
from references import entries

import varint as vi
from varint import orbits
from varint.orbits.graded import graded_spectrum
from varint.orbits.shooting import linearise, runs


@pytest.fixture(scope="module")
def eight():
    model = vi.models.figure_eight()
    return orbits.periodic(model.system, (model.q0, model.v0), period=vi.models.FIGURE_EIGHT_PERIOD)


def test_the_figure_eight_is_stable_with_the_published_multipliers(eight):
    of = orbits.floquet(eight)
    turns = np.sort(np.abs(np.angle(of.multipliers)))[::2] / (2 * np.pi)
    assert np.abs(turns - entries("orbits")["figure-eight"]["reference"]["turns"]).max() < 5e-11
    # Simó, Contemporary Mathematics 292 (2002) 209, from memory: no copy of it was found
    assert np.abs(turns - [0.00842272, 0.29809253]).max() < 5e-9
    assert np.abs(np.abs(of.multipliers) - 1).max() < 1e-11
    assert of.stable and of.verdict.startswith("linearly stable")
    assert of.trivial == 8 and of.blocks == 4  # energy, momentum, angular momentum
    assert sorted(of.signatures) == [-1, -1, 1, 1]
    assert "4 Jordan blocks of size 2" in str(of) and "<th>" in of._repr_html_()


def test_the_monodromy_is_symplectic_to_round_off(eight):
    phi = eight.monodromy
    n = len(phi) // 2
    form = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    size = np.linalg.norm(phi, 2)
    assert np.abs(phi.T @ form @ phi - form).max() < 1e-14 * size**2
    whole = eight.motion.transition_matrix()
    assert np.abs(whole - phi).max() < 1e-11 * size


def test_the_eigenvalues_of_the_whole_matrix_are_split_by_rounding_those_of_the_reduced_are_not(
    eight,
):
    ones = np.sort(np.abs(np.linalg.eigvals(eight.monodromy) - 1))[:8]
    assert ones.max() > 1e-9  # what the reduction is for
    finer = orbits.periodic(
        eight.system, eight, period=eight.period, steps=2 * eight.steps, segments=1
    )
    near = [np.sort_complex(x.floquet.multipliers) for x in (eight, finer)]
    assert np.abs(near[0] - near[1]).max() < 1e-10


def test_an_orbit_of_kepler_has_no_multipliers_of_its_own():
    model = vi.models.kepler()
    orbit = orbits.periodic(model.system, (model.q0, model.v0), period=2 * np.pi * 1.01)
    of = orbit.floquet
    assert of.trivial == 4 and not len(of.multipliers)
    assert "; 1 Jordan block of size 2" in str(of)
    assert of.blocks == 1  # the period goes with the energy; the perihelion stays
    assert of.stable


@pytest.mark.long
def test_signatures_tell_oscillators_of_negative_energy():
    index = np.cos(2 * np.pi * np.sqrt(2))
    for signs in ([1, 1], [1, -1]):
        system = springs(1.0, 2.0, signs=signs)
        orbit = orbits.periodic(system, ([1.0, 0.0], [0.0, 0.0]), period=6.2, energy=0.5, steps=64)
        of = orbit.floquet
        assert of.indices == pytest.approx([index], rel=1e-12)
        # √2 turns: e^{iωT} lies at 149 degrees
        ahead = of.signatures[int(np.argmin(np.abs(np.angle(of.multipliers) - 2.6026)))]
        assert ahead == signs[1]


def test_a_product_of_maps_keeps_all_of_its_eigenvalues():
    rng = np.random.default_rng(4)
    bases = [np.linalg.qr(rng.normal(size=(5, 5)))[0] for _ in range(9)]
    wanted = np.array([1e12, 3e4, 1.0, 1e-5, 1e-13])
    maps = np.array(
        [
            b @ np.diag(wanted ** (1 / 9)) @ a.T
            for a, b in zip(bases, bases[1:] + bases[:1], strict=True)
        ]
    )
    found, vectors = graded_spectrum(maps)
    assert np.sort(found.real)[::-1] == pytest.approx(wanted, rel=1e-11)
    assert np.abs(np.abs(bases[0].T @ vectors.real).max(axis=0) - 1).max() < 1e-10
    plain = np.linalg.eigvals(np.linalg.multi_dot(maps[::-1]))
    assert np.abs(plain).min() > 1e-7  # multiplied out, round-off of 1e12 is all that is left


@pytest.mark.long
def test_the_ready_halo_orbit_closes_by_another_integrator():
    integrate = pytest.importorskip("scipy.integrate")
    model = vi.models.restricted_three_body()
    mu = float(model.system.defaults["mu"])

    def rate(t, y):
        place, speed = y[:3], y[3:]
        force = np.array([place[0] + 2 * speed[1], place[1] - 2 * speed[0], 0.0])
        for m, x in ((1 - mu, -mu), (mu, 1 - mu)):
            away = place - [x, 0, 0]
            force -= m * away / np.linalg.norm(away) ** 3
        return np.concatenate([speed, force])

    start = np.concatenate([model.q0, model.v0])
    run = integrate.solve_ivp(
        rate, (0, model.duration), start, method="DOP853", rtol=1e-13, atol=1e-15
    )
    assert np.abs(run.y[:, -1] - start).max() < 1e-12


def test_the_tangent_map_is_that_of_the_run(eight):
    at, shooting = eight.at, eight.shooting
    linear = linearise(shooting, at, runs(shooting, at), eight.units, None)
    step, rng = 1e-6, np.random.default_rng(0)
    direction = rng.normal(size=at.x.shape[1])
    ends = []
    for sign in (1, -1):
        moved = at._replace(x=at.x.copy())
        moved.x[0] += sign * step * direction
        ends.append(runs(shooting, moved)[0].x[-1])
    there = linear.frames[1 % len(at.x)]
    slope = there.onto @ (ends[0] - ends[1]) / (2 * step)
    found = linear.maps[0] @ linear.frames[0].onto @ direction
    assert np.abs(slope - found).max() < 1e-6 * np.abs(slope).max()


def test_only_orbits_have_multipliers():
    with pytest.raises(vi.InputError, match="takes an Orbit"):
        orbits.floquet(3.0)
