"""Bodies with dry friction on the ground and between them: every joint sticks and slips alone."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import varint as vi

TOL = 1e-9


def test_two_blocks_with_friction_stick_and_slip_one_by_one():
    """A block pulled by a spring, which pulls another one: both on the ground at first, then one,
    then both move; compared with friction as a balance, by another integrator.
    """
    q, v, t = *vi.coordinates("x1", "x2"), vi.time()
    lagrangian = ca.sumsqr(v) / 2 - (q[0] - t / 2) ** 2 / 2 - 2 * (q[1] - q[0]) ** 2
    mu = 0.5, 0.8
    pair = vi.System(q, v, lagrangian, force=-ca.vertcat(*mu) * ca.sign(v), t=t)
    motion = vi.simulate(pair, q0=[0.0, 0.0], v0=[0.0, 0.0], duration=6.0)
    assert motion.stats["error_estimate"] <= TOL
    slips = [motion.t[np.flatnonzero(np.abs(motion.v[:, i]) > 1e-12)[0] - 1] for i in (0, 1)]
    assert slips[0] == pytest.approx(2 * mu[0], abs=1e-12)  # the spring pulls with t/2

    def rates(_t, y):
        return [y[2], y[3], _t / 2 - y[0] + 4 * (y[1] - y[0]) - mu[0], 0.0]

    alone = solve_ivp(
        rates,
        (slips[0], 6.0),
        [0.0, 0.0, 0.0, 0.0],
        rtol=1e-12,
        atol=1e-13,
        events=lambda t, y: 4 * (y[0] - y[1]) - mu[1],
    )
    assert slips[1] == pytest.approx(alone.t_events[0][0], abs=1e-8)
    some = (motion.t > slips[0]) & (motion.t < slips[1])
    assert np.abs(motion.q[some, 1]).max() < 1e-15


def test_a_block_that_sticks_on_another_one_slides_on_with_it():
    """By the closed form of two blocks whose joint comes to rest before the lower one does."""
    g, (lower, upper), (ground, joint) = 9.81, (2.0, 1.0), (0.1, 0.5)
    q, v = vi.coordinates("lower", "upper")
    held = joint * upper * g * ca.sign(v[1] - v[0])
    slows = ground * (lower + upper) * g * ca.sign(v[0])
    pair = vi.System(
        q,
        v,
        (lower * v[0] ** 2 + upper * v[1] ** 2) / 2,
        force=ca.vertcat(held - slows, -held),
    )
    motion = vi.simulate(pair, q0=[0.0, 0.0], v0=[3.0, 0.0], duration=2.0)
    rates = -(ground * (lower + upper) + joint * upper) * g / lower, joint * g
    meet = 3 / (rates[1] - rates[0])
    left, v1 = 2.0 - meet, rates[1] * meet
    path = v1 * left - ground * g * left**2 / 2
    ends = [3 * meet + rates[0] * meet**2 / 2 + path, rates[1] * meet**2 / 2 + path]
    assert motion.q[-1] == pytest.approx(ends, abs=1e-12)
    assert motion.v[-1] == pytest.approx([v1 - ground * g * left] * 2, abs=1e-12)


@pytest.mark.parametrize("start", [(-4.0, 0.0), (2.0, 0.0), (-1.0, -1.0), (2.0, 2.0)])
@pytest.mark.parametrize("masses", [(1.0, 1.0), (2.0, 2.0), (1.0, 0.5), (1.623, 1.53)])
def test_blocks_of_one_friction_slow_down_together_at_the_end_of_what_their_joint_can_just_hold(
    masses, start
):
    """Both decelerate by μg: the joint holds all that it can, and round-off is no push."""
    mu, g, (low, top) = 0.5, 9.81, masses
    q, v = vi.coordinates("lower", "upper")
    held = mu * top * g * ca.sign(v[1] - v[0])
    slows = mu * (low + top) * g * ca.sign(v[0])
    energy = (low * v[0] ** 2 + top * v[1] ** 2) / 2
    pair = vi.System(q, v, energy, force=ca.vertcat(held - slows, -held))
    motion = vi.simulate(pair, q0=[0.0, 0.0], v0=start, duration=3.0)
    way, (v1, v2) = np.sign(start[0]), np.abs(start)
    slow, fast = mu * g * (low + 2 * top) / low, mu * g
    meet = (v1 - v2) / (slow + fast)
    both = v2 + fast * meet
    ends = [v1 * meet - slow * meet**2 / 2, v2 * meet + fast * meet**2 / 2]
    ends = [way * (x + both**2 / (2 * fast)) for x in ends]
    assert motion.q[-1] == pytest.approx(ends, abs=1e-12)
    assert motion.stats["error_estimate"] <= TOL
