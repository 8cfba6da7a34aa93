"""Starts of constrained scenes: what is refused and why, what is repaired, what is said once."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import cartesian_pendulum

import varint as vi

REST = np.zeros(4)


def four_bar(coupler: float = 2.0) -> vi.System:
    """Cranks of length 1 about (0, 0) and (2, 0), joined by a coupler; a coupler of 2 makes a
    parallelogram.
    """
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    a, b = q[:2], q[2:]
    loop = ca.vertcat(
        ca.sumsqr(a) - 1, ca.sumsqr(b - a) - coupler**2, ca.sumsqr(b - ca.DM([2, 0])) - 1
    )
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[3]), constraint=loop)


def run(system, q0, v0=None, *, rule=None, steps=1, **more):
    return vi.simulate(
        system, rule, q0=q0, v0=np.zeros(len(q0)) if v0 is None else v0, h=0.01, steps=steps, **more
    )


def test_a_start_off_the_constraint_names_the_row_and_the_repair():
    with pytest.raises(
        vi.InputError,
        match=r"q0 violates the constraint rows \[0\]: g = \[0\.21\].*varint\.project",
    ):
        run(cartesian_pendulum(), [1.1, 0.0])


def test_a_velocity_across_the_constraint_names_the_row_and_the_repair():
    with pytest.raises(
        vi.InputError,
        match=r"v0 violates the velocity constraints of \['constraint\[0\]'\].*project",
    ):
        run(cartesian_pendulum(), [1.0, 0.0], [0.1, 1.0])


def test_a_momentum_across_the_constraint_is_refused():
    with pytest.raises(
        vi.InputError,
        match=r"p0 is not the momentum of a motion along the constraints: it is off by 1",
    ):
        vi.simulate(cartesian_pendulum(), q0=[1, 0], p0=[0.1, 1.0], h=0.01, steps=1)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.midpoint(), vi.composition("verlet")], ids=str)
def test_rules_without_multipliers_at_their_nodes_are_refused_with_the_rule_to_use(rule):
    with pytest.raises(vi.InputError, match=r"cannot carry constraints.*lobatto\(3\)"):
        run(cartesian_pendulum(), [1.0, 0.0], rule=rule)


def test_constraints_choose_a_lobatto_rule_by_themselves():
    assert vi.plan(cartesian_pendulum()).rule == vi.lobatto(3)


def test_the_projection_is_the_nearest_start_in_the_metric_of_the_masses():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, (v[0] ** 2 + 9 * v[1] ** 2) / 2, constraint=ca.sumsqr(q) - 1)
    wanted, speed = np.array([1.2, 0.4]), np.array([0.3, 1.0])
    q0, v0 = vi.project(system, wanted, speed)
    mass, slope = np.diag([1.0, 9.0]), 2 * q0
    assert abs(q0 @ q0 - 1) <= 1e-15 and abs(slope @ v0) <= 1e-15
    # the change is along M⁻¹Gᵀ: stationary, with one multiplier
    for change in (
        q0 - wanted,
        v0 - speed,
    ):
        pull = mass @ change
        assert abs(pull[0] * slope[1] - pull[1] * slope[0]) <= 1e-13
    angles = np.linspace(0, 2 * np.pi, 3601)
    others = np.stack([np.cos(angles), np.sin(angles)], -1) - wanted
    assert (q0 - wanted) @ mass @ (q0 - wanted) <= np.einsum(
        "ij,jk,ik->i", others, mass, others
    ).min() + 1e-12
    assert len(run(system, q0, v0)) == 2


def test_a_projection_that_cannot_succeed_says_which_rows_stay_open():
    q, v = vi.coordinates("x", "y")
    apart = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.vertcat(ca.sumsqr(q) - 1, q[0] - 2))
    with pytest.raises(
        vi.InputError, match=r"no configuration near q0=.*fulfils the constraint rows \[0"
    ):
        vi.project(apart, [1.0, 0.5])


def test_a_rod_given_twice_changes_nothing_but_the_multipliers_which_get_the_least_norm():
    q, v = vi.coordinates("x", "y")
    twice = ca.vertcat(ca.sumsqr(q) - 1, 2 * ca.sumsqr(q) - 2)
    double = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=twice)
    with pytest.warns(UserWarning, match=r"rows \[0, 1\] are redundant \(rank 1 of 2\)") as said:
        motion = run(double, [1.0, 0.0], steps=300)
    assert len(said) == 1
    plain = run(cartesian_pendulum(), [1.0, 0.0], steps=300)
    np.testing.assert_allclose(motion.q, plain.q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(motion.reaction_forces, plain.reaction_forces, rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        motion.multipliers, plain.multipliers * [0.2, 0.4], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(motion.at(1.2345).q, plain.at(1.2345).q, rtol=0, atol=1e-13)


def test_a_redundancy_that_holds_on_the_manifold_only_is_found_too():
    """Three equal cranks under one beam: the third is implied as long as the others hold."""
    q, v = vi.coordinates("x", "y", "angle")
    across = ca.vertcat(ca.cos(q[2]), ca.sin(q[2]))
    ends = [q[:2] + s * across - ca.DM([s, 0]) for s in (0.0, 1.0, 2.0)]
    loops = ca.vertcat(*(ca.sumsqr(end) - 1 for end in ends))
    beam = vi.System(q, v, (ca.sumsqr(v[:2]) + v[2] ** 2 / 3) / 2 - 9.81 * q[1], constraint=loops)
    with pytest.warns(UserWarning, match="redundant"):
        motion = run(beam, [0.6, -0.8, 0.0], steps=200)
    crank, w = vi.coordinates("a")
    exact = vi.simulate(
        vi.System(crank, w, w**2 / 2 - 9.81 * ca.sin(crank)),
        vi.gauss(6),
        q0=np.arctan2(-0.8, 0.6),
        v0=0.0,
        h=0.01,
        steps=200,
    )
    np.testing.assert_allclose(
        motion.q[-1, :2], [np.cos(exact.q[-1, 0]), np.sin(exact.q[-1, 0])], atol=1e-6
    )
    np.testing.assert_allclose(motion.value(loops), 0, atol=1e-12)


def test_a_folded_linkage_is_refused_with_the_rows_that_lose_their_rank():
    with pytest.raises(
        vi.InputError, match=r"rows \[0, 1, 2\] are dependent at the start.*singular configuration"
    ):
        run(four_bar(), [1.0, 0.0, 3.0, 0.0])
    assert len(run(four_bar(), [0.6, 0.8, 2.6, 0.8], steps=5)) == 6


def test_a_constraint_that_is_a_square_is_refused():
    q, v = vi.coordinates("x", "y")
    squared = vi.System(q, v, ca.sumsqr(v) / 2, constraint=(ca.sumsqr(q) - 1) ** 2)
    with pytest.raises(vi.InputError, match=r"rows \[0\] are dependent.*gradients do not vanish"):
        run(squared, [1.0, 0.0])


def test_a_direction_without_inertia_is_refused_unless_a_constraint_holds_it():
    q, v = vi.coordinates("x", "y", "z")
    lagrangian = (v[0] ** 2 + v[1] ** 2) / 2 - q[1]
    free = vi.System(q, v, lagrangian, constraint=ca.sumsqr(q[:2]) - 1)
    with pytest.raises(vi.InputError, match=r"singular along the constraints.*\['z'\] may move"):
        run(free, [1.0, 0.0, 0.0])
    held = vi.System(q, v, lagrangian, constraint=ca.vertcat(ca.sumsqr(q[:2]) - 1, q[2] - q[0]))
    motion = run(held, [1.0, 0.0, 1.0], steps=100)
    plain = run(
        vi.System(q[:2], v[:2], lagrangian, constraint=ca.sumsqr(q[:2]) - 1), [1.0, 0.0], steps=100
    )
    np.testing.assert_allclose(motion.q[:, :2], plain.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.multipliers[:, 1], 0, atol=1e-10)


def test_passing_through_a_singular_configuration_ends_with_a_clear_error():
    """A square whose cranks fold: at the dead point the motion branches."""
    with pytest.raises(vi.ConvergenceError, match="close to singular") as caught:
        vi.simulate(four_bar(), q0=[0.6, 0.8, 2.6, 0.8], v0=REST, h=2.0, steps=2000)
    assert caught.value.trajectory is not None


@pytest.mark.parametrize("rule", [vi.lobatto(2), vi.lobatto(3), vi.lobatto(4)], ids=str)
def test_a_start_from_two_configurations_passes_through_both(rule):
    system = cartesian_pendulum()
    motion = vi.simulate(system, rule, q0=[0.6, -0.8], v0=[0.8, 0.6], h=0.05, steps=10)
    p0 = vi.start_momentum(system, rule, q0=motion.q[3], q1=motion.q[4], h=0.05)
    np.testing.assert_allclose(p0, motion.p[3], rtol=0, atol=1e-11)
    again = vi.simulate(system, rule, q0=motion.q[3], p0=p0, h=0.05, steps=7)
    np.testing.assert_allclose(again.q, motion.q[3:], rtol=0, atol=1e-11)


def test_two_configurations_that_no_step_joins_are_refused():
    with pytest.raises(vi.InputError, match="no start momentum leads from q0 to q1"):
        vi.start_momentum(cartesian_pendulum(), q0=[1, 0], q1=[0.9, 0.9], h=0.05)


@pytest.mark.parametrize("rule", [vi.trapezoidal(), vi.lobatto(3)], ids=str)
def test_a_linkage_that_is_stretched_out_in_mid_run_fails_with_the_rows_that_meet(rule):
    """Two rods, one end pulled away evenly until they are straight; a pendulum beside them has
    no part in it.
    """
    (q, v), t = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3"), vi.time()
    rods = ca.vertcat(
        ca.sumsqr(q[4:]) - 1,
        ca.sumsqr(q[:2]) - 1,
        ca.sumsqr(q[2:4] - q[:2]) - 1,
        q[3],
        q[2] - 1.5 - t,
    )
    scene = vi.System(q, v, ca.sumsqr(v) / 2, constraint=rods, t=t)
    y = np.sqrt(1 - 0.75**2)
    start = dict(q0=[0.75, y, 1.5, 0, 0, -1], v0=[0.5, -0.375 / y, 1, 0, 1, 0])
    with pytest.raises(
        vi.ConvergenceError, match=r"gradients of the constraint rows \[1, 2, 4\]"
    ) as error:
        vi.simulate(scene, rule, **start, h=1e-2, steps=80)
    assert error.value.time == pytest.approx(0.49)  # the rods are straight at t = 0.5
    assert error.value.trajectory.t[-1] == pytest.approx(0.49)


def test_a_coordinate_that_may_move_without_inertia_is_refused_where_l_is_not_quadratic():
    q, v = vi.coordinates("x", "y")
    massless = vi.System(q, v, v[0] ** 2 / 2 + v[0] ** 4, nonholonomic=ca.horzcat(1, 0))
    with pytest.raises(vi.InputError, match=r"\['y'\] may move but has no inertia"):
        vi.simulate(massless, q0=[0, 0], v0=[0, 1], h=0.01, steps=1)
    with pytest.raises(
        vi.InputError, match="no velocity along the constraints belongs to a momentum"
    ):
        vi.simulate(massless, q0=[0, 0], p0=[0, 1], h=0.01, steps=1)
