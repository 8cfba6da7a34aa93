"""Families of driven scenes along the frequency of their drive: resonance curves with folds."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint import orbits

FRICTION, DRIVE = 0.1, 0.4


def duffing(wave) -> vi.System:
    """x'' + 0.1 x' + x + x³ = 0.4 times a wave of a phase and its frequency."""
    q, v, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(omega=0.5, friction=FRICTION, f=DRIVE)
    force = -c.friction * v + c.f * wave(c.omega, t)
    return vi.System(q, v, v**2 / 2 - q**2 / 2 - q**4 / 4, force=force, t=t, params=c)


def harmonic_balance(omega: float, x: np.ndarray) -> np.ndarray:
    """x at equal phases by all harmonics that they can hold, from a guess, by Newton's method."""
    n = len(x)
    k = 1j * np.fft.fftfreq(n, 1 / n)
    slope = np.real(np.fft.ifft(k[:, None] * np.fft.fft(np.eye(n), axis=0), axis=0)) * omega
    linear = slope @ slope + FRICTION * slope + np.eye(n)
    drive = DRIVE * np.cos(2 * np.pi * np.arange(n) / n)
    for _ in range(30):
        x = x - np.linalg.solve(linear + np.diag(3 * x**2), linear @ x + x**3 - drive)
    assert np.abs(linear @ x + x**3 - drive).max() < 1e-10
    return x


@pytest.fixture(scope="module")
def resonance():
    scene = duffing(lambda omega, t: ca.cos(omega * t))
    slow = orbits.periodic(scene, ([0.4], [0.0]), period=4 * np.pi)
    return orbits.family(slow, "omega", to=2.2, longest=0.3, most=200)


def test_the_period_goes_with_the_frequency_of_the_drive():
    scene = duffing(lambda omega, t: ca.cos(omega * t))
    slow = orbits.periodic(scene, ([0.4], [0.0]), period=4 * np.pi)
    short = orbits.family(slow, "omega", to=0.52, bifurcations=False)
    assert short.periods == pytest.approx(2 * np.pi / short.parameter("omega"), rel=1e-14)
    assert short.ended == "at omega=0.52" and short[-1].error_estimate < 1e-11
    n = 64
    phases = short[-1].motion.at(short[-1].period * np.arange(n) / n).q[:, 0]
    assert np.abs(phases - harmonic_balance(0.52, np.round(phases, 2))).max() < 1e-11


@pytest.mark.long
def test_resonance_folds_over_as_harmonic_balance_says(resonance):
    folds = [one for one in resonance.bifurcations if one.kind == "fold in omega"]
    assert len(folds) == 2 and folds[0].value > folds[1].value
    between = (resonance.values < folds[0].value) & (resonance.values > folds[1].value)
    assert (~resonance.stable[between]).any()  # the middle branch
    assert resonance.stable[0] and resonance.stable[-1]
    # the peak of one harmonic: δ ω a = f on the backbone ω² = 1 + ¾ a²
    top = max(np.abs(one.motion.q).max() for one in resonance)
    d2 = FRICTION**2
    peak = np.sqrt((np.sqrt(d2**2 + 3 * d2 * DRIVE**2) - d2) / (1.5 * d2))
    assert top == pytest.approx(peak, rel=0.03)
    for one in resonance[:: len(resonance) // 7]:
        n, omega = 96, float(one.parameters["omega"])
        phases = one.motion.at(one.period * np.arange(n) / n).q[:, 0]
        exact = harmonic_balance(omega, np.round(phases, 3))
        assert np.abs(phases - exact).max() < 1e-9


def test_a_drive_that_does_not_follow_the_parameter_is_refused():
    other = duffing(lambda omega, t: ca.cos(omega * t) + ca.cos(t / 2))
    one = orbits.periodic(other, ([0.4], [0.0]), period=4 * np.pi)
    with pytest.raises(vi.InputError, match="not periodic with the period"):
        orbits.family(one, "omega", to=0.6)
    along = orbits.family(one, "f", to=0.41)  # which moves no phase
    assert (along.periods == one.period).all()


@pytest.mark.parametrize("start", [0.3, -0.8, 1.7])
def test_poor_guesses_of_an_answer_to_a_drive_are_followed_to_it(start):
    """x″ + 0.1 x′ + x + x³ = 0.3 cos 1.2 t has one: from 0.3 Newton's method came to nothing."""
    q, v, t = *vi.coordinates("x"), vi.time()
    force = 0.3 * ca.cos(1.2 * t) - 0.1 * v
    spring = vi.System(q, v, v**2 / 2 - q**2 / 2 - q**4 / 4, force=force, t=t)
    found = orbits.periodic(spring, ([start], [0.0]), period=2 * np.pi / 1.2)
    long = vi.simulate(
        spring, vi.gauss(6), q0=0.0, v0=0.0, h=found.period / 64, steps=64 * 200, save_every=64
    )
    assert long.q[-1] == pytest.approx(found.q0, abs=1e-9)
    assert found.floquet.stable and found.residual < 1e-13


def test_a_drive_that_nothing_answers_is_said_to_have_no_orbit():
    """A push that turns a wheel ever faster against friction that is too weak to return it."""
    q, v, t = *vi.coordinates("x"), vi.time()
    wheel = vi.System(q, v, v**2 / 2, force=1 + ca.cos(t) - 0.01 * v, t=t)
    with pytest.raises(vi.ConvergenceError, match="no periodic orbit"):
        orbits.periodic(wheel, ([0.0], [0.0]), period=2 * np.pi)


@pytest.mark.parametrize("period", [2.0, 4.0, 7.0, 6.2])
def test_a_period_that_is_none_of_the_drive_is_refused(period):
    """Newton's method closes one such period, behind which the motion leaves."""
    scene = duffing(lambda omega, t: ca.cos(omega * t))
    with pytest.raises(vi.InputError, match=r"not the same that much later.*multiple of it"):
        orbits.periodic(scene, ([0.4], [0.0]), period=period, params=dict(omega=1.0))
    for many in (1, 3):
        found = orbits.periodic(
            scene, ([0.4], [0.0]), period=2 * np.pi * many, params=dict(omega=1.0)
        )
        assert found.residual < 1e-12


@pytest.mark.parametrize("period", [6.2832, 6.28, 18.8496])
def test_a_period_of_a_few_digits_is_that_of_the_drive(period):
    """It was refused with the advice to give all digits."""
    scene = duffing(lambda omega, t: ca.cos(omega * t))
    with pytest.warns(UserWarning, match=f"period={period} is taken for [0-9.]+, after which"):
        found = orbits.periodic(scene, ([0.4], [0.0]), period=period, params=dict(omega=1.0))
    many = round(period / (2 * np.pi))
    assert found.period == pytest.approx(2 * np.pi * many, rel=1e-14)
    assert found.residual < 1e-12


def test_drives_that_change_a_lagrangian_by_a_total_derivative_repeat():
    """(t³/3)' = t² is felt by nothing, t x' by momenta, which do not repeat with it."""
    q, v, t = *vi.coordinates("x"), vi.time()
    plain = v**2 / 2 - q**2
    kept = vi.System(q, v, plain + q * ca.cos(t) + t**2, t=t)
    assert orbits.periodic(kept, ([0.5], [0.0]), period=2 * np.pi).q0 == pytest.approx(1.0)
    lost = vi.System(q, v, plain + q * ca.cos(t) + t * v, t=t)
    with pytest.raises(vi.InputError, match="momenta or forces"):
        orbits.periodic(lost, ([0.5], [0.0]), period=2 * np.pi)
    turning = vi.System(q, v, v**2 / 2 + 0.1 * ca.cos(q - t), t=t)  # seen from what turns, at rest
    rolled = orbits.periodic(turning, ([0.1], [1.0]), period=2 * np.pi, turns={"x": 1})
    assert rolled.v0 == pytest.approx(1.0)
