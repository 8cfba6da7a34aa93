"""Where motions from switch to switch end and what they are told of: arcs that end in rest, powers
that leave an order of their own, steps that are too long for a piece.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad

import varint as vi

TOL, RUB = 1e-9, 0.3


def test_arcs_that_become_shorter_and_shorter_end_in_rest():
    """x'' = −sign x − μ sign x': every half swing takes √((1−μ)/(1+μ)) of the one before."""
    q, v = vi.coordinates("x")
    scene = vi.System(q, v, v**2 / 2 - ca.fabs(q), force=-RUB * ca.sign(v))
    motion = vi.simulate(scene, q0=1.0, v0=0.0, duration=30.0)
    slow, fast = 1 - RUB, 1 + RUB
    out, back, shrink = 1 / fast, 1 / np.sqrt(slow * fast), np.sqrt(slow / fast)
    speed = np.sqrt(2 * slow)
    end = speed / slow + speed * (out + back) / (1 - shrink)
    assert motion.t[-2] == pytest.approx(end, abs=1e-9)
    assert motion.t[-1] == 30.0
    assert abs(motion.q[-1, 0]) < 1e-18
    assert motion.v[-1, 0] == 0.0
    # turning points: (1 − μ)/(1 + μ) of the one before
    turns = np.abs(motion.q[1:-1, 0])[np.abs(motion.v[1:-1, 0]) < 1e-15]
    assert turns[:20] == pytest.approx((slow / fast) ** np.arange(1, 21), rel=1e-9)
    assert motion.stats["error_estimate"] < TOL
    assert motion.at([20.0]).q[0, 0] == pytest.approx(0.0, abs=1e-18)


HERTZ = [
    (6e3, 1.5, 0.19, 1e-9),
    (5378.47, 1.25, 0.1388, 1e-9),
    (7.7e5, 2.5, 0.0785, 1e-10),
    (210.0, 0.5, 0.275, 1e-7),
]
QUADRATURE = 1e-11  # of the reference, relative


def falling_ball(stiff, power, height, by_potential):
    """A ball on K max(0, −y)ⁿ and, by quadrature, how long it falls and half of a contact."""
    g, deepest = 9.81, ((power + 1) * 9.81 * height / stiff) ** (1 / (power + 1))
    for _ in range(50):
        rest = g * (height + deepest) - stiff * deepest ** (power + 1) / (power + 1)
        deepest -= rest / (g - stiff * deepest**power)

    def speed(deep):
        return np.sqrt(2 * (g * (height + deep) - stiff * deep ** (power + 1) / (power + 1)))

    half, _ = quad(lambda s: 2 * deepest * s / speed(deepest * (1 - s * s)), 0, 1, epsabs=1e-15)
    q, v = vi.coordinates("y")
    pressed = ca.fmax(0, -q)
    potential = stiff * pressed ** (power + 1) / (power + 1)
    lagrangian = v**2 / 2 - g * q - (potential if by_potential else 0)
    force = None if by_potential else stiff * pressed**power
    return vi.System(q, v, lagrangian, force=force), np.sqrt(2 * height / g), half


@pytest.mark.parametrize("stiff, power, height, tol", HERTZ)
@pytest.mark.parametrize("by_potential", [False, True])
def test_steps_are_halved_towards_contacts_with_fractional_powers(
    stiff, power, height, tol, by_potential
):
    """One flight, one contact, and half a flight. Behind the contact's zero no polynomial follows
    tⁿ: by steps of one size 5,000 to 80,000 nodes were needed, by estimates up to 600 times below
    the error.
    """
    ball, falls, half = falling_ball(stiff, power, height, by_potential)
    motion = vi.simulate(ball, q0=height, v0=0.0, duration=2.5 * falls + 2 * half, tol=tol)
    off = abs(motion.q[-1, 0] - 0.75 * height) / height
    assert off <= motion.stats["error_estimate"] + QUADRATURE
    assert motion.stats["error_estimate"] <= tol and len(motion) < 250


@pytest.mark.parametrize("stiff, power, height, tol", HERTZ)
def test_halved_steps_show_what_lies_between_their_nodes(stiff, power, height, tol, tmp_path):
    """The energy beside both ends of the contact, the deepest place, and the same from a file."""
    ball, falls, half = falling_ball(stiff, power, height, True)
    motion = vi.simulate(
        ball, q0=height, v0=0.0, duration=2 * falls + 2 * half, tol=tol, events={"turns": ball.v}
    )
    beside = np.concatenate([half * 2.0 ** -np.arange(1, 30), [0.0]])
    times = np.concatenate([falls + beside, falls + 2 * half - beside])
    energy = motion.at(times).energy
    assert np.abs(energy / energy[-1] - 1).max() < 10 * tol
    turn = next(event for event in motion.events if event.time > falls / 2)
    assert turn.time == pytest.approx(falls + half, abs=10 * tol)
    motion.save(tmp_path / "ball.npz")
    assert np.array_equal(vi.load(tmp_path / "ball.npz").at(times).q, motion.at(times).q)


@pytest.mark.parametrize("power", [0.5, 1 / 3, 1.5])
def test_powers_of_sizes_are_halved_on_both_sides(power):
    """x'' = −x − sign(x) |x|ⁿ: what is zero at the switch is x on one side and −x on the other,
    and stiffness is infinite there for n < 1. The energy x'²/2 + x²/2 + |x|ⁿ⁺¹/(n + 1) is kept.
    """
    q, v = vi.coordinates("x")
    spring = -ca.sign(q) * ca.fabs(q) ** power
    scene = vi.System(q, v, v**2 / 2 - q**2 / 2, force=spring)
    motion = vi.simulate(scene, q0=1.2, v0=-0.3, duration=12.0)
    x, speed = motion.q[:, 0], motion.v[:, 0]
    energy = speed**2 / 2 + x**2 / 2 + np.abs(x) ** (power + 1) / (power + 1)
    assert np.abs(energy / energy[0] - 1).max() < 1e-9
    assert motion.stats["switches"] >= 5 and len(motion) < 1000


def test_two_balls_that_press_one_another_are_halved_as_well():
    """Newton's cradle of two: the second leaves with all of the momentum of the first, whatever
    the power, and the first one rests.
    """
    q, v = vi.coordinates("one", "other")
    pressed = ca.fmax(0, q[0] + 0.1 - q[1])
    cradle = vi.System(q, v, ca.dot(v, v) / 2 - 1e5 * pressed**2.5 / 2.5)
    motion = vi.simulate(cradle, q0=[-0.3, 0.0], v0=[1.0, 0.0], duration=1.0)
    assert np.abs(motion.v[-1] - [0, 1]).max() < 1e-9
    assert len(motion) < 150


def test_a_preloaded_spring_with_a_damper_comes_to_rest():
    """x'' = −sign(x) − x − x': its arcs shrink by ever less, and never end; over thirty units of
    time they were followed until there were too many.
    """
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, v**2 / 2 - ca.fabs(q) - q**2 / 2, force=-v)
    motion = vi.simulate(spring, q0=1.0, v0=0.0, duration=100.0, tol=1e-5)
    assert motion.stats["error_estimate"] < 1e-5
    assert motion.t[-1] == 100.0 and abs(motion.q[-1, 0]) < 1e-5 and not motion.v[-1].any()
    moving = vi.simulate(spring, q0=1.0, v0=0.0, duration=10.0)
    assert motion.at(10.0).q[0] == pytest.approx(moving.q[-1, 0], abs=1e-5)
    assert abs(moving.q[-1, 0]) > 1e-5


def test_a_tether_that_goes_slack_is_followed_with_enough_steps():
    """Between two satellites, in a frame that goes round: too few steps a unit of time fail where
    it is taut, one after the other ever later, and it was left to steps across its kinks.
    """
    (q, v), n = vi.coordinates("x", "y"), 1.1e-3
    moving = 50 * ((v[0] - n * q[1]) ** 2 + (v[1] + n * q[0]) ** 2)
    tide = 25 * n**2 * (3 * q[0] ** 2 - ca.sumsqr(q))
    tether = 50 * ca.fmax(0, ca.norm_2(q) - 1000) ** 2
    pair = vi.System(q, v, moving + tide - tether)
    motion = vi.simulate(pair, q0=[990.0, 0.0], v0=[0.0, 1.0], duration=3900.0)
    assert motion.stats["error_estimate"] < TOL
    assert motion.stats["switches"] == 30 and motion.stats["steps"] < 10_000


@pytest.mark.parametrize("power", [1, 1.25, 1.5, 2])
@pytest.mark.parametrize("draw", [0.05, 0.6])
def test_contacts_that_cannot_pull_are_followed_however_they_are_written(power, draw):
    """Hunt and Crossley's contact max(0, K dⁿ (1 − α v)), d = max(0, −y): in flight both it and
    what it is the largest of are zero, and which one is larger decides nothing.
    """
    motions = []
    for clip in (lambda d, rest: ca.fmax(0, d * rest), lambda d, rest: d * ca.fmax(rest, 0)):
        q, v = vi.coordinates("y")
        pressed = 1e4 * ca.fmax(0, -q) ** power
        ball = vi.System(q, v, v**2 / 2 - 9.81 * q, force=clip(pressed, 1 - draw * v))
        motions.append(vi.simulate(ball, q0=1.0, v0=0.0, duration=2.0, tol=1e-8))
    one, other = motions
    assert one.stats["switches"] == other.stats["switches"] >= 3
    assert abs(one.q[-1, 0] - other.q[-1, 0]) < 2e-8
    assert np.ptp(one.energy) > 1.0  # it is damped
