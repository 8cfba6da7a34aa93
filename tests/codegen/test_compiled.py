"""Compiled run loops: against independent implementations in NumPy, and the properties of the
methods.
"""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import gauss
from varint.codegen.arguments import DONE, NOT_CONVERGED, NOT_FINITE
from varint.codegen.cache import compiler
from varint.codegen.explicit import explicit_kernel
from varint.codegen.gauss import gauss_form, gauss_kernel
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import run_loop
from varint.codegen.tableau import gauss_tableau

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def pendulum():
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + ca.cos(q))


def kepler():
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))


def double_pendulum():
    q, v = vi.coordinates("a", "b")
    x = ca.vertcat(ca.sin(q[0]), -ca.cos(q[0]))
    y = x + 0.7 * ca.vertcat(ca.sin(q[1]), -ca.cos(q[1]))
    kinetic = ca.sumsqr(ca.jtimes(x, q, v)) / 2 + 1.3 * ca.sumsqr(ca.jtimes(y, q, v)) / 2
    return vi.System(q, v, kinetic - 2 * x[1] - 3 * y[1])


def driven():
    """Coupled constant mass, parameters, time, controls, a force on the velocity, a constant in
    the momentum.
    """
    q, v = vi.coordinates("x", "y")
    t, c, u = vi.time(), vi.Parameters(k=1.3, m=[2.0, 0.7]), ca.SX.sym("u")
    kinetic = c.m[0] * v[0] ** 2 / 2 + c.m[1] * v[1] ** 2 / 2 + 0.4 * v[0] * v[1] + 0.3 * c.k * v[0]
    potential = c.k * q[0] ** 2 / 2 + q[1] ** 4 / 4 + q[0] * q[1] * ca.cos(t)
    force = ca.vertcat(u * ca.sin(q[1]), -0.1 * v[1])
    return vi.System(q, v, kinetic - potential, force=force, control=u, params=c, t=t)


def kicked():
    """The same without the force on the velocity: explicit."""
    q, v = vi.coordinates("x", "y")
    t, c, u = vi.time(), vi.Parameters(k=1.3, m=[2.0, 0.7]), ca.SX.sym("u")
    kinetic = c.m[0] * v[0] ** 2 / 2 + c.m[1] * v[1] ** 2 / 2 + 0.4 * v[0] * v[1] + 0.3 * c.k * v[0]
    potential = c.k * q[0] ** 2 / 2 + q[1] ** 4 / 4 + q[0] * q[1] * ca.cos(t)
    return vi.System(
        q, v, kinetic - potential, force=ca.vertcat(0, u * q[0]), control=u, params=c, t=t
    )


def field(system):
    """(q, p, t, u, c) → (v, dL/dq + F), by solving with the mass matrix in CasADi."""
    p = ca.SX.sym("p", system.q.numel())
    rest = ca.substitute(system.momentum, system.v, 0 * system.v)
    v = ca.solve(system.mass_matrix, p - rest)
    f = ca.substitute(ca.gradient(system.lagrangian, system.q) + system.force, system.v, v)
    return ca.Function("field", [system.q, p, system.t, system.control, system.c], [v, f])


def gauss_by_numpy(system, rule, q, p, h, steps, u=None, t0=0.0):
    """Gauss collocation by plain fixed-point iteration in NumPy."""
    rhs, a, b, c = field(system), rule.collocation, np.array(rule.weights), np.array(rule.nodes)
    for k in range(steps):
        speed, force = np.zeros((len(c), len(q))), np.zeros((len(c), len(q)))
        for _ in range(60):
            at = [(q + h * a[i] @ speed, p + h * a[i] @ force) for i in range(len(c))]
            out = [
                rhs(
                    x,
                    y,
                    t0 + (k + c[i]) * h,
                    u[k, i] if u is not None else [],
                    system.default_vector,
                )
                for i, (x, y) in enumerate(at)
            ]
            speed, force = (np.array([np.array(o[j]).ravel() for o in out]) for j in (0, 1))
        q, p = q + h * b @ speed, p + h * b @ force
    return q, p


def composition_by_numpy(system, rule, q, p, h, steps, u=None):
    rhs, times = field(system), np.array([0, *np.cumsum(rule.drifts)])
    for k in range(steps):
        for i, kick in enumerate(rule.kicks):
            at = (k + times[i]) * h, u[k, i] if u is not None else [], system.default_vector
            p = p + h * kick * np.array(rhs(q, p, *at)[1]).ravel()
            if i < len(rule.drifts):
                q = q + h * rule.drifts[i] * np.array(rhs(q, p, *at)[0]).ravel()
    return q, p


def turning():
    """A charged particle in the plane: velocities depend on the place and on momenta that
    change.
    """
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 + q[0] ** 2 * v[1] - ca.sumsqr(q))


def simulated(kernel, q0, p0, h, steps, system=None, **options):
    c = np.zeros(0) if system is None else system.default_vector
    return run_loop(
        kernel,
        np.array(q0, float),
        np.array(p0, float),
        c,
        t0=options.pop("t0", 0.0),
        h=h,
        steps=steps,
        **options,
    )


def controls(kernel, steps):
    return np.random.default_rng(0).uniform(-1, 1, (steps, kernel.nodes, kernel.controls))


@pytest.mark.parametrize("stages", (1, 2, 3, 5, 8, 10))
def test_the_second_order_form_gives_what_plain_gauss_collocation_gives(stages):
    rule = vi.gauss(stages)
    found = simulated(gauss_kernel(kepler(), rule), [0.4, 0], [0, 2.0], 0.05, 12)
    q, p = gauss_by_numpy(kepler(), rule, np.array([0.4, 0]), np.array([0, 2.0]), 0.05, 12)
    assert found.status == DONE
    assert np.abs(found.rows[-1] - [q, p, p]).max() < 1e-14


@pytest.mark.parametrize("stages", (1, 2, 4, 8))
def test_the_first_order_form_gives_what_plain_gauss_collocation_gives(stages):
    system, rule = double_pendulum(), vi.gauss(stages)
    found = simulated(gauss_kernel(system, rule), [1.0, 2.0], [0.3, -0.2], 0.02, 12)
    q, p = gauss_by_numpy(system, rule, np.array([1.0, 2.0]), np.array([0.3, -0.2]), 0.02, 12)
    assert np.abs(found.rows[-1, :2] - [q, p]).max() < 1e-14


@pytest.mark.parametrize("form", (1, 2))
def test_time_controls_parameters_damping_and_coupled_mass_enter_as_they_should(form):
    system, rule = driven(), vi.gauss(3)
    kernel = gauss_kernel(system, rule, form)
    u = controls(kernel, 15)
    found = simulated(kernel, [0.5, -0.4], [0.2, 0.1], 0.1, 15, system, u=u, t0=0.7)
    q, p = gauss_by_numpy(
        system, rule, np.array([0.5, -0.4]), np.array([0.2, 0.1]), 0.1, 15, u, 0.7
    )
    assert np.abs(found.rows[-1, :2] - [q, p]).max() < 1e-14
    v = ca.Function("v", [system.v, system.c], [system.momentum])
    assert np.abs(np.array(v(found.rows[-1, 2], system.default_vector)).ravel() - p).max() < 1e-14


def test_both_forms_agree_to_round_off():
    """Separable scenes may be written in either form; 600 steps leave them apart by round-off
    only.
    """
    runs = [
        simulated(gauss_kernel(pendulum(), vi.gauss(8), form), [2.0], [0.5], 0.5, 600)
        for form in (1, 2)
    ]
    assert np.abs(runs[0].rows - runs[1].rows).max() < 1e-12
    # forces first, then what they make of the momenta
    assert 0.8 < runs[1].iterations / runs[0].iterations < 1.2


@pytest.mark.parametrize("name", ("verlet", "yoshida4"))
def test_compositions_give_what_kick_and_drift_give(name):
    system, rule = kicked(), vi.composition(name)
    kernel = explicit_kernel(system, rule)
    u = controls(kernel, 20)
    found = simulated(kernel, [0.5, -0.4], [0.2, 0.1], 0.1, 20, system, u=u)
    q, p = composition_by_numpy(
        system, rule, np.array([0.5, -0.4]), np.array([0.2, 0.1]), 0.1, 20, u
    )
    assert np.abs(found.rows[-1, :2] - [q, p]).max() < 1e-14
    free = explicit_kernel(kepler(), rule)
    found = simulated(free, [0.4, 0], [0, 2.0], 0.01, 50)
    q, p = composition_by_numpy(kepler(), rule, np.array([0.4, 0]), np.array([0, 2.0]), 0.01, 50)
    assert np.abs(found.rows[-1] - [q, p, p]).max() < 1e-14


def slope(errors, steps):
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize("stages", (1, 2, 3))
def test_compiled_gauss_has_order_2s(stages):
    kernel, best = (
        gauss_kernel(double_pendulum(), vi.gauss(stages)),
        gauss_kernel(double_pendulum(), vi.gauss(8)),
    )
    exact = simulated(best, [1.0, 0.4], [0.1, 0.2], 1 / 40, 40).rows[-1]
    counts = np.array((40, 60, 90) if stages < 3 else (20, 30, 45))
    ends = [simulated(kernel, [1.0, 0.4], [0.1, 0.2], 1 / n, int(n)).rows[-1] for n in counts]
    for part in (0, 1):
        errors = [np.abs(end[part] - exact[part]).max() for end in ends]
        assert slope(errors, counts) == pytest.approx(2 * stages, abs=0.15)


@pytest.mark.parametrize(("name", "order"), (("verlet", 2), ("yoshida4", 4)))
def test_compiled_compositions_have_their_order(name, order):
    kernel, best = (
        explicit_kernel(pendulum(), vi.composition(name)),
        gauss_kernel(pendulum(), vi.gauss(8)),
    )
    exact = simulated(best, [1.0], [0.4], 0.1, 50).rows[-1]
    counts = np.array([200, 300, 450])
    ends = [simulated(kernel, [1.0], [0.4], 5 / n, int(n)).rows[-1] for n in counts]
    for part in (0, 1):
        assert slope(
            [np.abs(end[part] - exact[part]).max() for end in ends], counts
        ) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("stages", range(1, 17))
def test_rounded_tableaux_are_symplectic_and_symmetric_without_rounding_error(stages):
    t = gauss_tableau(stages)
    c, m, mm = t["STAGE_C"][0], t["STAGE_M1"], t["STAGE_M2"]
    assert np.array_equal(m + m.T, np.ones_like(m))
    assert np.array_equal(m, m[::-1, ::-1].T)
    assert np.array_equal(mm - mm.T, c[:, None] - c)
    assert np.array_equal(mm, mm[::-1, ::-1].T)
    assert np.array_equal(c + c[::-1], np.ones(stages))
    a, b = vi.gauss(stages).collocation, np.array(vi.gauss(stages).weights)
    assert np.abs(m * b - a).max() < 1e-15 and np.abs(mm * b - a @ a).max() < 1e-15


def windows(values, count=20):
    return np.array([w.mean() for w in np.array_split(values, count)])


def has_no_slope(values):
    """The windowed means grow by no more than their own scatter and a few units in the last
    place.
    """
    means = windows(values)
    x = np.linspace(-1, 1, len(means))
    fit = np.polyfit(x, means, 1)
    scatter = (means - np.polyval(fit, x)).std() / np.sqrt(len(means) / 3)
    return abs(fit[0]) < 4 * scatter + 1e-15


@pytest.mark.parametrize("form", (1, 2))
def test_gauss_keeps_energy_and_angular_momentum_over_long_runs(form):
    kernel = gauss_kernel(kepler(), vi.gauss(8), form)
    e = 0.6
    found = simulated(
        kernel, [1 - e, 0], [0, np.sqrt((1 + e) / (1 - e))], 2 * np.pi / 25.3, 200_000, save_every=7
    )
    q, p = found.rows[:, 0], found.rows[:, 1]
    energy = (p**2).sum(1) / 2 - 1 / np.hypot(*q.T)
    spin = q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]
    assert has_no_slope(energy + 0.5) and np.abs(windows(energy) + 0.5).max() < 1e-8
    # 2e5 steps: a part in 500 of a unit in the last place each
    assert np.abs(spin - spin[0]).max() < 5e-14


def test_verlet_keeps_energy_over_a_million_steps():
    kernel = explicit_kernel(pendulum(), vi.composition("verlet"))
    found = simulated(kernel, [1.0], [0.0], 0.05, 1_000_000, save_every=13)
    energy = found.rows[:, 1, 0] ** 2 / 2 - np.cos(found.rows[:, 0, 0])
    assert has_no_slope(energy) and np.ptp(energy) < 1e-3


def test_runs_go_back_to_where_they_came_from():
    kernel = gauss_kernel(double_pendulum(), vi.gauss(4))
    there = simulated(kernel, [0.5, 0.7], [0.2, -0.1], 0.05, 100).rows[-1]
    back = simulated(kernel, there[0], -there[1], 0.05, 100).rows[-1]
    assert (
        np.abs(back[0] - [0.5, 0.7]).max() < 1e-12 and np.abs(back[1] + [0.2, -0.1]).max() < 1e-12
    )
    verlet = explicit_kernel(kepler(), vi.composition("yoshida4"))
    there = simulated(verlet, [0.4, 0], [0, 2.0], 0.01, 500).rows[-1]
    back = simulated(verlet, there[0], there[1], -0.01, 500).rows[-1]
    assert np.abs(back[:2] - [[0.4, 0], [0, 2.0]]).max() < 1e-12


KERNELS = {
    "gauss, next step begun": lambda: (kepler(), gauss_kernel(kepler(), vi.gauss(8))),
    "gauss, next step begun, halves": lambda: (turning(), gauss_kernel(turning(), vi.gauss(8))),
    "gauss, second order": lambda: (kicked(), gauss_kernel(kicked(), vi.gauss(8))),
    "gauss, first order": lambda: (kicked(), gauss_kernel(kicked(), vi.gauss(3), 1)),
    "composition": lambda: (kicked(), explicit_kernel(kicked(), vi.composition("yoshida4"))),
}


@pytest.mark.parametrize("which", KERNELS)
def test_a_run_in_pieces_is_bitwise_the_run_in_one(which):
    system, kernel = KERNELS[which]()
    u = controls(kernel, 90) if kernel.controls else None
    whole = simulated(kernel, [0.5, 0.4], [0.2, 1.1], 0.1, 90, system, u=u, save_every=5, t0=0.3)
    assert whole.status == DONE
    rows, carry = [whole.rows[:1]], None
    for first in (0, 30, 60):
        now = None if u is None else u[first : first + 30]
        options = {"u": now, "save_every": 5, "t0": 0.3, "first": first, "carry": carry}
        piece = simulated(kernel, [0.5, 0.4], [0.2, 1.1], 0.1, 30, system, **options)
        carry = piece.carry
        assert np.array_equal(piece.rows[0], rows[-1][-1]) or first == 0
        rows.append(piece.rows[1:])
    assert np.array_equal(np.concatenate(rows), whole.rows)
    assert np.array_equal(whole.last.reshape(3, -1), whole.rows[-1])


@pytest.mark.parametrize(
    ("which", "speed"),
    [("gauss, next step begun", [-0.78, 0.976]), ("gauss, next step begun, halves", [0.2, 0.6])],
)
def test_beginning_the_next_step_early_changes_nothing_but_round_off(
    which, speed, monkeypatch, forget
):
    """Nor does it take more evaluations than the start from a finished step, but for one in ten."""
    system, kernel = KERNELS[which]()
    forget()
    monkeypatch.setattr(gauss, "SHORT", 0)
    _, plain = KERNELS[which]()
    runs = [
        simulated(k, [0.5, 0.4], speed, 0.05, 2000, system, save_every=100) for k in (kernel, plain)
    ]
    assert all(run.status == DONE for run in runs)
    assert np.abs(runs[0].rows - runs[1].rows).max() < 1e-11
    assert runs[0].iterations < 1.1 * runs[1].iterations


def test_after_a_start_that_failed_the_high_degree_is_tried_again():
    """Pushed to and fro within a step, a bead in a bowl has no start polynomial; later it has
    good ones again.
    """
    q, v = vi.coordinates("x")
    t = vi.time()
    push = 30 * ca.logic_and(t > 40, t < 40.25) - 30 * ca.logic_and(t > 40.25, t < 40.5)
    system = vi.System(q, v, v**2 / 2 + 20 * ca.sqrt(400 - q**2) + q * push, t=t)
    kernel = gauss_kernel(system, vi.gauss(8))
    before = simulated(kernel, [1.0], [0.0], 0.5, 80)
    pushed = simulated(kernel, [1.0], [0.0], 0.5, 400)
    after = simulated(kernel, [1.0], [0.0], 0.5, 2000, first=400, carry=pushed.carry)
    assert before.status == pushed.status == after.status == DONE
    assert pushed.iterations > 1.05 * 5 * before.iterations  # starts of low degree for 200 steps
    assert after.iterations < 1.02 * 25 * before.iterations


def test_what_is_saved_does_not_depend_on_how_often():
    kernel = explicit_kernel(pendulum(), vi.composition("verlet"))
    often = simulated(kernel, [1.0], [0.0], 0.1, 60)
    assert np.array_equal(
        often.rows[::6], simulated(kernel, [1.0], [0.0], 0.1, 60, save_every=6).rows
    )


def test_a_looser_level_saves_iterations_and_costs_accuracy_accordingly():
    kernel = gauss_kernel(kepler(), vi.gauss(8))
    runs = [
        simulated(kernel, [0.4, 0], [0, 2.0], 0.2, 100, level=level) for level in (0, 1e-9, 1e-5)
    ]
    assert runs[0].iterations > runs[1].iterations > runs[2].iterations
    errors = [np.abs(r.rows[-1] - runs[0].rows[-1]).max() for r in runs[1:]]
    assert 1e-14 < errors[0] < 1e-6 and errors[0] < errors[1] < 1e-2


def test_a_stiff_scene_is_reported_with_the_step_and_a_residual():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - 1e6 * q[1] ** 2 / 2)
    found = simulated(gauss_kernel(system, vi.gauss(3)), [1.0, 1.0], [0.0, 0.0], 0.1, 10)
    assert (found.status, found.steps, len(found.rows)) == (NOT_CONVERGED, 0, 1)
    assert not found.failed < 1e-3
    assert np.array_equal(found.last[:4], [1.0, 1.0, 0.0, 0.0])


def test_a_failure_in_the_middle_of_a_run_keeps_what_came_before():
    """A force that grows without bound at t = 2: the step that would cross it fails, the rows
    before it are good.
    """
    q, v = vi.coordinates("x")
    t = vi.time()
    system = vi.System(q, v, v**2 / 2 + ca.log(2 - t) * q, t=t)
    for kernel in (
        gauss_kernel(system, vi.gauss(3)),
        explicit_kernel(system, vi.composition("verlet")),
    ):
        found = simulated(kernel, [0.0], [0.0], 0.25, 20)
        assert found.status in (NOT_CONVERGED, NOT_FINITE)
        assert found.steps in (7, 8) and len(found.rows) == found.steps + 1
        assert np.isfinite(found.rows).all() and np.isfinite(found.last).all()


def test_a_start_value_outside_the_domain_of_a_force_is_tried_again_from_constant_forces():
    """The acceleration jumps from −1000 to √x at t = 1; going on with −1000 leads to x < 0,
    where there is no root.
    """
    q, v = vi.coordinates("x")
    t = vi.time()
    pull = ca.if_else(t < 1, -1000 * q, 2 / 3 * ca.fmax(q, 0) ** 1.5)
    system = vi.System(q, v, v**2 / 2 + pull, t=t)
    rooted = vi.System(q, v, v**2 / 2 + ca.if_else(t < 1, -1000 * q, 2 / 3 * q**1.5), t=t)
    found = simulated(gauss_kernel(rooted, vi.gauss(3)), [-0.19], [20.0], 0.01, 12, t0=0.98)
    clipped = simulated(gauss_kernel(system, vi.gauss(3)), [-0.19], [20.0], 0.01, 12, t0=0.98)
    assert found.status == DONE
    assert np.abs(found.rows - clipped.rows).max() < 1e-13


def test_scenes_and_rules_that_do_not_fit_are_refused():
    q, v = vi.coordinates("x", "y")
    held = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    with pytest.raises(NotCompilable, match="constraints"):
        gauss_kernel(held, vi.gauss(2))
    with pytest.raises(NotCompilable, match="separable"):
        explicit_kernel(double_pendulum(), vi.composition("verlet"))
    with pytest.raises(NotCompilable, match="kicks"):
        explicit_kernel(kepler(), vi.gauss(2))
    assert (gauss_form(kepler()), gauss_form(double_pendulum()), gauss_form(held)) == (2, 1, 0)


def test_a_kernel_is_built_once_and_goes_with_its_system():
    system = pendulum()
    assert gauss_kernel(system, vi.gauss(2)) is gauss_kernel(system, vi.gauss(2))
    assert explicit_kernel(system, vi.composition("verlet")) is explicit_kernel(
        system, vi.composition("verlet")
    )


@pytest.mark.parametrize("lanes", (4, 2, 1))
def test_shorter_vectors_give_the_same_motion(lanes, monkeypatch, forget):
    """The code for machines with AVX2, NEON or SSE, or without vectors, runs here too."""
    for scene, q0 in ((double_pendulum, [1.2, -0.4]), (kepler, [0.8, 0.3])):
        forget()
        wide = gauss_kernel(scene(), vi.gauss(6))
        with monkeypatch.context() as patch:
            forget()
            patch.setattr(gauss, "vector_length", lambda: lanes)
            narrow = gauss_kernel(scene(), vi.gauss(6))
        one, other = (
            simulated(kernel, q0, [0.1, 0.2], 0.05, 200).rows[-1] for kernel in (wide, narrow)
        )
        assert f"of {lanes}" in narrow.about
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-12)
