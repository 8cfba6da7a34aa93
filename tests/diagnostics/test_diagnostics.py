"""Diagnostics tell variational rules from methods that only look right: explicit Euler and RK4
must fail them.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import cart_pendulum, double_pendulum, driven_damped, henon_heiles, pendulum

import varint as vi
from varint import diagnostics as d
from varint.diagnostics.long_runs import window_means
from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import velocity_function

START = dict(q0=1.0, v0=0.3)
RULES = [
    vi.gauss(1),
    vi.gauss(2),
    vi.gauss(4),
    vi.lobatto(2),
    vi.lobatto(3),
    vi.composition("blanes-moan6"),
]


def runge_kutta(
    system: vi.System, tableau: list[list[float]], weights: list[float], name: str
) -> ca.Function:
    """An explicit Runge–Kutta method for Hamilton's equations, with the signature of
    `step_function`.
    """
    n = system.structure.n
    sizes = (n, n, (system.structure.controls, 1), system.c.numel(), 1, 1)
    inputs = [
        ca.MX.sym(x, *(k if isinstance(k, tuple) else (k,)))
        for x, k in zip(("q0", "p0", "u", "params", "t", "h"), sizes, strict=True)
    ]
    q, p, u, c, t, h = inputs
    slopes: list = []
    for row in tableau:
        x = q + h * sum((a * s[0] for a, s in zip(row, slopes, strict=False)), ca.DM.zeros(n))
        y = p + h * sum((a * s[1] for a, s in zip(row, slopes, strict=False)), ca.DM.zeros(n))
        now = t + h * sum(row)
        v = velocity_function(system)(x, y, now, c)
        _, _, gradient, force = point_function(system)(x, v, u, now, c)
        slopes.append((v, gradient + force))
    q1 = q + h * sum(b * s[0] for b, s in zip(weights, slopes, strict=True))
    p1 = p + h * sum(b * s[1] for b, s in zip(weights, slopes, strict=True))
    return ca.Function(
        name, inputs, [q1, p1, 0], ["q0", "p0", "u", "params", "t", "h"], ["q1", "p1", "residual"]
    )


def euler(system: vi.System) -> ca.Function:
    return runge_kutta(system, [[]], [1.0], "explicit_euler")


def rk4(system: vi.System) -> ca.Function:
    return runge_kutta(
        system, [[], [0.5], [0, 0.5], [0, 0, 1.0]], [1 / 6, 1 / 3, 1 / 3, 1 / 6], "rk4"
    )


CONTROLS = [euler, rk4]


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_every_rule_passes_its_self_test(rule):
    result = d.self_test(pendulum(), rule, h=0.1, **START)
    assert result.passed, str(result)
    assert result.convergence.q_order == pytest.approx(rule.order, abs=0.15)
    assert result.convergence.p_order == pytest.approx(rule.order, abs=0.15)
    assert all(line.startswith(("✓", "–", " ")) for line in str(result).splitlines()[1:])


@pytest.mark.parametrize(
    ("system", "rule", "start"),
    [
        (double_pendulum(), vi.gauss(2), dict(q0=[0.4, -0.2], v0=[0.1, 0.3], h=0.02)),
        (cart_pendulum(), vi.lobatto(3), dict(q0=[0.1, 0.8], v0=[0.2, 0.0], h=0.02)),
        (henon_heiles(), None, dict(q0=[0.1, 0.2], v0=[0.2, -0.1], h=0.1)),
    ],
    ids=["double_pendulum", "cart_pendulum", "henon_heiles"],
)
def test_coupled_scenes_pass_their_self_test(system, rule, start):
    result = d.self_test(system, rule, steps=1000, **start)
    assert result.passed, str(result)


def spherical() -> vi.System:
    """A spherical pendulum in Cartesian coordinates."""
    q, v = vi.coordinates("x", "y", "z")
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[2], constraint=ca.sumsqr(q) - 1)


ON_SPHERE = dict(q0=[0.6, 0, -0.8], v0=[0, 1.0, 0])


@pytest.mark.parametrize("rule", [vi.lobatto(2), vi.lobatto(3), vi.lobatto(4)], ids=str)
def test_constrained_scenes_pass_with_the_two_form_on_the_manifold(rule):
    result = d.self_test(spherical(), rule, h=0.02, steps=1000, **ON_SPHERE)
    assert result.passed, str(result)
    assert result.symplectic.worst < 1e-13 and result.constraints.passed
    assert result.conserved["rotation about z"].drift < 1e-13
    assert result.convergence.q_order == pytest.approx(rule.order, abs=0.15)


def test_a_step_that_leaves_the_constraint_is_seen():
    system = spherical()
    exact = vi.step_function(system, vi.lobatto(2))
    inputs = [ca.MX.sym(exact.name_in(i), *exact.size_in(i)) for i in range(6)]
    q1, p1, *rest = exact.call(inputs)
    sloppy = ca.Function("sloppy", inputs, [q1 * (1 + 1e-9), p1, rest[0]])
    drift = d.constraint_drift(system, sloppy, h=0.02, steps=20, **ON_SPHERE)
    assert drift.passed is False and drift.position > 1e-9
    assert d.constraint_drift(system, vi.lobatto(2), h=0.02, steps=500, **ON_SPHERE).passed
    assert d.constraint_drift(pendulum(), vi.gauss(2), h=0.1, **START).passed is None


def test_forces_excuse_symplecticity_and_energy_but_not_order_and_round_off():
    result = d.self_test(
        driven_damped(), vi.gauss(2), q0=[0.3, 0.1], v0=[0.2, 0.4], h=0.05, steps=300
    )
    assert result.symplectic.passed is None and result.symplectic.worst > 1e-6
    assert result.energy.passed is None
    assert result.convergence.passed and result.reversibility.passed


@pytest.mark.parametrize("method", CONTROLS)
def test_a_method_that_is_not_variational_fails_its_self_test(method):
    system = pendulum()
    result = d.self_test(system, method(system), h=0.1, order={euler: 1, rk4: 4}[method], **START)
    assert not result.passed
    assert (result.symplectic.passed, result.reversibility.passed) == (False, False)
    assert (result.energy.passed, result.round_off.passed) == (False, False)
    assert result.convergence.passed  # their orders are right: order alone shows nothing


@pytest.mark.parametrize(("method", "claimed"), [(euler, 2), (rk4, 5)])
def test_an_order_claimed_too_high_fails(method, claimed):
    system = pendulum()
    assert (
        d.convergence(system, method(system), duration=6.4, order=claimed, **START).passed is False
    )


def test_a_force_put_on_one_side_of_the_step_is_seen_in_the_order():
    system = driven_damped()
    n = system.structure.n
    free = vi.System(system.q, system.v, system.lagrangian, t=system.t)
    half = vi.step_function(free, vi.midpoint())
    q, p, u, c, t, h = (
        ca.MX.sym(x, k)
        for x, k in zip(("q", "p", "u", "c", "t", "h"), (n, n, 0, 0, 1, 1), strict=True)
    )
    q1, p1, _ = half(q, p, ca.DM(0, 1), ca.DM(0, 1), t, h)
    force = point_function(system)(
        q1, velocity_function(system)(q1, p1, t + h, 0), ca.DM(0, 1), t + h, 0
    )[3]
    one_sided = ca.Function("one_sided", [q, p, u, c, t, h], [q1, p1 + h * force, 0])
    start = dict(q0=[0.3, 0.1], v0=[0.2, 0.4], duration=2.0)
    wrong = d.convergence(system, one_sided, order=2, **start)
    assert wrong.passed is False and wrong.p_order == pytest.approx(1, abs=0.15)
    assert d.convergence(system, vi.midpoint(), **start).passed


def test_convergence_accepts_exact_solutions():
    model = vi.models.pendulum(theta0=1.0)
    result = d.convergence(
        model.system,
        vi.gauss(2),
        q0=model.q0,
        v0=model.v0,
        duration=2.0,
        reference=lambda t: tuple(x[0] for x in model.exact(np.array([t]))),
    )
    assert result.passed and result.q_order == pytest.approx(4, abs=0.15)
    with pytest.raises(vi.InputError, match="reference must be"):
        d.convergence(model.system, q0=1.0, v0=0.0, duration=1.0, reference=3)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_symplectic_defects_are_at_round_off(rule):
    result = d.symplectic_defect(pendulum(), rule, h=0.3, **START)
    assert result.worst < 1e-14


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_symplectic_defect_does_not_depend_on_units(scale):
    q, v = vi.coordinates("x")
    system = vi.System(q, v, (v**2 / 2 + ca.cos(q / scale) * scale**2) * 1e3)
    good = d.symplectic_defect(system, vi.gauss(2), q0=1.0 * scale, v0=0.3 * scale, h=0.1)
    bad = d.symplectic_defect(system, rk4(system), q0=1.0 * scale, v0=0.3 * scale, h=0.1)
    assert good.passed and not bad.passed
    assert good.worst < 1e-14 and 1e-10 < bad.worst < 1e-6


def test_a_magnetic_field_is_reversed_by_flipping_the_step():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + q[0] * v[1] - q[1] ** 4)
    result = d.reversibility_defect(system, vi.gauss(2), q0=[1.0, 0.2], v0=[0.1, 0.5], h=0.1)
    assert not result.flipped and result.passed
    assert not d.reversibility_defect(
        system, rk4(system), q0=[1.0, 0.2], v0=[0.1, 0.5], h=0.1
    ).passed


@pytest.mark.parametrize("method", CONTROLS)
def test_energy_drift_is_told_from_oscillation(method):
    system = pendulum()
    bad = d.energy_slope(system, method(system), h=0.05, steps=4000, **START)
    assert bad.passed is False and abs(bad.slope) > 20 * bad.noise
    good = d.energy_slope(system, vi.trapezoidal(), h=0.05, steps=4000, **START)
    assert good.passed and good.oscillation > 1e-5 > 1e3 * abs(good.slope)


def test_a_loosely_solved_step_drifts():
    """A residual of 1e-8 is invisible in one step and adds up over a run: solve to the round-off
    floor.
    """
    system = pendulum()
    exact = vi.step_function(system, vi.midpoint())
    inputs = [ca.MX.sym(exact.name_in(i), *exact.size_in(i)) for i in range(6)]
    q1, p1, r = exact.call(inputs)
    loose = ca.Function("loose", inputs, [q1, p1 * (1 - 1e-8), r])
    assert d.energy_slope(system, loose, h=0.1, **START).passed is False
    assert d.round_off(system, loose, h=0.1, **START).passed is False


def test_windowed_means_recover_a_slope_under_an_oscillation():
    t = np.linspace(0, 1000, 50_001)
    centres, means = window_means(t, 1e-6 * t + np.cos(7 * t), 20)
    assert np.polyfit(centres, means, 1)[0] == pytest.approx(1e-6, rel=1e-3)


def test_round_off_grows_like_a_random_walk():
    result = d.round_off(pendulum(), vi.gauss(3), h=0.1, steps=10_000, **START)
    assert result.passed and result.exponent < 1 and result.energy[-1] < 1e-14


def test_work_precision_finds_the_cheapest_rule():
    rules = [vi.trapezoidal(), vi.composition("kahan-li8")]
    result = d.work_precision(
        pendulum(), rules, duration=20.0, steps=(64, 256, 1024), repeats=2, **START
    )
    assert result.cheapest(1e-9) == "composition('kahan-li8')"
    assert (np.diff(result.error[0]) < 0).all() and result.error[1, 1] < 1e-12
    with pytest.raises(vi.InputError, match="no method reached"):
        result.cheapest(1e-30)
    assert "cheapest for an error of 1e-09: composition('kahan-li8')" in str(result)
    with pytest.raises(vi.InputError, match="list of rules"):
        d.work_precision(pendulum(), vi.gauss(2), duration=1.0, **START)


def test_costs_are_interpolated_between_steps():
    result = d.WorkPrecision(
        ("a",), np.array([1, 2]), np.array([[1.0, 100.0]]), np.array([[1e-2, 1e-6]]), 0.0
    )
    assert result.cost(0, 1e-4) == pytest.approx(10.0) and result.cost(0, 1e-9) == np.inf


def test_functions_that_are_no_steps_are_refused():
    x = ca.SX.sym("x")
    with pytest.raises(vi.InputError, match="no step function of this system"):
        d.symplectic_defect(pendulum(), ca.Function("f", [x], [x]), h=0.1, **START)
    with pytest.raises(vi.InputError, match="give order="):
        d.convergence(pendulum(), euler(pendulum()), duration=1.0, **START)
    with pytest.raises(vi.InputError, match="rule or a step function"):
        d.energy_slope(pendulum(), "rk4", h=0.1, **START)


def test_every_diagnostic_draws_its_figure():
    system = pendulum()
    figures = [
        d.convergence(system, vi.gauss(2), duration=6.4, **START).plot(),
        d.energy_slope(system, vi.gauss(2), h=0.1, steps=500, **START).plot(),
        d.round_off(system, vi.gauss(2), h=0.1, steps=100, **START).plot(),
        d.work_precision(
            system, [vi.gauss(2)], duration=6.4, steps=(32, 64), repeats=1, **START
        ).plot(),
    ]
    assert [len(f.axes) for f in figures] == [1, 2, 1, 1]
    assert all(
        axes.get_xlabel() and axes.get_ylabel() and axes.lines for f in figures for axes in f.axes
    )


def resting_coordinates() -> vi.System:
    """A charge in a field and a round well: one coordinate pulls on two that rest."""
    q, v = vi.coordinates("x", "y", "z")
    field = 2 * (q[0] * v[1] - q[1] * v[0]) + q[2] * v[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 + field - ca.sumsqr(q) ** 2)


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(4), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize("q0", [[1, 0, 0], [1, 1e-7, 1e-9]], ids=["at rest", "almost at rest"])
def test_exact_derivatives_keep_their_digits_where_coordinates_rest(rule, q0):
    system = resting_coordinates()
    assert d.symplectic_defect(system, rule, q0=q0, v0=[0, 0, 0], h=0.05).worst < 1e-13
    step = vi.step_function(system, rule)
    p0 = vi.simulate(system, rule, q0=q0, v0=[0, 0, 0], h=0.05, steps=1, backend="interpreted")
    q1 = np.array(step(q0=q0, p0=p0.p[0], t=0, h=0.05)["q1"]).ravel()
    np.testing.assert_allclose(q1, p0.q[1], rtol=1e-11)  # each coordinate by its own size


def test_a_massless_coordinate_costs_no_digits():
    model = vi.models.lotka_volterra()
    found = d.symplectic_defect(model.system, q0=model.q0, v0=model.v0, h=0.05)
    assert found.worst < 1e-14


@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
@pytest.mark.parametrize(
    "name",
    [
        "knife_edge",
        "rolling_disc",
        "chaplygin_sleigh",
        "bouncing_ball",
        "slide_off_sphere",
        "lotka_volterra",
    ],
)
def test_the_self_test_runs_on_rolling_bouncing_and_degenerate_scenes(name):
    model = getattr(vi.models, name)()
    found = d.self_test(model.system, q0=model.q0, v0=model.v0, h=model.h, steps=300)
    assert found.passed, str(found)
    if model.system.structure.contacts:
        assert found.symplectic.passed is None and "contacts" in str(found.symplectic)
        lossy = (model.system.restitution < 1).any()
        assert (found.energy.passed is None) == (found.round_off.passed is None) == lossy
