"""Derivatives at nodes within steps, of crossings, and of runs whose steps follow a time scale."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from test_tangents import differences, driven_cart, spring

import varint as vi

TIMES = [0.0, 0.05, 0.23, 0.31, 0.3499, 0.6, 0.73]
START = np.array([0.4, -0.3, 0.2, 0.5, 1.3])


def sprung(rule: vi.Rule):
    system, _ = spring()

    def run(x: np.ndarray, **more) -> vi.Trajectory:
        given = dict(q0=x[:2], v0=x[2:4], h=0.1, params=dict(m=x[4]))
        return vi.simulate(system, rule, **given, **more)

    return system, run


RULES = [vi.gauss(2), vi.composition("kahan-li6"), vi.lobatto(3)]


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_nodes_at_given_times_have_the_derivatives_of_dense_output(rule):
    _, run = sprung(rule)
    wanted = differences(lambda x: np.hstack([(m := run(x, at=TIMES)).q, m.v]).ravel(), START)
    whole = run(START, steps=8)
    for motion in (run(START, at=TIMES), whole.at(TIMES)):
        found = vi.sensitivity(motion, ["q0", "v0", "m"])
        assert np.abs(found.reshape(-1, 5) - wanted).max() < 1e-11 * np.abs(wanted).max()
    few = vi.sensitivity(run(START, at=[0.0, 0.73]), ["q0", "v0", "m"])
    assert np.abs(few[-1] - found[-1]).max() < 1e-11 * np.abs(wanted).max()
    short = vi.sensitivity(run(START, at=[0.0, 0.05]), ["q0", "v0", "m"])  # ends in the first step
    assert np.abs(short[-1] - found[1]).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("rule", RULES[:2], ids=str)
def test_losses_of_runs_that_end_within_a_step(rule):
    system, run = sprung(rule)
    loss, psi = ca.sumsqr(system.q) * (1 + system.v[0]), system.q * system.v
    weights = np.random.default_rng(0).normal(size=(len(TIMES), 2))

    def of(x: np.ndarray) -> vi.Gradient:
        return vi.gradient(run(x, at=TIMES), loss, nodes=psi, weights=weights)

    found = of(START)
    wanted = differences(lambda x: np.array([of(x).value]), START)[0]
    flat = np.concatenate([found.q0, found.v0, [found.params["m"]]])
    assert np.abs(flat - wanted).max() < 1e-10 * np.abs(wanted).max()
    assert found.duration is None and found.h is not None


@pytest.mark.parametrize("held", [True, False], ids=["held", "at nodes"])
def test_controls_act_on_nodes_within_their_steps(held):
    system, rule = driven_cart(), vi.gauss(2)
    shape = (3, 1 if held else 2, 2)
    u = np.random.default_rng(1).uniform(-1, 1, shape).ravel()
    loss = ca.sumsqr(system.q) * (1 + system.t) + system.control[0] ** 2

    def run(x: np.ndarray) -> vi.Trajectory:
        push = x.reshape(shape)
        given = dict(q0=[0.1, 0.4], v0=[0.2, -0.3], t0=0.3, h=0.1, at=[0.3, 0.34, 0.42, 0.55, 0.58])
        return vi.simulate(system, rule, u=push[:, 0] if held else push, steps=3, **given)

    found = vi.sensitivity(run(u), ["u"]).reshape(-1, len(u))
    wanted = differences(lambda x: np.hstack([(m := run(x)).q, m.v]).ravel(), u)
    assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max()
    weights = np.random.default_rng(2).normal(size=(5, 4))
    at_nodes = vi.gradient(run(u), nodes=ca.vertcat(system.q, system.v), weights=weights).u
    assert np.abs(at_nodes.ravel() - weights.ravel() @ found).max() < 1e-14
    along = vi.gradient(run(u), loss).u.ravel()
    by_runs = differences(lambda x: np.array([vi.gradient(run(x), loss).value]), u)[0]
    assert np.abs(along - by_runs).max() < 1e-10 * np.abs(by_runs).max()


@pytest.mark.parametrize("rule", RULES[:2], ids=str)
def test_the_end_of_a_run_until_a_crossing_moves_with_it(rule):
    system, run = sprung(rule)
    line = system.q[0] - 0.3
    motion = run(START, steps=60, until=line)
    found = vi.event_sensitivity(motion, None, ["q0", "v0", "m"], expression=line)

    def end(x: np.ndarray) -> np.ndarray:
        motion = run(x, steps=60, until=line)
        return np.concatenate([motion.t[-1:], motion.q[-1], motion.v[-1]])

    wanted = differences(end, START)
    each = np.vstack([found.time, found.after])
    assert np.abs(each - wanted).max() < 1e-10 * np.abs(wanted).max()
    assert np.array_equal(found.before, found.after)
    # at a fixed time the state moves otherwise: by its rate times the event's delay
    still = vi.sensitivity(motion, ["q0", "v0", "m"])[-1]
    assert np.abs(found.after[:2] - still[:2] - np.outer(motion.v[-1], found.time)).max() < 1e-3


def test_a_pendulums_quarter_period_by_elliptic_integrals():
    from scipy.special import ellipe, ellipk

    q, v = vi.coordinates("theta")
    system, theta = vi.System(q, v, v**2 / 2 + ca.cos(q)), 2.0
    motion = vi.simulate(
        system, vi.gauss(6), q0=theta, v0=0.0, h=0.05, steps=100, events=dict(bottom=q)
    )
    found = vi.event_sensitivity(motion, motion.events[0], ["q0"], expression=q)
    m = np.sin(theta / 2) ** 2
    slope = (ellipe(m) - (1 - m) * ellipk(m)) / (2 * m * (1 - m))  # dK/dm
    wanted = slope * np.sin(theta) / 2
    assert found.time[0] == pytest.approx(wanted, rel=1e-11)
    assert found.after[1, 0] == pytest.approx(-np.cos(theta / 2), rel=1e-11)  # v = −2 sin(θ0/2)


def orbiting(pushed: bool = False):
    """Where it is pushed, by a drive in time and a drag that depends on the place."""
    q, v = vi.coordinates("x", "y")
    c, t = vi.Parameters(mu=1.0), vi.time()
    potential = -c.mu / ca.norm_2(q)
    more = dict(t=t, force=-0.05 * c.mu * ca.sumsqr(q) * v) if pushed else {}
    potential += 0.1 * q[0] * ca.cos(2 * t) if pushed else 0.0
    system = vi.System(q, v, ca.sumsqr(v) / 2 - potential, params=c, **more)
    scale = vi.close_encounters(ca.norm_2(q))

    def run(x: np.ndarray, rule: vi.Rule | None = None, **more) -> vi.Trajectory:
        given = dict(q0=x[:2], v0=x[2:4], params=dict(mu=x[4]), duration=7.0)
        return vi.simulate(
            system, rule or vi.gauss(4), **given, **(dict(h=0.2, time_scale=scale) | more)
        )

    return system, run


ORBIT = np.array([0.5, 0.1, 0.0, 1.7, 1.0])


PUSHED = pytest.mark.parametrize("pushed", [False, True], ids=["free", "pushed"])


@PUSHED
def test_variable_steps_have_the_derivatives_of_their_nodes_at_given_times(pushed):
    system, run = orbiting(pushed)
    motion = run(ORBIT)
    some = [5, 17]

    def states(x: np.ndarray) -> np.ndarray:
        near = run(x)
        at = [near.at(t) for t in motion.t[some]] + [near[-1]]
        return np.concatenate([y for state in at for y in (state.q, state.v)])

    found = vi.sensitivity(motion, ["q0", "v0", "mu"])
    wanted = differences(states, ORBIT, 1e-4)
    rows = found[[*some, -1]].reshape(12, 5)
    assert np.abs(rows - wanted).max() < 1e-9 * np.abs(wanted).max()
    psi = ca.vertcat(system.q[0] * system.v[1], system.q[1])
    weights = np.random.default_rng(3).normal(size=(len(motion), 2))
    of = vi.gradient(motion, nodes=psi, weights=weights)
    by = np.einsum(
        "ko,kom->m", weights, vi.sensitivity(motion, ["q0", "v0", "mu", "h"], outputs=psi)
    )
    flat = np.concatenate([of.q0, of.v0, [of.params["mu"], of.h]])
    assert np.abs(flat - by).max() < 1e-12 * np.abs(by).max()
    assert of.t0 is None and of.duration is None


@PUSHED
def test_the_running_loss_of_variable_steps_is_the_same_integral(pushed):
    system, run = orbiting(pushed)
    loss = system.q[0] ** 2 * system.v[1] + system.t * system.q[1]
    found = vi.gradient(run(ORBIT), loss)
    wanted = differences(lambda x: np.array([vi.gradient(run(x), loss).value]), ORBIT, 1e-4)[0]
    flat = np.concatenate([found.q0, found.v0, [found.params["mu"]]])
    assert np.abs(flat - wanted).max() < 1e-9 * np.abs(wanted).max()
    equal = vi.gradient(run(ORBIT, vi.gauss(4), h=0.02, time_scale=None), loss)
    assert np.abs(found.q0 - equal.q0).max() < 1e-6 * np.abs(equal.q0).max()


@pytest.mark.parametrize(
    "scale", [None, pytest.param("auto", marks=pytest.mark.long)], ids=["given", "its own"]
)
@PUSHED
def test_the_transition_matrix_of_variable_steps_is_that_of_the_motion(scale, pushed):
    _, run = orbiting(pushed)
    motion = run(ORBIT, vi.gauss(6), **(dict(time_scale="auto", h=0.4) if scale else dict(h=0.2)))
    equal = run(ORBIT, vi.gauss(6), h=0.02, time_scale=None)
    phi, wanted = motion.transition_matrix(), equal.transition_matrix()
    assert np.abs(phi - wanted).max() < 1e-9 * np.abs(wanted).max()
    j = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    kept = np.abs(phi.T @ j @ phi - j).max() < 1e-9 * np.abs(phi).max()
    assert kept != pushed  # drag shrinks it
    product = motion.transition_matrix(9) @ motion.transition_matrix(0, 9)
    assert np.abs(product - phi).max() < 1e-9 * np.abs(phi).max()


def test_an_apse_of_an_orbit_in_variable_steps():
    system, run = orbiting()
    apse = ca.dot(system.q, system.v)
    motion = run(ORBIT, events=dict(apse=apse), until=(system.q[1], -1))

    def events(x: np.ndarray) -> np.ndarray:
        near = run(x, events=dict(apse=apse), until=(system.q[1], -1))
        e = near.events[0]
        return np.array([e.time, *e.q, *e.v_after, near.t[-1], *near.q[-1], *near.v[-1]])

    each = [
        vi.event_sensitivity(motion, event, ["q0", "v0", "mu"], expression=e)
        for event, e in ((motion.events[0], apse), (None, system.q[1]))
    ]
    found = np.vstack([np.vstack([x.time, x.after]) for x in each])
    wanted = differences(events, ORBIT, 1e-4)
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_what_has_no_derivative_within_steps_is_refused_in_words():
    system, run = sprung(vi.gauss(2))
    at = run(START, at=TIMES)
    with pytest.raises(vi.InputError, match=r"first node.*within a step"):
        at[1:].transition_matrix()
    with pytest.raises(vi.InputError, match="no 'duration'"):
        vi.sensitivity(at, ["duration"])
    until = run(START, steps=60, until=system.q[0] - 0.3, events=dict(rest=system.v[1]))
    for given, words in (
        (dict(), "say what crosses"),
        (dict(expression=system.q[1]), "another one"),
        (dict(expression=system.q), "one number"),
        (dict(event=vi.simulate(ball(), q0=1.0, v0=0.0, h=0.1, steps=9).events[0]), "none of"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.event_sensitivity(until, **given)
    _, orbit = orbiting()
    for name in ("duration", "t0"):
        with pytest.raises(vi.InputError, match="fictitious"):
            vi.sensitivity(orbit(ORBIT), [name])


def ball() -> vi.System:
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.5)


def test_a_motion_that_turns_on_a_line_has_no_time_of_crossing():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q)
    motion = vi.simulate(system, vi.gauss(2), q0=0.0, v0=1.0, h=0.3, steps=5, at=[0.0, 1.0])
    with pytest.raises(vi.ConvergenceError, match="graz"):
        vi.event_sensitivity(motion, expression=q - 0.5)
