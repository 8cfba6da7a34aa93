"""Periodic orbits against closed forms, published data and independent integrators."""

import casadi as ca
import numpy as np
import pytest
from orbit_scenes import double_pendulum_held, pendulum, springs
from references import entries

import varint as vi
from varint import orbits
from varint.orbits.guess import guess_of
from varint.orbits.phase import integrals
from varint.orbits.settle import settled, settles
from varint.orbits.shooting import Shooting


@pytest.mark.parametrize("top, near", [(0.1, 1e-13), (2.5, 1e-13), (3.1, 1e-11)])
def test_a_pendulum_swings_in_its_elliptic_period(top, near):
    exact = vi.models.pendulum_period(top, 1.0)
    found = orbits.periodic(
        pendulum(), ([top * 1.01], [0.0]), period=0.97 * exact, energy=-np.cos(top)
    )
    assert found.period == pytest.approx(exact, rel=near)
    assert found.error_estimate < 1e-12 and found.residual < 1e-12
    held = orbits.periodic(pendulum(), ([top * 0.99], [0.0]), period=exact)
    assert held.energy == pytest.approx(-np.cos(top), abs=100 * near)


def test_a_turning_pendulum_closes_up_to_its_turn():
    found = orbits.periodic(
        pendulum(), ([0.0], [3.0]), period=3.0, energy=3.0, turns={"theta": -1 + 2}
    )
    assert found.period == pytest.approx(2.62205755429212, rel=1e-14)  # √2 K(1/√2)
    assert found.motion.q[-1, 0] == pytest.approx(2 * np.pi, rel=1e-14)


def test_the_period_is_held_or_found_and_the_nearest_orbit_is_near():
    system = pendulum()
    motion = vi.simulate(system, vi.gauss(6), q0=1.0, v0=0.0, h=0.05, duration=6.7)
    nearest = orbits.periodic(system, motion)
    away = np.abs(nearest.q0 - 1.0).max(), abs(nearest.period - 6.7)
    assert max(away) < 0.01 and nearest.residual < 1e-13
    assert nearest.period == pytest.approx(
        vi.models.pendulum_period(float(np.arccos(-nearest.energy)), 1.0), rel=1e-12
    )


def test_a_swing_in_space_on_a_rod_has_the_period_of_the_plane():
    system = vi.models.spherical_pendulum_cartesian().system
    exact = vi.models.pendulum_period(1.2, np.sqrt(9.81))
    q0 = [np.sin(1.2), 0.0, -np.cos(1.2)]
    found = orbits.periodic(
        system, (q0, np.zeros(3)), period=1.02 * exact, energy=-9.81 * np.cos(1.2)
    )
    assert found.period == pytest.approx(exact, rel=1e-12)
    assert np.abs(found.motion.value(system.constraint)).max() < 1e-13
    of = found.floquet
    # energy and angular momentum: as much as there is in two degrees of freedom
    assert of.trivial == 4 and not len(of.multipliers) and of.blocks == 2


@pytest.mark.long
def test_angles_and_constraints_give_one_orbit():
    angles = vi.models.double_pendulum().system
    first = orbits.normal_modes(angles, [0.0, 0.0]).orbit(1, 0.5)
    held = double_pendulum_held()
    q = first.q0
    places = np.array([np.sin(q[0]), -np.cos(q[0]), np.sin(q).sum(), -np.cos(q).sum()])
    slopes = np.array([np.cos(q[0]), np.sin(q[0])]) * first.v0[0]
    lower = np.array([np.cos(q[1]), np.sin(q[1])]) * first.v0[1]
    speeds = np.concatenate([slopes, slopes + lower])
    second = orbits.periodic(
        held, (places, speeds), period=first.period * 1.001, energy=first.energy
    )
    assert second.period == pytest.approx(first.period, rel=1e-12)
    both = [np.sort_complex(x.floquet.multipliers) for x in (first, second)]
    assert np.abs(both[0] - both[1]).max() < 1e-9


def test_the_figure_eight_closes_to_thirteen_digits():
    model = vi.models.figure_eight()
    eight = orbits.periodic(
        model.system, (model.q0, model.v0), period=vi.models.FIGURE_EIGHT_PERIOD
    )
    assert eight.residual < 1e-13 and eight.error_estimate < 1e-13
    published = entries("orbits")["figure-eight"]["reference"]
    x1, v3 = np.array(published["x1"]), np.array(published["v3"])
    start = np.concatenate([x1, -x1, [0, 0]]), np.concatenate([-v3 / 2, -v3 / 2, v3])
    refined = orbits.periodic(model.system, start, period=published["period"], energy=eight.energy)
    assert refined.residual < 1e-13 and refined.error_estimate < 1e-13
    assert refined.period == pytest.approx(published["period"], abs=1e-8)
    assert np.abs(refined.q0 - start[0]).max() < 2e-8
    assert np.abs(refined.v0 - start[1]).max() < 2e-8
    # the start of the model has more digits of the same orbit
    assert refined.period == pytest.approx(eight.period, abs=1e-12)
    assert np.abs(eight.q0 - model.q0).max() < 1e-13
    assert np.abs(eight.v0 - model.v0).max() < 1e-13
    third = eight.motion.at(eight.period / 3)  # choreography: each body takes the next one's place
    bodies = eight.q0.reshape(3, 2)
    assert np.abs(third.q.reshape(3, 2) - np.roll(bodies, 1, axis=0)).max() < 1e-12 or (
        np.abs(third.q.reshape(3, 2) - np.roll(bodies, -1, axis=0)).max() < 1e-12
    )


def test_a_limit_cycle_has_the_published_period():
    cycle = orbits.periodic(van_der_pol(1.0), ([2.0], [0.1]), period=6.5)
    # Amore, Boyd & Fernández, Applied Mathematics and Computation 343 (2019) 279
    assert cycle.period == pytest.approx(6.6632868593231301, rel=1e-13)
    # Liouville: the multiplier is the exponential of the mean divergence
    motion = cycle.motion
    mean = np.mean(1 - motion.q[:-1, 0] ** 2) * cycle.period
    [mu] = cycle.floquet.multipliers
    assert mu.real == pytest.approx(np.exp(mean), rel=1e-6)
    assert cycle.floquet.verdict == "asymptotically stable"
    assert cycle.integrals == {}


def van_der_pol(mu: float) -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, (v**2 - q**2) / 2, force=mu * (1 - q**2) * v)


def test_a_motion_is_followed_to_the_cycle_that_it_runs_into():
    """Stiff, and from far off the period: one turn of the cycle, from near the guess on."""
    stiff, (q0, v0, long) = van_der_pol(10.0), (1.0, 1.0, 22.0)
    guess = guess_of(stiff, ([q0], [v0]), long, None, 0.0, None)
    known = integrals(stiff, guess.c, guess.x[:1], None)
    shooting = Shooting(stiff, vi.gauss(6), 1, 1, 0.0, guess.shift, known)
    assert settles(shooting, guess)
    turn = settled(shooting, guess)
    assert turn.period == pytest.approx(19.0783695669, rel=1e-5)  # by SciPy's Radau method
    there = turn.motion.at(turn.motion.t[0] + turn.period)
    assert np.abs(there.q - turn.motion.q[0]).max() < 1e-3
    assert abs(turn.x[0] - q0) < 0.3 and turn.motion.duration >= turn.period


@pytest.mark.long
def test_a_stiff_limit_cycle_is_found_from_a_rough_guess():
    """Newton's method comes to nothing there. The period is that of SciPy's Radau method, between
    two tops.
    """
    from scipy.integrate import solve_ivp

    mu = 10.0
    cycle = orbits.periodic(van_der_pol(mu), ([1.0], [1.0]), period=22.0)

    def rate(t, x):
        return [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]]

    def top(t, x):
        return x[1]

    top.direction = -1
    known = solve_ivp(rate, (0, 45), [2.0, 0.0], "Radau", rtol=1e-9, atol=1e-9, events=top)
    assert cycle.period == pytest.approx(np.diff(known.t_events[0])[-1], rel=1e-6)
    assert cycle.residual < 1e-12 and cycle.error_estimate < 1e-11
    assert np.abs(cycle.floquet.multipliers).max() < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("mu", [20.0, 50.0, 100.0])
def test_limit_cycles_of_relaxation_have_their_asymptotic_period(mu):
    """(3 − 2 ln 2) μ + 3 α μ^{−1/3} − (2 ln μ)/(3 μ) − 1.3233/μ + …, α = 2.338107 (Dorodnicyn)."""
    cycle = orbits.periodic(van_der_pol(mu), ([1.0], [1.0]), period=1.5 * mu)
    known = (3 - 2 * np.log(2)) * mu + 3 * 2.338107 * mu ** (-1 / 3) - 2 * np.log(mu) / (3 * mu)
    assert abs(cycle.period - known) < 3 / mu
    assert cycle.residual < 1e-11 and cycle.error_estimate < 1e-11


def test_a_motion_that_comes_to_rest_is_no_cycle():
    q, v = vi.coordinates("x")
    damped = vi.System(q, v, (v**2 - q**2) / 2, force=-0.5 * v)
    with pytest.raises(vi.ConvergenceError, match=r"equilibrium|no periodic orbit"):
        orbits.periodic(damped, ([1.0], [0.0]), period=6.5)


@pytest.mark.long
def test_a_driven_oscillator_answers_with_the_steady_amplitude():
    q, v = vi.coordinates("x")
    t, c = vi.time(), vi.Parameters(Omega=0.8, gamma=0.3)
    driven = vi.System(
        q, v, (v**2 - q**2) / 2 + q * ca.cos(c.Omega * t), force=-c.gamma * v, t=t, params=c
    )
    answer = orbits.periodic(driven, ([0.0], [0.0]), period=2 * np.pi / 0.8)
    wave = 1 / (1 - 0.8**2 + 0.3j * 0.8)  # x = Re(wave e^{iΩt})
    assert answer.q0[0] == pytest.approx(wave.real, rel=1e-12)
    assert answer.v0[0] == pytest.approx((0.8j * wave).real, rel=1e-12)
    assert np.prod(answer.floquet.multipliers).real == pytest.approx(
        np.exp(-0.3 * answer.period), rel=1e-12
    )


def test_what_converges_to_rest_or_nowhere_says_so():
    with pytest.raises(vi.ConvergenceError, match="equilibrium"):
        orbits.periodic(pendulum(), ([0.3], [0.0]), period=5.0)  # below 2π there is none
    with pytest.raises(vi.ConvergenceError, match=r"no periodic orbit|equilibrium"):
        q, v = vi.coordinates("x")
        hill = vi.System(q, v, (v**2 + q**2) / 2)
        orbits.periodic(hill, ([1.0], [0.3]), period=1.0, energy=-0.3)


@pytest.mark.parametrize(
    "change, words",
    [
        (dict(period=None), "give period="),
        (dict(period=-1.0), "period must be positive"),
        (dict(tol=0.0), "tol must be"),
        (dict(steps=100, segments=7), "no multiple"),
        (dict(turns={"phi": 1}), "whole numbers for angles"),
        (dict(guess=([1.0, 2.0], [0.0])), "shape"),
        (dict(guess=3.0), "pair"),
        (dict(symmetries=["none"]), "those of this system"),
    ],
)
def test_what_is_no_problem_is_refused(change, words):
    given = dict(guess=([1.0], [0.0]), period=6.0) | change
    with pytest.raises(vi.InputError, match=words):
        orbits.periodic(pendulum(), given.pop("guess"), **given)


def test_scenes_without_a_flow_are_refused():
    model = vi.models.bouncing_ball()
    with pytest.raises(vi.InputError, match="without contacts"):
        orbits.periodic(model.system, (model.q0, model.v0), period=1.0)
    model = vi.models.cart_pole()
    with pytest.raises(vi.InputError, match="controls"):
        orbits.periodic(model.system, (model.q0, model.v0), period=1.0)
    q, v = vi.coordinates("x")
    damped = vi.System(q, v, (v**2 - q**2) / 2, force=-0.1 * v)
    with pytest.raises(vi.InputError, match="does not conserve"):
        orbits.periodic(damped, ([1.0], [0.0]), period=6.0, energy=0.5)


@pytest.mark.long
def test_many_segments_find_what_one_finds():
    system = springs(1.0, 2.0)
    guess = ([1.0, 0.0], [0.0, 0.0])
    one, four = (
        orbits.periodic(system, guess, period=6.2, energy=0.5, steps=48, segments=m) for m in (1, 4)
    )
    assert four.at.x.shape == (4, 4)
    assert one.period == pytest.approx(four.period, rel=1e-14)
    for found in (one, four):  # the phase is free
        circle = found.motion.q[:, 0] ** 2 + found.motion.v[:, 0] ** 2
        assert np.abs(circle - 1).max() < 1e-13


@pytest.mark.long
def test_arenstorfs_orbit_closes_with_its_published_start():
    model = vi.models.arenstorf()
    found = orbits.periodic(model.system, (model.q0, model.v0), period=vi.models.ARENSTORF_PERIOD)
    assert np.abs(found.q0 - model.q0).max() < 1e-12
    assert np.abs(found.v0 - model.v0).max() < 1e-9
    assert found.error_estimate < 1e-10


@pytest.mark.long
def test_a_relative_orbit_comes_back_turned():
    system = vi.models.spherical_pendulum_cartesian().system
    turn = vi.symmetries(system)["rotation about z"]
    [cone] = orbits.relative_equilibria(system, turn, [0.6, 0.0, -0.8], rate=3.8)
    modes = orbits.normal_modes(cone.system, cone)
    found = modes.orbit(0, 0.1)
    assert found.period == pytest.approx(modes.periods[0], rel=2e-3)
    # the same start at rest in space: after a period it is where it was, turned by Ω T
    motion = vi.simulate(
        system, vi.lobatto(5), q0=found.q0, p0=found.p0, duration=found.period, steps=found.steps
    )
    angle = float(found.parameters["rate"]) * found.period
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.abs(motion.q[-1, :2] - turned @ found.q0[:2]).max() < 1e-11
    assert np.abs(motion.q[-1, 2] - found.q0[2]) < 1e-12
    assert np.abs(motion.q[len(motion) // 2] - found.q0).max() > 0.1
