"""Multipliers against published ones and closed forms; those of integrals are told apart."""

import numpy as np
import pytest
from orbit_scenes import springs

import varint as vi
from varint import orbits
from varint.orbits.shooting import linearise, runs

# Howell, Celestial Mechanics 32 (1984) 53, table I: halo orbits about L1 for μ = 0.04, x, z, ẏ at
# the start, half the period, and the stability index that is not near 1 or −1 as printed
HOWELL = [
    (0.723268, 0.040000, 0.198019, 1.300177, 1181.69),
    (0.753700, 0.267595, 0.399909, 1.211253, 4.95816),
    (0.801125, 0.299382, 0.312474, 1.017241, 0.94834),
]


@pytest.fixture(scope="module")
def eight():
    model = vi.models.figure_eight()
    return orbits.periodic(model.system, (model.q0, model.v0), period=vi.models.FIGURE_EIGHT_PERIOD)


def test_the_figure_eight_is_stable_with_the_published_multipliers(eight):
    of = orbits.floquet(eight)
    # Simó, Contemporary Mathematics 292 (2002) 209: exp(±2πi ν), ν = 0.00842272, 0.29809253
    turns = np.sort(np.abs(np.angle(of.multipliers))) / (2 * np.pi)
    assert np.abs(turns[::2] - [0.00842272, 0.29809253]).max() < 5e-9
    assert np.abs(np.abs(of.multipliers) - 1).max() < 1e-11
    assert of.stable and of.verdict.startswith("linearly stable")
    assert of.trivial == 8 and of.blocks == 4  # energy, momentum, angular momentum
    assert sorted(of.signatures) == [-1, -1, 1, 1]
    assert "Jordan" in str(of) and "<th>" in of._repr_html_()


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


@pytest.mark.long
@pytest.mark.parametrize("row", HOWELL)
def test_halo_orbits_have_howells_periods_and_stability_indices(row):
    x, z, speed, half, index = row
    system = vi.models.restricted_three_body().system
    found = orbits.periodic(
        system, ([x, 0.0, z], [0.0, speed, 0.0]), period=2 * half, params=dict(mu=0.04)
    )
    # half the last digit of the start makes this much of the orbit, and more along it
    side = found.motion.q[np.abs(found.motion.q[:, 2]).argmax()]
    assert side[[0, 2]] == pytest.approx([x, z], abs=3e-6)
    values = found.floquet.indices
    assert np.abs(values - index).min() < 0.006 * max(1.0, index / 100)
    assert np.prod(found.floquet.multipliers).real == pytest.approx(1.0, rel=1e-8)


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
