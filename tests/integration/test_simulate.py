"""What `simulate` and `Trajectory` promise: grids, controls, saving, dense output, events,
partial results.
"""

from __future__ import annotations

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from scenes import COMPOSITIONS, double_pendulum, driven_damped, pendulum

import varint as vi
import varint.multibody as mb
from varint.discrete.lagrangian import interval


def pushed() -> tuple[vi.System, ca.SX]:
    q, v = vi.coordinates("x", "theta")
    force = ca.SX.sym("force")
    lagrangian = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2 + 9.81 * ca.cos(q[1])
    return vi.System(q, v, lagrangian, force=ca.vertcat(force, 0), control=force), force


def test_two_of_h_steps_and_duration_give_the_same_run():
    runs = [
        vi.simulate(pendulum(), q0=1, v0=0, **grid)
        for grid in (dict(h=0.1, steps=50), dict(h=0.1, duration=5.0), dict(steps=50, duration=5.0))
    ]
    for run in runs:
        assert run.q.shape == (51, 1)
        np.testing.assert_array_equal(run.q, runs[0].q)


def test_times_are_multiples_of_the_step_and_do_not_accumulate_round_off():
    motion = vi.simulate(pendulum(), q0=1, v0=0, h=0.1, steps=12_345)
    np.testing.assert_array_equal(motion.t, 0.1 * np.arange(12_346))


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
def test_saving_every_few_steps_keeps_the_same_nodes(rule):
    whole = vi.simulate(double_pendulum(), rule, q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=1234)
    some = vi.simulate(
        double_pendulum(), rule, q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=1234, save_every=100
    )
    assert list(some.k) == [*range(0, 1201, 100), 1234]
    np.testing.assert_allclose(some.q, whole.q[some.k], atol=1e-13)
    assert abs(some.action - whole.action) <= 1e-11 * abs(whole.action)


def test_explicit_runs_are_bit_identical_whatever_is_saved():
    rule = vi.composition("blanes-moan4")
    whole = vi.simulate(pendulum(), rule, q0=1, v0=0, h=0.1, steps=2345)
    some = vi.simulate(pendulum(), rule, q0=1, v0=0, h=0.1, steps=2345, save_every=7)
    np.testing.assert_array_equal(some.q, whole.q[some.k])


def test_parameters_change_the_run_without_building_anew(forget):
    c = vi.Parameters(length=1.0, g=9.81)
    q, v = vi.coordinates("theta")
    system = vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)
    small = dict(q0=1e-4, v0=0.0, h=0.01, steps=400)
    built = []
    for length in (0.5, 2.0):
        motion = vi.simulate(system, params=dict(length=length), **small)
        np.testing.assert_allclose(
            motion.q[:, 0], 1e-4 * np.cos(np.sqrt(9.81 / length) * motion.t), atol=1e-9
        )
        assert motion.parameters["length"] == length
        built.append({*system.__dict__["_built_for_alike"]})
    assert built[0] == built[1] and len(built[0]) > 5


def test_a_vector_parameter_is_set_as_a_whole():
    c = vi.Parameters(m=[1.0, 2.0])
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.dot(c.m, v**2) / 2 - ca.sumsqr(q) / 2, params=c)
    motion = vi.simulate(
        system, vi.gauss(6), q0=[1, 1], v0=[0, 0], h=0.1, steps=10, params=dict(m=[4.0, 9.0])
    )
    np.testing.assert_allclose(motion.q[-1], [np.cos(1 / 2), np.cos(1 / 3)], atol=1e-13)


def test_controls_per_step_and_per_node_agree_where_they_are_constant():
    system, _ = pushed()
    rule, steps = vi.gauss(2), 60
    u = np.sin(np.arange(steps) / 7)[:, None]
    start = dict(q0=[0, 0.3], v0=[0, 0], h=0.05, steps=steps)
    a = vi.simulate(system, rule, u=u, **start)
    b = vi.simulate(system, rule, u=np.repeat(u[:, None], 2, axis=1), **start)
    np.testing.assert_allclose(a.q, b.q, atol=1e-14)
    assert a.value(system.control).shape == (steps + 1,)


def test_dense_output_follows_controls_that_vary_within_a_step():
    system, _ = pushed()
    rule, steps, h = vi.gauss(3), 40, 0.05
    nodes = h * (np.arange(steps)[:, None] + np.array(rule.nodes))
    motion = vi.simulate(
        system, rule, u=np.sin(3 * nodes)[..., None], q0=[0, 0.3], v0=[0, 0], h=h, steps=steps
    )
    q, v, t = *vi.coordinates("x", "theta"), vi.time()
    lagrangian = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2 + 9.81 * ca.cos(q[1])
    smooth = vi.System(q, v, lagrangian, force=ca.vertcat(ca.sin(3 * t), 0), t=t)
    exact = vi.simulate(smooth, vi.gauss(8), q0=[0, 0.3], v0=[0, 0], h=h, steps=steps)
    times = np.linspace(0, 2, 33)
    np.testing.assert_allclose(motion.at(times).q, exact.at(times).q, atol=2e-8)


def test_dense_output_meets_the_nodes():
    motion = vi.simulate(
        driven_damped(), vi.gauss(2), q0=[0.5, 0.2], v0=[0.1, 0.4], h=0.05, steps=40, save_every=4
    )
    np.testing.assert_array_equal(motion.at(motion.t).q, motion.q)
    one = motion.at(1.0)
    np.testing.assert_array_equal(one.q, motion.q[5])
    between = vi.simulate(
        driven_damped(), vi.gauss(2), q0=[0.5, 0.2], v0=[0.1, 0.4], h=0.05, steps=22
    )
    np.testing.assert_allclose(motion.at(1.1).p, between.p[-1], atol=1e-13)


@pytest.mark.parametrize("rule", [vi.gauss(4), vi.composition("kahan-li8")], ids=str)
def test_until_stops_at_the_crossing(rule):
    """The pendulum from rest at angle 1 passes the bottom after a quarter of its period,
    K(sin²½).
    """
    motion = vi.simulate(
        pendulum(), rule, q0=1.0, v0=0.0, h=0.1, steps=1000, until=pendulum_angle()
    )
    quarter = float(mp.ellipk(mp.sin(mp.mpf(1) / 2) ** 2))
    assert abs(motion.t[-1] - quarter) <= 1e-11
    assert abs(motion.q[-1, 0]) <= 1e-13
    np.testing.assert_array_equal(motion.t[:-1], 0.1 * np.arange(17))


def pendulum_angle() -> ca.SX:
    return ca.SX.sym("theta")


def test_until_works_with_coarse_saving():
    fine = vi.simulate(
        pendulum(), vi.gauss(4), q0=1.0, v0=0.0, h=0.05, steps=1000, until=pendulum_angle() + 0.5
    )
    coarse = vi.simulate(
        pendulum(),
        vi.gauss(4),
        q0=1.0,
        v0=0.0,
        h=0.05,
        steps=1000,
        until=pendulum_angle() + 0.5,
        save_every=10,
    )
    assert abs(fine.t[-1] - coarse.t[-1]) <= 1e-12


def test_a_trajectory_saves_and_loads_with_its_system(tmp_path):
    c = vi.Parameters(m=[1.0, 2.0], k=3.0)
    q, v, t, force = *vi.coordinates("x", "y"), vi.time(), ca.SX.sym("force")
    lagrangian = ca.dot(c.m, v**2) / 2 - c.k * ca.sumsqr(q) ** 2 * (1 + ca.sin(t) / 3)
    system = vi.System(
        q, v, lagrangian, force=ca.vertcat(force, -v[1]), control=force, params=c, t=t
    )
    motion = vi.simulate(
        system,
        vi.gauss(2),
        q0=[1, 0],
        v0=[0, 1],
        h=0.1,
        steps=30,
        u=0.3,
        params=dict(k=2.0),
        t0=1.5,
    )
    motion.save(tmp_path / "run")
    again = vi.load(tmp_path / "run.npz")
    for name in ("t", "q", "v", "p", "u", "c", "k"):
        np.testing.assert_array_equal(getattr(again, name), getattr(motion, name))
    assert (again.rule, again.h, again.system.names) == (motion.rule, motion.h, motion.system.names)
    np.testing.assert_array_equal(again.value(q[0] * c.k * force), motion.value(q[0] * c.k * force))
    np.testing.assert_allclose(again.at(2.22).q, motion.at(2.22).q, atol=1e-15)
    assert again.action == pytest.approx(motion.action, rel=1e-14)
    assert again.parameters["k"] == 2.0


def test_files_that_are_no_trajectories_are_refused(tmp_path):
    with pytest.raises(vi.InputError, match="there is no file"):
        vi.load(tmp_path / "nothing.npz")
    (tmp_path / "torn.npz").write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(vi.InputError, match="no trajectory written by varint"):
        vi.load(tmp_path / "torn.npz")
    np.savez(tmp_path / "other.npz", header=np.array('{"format": "other"}'))
    with pytest.raises(vi.InputError, match="'other'"):
        vi.load(tmp_path / "other.npz")


def test_slices_and_states():
    motion = vi.simulate(pendulum(), vi.gauss(2), q0=1, v0=0, h=0.1, steps=20)
    part = motion[5:16:5]
    np.testing.assert_array_equal(part.t, motion.t[5:16:5])
    np.testing.assert_allclose(part.at(0.73).q, motion.at(0.73).q, atol=1e-14)
    state = motion[-1]
    assert state.q.shape == (1,)
    assert state.t == motion.t[-1]


def test_values_of_expressions_have_time_first():
    motion = vi.simulate(double_pendulum(), q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=10)
    q, v = motion.system.q, motion.system.v
    assert motion.value(q[0]).shape == (11,)
    assert motion.value(ca.vertcat(q, v)).shape == (11, 4)
    outer = motion.value(ca.mtimes(q, v.T))
    np.testing.assert_allclose(outer, motion.q[:, :, None] * motion.v[:, None, :])
    with pytest.raises(vi.InputError, match=r"unknown symbols \['z'\]"):
        motion.value(ca.SX.sym("z"))


def test_xarray_has_named_coordinates():
    data = vi.simulate(double_pendulum(), q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=10).to_xarray()
    assert list(data.coordinate.values) == ["a", "b"]
    assert data.q.dims == ("time", "coordinate")


def test_plots_have_labelled_axes():
    import matplotlib.pyplot as plt

    motion = vi.simulate(double_pendulum(), q0=[0.4, 0.2], v0=[0, 0], h=0.01, steps=10)
    for figure in (motion.plot(), motion.plot(motion.system.q[0], motion.system.energy)):
        assert all(axes.get_ylabel() for axes in figure.axes)
        assert figure.axes[-1].get_xlabel()
        plt.close(figure)


def test_velocities_are_legendre_transforms_and_no_differences():
    motion = vi.simulate(double_pendulum(), vi.gauss(3), q0=[0.4, 0.2], v0=[1, 2], h=0.1, steps=20)
    np.testing.assert_allclose(motion.v[0], [1, 2], atol=1e-15)
    np.testing.assert_allclose(motion.value(motion.system.momentum), motion.p, atol=1e-13)


def test_a_lagrangian_that_is_not_quadratic_in_v_runs():
    """Relativistic particle, L = −√(1 − v²) − x²/2: the energy 1/√(1 − v²) + x²/2 stays."""
    q, v = vi.coordinates("x")
    motion = vi.simulate(
        vi.System(q, v, -ca.sqrt(1 - v**2) - q**2 / 2),
        vi.gauss(4),
        q0=1.5,
        v0=0.0,
        h=0.05,
        steps=400,
    )
    assert np.abs(motion.energy - motion.energy[0]).max() <= 1e-10
    assert np.abs(motion.v).max() > 0.8


def test_a_degenerate_lagrangian_runs_by_midpoint_with_a_warning():
    """Lotka–Volterra by a one-form that is not linear: H is nearly kept, and it warns."""
    q, v = vi.coordinates("x", "y")
    energy = ca.exp(q[0]) - 2 * q[0] + ca.exp(q[1]) - q[1]
    system = vi.System(q, v, (q[1] + q[1] ** 3 / 10) * v[0] - energy)
    with pytest.warns(UserWarning, match="degenerate"):
        motion = vi.simulate(system, vi.midpoint(), q0=[0.2, 0.4], h=0.02, steps=2000)
    values = motion.value(energy)
    assert np.abs(values - values[0]).max() <= 1e-3
    assert np.ptp(motion.q[:, 0]) > 0.5
    with pytest.raises(vi.InputError, match=r"degenerate.*use midpoint"):
        vi.simulate(system, vi.gauss(2), q0=[0.2, 0.4], h=0.02, steps=10)


def test_a_step_that_does_not_converge_carries_the_partial_trajectory():
    with pytest.raises(vi.ConvergenceError, match="try a smaller h") as caught:
        vi.simulate(double_pendulum(), vi.gauss(2), q0=[0.4, -0.3], v0=[20, 0], h=0.5, steps=1000)
    error = caught.value
    assert error.step == len(error.trajectory) - 1
    assert error.time == error.trajectory.t[-1]
    assert error.residual > 1e-10 or np.isnan(error.residual)
    assert np.isfinite(error.trajectory.q).all()


@pytest.mark.parametrize("rule", [vi.composition("verlet"), vi.gauss(2)], ids=str)
def test_a_motion_that_leaves_the_domain_of_the_lagrangian_stops_with_the_nodes_before_it(rule):
    q, v = vi.coordinates("x")
    root = vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))
    with pytest.raises(vi.ConvergenceError) as caught:
        vi.simulate(root, rule, q0=1.0, v0=-3.0, h=0.01, steps=1000)
    assert 0.2 < caught.value.time < 0.6
    assert np.isfinite(caught.value.trajectory.q).all()


@pytest.mark.parametrize("rule", COMPOSITIONS, ids=str)
def test_explicit_and_general_steppers_agree(rule):
    """Verlet's kick and drift is the trapezoidal rule; every composition matches its own
    discrete Lagrangian.
    """
    system = pendulum()
    motion = vi.simulate(system, rule, q0=1.0, v0=0.3, h=0.1, steps=5)
    one = interval(system, rule)
    match = ca.Function(
        "match", [one.q0, one.dq, one.t, one.h], [one.p_minus, one.p_plus, one.inner]
    )
    stepper = vi.plan(system, rule).build(system, rule)
    for k in range(5):
        x = stepper.start(motion.q[k], motion.p[k], [], 0, 0.1, [])
        increments = stepper.path(x, [], 0, 0.1, [], [1, 1])
        p0, p1, inner = match(motion.q[k], ca.reshape(increments, 1, -1), 0, 0.1)
        np.testing.assert_allclose(float(p0), motion.p[k, 0], atol=1e-13)
        np.testing.assert_allclose(float(p1), motion.p[k + 1, 0], atol=1e-13)
        np.testing.assert_allclose(np.array(inner), 0, atol=1e-12)


def test_round_off_of_a_long_explicit_run_stays_at_its_level():
    """1e6 Verlet steps: summation is compensated, so two runs that differ by ulps stay together
    as the flow does.
    """
    there = vi.simulate(
        pendulum(), vi.trapezoidal(), q0=1.0, v0=0.0, h=0.01, steps=500_000, save_every=500_000
    )
    back = vi.simulate(
        pendulum(),
        vi.trapezoidal(),
        q0=there.q[-1],
        p0=-there.p[-1],
        h=0.01,
        steps=500_000,
        save_every=500_000,
    )
    assert abs(back.q[-1, 0] - 1.0) <= 2e-12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(steps=10**20), "more than any run can take"),
        (dict(steps=None, h=1e-253, duration=7), "more than any run can take"),
        (dict(steps=None, h=5e-320, duration=7), "steps=inf is more than any run can take"),
        (dict(t0=1e20), "steps of h=0.1 do not move a clock at t=1e\\+20"),
        (dict(checkpoint=3), "checkpoint must be the path of a file, got 3"),
    ],
)
def test_values_out_of_range_are_refused(arguments, message):
    with pytest.raises(vi.InputError, match=message):
        vi.simulate(pendulum(), **dict(q0=1.0, v0=0.0, h=0.1, steps=5) | arguments)


def test_what_is_no_system_is_refused():
    with pytest.raises(vi.InputError, match="the first argument must be a varint System, got str"):
        vi.simulate("pendulum", q0=1.0, v0=0.0, h=0.1, steps=5)


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        (vi.models.pendulum(), r"Model; give its \.system$"),
        (mb.Model(), r"Model; give its \.system\(\)$"),
    ],
)
def test_a_model_in_place_of_its_system_is_told_so(given, hint):
    with pytest.raises(vi.InputError, match=hint):
        vi.simulate(given, q0=1.0, v0=0.0, h=0.1, steps=5)
    with pytest.raises(vi.InputError, match=hint):
        vi.ensemble(given, q0=[[1.0]], v0=[[0.0]], h=0.1, steps=5)


def test_a_lagrangian_that_is_not_finite_at_the_start_is_refused_even_if_its_derivatives_are():
    q, v = vi.coordinates("x")
    with pytest.raises(vi.InputError, match="the Lagrangian is not finite at the start"):
        vi.simulate(vi.System(q, v, v**2 / 2 + ca.log(q - 2)), q0=1.0, v0=0.0, h=0.1, steps=5)


@pytest.mark.parametrize(
    ("times", "message"), [("noon", "got 'noon'"), ([], r"shape \(0,\)"), ([[1.0]], r"\(1, 1\)")]
)
def test_times_that_are_none_are_refused(times, message):
    motion = vi.simulate(pendulum(), q0=1.0, v0=0.0, h=0.1, steps=20)
    with pytest.raises(vi.InputError, match=message):
        motion.at(times)


def test_nodes_may_be_picked_by_a_list_but_not_none_of_them():
    motion = vi.simulate(pendulum(), q0=1.0, v0=0.0, h=0.1, steps=20)
    np.testing.assert_array_equal(motion[[0, 5, 20]].t, motion.t[[0, 5, 20]])
    with pytest.raises(vi.InputError, match="no node of the 21 is left"):
        motion[30:]
