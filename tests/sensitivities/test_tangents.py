"""Tangents are the derivatives of the discrete motion: of each step by CasADi's own implicit
function theorem, of whole runs by differences, by closed forms, and symplectic.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, driven_damped, pendulum
from scipy.special import ellipe, ellipk

import varint as vi
from varint.codegen import cache
from varint.codegen.graph import NotCompilable
from varint.codegen.native_sweep import native_sweep
from varint.numerics.arrays import call
from varint.sensitivities import loops, steps_at_once
from varint.sensitivities.loops import is_built, sweeper


def spring() -> tuple[vi.System, vi.Parameters]:
    """A mass on a spring in the plane, with parameters."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.3, k=2.0, rest=[1.0, 0.2])
    stretch = ca.sqrt(ca.sumsqr(q - c.rest)) - 1.0
    return vi.System(q, v, c.m * ca.sumsqr(v) / 2 - c.k * stretch**2 / 2, params=c), c


def driven_cart() -> vi.System:
    """Controls that enter nonlinearly, a mass matrix that depends on q, time, a parameter."""
    q, v, t = *vi.coordinates("x", "theta"), vi.time()
    u, c = ca.SX.sym("u", 2), vi.Parameters(g=9.81)
    kinetic = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2
    force = ca.vertcat(u[0] - 0.1 * v[0], u[1] ** 2 * ca.sin(t))
    return vi.System(q, v, kinetic + c.g * ca.cos(q[1]), force=force, control=u, params=c, t=t)


def swinging() -> vi.System:
    """A linear scene that is driven and damped."""
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    c = vi.Parameters(k=2.0, drag=0.1)
    lagrangian = ca.sumsqr(v) / 2 - c.k * ca.sumsqr(q) / 2 - 0.3 * q[0] * q[1]
    force = ca.vertcat(ca.sin(t) - c.drag * v[0], -c.drag * v[1])
    return vi.System(q, v, lagrangian, force=force, params=c, t=t)


def differences(motion_at, x: np.ndarray, d: float = 1e-3) -> np.ndarray:
    """∂f/∂x by central differences of order 8."""
    columns = []
    for i in range(len(x)):
        e = np.zeros(len(x))
        e[i] = d
        columns.append(
            sum(
                w * (motion_at(x + k * e) - motion_at(x - k * e))
                for k, w in zip((1, 2, 3, 4), (4 / 5, -1 / 5, 4 / 105, -1 / 280), strict=True)
            )
            / d
        )
    return np.array(columns).T


def step_slopes(system: vi.System, rule: vi.Rule) -> ca.Function:
    """∂(q1, p1)/∂q0 and ∂(q1, p1)/∂p0 of the step function, by CasADi."""
    step = vi.step_function(system, rule)
    inputs = [ca.MX.sym(step.name_in(i), step.numel_in(i)) for i in range(6)]
    q, p, u, *others = inputs
    after = ca.vertcat(*step.call([q, p, ca.reshape(u, *step.size_in(2)), *others])[:2])
    return ca.Function("slopes", inputs, [ca.densify(ca.jacobian(after, x)) for x in (q, p)])


KINDS = [
    (pendulum, vi.composition("blanes-moan4")),
    (pendulum, vi.midpoint()),
    (double_pendulum, vi.gauss(2)),
    (double_pendulum, vi.gauss(5)),
    (driven_damped, vi.gauss(3)),
    (driven_damped, vi.lobatto(3)),
    (swinging, vi.gauss(3)),
]
HELD = [
    (vi.models.pendulum_cartesian, vi.lobatto(3)),
    (vi.models.pendulum_cartesian, vi.trapezoidal()),  # SHAKE and RATTLE
    (vi.models.double_atwood, vi.lobatto(2)),
    (vi.models.turning_wire, vi.lobatto(4)),
    (vi.models.chaplygin_sleigh, vi.midpoint()),
    (vi.models.rolling_disc, vi.midpoint()),
]


def named(x) -> str:
    return x.__name__ if callable(x) else str(x)


def run_of(scene, rule: vi.Rule, steps: int = 4) -> vi.Trajectory:
    made = scene()
    if isinstance(made, vi.System):
        n = made.structure.n
        q0, v0 = np.linspace(0.7, 0.3, n), np.linspace(0.2, -0.1, n)
        return vi.simulate(made, rule, q0=q0, v0=v0, h=0.05, steps=steps)
    return vi.simulate(made.system, rule, q0=made.q0, v0=made.v0, h=made.h, steps=steps)


@pytest.mark.parametrize(("scene", "rule"), KINDS + HELD, ids=named)
def test_a_step_has_the_derivative_that_its_equations_give_it(scene, rule):
    motion = run_of(scene, rule)
    slopes = step_slopes(motion.system, rule)
    for k in range(2):
        at = motion.q[k], motion.p[k], np.empty(0), motion.c, motion.t[k : k + 1]
        size = 2 * motion.q.shape[1]
        flat = call(slopes, *at, np.array([motion.h]))
        whole = np.hstack([x.reshape(-1, size).T for x in flat])
        found = motion.transition_matrix(k, k + 1)
        assert np.abs(found - whole).max() < 1e-12 * np.abs(whole).max()


def tangent_space(motion: vi.Trajectory, k: int) -> np.ndarray:
    """Changes of (q, p) at a node that keep to g = 0 and W v + w = 0, as columns."""
    from varint.diagnostics.constraints import surface_function

    slope = np.array(
        surface_function(motion.system)(motion.q[k], motion.p[k], motion.t[k], motion.c)[1]
    )
    _, values, vectors = np.linalg.svd(slope)
    return vectors[int((values > 1e-10 * values[0]).sum()) :].T


@pytest.mark.parametrize(
    "rule", [vi.gauss(2), vi.gauss(4), vi.lobatto(3), vi.composition("kahan-li6")], ids=str
)
def test_sensitivities_are_what_differences_of_runs_come_to(rule):
    system, c = spring()
    start = np.array([0.4, -0.3, 0.2, 0.5, 0.1, 1.3, 2.0, 1.0, 0.2])

    def end(x: np.ndarray) -> np.ndarray:
        params = dict(m=x[5], k=x[6], rest=x[7:])
        motion = vi.simulate(system, rule, q0=x[:2], v0=x[2:4], h=x[4], steps=12, params=params)
        return np.concatenate([motion.q[-1], motion.v[-1]])

    motion = vi.simulate(system, rule, q0=start[:2], v0=start[2:4], h=0.1, steps=12)
    found = vi.sensitivity(motion, ["q0", "v0", "h", c.m, "k", c.rest])
    assert found.shape == (13, 4, 9)
    assert np.array_equal(found[0, :, :4], np.eye(4))
    wanted = differences(end, start)
    assert np.abs(found[-1] - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize("held", [True, False], ids=["held", "at nodes"])
def test_sensitivities_to_controls_and_times_are_what_differences_come_to(rule, held):
    system, steps = driven_cart(), 3
    shape = (steps, 1 if held else len(rule.nodes), 2)
    u = np.random.default_rng(1).uniform(-1, 1, shape)
    start = np.concatenate([[0.3, 0.9], u.ravel()])  # t0, duration, u

    def run(x: np.ndarray) -> vi.Trajectory:
        given = x[2:].reshape(shape)
        return vi.simulate(
            system,
            rule,
            q0=[0.1, 0.4],
            v0=[0.2, -0.3],
            t0=x[0],
            duration=x[1],
            steps=steps,
            u=given[:, 0] if held else given,
        )

    found = vi.sensitivity(run(start), ["t0", "duration", "u"], outputs=system.q * system.v)
    wanted = differences(lambda x: run(x).q[-1] * run(x).v[-1], start)
    assert np.abs(found[-1] - wanted).max() < 1e-10 * np.abs(wanted).max()
    assert not found[1, :, 2 + shape[1] * 2 :].any()  # what comes later has no effect


def test_with_momenta_held_parameters_act_otherwise_than_with_velocities_held():
    q, v = vi.coordinates("x")
    c = vi.Parameters(m=2.0)
    motion = vi.simulate(
        vi.System(q, v, c.m * v**2 / 2, params=c), vi.midpoint(), q0=0.0, v0=3.0, h=0.5, steps=4
    )
    assert np.allclose(vi.sensitivity(motion, ["m", "v0"])[-1], [[0.0, 2.0], [0.0, 1.0]])
    # x = p0 t / m
    assert np.allclose(vi.sensitivity(motion, ["m", "p0"])[-1], [[-3.0, 1.0], [-1.5, 0.5]])


@pytest.mark.parametrize(
    ("scene", "rule"),
    [
        (pendulum, vi.gauss(2)),
        (pendulum, vi.composition("kahan-li6")),
        (double_pendulum, vi.gauss(4)),
        (double_pendulum, vi.lobatto(3)),
    ],
    ids=named,
)
def test_the_transition_matrix_of_many_steps_is_symplectic(scene, rule):
    motion = run_of(scene, rule, steps=400)
    phi, n = motion.transition_matrix(), motion.q.shape[1]
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    assert np.abs(phi.T @ j @ phi - j).max() < 1e-13 * max(1.0, np.abs(phi).max() ** 2)


def test_transition_matrices_multiply():
    motion = run_of(double_pendulum, vi.gauss(2), steps=30)
    product = motion.transition_matrix(11, 30) @ motion.transition_matrix(0, 11)
    whole = motion.transition_matrix()
    assert np.abs(product - whole).max() < 1e-13 * np.abs(whole).max()
    assert np.array_equal(motion.transition_matrix(5, 5), np.eye(4))


def test_the_transition_matrix_of_a_circular_orbit_is_that_of_clohessy_and_wiltshire():
    model = vi.models.kepler(e=0.0)
    motion = vi.simulate(
        model.system, vi.gauss(8), q0=model.q0, v0=model.v0, duration=5.0, steps=40
    )
    of_state = vi.sensitivity(motion)[-1]
    t, (c, s) = 5.0, (np.cos(5.0), np.sin(5.0))
    wanted = np.array(
        [
            [4 - 3 * c, 0, s, 2 * (1 - c)],
            [6 * (s - t), 1, -2 * (1 - c), 4 * s - 3 * t],
            [3 * s, 0, c, 2 * s],
            [-6 * (1 - c), 0, -2 * s, 4 * c - 3],
        ]
    )

    def turning(angle: float) -> np.ndarray:
        """From the frame that turns with the orbit to the one at rest."""
        r = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return np.block([[r, np.zeros((2, 2))], [r @ [[0, -1], [1, 0]], r]])

    wanted = turning(t) @ wanted @ np.linalg.inv(turning(0.0))
    assert np.abs(of_state - wanted).max() < 1e-12 * np.abs(wanted).max()


def after_a_period(motion: vi.Trajectory, slope: np.ndarray, period_slope: float) -> np.ndarray:
    """1 − f (dT/dE ∂E/∂x): where all orbits are closed, a neighbour is late by what its period
    is longer.
    """
    n = motion.q.shape[1]
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    return np.eye(2 * n) - np.outer(j @ slope, period_slope * slope)


def test_keplers_transition_matrix_after_a_period_in_closed_form():
    model = vi.models.kepler(e=0.6)
    q, v = model.q0, model.v0
    r, energy = np.linalg.norm(q), v @ v / 2 - 1 / np.linalg.norm(q)
    motion = vi.simulate(
        model.system,
        vi.gauss(8),
        q0=q,
        v0=v,
        duration=2 * np.pi * (-2 * energy) ** -1.5,
        steps=80,
    )
    slope = np.concatenate([q / r**3, v])  # of E, with p = v
    wanted = after_a_period(motion, slope, 6 * np.pi * (-2 * energy) ** -2.5)
    found = motion.transition_matrix()
    assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_the_pendulums_transition_matrix_after_a_period_by_elliptic_integrals():
    theta = 2.0
    m = np.sin(theta / 2) ** 2
    period = 4 * ellipk(m)
    # dK/dm = (E − (1 − m) K) / (2 m (1 − m)); E = 2m − 1 is the pendulum's energy
    of_energy = 4 * (ellipe(m) - (1 - m) * ellipk(m)) / (2 * m * (1 - m)) / 2
    motion = vi.simulate(
        pendulum(), vi.composition("kahan-li8"), q0=theta, v0=0.0, duration=period, steps=300
    )
    wanted = after_a_period(motion, np.array([np.sin(theta), 0.0]), of_energy)
    assert np.abs(motion.transition_matrix() - wanted).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("rule", [vi.gauss(4), vi.composition("blanes-moan4")], ids=str)
def test_compiled_and_native_tangents_are_the_same_and_interpreted_ones_agree(rule):
    system, _ = spring()
    motion = vi.simulate(system, rule, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=40)
    wrt = ["q0", "v0", "t0", "h", "m", "k", "rest"]
    one, data, other = (
        vi.sensitivity(motion, wrt, backend=backend)
        for backend in ("compiled", "native", "interpreted")
    )
    assert np.array_equal(one, data)
    assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()


def test_columns_are_the_same_bytes_whatever_is_beside_them():
    """They are carried side by side, and each goes on until it is found."""
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(4), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=40)
    names = ["q0", "v0", "rest", "m", "k"]
    whole = vi.sensitivity(motion, names, backend="native")
    for few, at in ((["v0"], slice(2, 4)), (["rest", "m", "k"], slice(4, 8)), (["k"], slice(7, 8))):
        found = vi.sensitivity(motion, ["q0", *few], backend="native")[:, :, 2:]
        assert np.array_equal(found, whole[:, :, at])


@pytest.mark.skipif(not is_built(), reason="installed without a compiler")
def test_gauss_rules_are_arranged_without_the_derivative_of_a_whole_step(monkeypatch):
    monkeypatch.setattr(loops, "operations", lambda *_: pytest.fail("a step was differentiated"))
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(8), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.3, steps=20)
    phi = motion.transition_matrix()
    form = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    assert np.abs(phi.T @ form @ phi - form).max() < 1e-12


def test_a_stiff_scene_is_differentiated_by_factors_where_the_stages_do_not_contract():
    q, v = vi.coordinates("x", "y")
    stiff = vi.System(q, v, ca.sumsqr(v) / 2 - 1e4 * (ca.sumsqr(q) - 1) ** 2 - q[1])
    motion = vi.simulate(stiff, vi.gauss(3), q0=[1.0, 0.0], v0=[0.0, 1.0], h=0.05, steps=20)
    data, other = (vi.sensitivity(motion, backend=x) for x in ("native", "interpreted"))
    assert np.abs(data - other).max() < 1e-10 * np.abs(other).max()


@pytest.mark.skipif(not is_built(), reason="installed without a compiler")
def test_steps_whose_factors_are_too_large_for_the_core_are_differentiated_all_the_same():
    """Ten stages of a double pendulum, and steps at which the iteration of their derivatives
    fails: CasADi takes those.
    """
    model = vi.models.double_pendulum(theta=(2.0, 2.5), length=(1.2, 1.0))
    start = dict(q0=model.q0, v0=model.v0, h=0.2)
    motion = vi.simulate(model.system, vi.gauss(10), **start, steps=60)
    with pytest.raises(NotCompilable, match="too large"):
        native_sweep(motion.system, motion.rule, None)
    loss = ca.sumsqr(motion.system.v)
    sums = [vi.gradient(motion, None, loss, backend=x) for x in ("native", "interpreted")]
    assert np.allclose(sums[0].v0, sums[1].v0, rtol=1e-9)
    ends = vi.sensitivity(motion, ["q0", "v0"], backend="native")[-1]
    assert np.allclose(2 * motion.v[-1] @ ends[2:, 2:], sums[0].v0, rtol=1e-6)
    phi = motion.transition_matrix()
    form = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    assert np.abs(phi.T @ form @ phi - form).max() < 1e-13 * np.abs(phi).max() ** 2


@pytest.mark.long
@pytest.mark.parametrize(("scene", "rule"), KINDS + HELD, ids=named)
def test_derivatives_are_the_same_bytes_with_the_scene_as_data_and_compiled(scene, rule):
    motion = run_of(scene, rule, steps=12)
    s, wrt = motion.system, ["q0", "v0", *motion.system.defaults, "t0", "h"]
    loss = ca.sumsqr(s.q) + ca.sumsqr(s.v)
    both = ("native", "compiled")
    one, other = (vi.sensitivity(motion, wrt, backend=x) for x in both)
    assert np.array_equal(one, other)
    one, other = (vi.gradient(motion, loss, s.q[0], backend=x) for x in both)
    assert repr(one) == repr(other)
    for name in ("value", "q0", "v0", "h", "t0"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    flows = [vi.flow(s, rule, h=motion.h, steps=3, backend=x) for x in both]
    x = [ca.MX.sym(f"x{i}", *flows[0].size_in(i)) for i in range(4)]
    given = motion.q[0], motion.v[0], motion.c, np.zeros(flows[0].size_in(3))
    hessians = []
    for flow in flows:
        value = ca.sum1(ca.vertcat(*flow(*x)))
        of_both = ca.hessian(value, ca.vertcat(*x[:3]))[0]
        hessians.append(np.array(ca.Function("hessian", x, [of_both])(*given)))
    assert np.abs(hessians[0]).max() > 0
    assert np.array_equal(*hessians)


@pytest.mark.skipif(not is_built(), reason="installed without a compiler")
def test_long_sweeps_need_no_compiler(monkeypatch, recwarn):
    """The native core takes them: far less than CasADi's own loops, with nothing compiled."""
    monkeypatch.setattr(cache, "library", lambda *_: pytest.fail("something was compiled"))
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(4), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=1000)
    by = sweeper(system, motion.rule, 1000, "auto")
    assert by.native and by.kernels
    of_end = motion.transition_matrix()
    found = vi.gradient(motion, terminal_loss=system.q[1], held="p0")
    assert np.abs(of_end[1] - np.concatenate([found.q0, found.p0])).max() < 1e-9
    assert not recwarn


def test_nodes_that_were_left_out_are_computed_once_more():
    system, _ = spring()
    given = dict(q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=40)
    all_kept = vi.simulate(system, vi.gauss(2), **given)
    few = vi.simulate(system, vi.gauss(2), **given, save_every=7)
    wanted = vi.sensitivity(all_kept, ["q0", "k"])[few.k]
    found = vi.sensitivity(few, ["q0", "k"])
    assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()
    assert np.allclose(few.transition_matrix(2, 4), all_kept.transition_matrix(14, 28))


def test_a_part_of_a_run_is_differentiated_from_its_own_start():
    system, steps = driven_cart(), 6
    u = np.random.default_rng(1).uniform(-1, 1, (steps, 2))
    motion = vi.simulate(
        system, vi.gauss(2), q0=[0.1, 0.4], v0=[0.2, -0.3], h=0.1, steps=steps, u=u
    )
    part = motion[2:]
    alone = vi.simulate(
        system, vi.gauss(2), q0=part.q[0], v0=part.v[0], h=0.1, steps=4, t0=0.2, u=u[2:]
    )
    found, wanted = (vi.sensitivity(x, ["q0", "h", "u"])[-1] for x in (part, alone))
    assert found.shape == (4, 3 + 12) and not found[:, 3:7].any()
    assert np.abs(np.delete(found, range(3, 7), 1) - wanted).max() < 1e-12 * np.abs(wanted).max()
    one, other = (vi.gradient(x, terminal_loss=system.q[0]) for x in (part, alone))
    assert not one.u[:2].any() and np.allclose(one.u[2:], other.u, rtol=1e-11, atol=1e-14)
    assert one.h == pytest.approx(other.h, rel=1e-11)


def test_redundant_constraints_have_the_tangents_of_those_that_are_independent():
    q, v = vi.coordinates("x", "y")
    lagrangian, rod = ca.sumsqr(v) / 2 - 9.81 * q[1], ca.sumsqr(q) - 1
    given = dict(q0=[0.6, -0.8], v0=[0.8, 0.6], h=0.02, steps=5)
    once = vi.simulate(vi.System(q, v, lagrangian, constraint=rod), vi.lobatto(3), **given)
    both = vi.System(q, v, lagrangian, constraint=ca.vertcat(rod, 2 * rod))
    with pytest.warns(UserWarning, match="redundant"):
        twice = vi.simulate(both, vi.lobatto(3), **given)
    along = tangent_space(once, 0)
    one, two = (x.transition_matrix() @ along for x in (once, twice))
    assert np.abs(one - two).max() < 1e-11 * np.abs(one).max()


@pytest.mark.parametrize("backend", ["native", "interpreted"])
def test_a_derivative_that_cannot_be_taken_is_told_by_its_step_and_cause(backend):
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=2.0)
    system = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    motion = vi.simulate(system, vi.midpoint(), q0=0.4, v0=0.2, h=0.5, steps=9)
    singular = np.array([-16.0])  # 1 + h² k / 4 = 0
    with pytest.raises(vi.ConvergenceError, match="no regular derivative") as found:
        vi.sensitivity(replace(motion, c=singular), ["p0"], backend=backend)
    assert found.value.step == 0
    motion = run_of(pendulum, vi.midpoint(), steps=9)
    lost = motion.q.copy()
    lost[4] = np.nan
    with pytest.raises(vi.ConvergenceError, match="not finite") as found:
        vi.sensitivity(replace(motion, q=lost), backend=backend)
    assert found.value.step == 3


def test_what_ends_an_evaluation_for_another_reason_is_not_called_a_grazing(monkeypatch):
    system, _ = spring()
    motion = vi.simulate(system, vi.gauss(2), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=4)

    def interrupted(*_):
        raise RuntimeError("Error in Function::call\nno more threads")

    monkeypatch.setattr(steps_at_once, "over_columns", interrupted)
    with pytest.raises(vi.ConvergenceError, match=r"step 0.*no more threads"):
        vi.sensitivity(motion, backend="interpreted")


def test_what_cannot_be_differentiated_is_refused_in_words():
    system, _ = spring()
    motion = vi.simulate(system, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=4)
    for wrt, words in (
        (["speed"], "unknown.*known"),
        ([], "each once"),
        (["q0", "q0"], "each once"),
        (["v0", "p0"], "both v0 and p0"),
        (["h", "duration"], "both h and duration"),
        (["u"], "unknown"),
        ([3], "names or symbols"),
    ):
        with pytest.raises(vi.InputError, match=words):
            vi.sensitivity(motion, wrt)
    with pytest.raises(vi.InputError, match="backend"):
        vi.sensitivity(motion, backend="fast")
    with pytest.raises(vi.InputError, match="unknown symbols"):
        vi.sensitivity(motion, outputs=ca.SX.sym("z"))
    for k0, k1 in ((3, 1), (0, 9), (0.5, 1)):
        with pytest.raises(vi.InputError, match="node"):
            motion.transition_matrix(k0, k1)
    with pytest.raises(vi.InputError, match="no step"):
        motion[:1].transition_matrix()
    first = vi.models.guiding_centre()
    with pytest.warns(UserWarning, match="degenerate"):
        drift = vi.simulate(first.system, q0=first.q0, v0=first.v0, h=first.h, steps=4)
    with pytest.raises(vi.InputError, match="first order"):
        drift.transition_matrix()
