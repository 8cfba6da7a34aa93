"""Derivatives across impacts and detachments: closed forms of bounces, saltation in a billiard, and
differences of runs wherever contacts close, hold and let go.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import disc_on_table

import varint as vi


def ball(restitution: float = 0.8) -> vi.System:
    q, v = vi.coordinates("y")
    c = vi.Parameters(g=9.81)
    lagrangian = v**2 / 2 - c.g * q
    return vi.System(q, v, lagrangian, contact=q, restitution=restitution, params=c)


def bouncing(bounces: int, t: float) -> ca.Function:
    """(height, e, g) → y and v at t, time of the last bounce and speed behind it: y = v (t − t*) −
    g (t − t*)²/2, after t* = √(2 h/g) (1 + 2 Σ eʲ).
    """
    height, e, g = ca.SX.sym("height"), ca.SX.sym("e"), ca.SX.sym("g")
    begin = ca.sqrt(2 * height / g)
    last = begin * (1 + 2 * sum(e**j for j in range(1, bounces)))
    speed = ca.sqrt(2 * g * height) * e**bounces
    since = t - last
    out = ca.vertcat(speed * since - g * since**2 / 2, speed - g * since, last, speed)
    given = ca.vertcat(height, e, g)
    return ca.Function("bouncing", [given], [out, ca.jacobian(out, given)])


@pytest.mark.parametrize("bounces", [1, 4])
def test_a_bouncing_balls_derivatives_in_closed_form(bounces):
    height, e, g = 1.0, 0.8, 9.81
    begin = np.sqrt(2 * height / g)
    t = begin * (1 + 2 * sum(e**j for j in range(1, bounces)) + 0.9 * e**bounces)
    motion = vi.simulate(
        ball(e), vi.lobatto(3), q0=height, v0=0.0, duration=t, steps=4 + 4 * bounces
    )
    found = vi.sensitivity(motion, ["q0", "restitution", "g"])[-1]
    value, wanted = (np.array(x) for x in bouncing(bounces, t)([height, e, g]))
    assert motion.q[-1, 0] == pytest.approx(value[0, 0], rel=1e-11)
    assert np.abs(found - wanted[:2]).max() < 1e-11 * np.abs(wanted).max()
    hit = [event for event in motion.events if event.kind == "impact"][-1]
    at_hit = vi.event_sensitivity(motion, hit, ["q0", "restitution", "g"])
    assert np.abs(at_hit.time - wanted[2]).max() < 1e-11 * np.abs(wanted).max()
    assert np.abs(at_hit.after[1] - wanted[3]).max() < 1e-11 * np.abs(wanted).max()
    assert np.abs(at_hit.before[1] * e + at_hit.after[1])[[0, 2]].max() < 1e-11
    assert np.abs(at_hit.after[0]).max() < 1e-12  # it is on the floor


def test_restitution_as_a_parameter_is_what_it_is_as_a_number():
    """By e² it is 2 e times as much; of contacts that share it the sum."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(restitution=0.9)
    walls, e = ca.vertcat(q, 1.5 - q), c.restitution**2
    lagrangian = ca.sumsqr(v) / 2 - 9.81 * q[1]
    one = vi.System(q, v, lagrangian, contact=walls, restitution=e, params=c)
    other = vi.System(q, v, lagrangian, contact=walls, restitution=0.9**2)
    runs = [
        vi.simulate(x, vi.lobatto(2), q0=[1.0, 1.0], v0=[2.0, 0.3], h=0.05, steps=24)
        for x in (one, other)
    ]
    found, each = (vi.sensitivity(motion, ["restitution"])[-1] for motion in runs)
    assert {event.contact for event in runs[0].events} == {0, 1, 2}
    assert np.abs(found[:, 0] - 1.8 * each.sum(1)).max() < 1e-12 * np.abs(each).max()


def test_a_ball_that_came_to_rest_has_forgotten_its_start():
    motion = vi.simulate(ball(0.3), vi.lobatto(3), q0=1.0, v0=0.0, h=0.05, steps=40)
    assert motion.events[-1].kind == "stop"
    assert np.abs(vi.sensitivity(motion, ["q0", "v0", "g"])[-1]).max() < 1e-12
    assert np.abs(vi.gradient(motion, nodes=motion.system.q).q0).max() > 0.1


def circle_billiard() -> vi.System:
    q, v = vi.coordinates("x", "y")
    gap = (1 - ca.sumsqr(q)) / 2
    return vi.System(q, v, ca.sumsqr(v) / 2, contact=gap, restitution=1.0)


def test_a_disc_against_a_curved_wall_has_the_saltation_matrix_of_optics():
    """A beam in a circle: δs' = −(δs + …) by mirrors of focal length cos α/2; and symplectic."""
    system = circle_billiard()
    angle, speed = 0.4, 1.3  # of incidence; from the middle of a chord
    start = np.array([0.0, -np.sin(angle)])
    motion = vi.simulate(
        system, vi.lobatto(2), q0=start, v0=[speed, 0.0], duration=5.0 / speed, steps=25
    )
    assert len(motion.events) == 3
    phi, n = motion.transition_matrix(), 2
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    assert np.abs(phi.T @ j @ phi - j).max() < 1e-12 * np.abs(phi).max() ** 2
    # across the ray: flights of length c/2, c, c, rest; mirrors δα = −2 δs/cos α
    half = np.cos(angle)
    mirror = np.array([[-1.0, 0.0], [2 / np.cos(angle), -1.0]])

    def flight(length: float) -> np.ndarray:
        return np.array([[1.0, length], [0.0, 1.0]])

    beam = flight(5.0 - 5 * half) @ mirror @ flight(2 * half)
    beam = beam @ mirror @ flight(2 * half) @ mirror @ flight(half)
    heading = motion.v[-1] / speed
    across = np.array([-heading[1], heading[0]])
    found = np.array(
        [
            [across @ phi[:2, 1], across @ phi[:2, 3] * speed],
            [across @ phi[2:, 1] / speed, across @ phi[2:, 3]],
        ]
    )
    assert np.abs(found - beam).max() < 1e-11 * np.abs(beam).max()


def cradle() -> vi.System:
    """Three balls on a rail."""
    q, v = vi.coordinates("a", "b", "c")
    gaps = ca.vertcat(q[1] - q[0] - 1, q[2] - q[1] - 1)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 0.3 * ca.sumsqr(q), contact=gaps, restitution=0.9)


def driven_ball() -> vi.System:
    q, v = vi.coordinates("y")
    u = ca.SX.sym("u")
    return vi.System(
        q, v, v**2 / 2 - 9.81 * q, contact=q, restitution=0.8, force=u - 0.1 * v, control=u
    )


def touching(bounces: float):
    """Two balls at rest that touch, hit by a third."""
    q, v = vi.coordinates("a", "b", "c")
    gaps = ca.vertcat(q[1] - q[0] - 1, q[2] - q[1] - 1)
    mass = ca.vertcat(1.0, 2.0, 3.0)
    kinetic = ca.dot(mass, v**2) / 2
    system = vi.System(q, v, kinetic, contact=gaps, restitution=[0.9, bounces])

    def run(x: np.ndarray) -> vi.Trajectory:
        q0, v0 = [x[0], 0.0, 1.0], [x[1], 0.0, 0.0]
        return vi.simulate(system, vi.lobatto(2), q0=q0, v0=v0, h=0.1, steps=9)

    return run


@pytest.mark.parametrize("bounces", [0.9, 0.0])  # handed on; or both go on together
def test_a_blow_that_touching_balls_hand_on(bounces):
    run, start = touching(bounces), np.array([-1.5, 1.2])
    motion = run(start)
    found = vi.sensitivity(motion, ["q0", "v0"])[-1][:, [0, 3]]
    wanted = by_runs(lambda x: np.append(run(x).q[-1], run(x).v[-1]), start)
    assert motion.v[-1, 2] > 0.1
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


def with_gravity(model: vi.models.Model):
    def run(x: np.ndarray, **more) -> vi.Trajectory:
        steps = round(model.duration / model.h / 2)
        given = dict(q0=model.q0, v0=model.v0, duration=model.duration, steps=steps)
        return vi.simulate(model.system, vi.lobatto(3), **given, params=dict(gravity=x[0]), **more)

    return run, np.array([9.81]), ["gravity"]


def from_start(system: vi.System, start, rule=None, h: float = 0.05, steps: int = 40):
    rule, n = rule or vi.lobatto(3), system.structure.n

    def run(x: np.ndarray, **more) -> vi.Trajectory:
        given = dict(h=x[-1], steps=steps) | more
        return vi.simulate(system, rule, q0=x[:n], v0=x[n:-1], **given)

    return run, np.array([*start, h]), ["q0", "v0", "h"]


def driven_at_nodes(held: bool):
    shape, system = (6, 1 if held else 3, 1), driven_ball()
    u = np.random.default_rng(1).uniform(-3, 3, shape)

    def run(x: np.ndarray, **more) -> vi.Trajectory:
        push = x[2:].reshape(shape)
        given = dict(q0=0.05, v0=x[0], t0=x[1], h=0.05, steps=6)
        push = push[:, 0] if held else push
        return vi.simulate(system, vi.lobatto(3), **given, u=push, **more)

    return run, np.concatenate([[0.1, 0.3], u.ravel()]), ["v0", "t0", "u"]


def moving_table():
    q, v, t = *vi.coordinates("x"), vi.time()
    c = vi.Parameters(depth=0.1, rate=3.0)
    gap = q - c.depth * ca.sin(c.rate * t)
    lagrangian = v**2 / 2 - 9.81 * q
    system = vi.System(q, v, lagrangian, contact=gap, restitution=0.7, params=c, t=t)

    def run(x: np.ndarray, **more) -> vi.Trajectory:
        given = dict(q0=0.5, v0=0.1, t0=x[0], h=0.05, steps=16)
        return vi.simulate(
            system, vi.lobatto(3), **given, params=dict(depth=x[1], rate=x[2]), **more
        )

    return run, np.array([0.2, 0.1, 3.0]), ["t0", "depth", "rate"]


SCENES = {
    "moving table": moving_table,
    "sphere": lambda: with_gravity(vi.models.slide_off_sphere()),  # lets go, falls, stays
    "ladder": lambda: with_gravity(vi.models.falling_ladder()),
    "box": lambda: from_start(disc_on_table(9.81, [0.9, 0.7, 0.0]), [0.3, 0.4, 1.5, 0.3], steps=24),
    "cradle": lambda: from_start(cradle(), [-1.8, -0.5, 0.8, 1.0, 0.0, 0.1], steps=16),
    "held controls": lambda: driven_at_nodes(True),
    "controls at nodes": lambda: driven_at_nodes(False),
}


def by_runs(of, x: np.ndarray, d: float = 1e-3) -> np.ndarray:
    """∂f/∂x by central differences of order 4."""
    columns = []
    for e in np.eye(len(x)) * d:
        near, far = (of(x + k * e) - of(x - k * e) for k in (1, 2))
        columns.append((8 * near - far) / (12 * d))
    return np.array(columns).T


@pytest.mark.parametrize("name", SCENES)
def test_ends_and_events_move_as_those_of_neighbouring_runs_do(name):
    run, start, wrt = SCENES[name]()
    motion = run(start)
    assert motion.events

    def end_and_events(x: np.ndarray) -> np.ndarray:
        motion = run(x)
        rows = [[e.time, *e.q, *e.v_before, *e.v_after] for e in motion.events]
        return np.concatenate([motion.q[-1], motion.v[-1], *rows])

    found = vi.sensitivity(motion, wrt)
    assert found.shape[::2] == (len(motion), len(start))
    each, n = [found[-1]], motion.q.shape[1]
    for event in motion.events:
        of = vi.event_sensitivity(motion, event, wrt)
        each += [of.time[None], of.after[:n], of.before[n:], of.after[n:]]
        assert np.abs(of.before[:n] - of.after[:n]).max() < 1e-12 * max(1, np.abs(of.after).max())
    wanted = by_runs(end_and_events, start)
    assert np.abs(np.vstack(each) - wanted).max() < 1e-8 * max(np.abs(wanted).max(), 1.0)


@pytest.mark.parametrize("name", SCENES)
def test_the_adjoint_across_contacts_is_the_tangents_transpose(name):
    run, start, wrt = SCENES[name]()
    motion = run(start)
    s = motion.system
    loss = ca.sum1(ca.sin(s.q) * (1 + s.v))
    weights = np.random.default_rng(2).normal(size=len(motion))
    found = vi.gradient(motion, nodes=loss, weights=weights)
    names = [x for x in wrt if x not in ("h", "t0")] + ["t0", "h", "restitution"]
    rows = vi.sensitivity(motion, names, outputs=loss)[:, 0]
    parts = {"q0": found.q0, "v0": found.v0, "h": found.h, "t0": found.t0}
    parts |= {"u": found.u, "restitution": found.restitution, **found.params}
    flat = np.concatenate([np.ravel(parts[x]) for x in names])
    wanted = weights @ rows
    assert np.abs(flat - wanted).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("name", ["sphere", "held controls"])
def test_the_running_loss_across_contacts_is_differentiated_too(name):
    run, start, wrt = SCENES[name]()
    s = run(start).system
    loss = ca.sumsqr(s.q) * (1 + ca.sum1(s.v))

    def of(x: np.ndarray) -> vi.Gradient:
        return vi.gradient(run(x), loss)

    found = of(start)
    parts = {"q0": found.q0, "v0": found.v0, "h": found.h, "t0": found.t0, "u": found.u}
    flat = np.concatenate([np.ravel((parts | found.params)[x]) for x in wrt])
    wanted = by_runs(lambda x: np.array([of(x).value]), start)[0]
    assert np.abs(flat - wanted).max() < 1e-8 * max(np.abs(wanted).max(), 1.0)


def test_nodes_left_out_of_a_run_with_impacts_are_computed_once_more():
    run, start, _ = SCENES["box"]()
    every = run(start)
    times = np.array([0.0, 0.33, 0.5, 1.134, every.t[-1]])
    for few in (run(start, save_every=7), run(start, at=times), every.at(times), every[::5]):
        found = vi.sensitivity(few)
        at = np.array([np.argmin(np.abs(every.t - t)) for t in few.t])
        same = np.abs(every.t[at] - few.t) < 1e-12
        wanted = vi.sensitivity(every)[at[same]]
        assert np.abs(found[same] - wanted).max() < 1e-10 * np.abs(wanted).max()
    within = vi.sensitivity(every.at(times))[3]

    def state(x: np.ndarray) -> np.ndarray:
        there = run(np.append(x, start[-1])).at(times[3])
        return np.append(there.q, there.v)

    assert np.abs(within - by_runs(state, start[:-1])).max() < 1e-8


@pytest.mark.parametrize("end", [0.44, 0.4605, 0.47, 0.478])  # the first impact is at √(2/9.81)
def test_nodes_that_are_left_end_the_run_where_they_end(end):
    system = ball()
    whole = vi.simulate(system, vi.lobatto(3), q0=1.0, v0=0.0, h=0.0151, steps=40)
    few = whole.at([0.0, 0.2, end])
    assert vi.gradient(few, ca.SX(1)).value == pytest.approx(end, rel=1e-14)  # ∫ dt
    every = whole.at(np.append(whole.t[whole.t < end], end))
    found = few.transition_matrix()
    assert np.abs(found - every.transition_matrix()).max() < 1e-11
    assert np.abs(found - vi.sensitivity(few, ["q0", "p0"])[-1]).max() < 1e-11


def test_every_other_node_may_end_at_an_impact():
    motion = vi.simulate(ball(), vi.lobatto(3), q0=1.0, v0=0.0, h=0.0151, steps=40)
    hit = int(np.flatnonzero(motion.t == motion.events[0].time)[-1])
    wanted = motion[: hit + 1].transition_matrix()
    assert np.abs(motion[0 : hit + 1 : hit].transition_matrix() - wanted).max() < 1e-11


def test_a_part_of_a_run_with_impacts_begins_where_it_begins():
    run, start, _ = SCENES["box"]()
    motion = run(start)
    hit = int(np.flatnonzero(np.diff(motion.k) == 0)[0])  # an event is the node behind
    for middle in (4, hit, hit + 1, len(motion) - 3):
        product = motion.transition_matrix(middle) @ motion.transition_matrix(0, middle)
        whole = motion.transition_matrix()
        assert np.abs(product - whole).max() < 1e-8 * np.abs(whole).max()


@pytest.mark.parametrize("h", [0.3, 0.25])  # between two nodes, and at one
def test_a_motion_that_grazes_has_no_derivative_and_says_so(h):
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2, contact=ca.norm_2(q) - 1, restitution=1.0)

    def passing(height: float) -> vi.Trajectory:
        return vi.simulate(system, vi.lobatto(2), q0=[-2, height], v0=[1, 0], h=h, steps=14)

    for refused in (vi.sensitivity, lambda x: vi.gradient(x, nodes=q[0])):
        with pytest.raises(vi.ConvergenceError, match="graz"):
            refused(passing(1.0))
    assert passing(1 - 1e-3).events and not passing(1 + 1e-6).events
    for height in (1 - 1e-3, 1 + 1e-6):
        assert np.isfinite(vi.sensitivity(passing(height))).all()


def test_walls_that_are_hit_together_have_no_derivative_either():
    q, v = vi.coordinates("x", "y")
    corner = vi.System(q, v, ca.sumsqr(v) / 2, contact=q, restitution=1.0)
    motion = vi.simulate(corner, vi.lobatto(2), q0=[1.0, 1.0], v0=[-1.0, -1.0], h=0.3, steps=6)
    with pytest.raises(vi.ConvergenceError, match="together"):
        motion.transition_matrix()


@pytest.mark.parametrize("x", [0.3, 0.31])
def test_a_blow_that_falls_on_the_end_of_a_step_is_one_like_others(x):
    """In a square the motion unfolds: δx = ± (δx0 + t δv0); from 0.3 at 0.7 it is hit at t = 1."""
    q, v = vi.coordinates("x", "y")
    walls = ca.vertcat(q[0], 1 - q[0], q[1], 1 - q[1])
    square = vi.System(q, v, ca.sumsqr(v) / 2, contact=walls, restitution=1.0)
    start = dict(q0=[x, 0.4], v0=[0.7, 0.45])
    motion = vi.simulate(square, vi.lobatto(2), **start, h=0.05, steps=40)
    assert (np.abs(motion.events[0].time - 1) < 1e-12) == (x == 0.3)
    signs = (-1) ** np.floor(np.array([x, 0.4]) + np.array([0.7, 0.45]) * 2)
    wanted = np.kron([[1, 2], [0, 1]], np.diag(signs))
    found = vi.sensitivity(motion, ["q0", "v0"])
    assert np.abs(found[-1] - wanted).max() < 1e-12
    pulled = vi.gradient(motion, terminal_loss=q[0] + 3 * v[1])
    assert np.abs(pulled.q0 - [signs[0], 0]).max() < 1e-12
    assert np.abs(pulled.v0 - [2 * signs[0], 3 * signs[1]]).max() < 1e-12
