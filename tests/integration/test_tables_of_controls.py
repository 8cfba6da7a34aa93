"""Default calls under tables of controls: runs of the core whose steps take their controls from the
rows, beside closed forms, other integrators and runs by steps that are given.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import varint as vi
from varint.codegen.gauss import gauss_kernel
from varint.codegen.native import native_gauss
from varint.integration import table_trials, to_tolerance


def particle() -> vi.System:
    q, v = vi.coordinates("x")
    push, c = ca.SX.sym("push"), vi.Parameters(mass=2.0)
    return vi.System(q, v, c.mass * v**2 / 2, force=push, control=push, params=c)


def cart() -> vi.System:
    q, v = vi.coordinates("x", "theta")
    push = ca.SX.sym("push")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[1])
    force = ca.vertcat(push - 0.3 * v[0], 0)
    return vi.System(q, v, kinetic + 9.81 * ca.cos(q[1]), force=force, control=push)


def rocket() -> vi.System:
    q, v = vi.coordinates("height")
    t, thrust = vi.time(), ca.SX.sym("thrust")
    mass = 2 - 0.2 * t
    drag = 0.05 * v * ca.sqrt(v**2 + 1)
    return vi.System(q, v, mass * (v**2 / 2 - 9.81 * q), force=thrust - drag, control=thrust, t=t)


def arm() -> vi.System:
    q, v = vi.coordinates("theta1", "theta2")
    torque = ca.SX.sym("torque", 2)
    kinetic = 0.45 * v[0] ** 2 + 0.15 * (v[0] + v[1]) ** 2
    kinetic += 0.3 * ca.cos(q[1]) * v[0] * (v[0] + v[1])
    potential = 9.81 * (0.8 * ca.sin(q[0]) + 0.3 * ca.sin(q[0] + q[1]))
    return vi.System(q, v, kinetic - potential, force=torque - 0.2 * v, control=torque)


SCENES = {
    "cart": (cart(), [0.0, 0.5], [0.1, 0.0], 3.0, 2.0),
    "rocket": (rocket(), [0.0], [1.0], 3.0, 30.0),
    "arm": (arm(), [-1.0, 0.5], [0.0, 0.1], 2.0, 3.0),
}


@pytest.fixture
def only_short(monkeypatch):
    def never(*_, **__):
        raise AssertionError("the long way is taken")

    monkeypatch.setattr(to_tolerance, "simulate_to_tolerance", never)
    monkeypatch.setattr(table_trials, "looked_at", never)  # doubts are none either


def a_table(rng: np.random.Generator, rows: int, controls: int, size: float) -> np.ndarray:
    """Jumps, zero rows, rows that are alike, a ramp, or one pulse."""
    kind, free = rng.integers(5), size * rng.uniform(-1, 1, (rows, controls))
    if kind == 1:
        return free * (rng.random((rows, 1)) < 0.4)
    if kind == 2:
        return np.repeat(free, 4, axis=0)[:rows]
    if kind == 3:
        return np.linspace(-1, 1, rows)[:, None] * free[0]
    if kind == 4:
        return np.where(np.arange(rows)[:, None] == rng.integers(rows), 3 * free, 0.0)
    return free


def polynomial(nodes, values, x):
    """That of values (r, k) at the nodes, at x."""
    others = [[x - b for b in nodes if b != a] for a in nodes]
    divisors = [[a - b for b in nodes if b != a] for a in nodes]
    return np.prod(others, axis=1) / np.prod(divisors, axis=1) @ values


def at_knots(system, q0, v0, t0, duration, u, rule=None):
    """q where rows end, (rows + 1, n), by DOP853 from each to the next."""
    s, n, rows = system, len(q0), len(u)
    p = ca.gradient(s.lagrangian, s.v)
    rest = ca.gradient(s.lagrangian, s.q) + s.force - ca.jtimes(p, s.q, s.v) - ca.jacobian(p, s.t)
    slope = ca.vertcat(s.v, ca.solve(ca.densify(ca.jacobian(p, s.v)), ca.densify(rest)))
    rate = ca.Function("rate", [s.q, s.v, s.t, s.control], [slope])
    x, found = np.concatenate((q0, v0)), [np.array(q0, dtype=float)]
    for k, row in enumerate(u):
        begin, end = (t0 + duration * i / rows for i in (k, k + 1))

        def f(t, x, row=row, begin=begin, end=end):
            now = row if rule is None else polynomial(rule.nodes, row, (t - begin) / (end - begin))
            return rate(x[:n], x[n:], t, now).full().ravel()

        run = solve_ivp(f, (begin, end), x, "DOP853", rtol=1e-12, atol=1e-13)
        assert run.success
        x = run.y[:, -1]
        found.append(x[:n])
    return np.array(found)


@pytest.mark.parametrize("rows", [2, 7, 50, 300])
@pytest.mark.parametrize("duration", [4.0, -4.0])
def test_a_particle_goes_as_far_as_its_pushes_say(only_short, rows, duration):
    rng, system = np.random.default_rng(rows), particle()
    u, h = rng.uniform(-1, 1, rows), duration / rows
    motion = vi.simulate(system, q0=1.0, v0=0.5, duration=duration, u=u, params={"mass": 4.0})
    speed = 0.5 + np.concatenate(([0.0], np.cumsum(h * u / 4)))
    way = h * speed[:-1] + h**2 * u / 8
    x = motion.q[:: (len(motion) - 1) // rows, 0]
    assert np.abs(x - 1 - np.concatenate(([0.0], np.cumsum(way)))).max() < 1e-10 * np.ptp(x)


def test_linear_motions_are_those_of_the_exponential(only_short):
    rng = np.random.default_rng(0)
    q, v = vi.coordinates("x", "y")
    t, push = vi.time(), ca.SX.sym("push")
    stiffness, damping = np.array([[20.0, 3.0], [3.0, 4.0]]), np.diag([0.2, 0.1])
    force = ca.vertcat(push, 0) - ca.mtimes(damping, v) + ca.vertcat(0, ca.sin(3 * t))
    lagrangian = ca.sumsqr(v) / 2 - ca.bilin(stiffness, q, q) / 2
    system = vi.System(q, v, lagrangian, force=force, control=push, t=t)
    slope = np.zeros((8, 8))  # of q, v, sin 3t, cos 3t, the push, and nothing
    slope[:2, 2:4], slope[2:4, :2], slope[2:4, 2:4] = np.eye(2), -stiffness, -damping
    slope[2, 6], slope[3, 4], slope[4, 5], slope[5, 4] = 1, 1, 3, -3
    for rows, rule in ((5, None), (40, None), (12, vi.gauss(2)), (12, vi.gauss(4))):
        u, step = rng.uniform(-3, 3, rows), expm(slope * (4.0 / rows))
        how = {"q0": [0.4, 0.1], "v0": [0.0, 1.0], "duration": 4.0, "u": u, "tol": 1e-8}
        motion = vi.simulate(system, rule, **how)
        x = np.array([0.4, 0.1, 0, 1, 0, 1, 0, 0])
        for k, one in enumerate(u):
            x[6] = one
            x = step @ x
            node = motion.q[(k + 1) * (len(motion) - 1) // rows]
            assert np.abs(node - x[:2]).max() < 1e-8
        assert "one linear map a step" in motion.stats["backend"]


@pytest.mark.parametrize("name", SCENES)
def test_errors_are_below_the_wanted_ones_and_the_estimate(only_short, name):
    system, q0, v0, duration, size = SCENES[name]
    rng, controls = np.random.default_rng(len(name)), system.control.numel()
    for rows, tol in ((2, 1e-4), (5, 1e-9), (23, 1e-3), (50, 1e-6), (50, 1e-9)):
        u, t0 = a_table(rng, rows, controls, size), 0.3
        motion = vi.simulate(system, q0=q0, v0=v0, t0=t0, duration=duration, tol=tol, u=u)
        steps = len(motion) - 1
        assert steps % rows == 0 and motion.system is system
        assert np.array_equal(motion.u, np.repeat(u, steps // rows, axis=0)[:, None])
        true = at_knots(system, q0, v0, t0, duration, u)
        most = [1.0 if "theta" in name else np.inf for name in system.names]
        scale = np.minimum(np.ptp(motion.q, axis=0), most)
        error = (np.abs(motion.q[:: steps // rows] - true) / scale).max()
        estimate = motion.stats["error_estimate"]
        assert error <= estimate + 1e-11 and estimate <= tol


@pytest.mark.parametrize("stages", [2, 3])
def test_rows_of_a_value_at_each_node_are_polynomials(only_short, stages):
    system, q0, v0, duration, size = SCENES["cart"]
    rng, rule = np.random.default_rng(stages), vi.gauss(stages)
    u = size * rng.uniform(-1, 1, (9, stages, 1))
    motion = vi.simulate(system, rule, q0=q0, v0=v0, duration=duration, tol=1e-7, u=u)
    true = at_knots(system, q0, v0, 0.0, duration, u, rule)
    steps = len(motion) - 1
    assert np.abs(motion.q[:: steps // 9] - true).max() < 1e-7
    within = [[(k % (steps // 9) + c) / (steps // 9) for c in rule.nodes] for k in range(steps)]
    rows = np.repeat(u, steps // 9, axis=0)
    known = [[polynomial(rule.nodes, r, x) for x in xs] for r, xs in zip(rows, within, strict=True)]
    assert np.abs(motion.u - known).max() < 1e-12
    again = vi.simulate(system, rule, q0=q0, v0=v0, duration=duration, steps=steps, u=motion.u)
    assert np.abs(again.q - motion.q).max() < 1e-9


def test_the_motion_is_one_by_its_own_steps_and_controls(only_short):
    system, q0, v0, duration, size = SCENES["arm"]
    table = np.random.default_rng(5).uniform(-size, size, (20, 2))
    asked, u = {"q0": q0, "v0": v0, "duration": duration}, table.copy()
    motion = vi.simulate(system, **asked, u=u)
    u[:] = np.nan  # what a user does with it afterwards is no part of the motion
    p0 = motion.p[0]
    steps = len(motion) - 1
    assert np.array_equal(motion.u[:: steps // 20, 0], table)
    again = vi.simulate(system, motion.rule, **asked, steps=steps, u=motion.u)
    assert np.abs(again.q - motion.q).max() < 1e-11
    assert np.abs(again.energy - motion.energy).max() < 1e-10
    assert np.abs(motion.at([0.31, 1.7]).q - again.at([0.31, 1.7]).q).max() < 1e-11
    one, other = (vi.gradient(x, terminal_loss=system.q[0]) for x in (motion, again))
    assert np.abs(one.u - other.u).max() < 1e-8
    by_momentum = vi.simulate(system, q0=q0, p0=p0, duration=duration, u=table)
    assert by_momentum.q.tobytes() == motion.q.tobytes()
    times = np.linspace(0, duration, 7)
    asked_at = vi.simulate(system, q0=q0, v0=v0, at=times, u=table)
    assert np.abs(asked_at.q - motion.at(times).q).max() < 1e-12


def test_rows_that_are_alike_are_a_control_that_stays_the_same(only_short):
    system, q0, v0, duration, _ = SCENES["cart"]
    asked = {"q0": q0, "v0": v0, "duration": duration, "tol": 1e-10}
    one = vi.simulate(system, **asked, u=0.7)
    for rows in (2, 30):
        table = vi.simulate(system, **asked, u=np.full(rows, 0.7))
        assert np.abs(table.q[-1] - one.q[-1]).max() < 2e-10


def test_operations_as_data_and_compiled_ones_give_the_same_bytes(monkeypatch, only_short):
    rng = np.random.default_rng(7)
    for name, (system, q0, v0, duration, size) in SCENES.items():
        for rule, each in ((vi.gauss(4), 1), (vi.gauss(2), 2)):
            u = rng.uniform(-size, size, (12, each, system.control.numel()))
            found = []
            for kernel in (native_gauss(system, rule), gauss_kernel(system, rule)):
                monkeypatch.setattr(table_trials, "kernel_now", lambda _, kernel=kernel: kernel)
                how = {"q0": q0, "v0": v0, "duration": duration, "u": u}
                found.append(vi.simulate(system, rule, tol=1e-6, **how))
            native, compiled = found
            assert native.stats["backend"].startswith("native"), name
            assert compiled.stats["backend"].startswith("compiled"), name
            for field in ("t", "q", "p", "u"):
                assert getattr(native, field).tobytes() == getattr(compiled, field).tobytes()
            assert native.stats["error_estimate"] == compiled.stats["error_estimate"]


def test_the_core_and_python_make_the_same_motion(monkeypatch, only_short):
    from varint.integration.even_motion import _proved

    system, q0, v0, duration, size = SCENES["rocket"]
    u = np.random.default_rng(8).uniform(0, size, 15)
    found = []
    for prove in (table_trials.proved_motion(), _proved):
        monkeypatch.setattr(table_trials, "proved_motion", lambda prove=prove: prove)
        found.append(vi.simulate(system, q0=q0, v0=v0, duration=duration, u=u))
    one, other = found
    for field in ("t", "q", "p", "u"):
        assert getattr(one, field).tobytes() == getattr(other, field).tobytes()


def test_tables_that_are_none_are_refused_as_ever():
    system, asked = arm(), {"q0": [0.0, 0.0], "v0": [0.0, 0.0], "duration": 1.0}
    with pytest.raises(vi.InputError, match="u is not finite"):
        vi.simulate(system, **asked, u=[[0.0, 1.0], [np.inf, 0.0]])
    with pytest.raises(vi.InputError, match=r"u has shape \(5, 3\); it must have \(5, 2\)"):
        vi.simulate(system, **asked, u=np.zeros((5, 3)))
    with pytest.raises(vi.InputError, match="u must be numbers"):
        vi.simulate(system, **asked, u=[["a", "b"], ["c", "d"]])
    with pytest.raises(vi.InputError, match="q0"):
        vi.simulate(system, **asked | {"q0": [0.0, np.nan]}, u=np.zeros((5, 2)))


def test_what_is_asked_besides_changes_nothing_of_the_motion():
    system, q0, v0, duration, size = SCENES["cart"]
    u = np.random.default_rng(9).uniform(-size, size, 10)
    asked = {"q0": q0, "v0": v0, "duration": duration, "tol": 1e-7, "u": u}
    motion = vi.simulate(system, **asked)
    for more in ({"backend": "native"}, {"backend": "compiled"}, {"progress": True}):
        other = vi.simulate(system, **asked, **more)
        assert other.q.tobytes() == motion.q.tobytes() and other.u.tobytes() == motion.u.tobytes()
        assert other.stats["error_estimate"] == motion.stats["error_estimate"]
    few = vi.simulate(system, **asked, save_every=(len(motion) - 1) // 10)
    assert np.array_equal(few.q, motion.q[:: (len(motion) - 1) // 10]) and len(few.u) == len(
        motion.u
    )
    noted = vi.simulate(system, **asked, events={"middle": system.q[1]})
    assert len(noted) == len(motion) and np.abs(noted.q - motion.q).max() < 1e-8
    ended = vi.simulate(system, **asked, until=system.q[1])
    first = min(event.time for event in noted.events)
    assert ended.t[-1] == pytest.approx(first, abs=1e-7)


def test_runs_that_are_made_in_parts_go_on_in_the_table(only_short):
    system, q0, v0, duration, size = SCENES["arm"]
    u = np.random.default_rng(10).uniform(-size, size, (1300, 2))
    asked = {"q0": q0, "v0": v0, "duration": duration}
    motion = vi.simulate(system, **asked, u=u)
    again = vi.simulate(system, motion.rule, **asked, steps=len(motion) - 1, u=motion.u)
    assert len(motion) > 2600 and np.abs(again.q - motion.q).max() < 1e-11


def test_narrow_places_are_looked_at_under_the_controls_there(only_short):
    q, v = vi.coordinates("x")
    push = ca.SX.sym("push")
    bump = 0.3 * ca.exp(-(((q - 2) / 0.02) ** 2))
    system = vi.System(q, v, v**2 / 2 - bump, force=push - 0.1 * v, control=push)
    u = np.random.default_rng(6).uniform(-4, 6, 11)
    motion = vi.simulate(system, q0=0.0, v0=0.5, duration=3.0, tol=1e-7, u=u)
    true = at_knots(system, [0.0], [0.5], 0.0, 3.0, u)
    error = np.abs(motion.q[:: (len(motion) - 1) // 11] - true).max() / np.ptp(motion.q)
    assert motion.q.max() > 2.1 and error <= motion.stats["error_estimate"] <= 1e-7
