"""Scenes that settle: momenta tend to zero while what holds the scene does not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.discrete.lagrangian import point_function
from varint.discrete.term_sizes import term_sizes

RULES = [vi.midpoint(), vi.gauss(2), vi.gauss(4), vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)]
BACKENDS = ["interpreted", "compiled"]


def held_arm() -> vi.System:
    """A light arm held by a stiff controller against gravity."""
    q, v = vi.coordinates("a")
    return vi.System(q, v, 0.05 * v**2 + 9.81 * ca.cos(q), force=200 * (1.5 - q) - 5 * v)


def two_link_arm() -> vi.System:
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + ca.cos(q[0] - q[1]) * v[0] * v[1]
    weight = 2 * 9.81 * ca.cos(q[0]) + 9.81 * ca.cos(q[1])
    return vi.System(q, v, kinetic + weight, force=100 * (ca.DM([1.2, -0.4]) - q) - 10 * v)


def displaced_spring() -> vi.System:
    """A coordinate near zero whose terms are of size one and more: lengths with displacements."""
    q, v = vi.coordinates("u")
    length = ca.sqrt((1 + q) ** 2 + 1e-3)
    return vi.System(q, v, v**2 / 2 - 5e3 * (length - 1) ** 2, force=-v)


def damped_oscillator() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**2 / 2 - q**4 / 4, force=-v)


def friction_to_rest() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2, force=-3 * ca.tanh(v / 0.1))


def held_rod() -> vi.System:
    q, v = vi.coordinates("x", "y")
    return vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - 9.81 * q[1],
        constraint=ca.sumsqr(q) - 1,
        force=100 * (ca.DM([2.0, 0.0]) - q) - 5 * v,
    )


SCENES = {
    "held arm": (held_arm, [0.0], 0.01),
    "two-link arm": (two_link_arm, [0.0, 0.0], 0.01),
    "displaced spring": (displaced_spring, [0.1], 0.02),
    "damped oscillator": (damped_oscillator, [1.0], 0.05),
    "friction": (friction_to_rest, [0.0], 0.01),
    "held rod": (held_rod, [0.0, -1.0], 0.01),
}


def settle(name: str, rule: vi.Rule, backend: str, steps: int) -> vi.Trajectory:
    build, q0, h = SCENES[name]
    speed = 2.0 if name == "friction" else 0.0
    return vi.simulate(
        build(),
        rule,
        q0=q0,
        v0=np.full(len(q0), speed),
        h=h,
        steps=steps,
        save_every=steps // 10,
        backend=backend,
    )


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_that_settles_stays_where_its_forces_vanish(name, rule, backend):
    if name == "held rod" and rule.points != rule.nodes:
        return
    motion = settle(name, rule, backend, 20_000)
    q, rest = motion.q[-1], np.zeros(motion.q.shape[1])
    assert len(motion) == 11 and np.abs(motion.p[-1]).max() < 1e-10
    _, _, gradient, force = point_function(motion.system)(q, rest, 0, 0, 0)
    left = np.asarray(gradient + force).ravel()
    if motion.system.structure.constraints:
        left = left + motion.reaction_forces[-1]
    assert np.abs(left).max() < 1e-8


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "rule",
    [vi.midpoint(), pytest.param(vi.trapezoidal(), marks=pytest.mark.long)],
    ids=str,
)
def test_a_held_arm_stays_for_a_million_steps(rule, backend):
    motion = settle("held arm", rule, backend, 1_000_000 if backend == "compiled" else 100_000)
    assert np.ptp(motion.q[2:]) < 1e-14


def test_small_steps_are_no_worse_than_large_ones():
    """The advice of the error, a smaller h, made it fail earlier."""
    system = held_arm()
    for h in (1e-3, 1e-4):
        motion = vi.simulate(system, vi.gauss(2), q0=0, v0=0, h=h, steps=20_000, save_every=2000)
        assert len(motion) == 11


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_target_that_moves_far_and_stops_is_followed(backend):
    """The forces' terms grow from nothing to 6e4 while the momentum stays small, then vanishes."""
    q, v = vi.coordinates("a")
    t = vi.time()
    target = ca.fmin(10 * t, 300)
    force = 200 * (target - q) - 20 * v - 0.3 * ca.sin(q)
    system = vi.System(q, v, 0.05 * v**2, force=force, t=t)
    for rule in (vi.gauss(2), vi.trapezoidal()):
        motion = vi.simulate(
            system, rule, q0=0, v0=0, h=0.01, steps=20_000, save_every=1000, backend=backend
        )
        assert abs(200 * (300 - motion.q[-1, 0]) - 0.3 * np.sin(motion.q[-1, 0])) < 1e-8


def test_a_scene_with_a_contact_settles_too():
    q, v = vi.coordinates("a")
    arm = held_arm()
    lagrangian, force = ca.substitute([arm.lagrangian, arm.force], [arm.q, arm.v], [q, v])
    system = vi.System(q, v, lagrangian, force=force, contact=q + 1)
    motion = vi.simulate(system, q0=0, v0=0, h=0.01, steps=10_000, save_every=1000)
    assert np.abs(motion.p[-1]).max() < 1e-12


def test_members_of_an_ensemble_settle_as_they_do_alone():
    many = vi.ensemble(
        two_link_arm(),
        vi.lobatto(3),
        q0=[[0.0, 0.0], [0.3, 0.1]],
        v0=[0, 0],
        h=0.01,
        steps=5000,
        save_every=500,
        backend="interpreted",
    )
    for i, q0 in enumerate(([0.0, 0.0], [0.3, 0.1])):
        alone = vi.simulate(
            two_link_arm(),
            vi.lobatto(3),
            q0=q0,
            v0=[0, 0],
            h=0.01,
            steps=5000,
            save_every=500,
            backend="interpreted",
        )
        np.testing.assert_array_equal(many.q[i], alone.q)


def test_sizes_of_terms_bound_the_rounding_of_their_sum():
    """Against extended precision: the error of every result is a few ulp of its size."""
    q = ca.SX.sym("q", 2)
    terms = ca.vertcat(
        200 * (1.5 - q[0]),
        1 - ca.cos(q[1]),
        ca.sqrt(q[0] ** 2 + q[1] ** 2) - 1.5,
        ca.exp(q[1]) - 1,
        ca.atan2(q[1], q[0]) * 3 - ca.sin(q[1]) / q[0],
        ca.log(1 + q[1]) - q[1],
    )
    function = ca.Function("terms", [q], [terms])
    rng = np.random.default_rng(5)
    for _ in range(50):
        at = np.array([1.5 + 1e-8 * rng.normal(), 1e-8 * rng.normal()])
        value = np.asarray(function(at)).ravel()
        x, y = np.longdouble(at)
        exact = [
            200 * (np.longdouble(1.5) - x),
            1 - np.cos(y),
            np.sqrt(x**2 + y**2) - np.longdouble(1.5),
            np.exp(y) - 1,
            np.arctan2(y, x) * 3 - np.sin(y) / x,
            np.log(1 + y) - y,
        ]
        sizes = term_sizes(function, at)
        assert (np.abs(value - np.array(exact, dtype=float)) <= 4e-16 * sizes).all()
        assert (sizes >= np.abs(value)).all() and (sizes < 1e3).all()


def steep_friction(scale):
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2, force=-ca.tanh(v / scale)), [0.0], [1.0]


def steep_friction_of_a_joint(scale):
    q, v = vi.coordinates("x", "y")
    turning = q[0] * v[1] - q[1] * v[0]
    force = -3 * ca.tanh(turning / scale) * ca.vertcat(-q[1], q[0])
    L = ca.sumsqr(v) / 2 - 9.81 * q[1]
    return vi.System(q, v, L, force=force, constraint=ca.sumsqr(q) - 1), [1.0, 0.0], [0.0, 0.0]


@pytest.mark.parametrize("rule", [vi.lobatto(3), vi.lobatto(4)], ids=str)
@pytest.mark.parametrize("scale", [1e-3, 1e-4])
@pytest.mark.parametrize("scene", [steep_friction, steep_friction_of_a_joint])
@pytest.mark.filterwarnings("ignore:the speed of x")  # lobatto(3) rests so: test_false_speed
def test_friction_with_a_steep_sign_brings_a_motion_to_rest(scene, scale, rule):
    """Steps ten and a hundred times as long as the friction's own time where it turns round."""
    system, q0, v0 = scene(scale)
    motion = vi.simulate(system, rule, q0=q0, v0=v0, h=0.01, steps=300)
    assert np.abs(motion.v[-50:]).max() < 0.01  # of a step of its deceleration
    if scene is steep_friction:
        assert motion.q[-1, 0] == pytest.approx(0.5, abs=1e-5)  # v²/2a


def test_what_rests_for_long_stays_in_its_loop(monkeypatch):
    """Typical sizes of what has come to rest went down until they divided zero by zero: the run
    went on interpreted, a hundred times slower.
    """
    monkeypatch.setattr("varint.integration.compiled_loop.interpreted_blocks", None)
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, v**2 / 2 - ca.cosh(q), force=-v)
    run = dict(q0=0.0, v0=0.0, h=0.01, steps=330_000, save_every=30_000, backend="native")
    motion = vi.simulate(spring, vi.gauss(1), **run)
    assert motion.k[-1] == 330_000
    assert not motion.q.any()
    assert not motion.p.any()


def test_a_motion_that_has_come_to_rest_is_not_followed_by_ever_more_steps(monkeypatch):
    """Its energy is round-off beside p·v of nothing: a default call took more than 17 GB, and
    had not ended after four minutes.
    """
    from varint.integration import short_call
    from varint.integration.time_transformation import variable_course

    run, asked = variable_course.physical_run, []

    def watched(prepared, problem):
        asked.append(problem.steps)
        assert len(asked) <= 8, asked  # two searches of four
        return run(prepared, problem)

    monkeypatch.setattr(variable_course, "physical_run", watched)
    monkeypatch.setattr(short_call, "are_stiff", lambda *_: False)  # its steps would grow
    q, v = vi.coordinates("a", "b")
    m1, m2, l1, l2 = 0.40826, 4.2304, 0.22269, 0.52788
    both = v[0] + v[1]
    kinetic = m1 * (l1 * v[0]) ** 2 / 2 + m2 * ((l1 * v[0]) ** 2 + (l2 * both) ** 2) / 2
    kinetic += m2 * l1 * l2 * v[0] * both * ca.cos(q[1])
    height = -(m1 + m2) * l1 * ca.cos(q[0]) - m2 * l2 * ca.cos(q[0] + q[1])
    pull = ca.vertcat(238.54 * (1.76987 - q[0]), 858.12 * (1.63796 - q[1]))
    force = pull - ca.vertcat(14.9562, 189.14817) * v
    arm = vi.System(q, v, kinetic - 9.81 * height, force=force)
    start = dict(q0=[0.9959, -0.07683], v0=[-4.90664, -1.06771])
    motion = vi.simulate(arm, **start, duration=13.43, tol=1.174e-8)
    assert asked and motion.stats["error_estimate"] <= 1.174e-8


def test_what_the_last_digit_alone_puts_out_of_reach_is_said_at_once():
    """Strong dampers, and nothing pulls: coordinates of one change by 1e-4 and less, of which their
    last digit is 4e-11. Twenty-three runs of up to four million steps took 9 s and 1.3 GB.
    """
    q, v = vi.coordinates("a", "b")
    kinetic = (
        0.04 * v[0] ** 2 + 0.2 * (v[0] + v[1]) ** 2 + 0.18 * v[0] * (v[0] + v[1]) * ca.cos(q[1])
    )
    force = ca.vertcat(-141.5 * v[0], -94.3 * v[1] - 2.415 * (q[1] + 0.501))
    arm = vi.System(q, v, kinetic, force=force)
    call = dict(q0=[-0.8775, 0.6698], v0=[0.0, 0.0], duration=0.054, tol=1e-12)
    with pytest.warns(UserWarning, match="out of reach"):
        motion = vi.simulate(arm, **call)
    assert motion.stats["runs"] < 9 and motion.stats["error_estimate"] > 1e-12
