"""Thrust and drag that time switches on orbits with close passages: each leg between two switches
follows the rate of the orbit.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

E, END = 0.99, 20.0
Q0, V0 = [1 + E, 0.0], [0.0, np.sqrt((1 - E) / (1 + E))]
MANY = 400  # nodes, of which equal steps would need more than ten thousand


def acting(push, t, size=0.02):
    """A force of this size that turns with time, or pushes along the velocity."""
    return {
        "along": lambda v: size * v,
        "turning": lambda v: size * ca.vertcat(ca.cos(t), ca.sin(t)),
        "none": lambda v: None,
    }[push]


def orbit(force):
    """Kepler's problem with a force of (v, t)."""
    q, v = vi.coordinates("x", "y")
    t = ca.SX.sym("t")
    return vi.System(q, v, ca.dot(v, v) / 2 + 1 / ca.norm_2(q), force=force(v, t), t=t)


def by_hand(push, until, tol=1e-11):
    """Leg by leg: coasting until t = 3, pushed until t = 8.2, coasting again."""
    q, v, t = Q0, V0, 0.0
    for which, end in (("none", 3.0), (push, 8.2), ("none", until)):
        leg = orbit(lambda v, t, which=which: acting(which, t)(v))
        motion = vi.simulate(leg, q0=q, v0=v, t0=t, duration=end - t, tol=tol)
        q, v, t = motion.q[-1], motion.v[-1], end
    return q


@pytest.mark.parametrize("push", ["along", "turning"])
def test_switched_thrust_follows_the_rate_of_the_orbit(push, tmp_path):
    """At the end, between nodes, until a line is crossed, and from a file."""
    scene = orbit(lambda v, t: ca.if_else(ca.logic_and(t > 3, t < 8.2), acting(push, t)(v), 0))
    motion = vi.simulate(scene, q0=Q0, v0=V0, duration=END)
    assert len(motion) < MANY
    assert {3.0, 8.2} <= set(motion.t.tolist())
    q = by_hand(push, END)
    size = np.ptp(motion.q, axis=0).max()
    assert np.abs(motion.q[-1] - q).max() <= 1e-9 * size
    assert motion.stats["error_estimate"] <= 1e-9
    for time in (9.4, 13.3):  # beside passages, and far from them
        q = by_hand(push, time)
        assert np.abs(motion.at(time).q - q).max() <= 1e-9 * size
    ended = vi.simulate(
        scene, q0=Q0, v0=V0, duration=END, until=scene.q[1] + ca.fmax(0, 12 - scene.t)
    )
    assert ended.t[-1] > 11
    assert np.abs(ended.q[-1] - motion.at(ended.t[-1]).q).max() <= 2e-9 * size
    motion.save(tmp_path / "orbit.npz")
    again = vi.load(tmp_path / "orbit.npz")
    assert np.array_equal(again.at(9.4).q, motion.at(9.4).q)
    back = vi.simulate(scene, q0=motion.q[-1], v0=motion.v[-1], t0=END, duration=-END)
    assert len(back) < MANY and np.abs(back.q[-1] - Q0).max() <= 1e-9 * size


def test_what_legs_err_by_grows_on_those_behind_them():
    """A passage behind each of five switches magnifies errors by two powers of ten and more."""
    burns = [1.0, 2.0, 7.0, 9.0, 14.0]
    scene = orbit(lambda v, t: 0.01 * v * sum((-1) ** i * (t > x) for i, x in enumerate(burns)))
    motion, closer = (
        vi.simulate(scene, q0=Q0, v0=V0, duration=END, tol=tol) for tol in (1e-6, 1e-10)
    )
    apart = np.abs(motion.q[-1] - closer.q[-1]).max() / np.ptp(closer.q, axis=0).max()
    assert apart <= motion.stats["error_estimate"] <= 1e-6


def test_a_lost_run_says_nothing_of_powers_that_begin_at_switches():
    """A run of too few steps flies off, beside which the passages look as if r² were zero there:
    √(r²) has an order of zero then, by which estimates were divided.
    """
    closer = orbit(lambda v, t: -0.01 * v * ca.if_else(t < 6, 1, 0))
    never = 1e-30 * ca.fmax(0, closer.v[0] - 1e3)  # nor are legs between times looked for beside it
    scene = vi.System(closer.q, closer.v, closer.lagrangian, force=closer.force + never, t=closer.t)
    far, near = (vi.simulate(s, q0=Q0, v0=V0, duration=END) for s in (scene, closer))
    assert len(near) < 2000 < len(far)
    assert np.abs(far.q[-1] - near.q[-1]).max() < 4e-9
