"""Fits to which no step is given: truths are found as by fine steps, and no step error is left."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi

TIMES = np.linspace(0.1, 6.0, 40)


def measured(system: vi.System, sigma: float, seed: int = 0, **start) -> vi.Measurement:
    """All coordinates of the true motion, with noise."""
    true = vi.simulate(system, **start, at=TIMES, tol=1e-12)
    noise = np.random.default_rng(seed).normal(size=true.q.shape)
    return vi.Measurement(system.q, TIMES, true.q + sigma * noise, sigma=sigma)


def swinging() -> tuple[vi.System, dict]:
    q, v = vi.coordinates("theta")
    c = vi.Parameters(length=1.0, friction=0.0)
    lagrangian = c.length**2 * v**2 / 2 + 9.81 * c.length * ca.cos(q)
    return vi.System(q, v, lagrangian, force=-c.friction * v, params=c), {"q0": 2.0, "v0": 0.0}


def orbiting() -> tuple[vi.System, dict]:
    """With an encounter, which long equal steps do not resolve."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(mu=1.0)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + c.mu / ca.norm_2(q), params=c)
    return system, {"q0": [1.0, 0.0], "v0": [0.0, 0.4]}


SCENES = {
    "a pendulum": (swinging, {"length": 0.8, "friction": 0.1}),
    "an orbit": (orbiting, {"mu": 1.1}),
}


@pytest.mark.parametrize("sigma", [1e-2, 1e-9])
@pytest.mark.parametrize("which", SCENES)
def test_truths_are_found_and_no_step_error_is_left(which, sigma):
    """However accurate the data are; a warning would be an error here."""
    make, true = SCENES[which]
    system, start = make()
    found = vi.fit(
        system, data=measured(system, sigma, params=true, **start), unknown=[*true], **start
    )
    off = np.abs(found.estimates - [*true.values()]) / found.sigma
    assert found.converged and off.max() < 4
    assert np.abs(found.step_shift / found.sigma).max() <= 0.1


def test_a_step_that_is_given_stays():
    system, start = swinging()
    true = SCENES["a pendulum"][1]
    seen = measured(system, 1e-2, params=true, **start)
    given = vi.fit(system, data=seen, unknown=[*true], h=0.05, **start)
    assert given.trajectories[0].h == 0.05


def test_experiments_share_a_step_and_the_shortest_counts():
    system, _ = orbiting()
    starts = {"q0": [1.0, 0.0], "v0": [0.0, 0.3]}, {"q0": [1.0, 0.0], "v0": [0.0, 1.0]}
    data = [measured(system, 1e-3, i, params={"mu": 1.1}, **x) for i, x in enumerate(starts)]
    experiments = [vi.Experiment([y], **x) for y, x in zip(data, starts, strict=True)]
    both = vi.fit(system, data=experiments, unknown=["mu"])
    alone = [vi.fit(system, data=[x], unknown=["mu"]) for x in experiments]
    steps = [x.trajectories[0].h for x in alone]
    assert both.trajectories[0].h == both.trajectories[1].h == min(steps) < max(steps) / 2
    assert abs(both.estimates[0] - 1.1) < 4 * both.sigma[0]


def test_segments_contacts_and_starts_by_parameters_need_no_step_either():
    system, start = swinging()
    seen = measured(system, 1e-3, params={"length": 0.8, "friction": 0.1}, **start)
    unknown = ["length", "friction", "q0", "v0"]
    pieces = vi.fit(system, data=seen, unknown=unknown, q0=1.8, v0=0.1, segments=4)
    whole = vi.fit(system, data=seen, unknown=unknown, q0=1.8, v0=0.1)
    assert (np.abs(pieces.estimates - whole.estimates) / whole.sigma).max() < 0.1

    q, v = vi.coordinates("y")
    c = vi.Parameters(e=0.7, height=1.1)
    ball = vi.System(q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=c.e, params=c)
    dropped = vi.simulate(ball, q0=1.0, v0=0.0, h=0.01, steps=200, params={"e": 0.83})
    heights = vi.Measurement(q, dropped.t[::7], dropped.q[::7, 0], sigma=1e-3)
    found = vi.fit(ball, data=heights, unknown=["e", "height"], q0=c.height, v0=0.0)
    assert np.abs(found.estimates - [0.83, 1.0]).max() < 1e-6


def test_constant_controls_do_and_those_of_steps_ask_for_a_step():
    q, v = vi.coordinates("x")
    u, c = ca.SX.sym("u"), vi.Parameters(m=1.0)
    cart = vi.System(q, v, c.m * v**2 / 2 - q**2, force=u, control=u, params=c)
    start = {"q0": 0.0, "v0": 0.0}
    seen = measured(cart, 1e-4, u=0.7, params={"m": 1.3}, **start)
    found = vi.fit(cart, data=seen, unknown=["m"], u=0.7, **start)
    assert abs(found.estimates[0] - 1.3) < 4 * found.sigma[0]
    with pytest.raises(vi.InputError, match="give h: a table of controls"):
        vi.fit(cart, data=seen, unknown=["m"], u=np.ones((60, 1)), **start)
    with pytest.raises(vi.InputError, match="h must be positive"):
        vi.fit(cart, data=seen, unknown=["m"], u=0.7, h=0.0, **start)


def test_guesses_that_meet_what_the_truth_does_not_ask_for_so_many_steps_at_most():
    """A guess that passes the centre closely, which takes tens of thousands of equal steps."""
    system, start = orbiting()
    seen = measured(system, 1e-4, params={"mu": 1.1}, **start)
    near = {"q0": [1.0, 0.0], "v0": [0.0, 0.15]}
    found = vi.fit(system, data=seen, unknown=["mu", "v0"], **near)
    assert (np.abs(found.estimates - [1.1, 0.0, 0.4]) / found.sigma).max() < 5
    assert len(found.trajectories[0]) < 10_000
