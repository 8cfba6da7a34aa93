"""Variable steps over forces and explicit time: the energy is the momentum of the clock."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.diagnostics import symplectic_defect
from varint.integration.time_transformation.time_scale import transformed_scene

q, v = vi.coordinates("x", "y")
T = vi.time()
R = ca.norm_2(q)
KEPLER = ca.sumsqr(v) / 2 + 1 / R
START = dict(q0=[0.1, 0.0], v0=[0.0, 19**0.5])  # e = 0.9
SPIN = 0.7
TURN = ca.blockcat([[ca.cos(SPIN * T), -ca.sin(SPIN * T)], [ca.sin(SPIN * T), ca.cos(SPIN * T)]])


def bar(x):
    """A potential without symmetry, at rest in its own frame."""
    return 1 / ca.norm_2(x) + 0.02 * x[0] * x[1] + 0.05 * x[0]


SCENES = {
    "drag": vi.System(q, v, KEPLER, force=-0.01 * v),
    "quadratic drag": vi.System(q, v, KEPLER, force=-0.01 * ca.norm_2(v) * v),
    "a pull": vi.System(q, v, ca.sumsqr(v) / 2, force=-q / R**3 - 0.001 * v),
    "a drive": vi.System(q, v, KEPLER + 0.05 * q[0] * ca.cos(2 * T), t=T),
    "a turning bar": vi.System(q, v, ca.sumsqr(v) / 2 + bar(TURN.T @ q), t=T),
    "drag in a drive": vi.System(
        q, v, KEPLER + 0.05 * q[0] * ca.cos(2 * T), force=-0.01 * (1 + ca.sin(T)) * v, t=T
    ),
    "in pairs": vi.System(  # of masses that are no diagonal matrix
        q,
        v,
        0.8 * v[0] ** 2 + 0.6 * v[1] ** 2 + 0.3 * v[0] * v[1] + 1 / R,
        force=-0.01 * v,
    ),
}


@pytest.fixture(params=SCENES)
def scene(request):
    return SCENES[request.param]


def run(system, h=0.4, rule=None, **more):
    asked = dict(START, h=h, duration=7.0, t0=0.3, time_scale="auto") | more
    return vi.simulate(system, rule or vi.gauss(8), **asked)


def test_the_motion_is_that_of_short_equal_steps(scene):
    motion = run(scene)
    equal = vi.simulate(scene, vi.gauss(8), **START, duration=7.0, steps=4000, t0=0.3)
    assert motion.t[-1] == pytest.approx(7.3, rel=1e-15)
    assert len(motion) < 120
    assert np.abs(motion.q[-1] - equal.q[-1]).max() < 1e-11
    assert np.abs(motion.v[-1] - equal.v[-1]).max() < 1e-10
    assert motion.action == pytest.approx(equal.action, rel=1e-9)


@pytest.mark.parametrize("rule", [vi.gauss(1), vi.gauss(2), vi.gauss(3)], ids=str)
def test_the_order_is_that_of_the_rule(scene, rule):
    exact = run(scene, 0.3, duration=1.0).q[-1]
    steps = np.array([0.08, 0.056, 0.04, 0.028]) * (1 if rule.order == 2 else 3)
    errors = [np.abs(run(scene, h, rule, duration=1.0).q[-1] - exact).max() for h in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(slope - rule.order) < 0.25 * (1 if rule.order == 2 else 2)


def test_both_gears_have_the_same_bytes(scene):
    native, compiled = (run(scene, backend=gear) for gear in ("native", "compiled"))
    for name in ("t", "q", "p"):
        assert np.array_equal(getattr(native, name), getattr(compiled, name))


def test_the_momentum_of_the_clock_keeps_account_of_the_energy(scene):
    motion = run(scene, 0.6)
    inner = motion.fictitious
    assert np.abs(motion.energy + inner.p[:, -1]).max() < 1e-9
    assert np.ptp(motion.energy) > 1e-4  # which changes indeed
    assert np.abs(inner.v[:, -2] - inner.p[:, -1]).max() < 1e-14


def test_a_run_back_returns_to_the_start(scene):
    there = run(scene)
    end = dict(q0=there.q[-1], v0=there.v[-1], t0=there.t[-1])
    back = run(scene, **end, h=-0.4, duration=-7.0)
    assert np.abs(back.q[-1] - START["q0"]).max() < 1e-10
    assert back.t[-1] == pytest.approx(0.3, abs=1e-14)


def test_reversible_forces_take_the_same_way_back():
    lifted = vi.System(q, v, KEPLER, force=0.05 * ca.sumsqr(v) * ca.vertcat(-q[1], q[0]))
    there = run(lifted)
    back = run(lifted, q0=there.q[-1], v0=-there.v[-1])
    assert np.ptp(there.energy) > 0.01
    assert np.abs(back.q[-1] - START["q0"]).max() < 1e-10


@pytest.mark.parametrize("name", ["a drive", "a turning bar"])
def test_steps_over_explicit_time_are_symplectic(name):
    inner = transformed_scene(SCENES[name], R**1.5 * (1.2 + ca.sin(T) / 2))
    energy = float(inner.energy(START["q0"], START["v0"], 0.3, [], 0)[0])
    given = dict(q0=[0.1, 0, 0, 0], p0=[0, 19**0.5, 1, -energy], h=0.3)
    times = {"start time": 0.3, "initial energy": energy, "initial time scale": 1.0}
    assert symplectic_defect(inner.system, vi.gauss(3), **given, params=times).passed


def test_explicit_time_is_that_of_the_twin_without_it():
    """A bar at rest in the turning frame, where its scene does not depend on time."""
    turning = ca.sumsqr(v + SPIN * ca.vertcat(-q[1], q[0])) / 2 + bar(q)
    twin = vi.System(q, v, turning)
    begin = np.array(START["v0"]) + SPIN * np.array([0.0, 0.1])
    seen = run(SCENES["a turning bar"], v0=begin, t0=0.0, duration=40.0)
    own = run(twin, t0=0.0, duration=40.0)
    angle = SPIN * seen.t[-1]
    back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    assert np.abs(back @ seen.q[-1] - own.q[-1]).max() < 1e-9
    spin = seen.q[:, 0] * seen.v[:, 1] - seen.q[:, 1] * seen.v[:, 0]
    jacobi = seen.energy - SPIN * spin
    assert np.abs(jacobi - jacobi[0]).max() < 1e-11
    assert np.ptp(spin) > 1e-3


def test_a_time_scale_may_depend_on_time_where_the_scene_does():
    near = 0.01 + R**1.5 * (1.5 + ca.cos(T))
    motion = run(SCENES["a drive"], 0.2, time_scale=near)
    assert np.abs(motion.q[-1] - run(SCENES["a drive"]).q[-1]).max() < 1e-11
    with pytest.raises(vi.InputError, match="q and the parameters alone"):
        run(SCENES["drag"], time_scale=near)


def test_what_changes_the_energy_otherwise_is_refused():
    u = ca.SX.sym("u")
    wall = dict(contact=q[0] + 5)
    for reason, more in {"contacts": wall, "controls": dict(control=u, force=u * v)}.items():
        with pytest.raises(vi.InputError, match=reason):
            run(vi.System(q, v, KEPLER, **more), rule=vi.gauss(2))


def test_events_and_dense_output_are_at_physical_times():
    system = SCENES["drag in a drive"]
    crossing = q[0] - 0.01 * ca.sin(T)
    motion = run(system, events={"crossing": crossing})
    assert len(motion.events) == 3
    for event in motion.events:
        x, _ = motion.at(event.time).q
        assert abs(x - 0.01 * np.sin(event.time)) < 1e-12
    times = np.linspace(0.3, 7.3, 7)
    fine = run(system, 0.2)
    assert np.abs(motion.at(times).q - fine.at(times).q).max() < 1e-11
