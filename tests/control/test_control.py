"""What every optimal control keeps: replay, costates, balances, ends, bounds, constraints; and
what is refused.
"""

from __future__ import annotations

import re
import signal
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import (
    U,
    cartpole,
    coarse,
    move,
    particle,
    pendulum,
    replay_defect,
    swing,
    swing_up,
)

import varint as vi
from varint.control.balances import energy_balance, momentum_balance
from varint.nlp.watch import Watch

RULES = [vi.midpoint(), vi.gauss(2), vi.gauss(3), vi.trapezoidal(), vi.lobatto(3), vi.lobatto(4)]


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("control", ["nodes", "constant"])
@coarse
def test_simulation_with_the_optimal_controls_reproduces_the_optimal_path(rule, control):
    motion = swing(pendulum(9.81), 3.0, 40, rule=rule, control=control)
    assert replay_defect(motion) < 1e-9
    again = vi.simulate(pendulum(9.81), rule, q0=[0], v0=[0], duration=3.0, steps=40, u=motion.u)
    assert np.abs(again.q - motion.q).max() < 1e-9
    assert np.abs(again.p - motion.p).max() < 1e-8


@coarse
def test_control_of_the_midpoint_rule_is_the_closed_form_of_its_costates():
    system, weight = cartpole(), 0.7
    motion = swing_up(vi.midpoint(), 40, weight)
    mu = motion.costates.p
    force_on = np.array([1.0, 0.0])
    expected = -(mu[:-1] + mu[1:]) @ force_on / (4 * weight)
    assert np.abs(expected).max() < 20  # bounds are not active
    assert motion.u[:, 0, 0] == pytest.approx(expected, abs=1e-6)
    assert system.structure.cyclic == (0,)


@pytest.mark.parametrize("rule", [vi.gauss(3), vi.lobatto(3)], ids=str)
def test_costates_are_the_derivatives_of_the_cost(rule):
    start, step = dict(q=np.array([0.3, -0.2]), v=np.array([0.1, 0.4])), 1e-4
    base = swing_up(rule, 30, start=start)
    p = vi.simulate(
        cartpole(), rule, q0=start["q"], v0=start["v"], h=1e-3, steps=1, u=np.zeros((1, 1))
    ).p[0]

    def cost(dq, dp):
        q = start["q"] + dq
        mass = ca.Function("M", [cartpole().q], [cartpole().mass_matrix])
        v = np.linalg.solve(np.array(mass(q)), p + dp)
        return swing_up(rule, 30, start=dict(q=q, v=v), guess=base).cost

    for i in range(2):
        e = step * np.eye(2)[i]
        assert (cost(e, 0) - cost(-e, 0)) / (2 * step) == pytest.approx(
            base.costates.q[0, i], rel=1e-5
        )
        assert (cost(0, e) - cost(0, -e)) / (2 * step) == pytest.approx(
            base.costates.p[0, i], rel=1e-5
        )


def test_momentum_of_a_cyclic_coordinate_changes_by_the_impulse_of_the_force_exactly():
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[1, np.pi], v=[0.7, 0]))
    [(name, gained, impulse)] = momentum_balance(motion, motion.solution.q)
    assert name == "translation along x"
    assert gained == pytest.approx(impulse, abs=1e-11)
    assert abs(gained) > 0.5


@pytest.mark.parametrize("stages", [2, 3])
def test_energy_gained_is_the_work_of_the_controls_to_the_order_of_the_rule(stages):
    defects = []
    for steps in (40, 80):
        gained, work = energy_balance(
            *((m := swing(pendulum(9.81), 3.0, steps, rule=vi.gauss(stages))), m.solution.q)
        )
        defects.append(abs(gained - work))
    assert np.log2(defects[0] / defects[1]) > 2 * stages - 0.4


def test_angular_momentum_of_an_orbit_changes_by_the_torque_integral_only():
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), force=push, control=push)
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=2.0,
        steps=30,
        cost=ca.sumsqr(push),
        start=dict(q=[1, 0], v=[0, 1]),
        end=dict(q=[-1.2, 0.3], v=[None, None]),
        guess=dict(q=lambda t: [np.cos(1.5 * t), np.sin(1.5 * t)]),
    )
    rule, points = motion.rule, motion.solution.q.values
    nodes = np.einsum("ij,kjn->kin", rule.basis, points)
    torque = nodes[..., 0] * motion.u[..., 1] - nodes[..., 1] * motion.u[..., 0]
    gained = (motion.q[:, 0] * motion.p[:, 1] - motion.q[:, 1] * motion.p[:, 0])[[0, -1]]
    assert gained[1] - gained[0] == pytest.approx(
        motion.h * (torque @ np.array(rule.weights)).sum(), abs=1e-11
    )
    [(name, change, impulse)] = momentum_balance(motion, motion.solution.q)
    assert (name, change) == ("rotation about z", pytest.approx(gained[1] - gained[0], abs=1e-12))
    assert impulse == pytest.approx(change, abs=1e-11)


def test_free_end_has_zero_costate():
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[1, np.pi], v=[0, None]))
    # Mᵀμ of the free velocity
    assert abs(motion.costates.p[-1] @ np.array([0.3 * 0.5 * -1, 0.3 * 0.25])) < 1e-8
    motion = swing_up(vi.gauss(2), 30, end=dict(q=[None, np.pi], v=[0, 0]))
    assert abs(motion.costates.q[-1, 0]) < 1e-8
    assert abs(motion.q[-1, 0] - 1) > 0.05


def test_end_given_by_momenta_and_by_expressions_equals_the_end_given_by_velocities():
    q, v = particle().q, particle().v
    base = move(vi.gauss(2), 8, end=dict(q=[1], v=[0.5]))
    by_momentum = move(vi.gauss(2), 8, end=dict(q=[1], p=[0.5]))
    by_expressions = move(vi.gauss(2), 8, end=dict(bounds=[(1.5, q + v, 1.5), (0.5, q - v, 0.5)]))
    assert [by_momentum.cost, by_expressions.cost] == pytest.approx([base.cost] * 2, rel=1e-9)


def test_bounded_end_takes_the_cheapest_value_in_its_window():
    motion = move(vi.gauss(2), 8, end=dict(q=[vi.free(2, 1, 3)], v=[0]))
    assert motion.q[-1, 0] == pytest.approx(1, abs=1e-8)
    assert motion.cost == pytest.approx(12, rel=1e-7)


def test_periodic_end_repeats_the_start():
    motion = swing(
        pendulum(),
        5.0,
        40,
        cost=U**2 + (pendulum().v - 1.5) ** 2,
        start=None,
        end=dict(periodic=[2 * np.pi]),
        guess=dict(q=lambda t: 2 * np.pi * t / 5),
    )
    assert motion.q[-1] - motion.q[0] == pytest.approx(2 * np.pi, abs=1e-10)
    assert motion.p[-1] == pytest.approx(motion.p[0], abs=1e-10)
    assert np.ptp(motion.p) > 0.1


def test_time_dependent_scene_and_cost_use_the_times_of_the_nodes():
    q, v = vi.coordinates("x")
    t = vi.time()
    # x'' = cos t + u with u = −cos t free of cost: the cost asks for exactly this control
    system = vi.System(q, v, v**2 / 2 + q * ca.cos(t), force=U, control=U, t=t)
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=2.0,
        steps=10,
        t0=0.7,
        cost=(U + ca.cos(t)) ** 2,
        start=dict(q=[0], v=[1]),
    )
    assert motion.cost == pytest.approx(0, abs=1e-16)
    assert motion.t[[0, -1]] == pytest.approx([0.7, 2.7])
    assert motion.q[:, 0] == pytest.approx(motion.t - 0.7, abs=1e-9)
    assert replay_defect(motion) < 1e-12


def test_optimised_parameter_is_where_the_cost_is_stationary():
    q, v = vi.coordinates("theta")
    c = vi.Parameters(stiffness=1.0, rest=np.zeros(2))
    spring = c.stiffness * (q - c.rest[0]) ** 2 / 2
    system = vi.System(q, v, v**2 / 2 - spring, force=U, control=U, params=c)

    def cost(**given):
        return vi.optimal_control(
            system,
            vi.gauss(3),
            duration=3.0,
            steps=10,
            cost=U**2 + 0.01 * c.stiffness**2,
            start=dict(q=[0], v=[0]),
            end=dict(q=[1], v=[0]),
            params=dict(rest=[0.5, 0.0]) | given,
        )

    best = cost(stiffness=vi.free(1.0, 0.1, 10.0))
    found = float(best.parameters["stiffness"])
    assert 0.2 < found < 9
    assert min(cost(stiffness=found * x).cost for x in (0.99, 1.01)) > best.cost
    assert cost(stiffness=found).cost == pytest.approx(best.cost, rel=1e-9)
    assert replay_defect(best) < 1e-10


def test_path_bounds_on_expressions_hold_where_they_are_declared():
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push", 2)
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=push, control=push)
    hole = ca.sumsqr(q - ca.DM([0.5, 0.02]))
    motion = vi.optimal_control(
        system,
        vi.gauss(3),
        duration=1.0,
        steps=20,
        cost=ca.sumsqr(push),
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[1, 0], v=[0, 0]),
        bounds=[(0.04, hole, None), (None, ca.sumsqr(push), 100), (None, v[0], 2.0)],
    )
    points = motion.solution.q.values
    assert ((points - [0.5, 0.02]) ** 2).sum(axis=2).min() == pytest.approx(0.04, abs=1e-9)
    assert (motion.u**2).sum(axis=2).max() <= 100 + 1e-8
    assert motion.cost > 12
    assert any("sq" in name or "push" in name or ">=" in name for name in motion.solution.active)


def _rod():
    """The pendulum as a particle on a rod; the torque u acts through F = u ∂θ/∂q."""
    q, v = vi.coordinates("x", "y")
    force = U * ca.vertcat(-q[1], q[0])
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, force=force, control=U
    )


def _rod_swing(rule, steps, end=None, **given):
    def circle(t):
        return [np.sin(np.pi * t / 3), -np.cos(np.pi * t / 3)]

    return vi.optimal_control(
        _rod(),
        rule,
        duration=3.0,
        steps=steps,
        cost=U**2,
        start=dict(q=[0, -1], v=[0, 0]),
        end=end or dict(q=[0, 1], v=[0, 0]),
        guess=dict(q=circle),
        **given,
    )


@pytest.mark.parametrize("stages", [3, 4])
def test_particle_on_a_rod_costs_what_the_pendulum_costs_to_the_order_of_the_rule(stages):
    exact = swing(pendulum(9.81), 3.0, 40).cost
    errors = [abs(_rod_swing(vi.lobatto(stages), steps).cost - exact) for steps in (20, 40)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * stages - 2, abs=0.25)
    assert errors[1] < 2e-5 * exact if stages == 4 else 1e-3 * exact


def test_constraints_hold_in_positions_and_velocities_and_multipliers_are_the_tension():
    motion = _rod_swing(vi.lobatto(4), 40)
    q, v = motion.q, motion.v
    assert np.abs((q**2).sum(axis=1) - 1).max() < 1e-12
    assert np.abs((q * v).sum(axis=1)).max() < 1e-11
    tension = (v**2).sum(axis=1) - 9.81 * q[:, 1]
    assert -2 * motion.multipliers[:, 0] == pytest.approx(tension, abs=1e-10)
    assert replay_defect(motion) < 1e-9


def test_nonuniform_mesh_solves_the_same_problem():
    mesh = np.concatenate([[0], np.cumsum(np.linspace(1, 3, 40))])
    motion = swing(pendulum(9.81), 3.0, 0, mesh=mesh / mesh[-1])
    assert motion.cost == pytest.approx(36.6402890624, rel=1e-7)
    assert replay_defect(motion) < 1e-9
    assert motion.at(motion.t[7]).q == pytest.approx(motion.q[7], abs=1e-12)


def test_warm_start_takes_fewer_iterations_than_a_cold_one():
    cold = swing_up()
    warm = swing_up(guess=cold)
    finer = swing_up(steps=60, guess=cold)
    other = swing_up(end=dict(q=[1.01, np.pi], v=[0, 0]), guess=cold)
    assert warm.solution.iterations <= 3
    assert max(finer.solution.iterations, other.solution.iterations) < cold.solution.iterations
    assert finer.cost == pytest.approx(cold.cost, rel=1e-8)


def test_scene_in_si_units_converges_like_the_scene_in_natural_units():
    """The orbit transfer of radius 7000 km, in metres, seconds and newtons."""
    mu, r0, mass = 3.986e14, 7e6, 1000.0
    t = np.sqrt(r0**3 / mu)
    q, v = vi.coordinates("r", "phi")
    kinetic = mass * (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    system = vi.System(q, v, kinetic + mass * mu / q[0], force=ca.vertcat(0, q[0] * U), control=U)
    rate = 1.2**-1.5
    motion = vi.optimal_control(
        system,
        vi.gauss(4),
        duration=7.248846379348906 * t,
        steps=40,
        cost=U**2,
        start=dict(q=[r0, 0], v=[0, 1 / t]),
        end=dict(q=[1.2 * r0, 2 * np.pi], v=[0, rate / t]),
    )
    unit = mass * r0 / t**2
    assert motion.cost / (unit**2 * t) == pytest.approx(0.0010650580279977073, rel=1e-8)
    assert motion.solution.iterations < 30


@pytest.mark.parametrize("plugin", ["sqpmethod", "fatrop"])
def test_other_solvers_find_the_same_control(plugin):
    options = {
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "qpsol": "qrqp",
    }
    options |= {"qpsol_options": {"print_iter": False, "print_header": False}}
    motion = move(vi.gauss(2), 5, solver=plugin, options=options if plugin == "sqpmethod" else None)
    assert motion.cost == pytest.approx(12, rel=1e-6)


def test_trajectory_of_a_simulation_and_arrays_serve_as_guess():
    motion = vi.simulate(
        pendulum(), vi.gauss(2), q0=0.0, v0=1.9, duration=3.0, steps=25, u=np.zeros((25, 1))
    )
    by_motion = swing(pendulum(), 3.0, guess=motion)
    by_arrays = swing(
        pendulum(), 3.0, guess=dict(q=np.linspace(0, np.pi, 9)[:, None], u=np.zeros((9, 1)))
    )
    assert by_arrays.cost == pytest.approx(by_motion.cost, rel=1e-8)


def test_report_names_status_cost_violation_replay_energy_and_momenta(capsys):
    motion = swing_up(steps=30)
    motion.report()
    text = capsys.readouterr().out
    for word in (
        motion.solution.status,
        "cost",
        "violation",
        "replay defect",
        "energy",
        "translation along x",
    ):
        assert word in text
    assert f"{motion.cost:.12g}" in text
    assert motion.solution.history["cost"][-1] == pytest.approx(motion.cost)


def test_impossible_problem_is_a_solver_error_with_the_last_iterate():
    with pytest.raises(vi.SolverError, match="violation") as error:
        move(vi.gauss(2), 10, bounds=[(-1, U, 1)])
    assert error.value.status == "Infeasible_Problem_Detected"
    assert error.value.iterate.q.shape == (11, 1)
    with pytest.raises(vi.SolverError, match="max_iter") as error:
        swing_up(options={"ipopt": {"max_iter": 2}})
    assert error.value.status == "Maximum_Iterations_Exceeded"


def test_interrupt_returns_the_last_iterate_with_a_warning(monkeypatch):
    """The signal comes while the solver works, in its third iteration."""
    seen, watched = [], Watch.eval

    def interrupted(self, arg):
        seen.append(1)
        if len(seen) == 3:
            signal.raise_signal(signal.SIGINT)
        return watched(self, arg)

    monkeypatch.setattr(Watch, "eval", interrupted)
    hard = vi.models.falling_cat(np.pi / 4, 2.0).phases[0]
    with pytest.warns(UserWarning, match="stopped on request"):
        [motion] = vi.optimal_phases([replace(hard, steps=40)])
    assert 3 <= len(seen) <= 5
    assert motion.solution.status == "User_Requested_Stop"
    assert not motion.solution.success
    assert motion.q.shape == (41, 3)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_progress_shows_iterations_cost_and_violation(capsys):
    swing_up(steps=20, progress=True)
    assert "violation" in capsys.readouterr().err


def _contact():
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2, force=U, control=U, contact=q)


def _free_fall():
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(duration=-1.0), "positive"),
        (dict(duration=vi.free(1, -1, 2)), "positive lower bound"),
        (dict(steps=0), "whole number"),
        (dict(steps=2.5), "whole number"),
        (dict(start=dict(q=[0, 1])), "one for each of"),
        (dict(start=dict(x=[0])), "unknown keys"),
        (dict(start=dict(q=[np.nan])), "not finite"),
        (dict(start=dict(periodic=True)), "belongs to the end"),
        (dict(end=dict(q=[1], periodic=True)), "given at both ends"),
        (dict(cost=ca.SX.sym("other")), "depends on ['other']"),
        (dict(cost=ca.vertcat(U, U)), "one number"),
        (dict(terminal_cost=U), "depends on ['u']"),
        (dict(bounds=[(2, U, 1)]), "contradict"),
        (dict(bounds=[(2, U)]), "(lower, expression, upper)"),
        (dict(bounds=[(None, U, [1, 2])]), "one number or 1"),
        (dict(bounds=[(0.5, particle().q, 2)]), "the start has x = 0"),
        (dict(bounds=[(0, particle().t, 1)]), "does not depend on the path"),
        (dict(control="linear"), "'nodes'"),
        (dict(solver="nosuch"), "unknown solver"),
        (dict(options={"nonsense": 1}), "nonsense"),
        (dict(guess=dict(x=1)), "unknown keys"),
        (dict(guess=dict(q=np.zeros((3, 2)))), "it takes (samples, 1)"),
        (dict(guess=3), "guess must be"),
        (dict(mesh=[0, 0.5, 0.4, 1]), "increase from 0 to 1"),
        (dict(params=dict(mass=1)), "unknown parameters"),
    ],
)
def test_bad_input_is_refused_with_what_to_do(change, message):
    given = (
        dict(duration=1.0, steps=5, cost=U**2, start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
        | change
    )
    with pytest.raises(vi.InputError, match=re.escape(message)):
        vi.optimal_control(particle(), vi.gauss(2), **given)


@pytest.mark.parametrize(
    ("system", "rule", "message"),
    [
        (_contact, None, "phases and links"),
        (_free_fall, None, "nothing can be chosen"),
        (particle, vi.composition("verlet"), "composition"),
        (particle, 2, "rule must be"),
        (_rod, vi.gauss(2), "lobatto"),
        (lambda: 3, None, "varint.System"),
    ],
)
def test_unfit_scenes_and_rules_are_refused_with_a_remedy(system, rule, message):
    with pytest.raises(vi.InputError, match=message):
        vi.optimal_control(system(), rule, duration=1.0, steps=5)


def test_ends_off_the_constraint_are_refused():
    with pytest.raises(vi.InputError, match="violates constraint 0"):
        _rod_swing(vi.lobatto(3), 10, end=dict(q=[0, 1.1], v=[0, 0]))
    with pytest.raises(vi.InputError, match="G v"):
        _rod_swing(vi.lobatto(3), 10, end=dict(q=[0, 1], v=[0, 1]))
    with pytest.raises(vi.InputError, match="say the same"):
        _rod_swing(vi.lobatto(3), 10, end=dict(q=[None, 1], v=[0, 0]))


def test_saved_solution_comes_back_with_cost_costates_controls_replay_and_report(tmp_path, capsys):
    motion = vi.models.overhead_crane().solve()[0]
    motion.save(tmp_path / "crane.npz")
    again = vi.load(tmp_path / "crane.npz")
    assert (again.cost, again.solution.status, again.solution.iterations) == (
        motion.cost,
        motion.solution.status,
        motion.solution.iterations,
    )
    t = np.linspace(0, motion.duration, 50)
    assert np.array_equal(again.u_at(t), motion.u_at(t))
    assert np.array_equal(again.costates.p, motion.costates.p) and np.array_equal(
        again.costates.q, motion.costates.q
    )
    assert again.solution.active.keys() == motion.solution.active.keys() != set()
    assert replay_defect(again) == replay_defect(motion)
    texts = []
    for one in (motion, again):
        one.report()
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    warm = vi.optimal_phases([replace(vi.models.overhead_crane().phases[0], guess=again)])[0]
    assert warm.cost == pytest.approx(motion.cost, rel=1e-8)
    with pytest.raises(vi.InputError, match="guess=motion"):
        vi.refine(again)


def test_part_of_an_optimal_motion_and_times_outside_have_no_controls():
    motion = move(vi.gauss(2), 10)
    with pytest.raises(vi.InputError, match="from 0 to 1"):
        motion.u_at(1.5)
    part = motion[2:5]
    with pytest.raises(vi.InputError, match="optimal_control"):
        part.u_at(0.3)
    assert repr(motion.solution).count("\n") == 0


def test_figure_draws_the_controls_as_functions_of_time():
    motion = move(vi.gauss(2), 3)
    axes = next(x for x in motion.plot().axes if x.get_title() == "Controls")
    t, u = axes.lines[0].get_data()
    assert u == pytest.approx(6 - 12 * t, abs=1e-9)  # the exact control, between the nodes as well


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(guess=dict(q=[[0], [np.nan]])), "not finite in 1"),
        (dict(guess=dict(u=lambda t: [np.nan])), "not finite in 10"),
        (dict(guess=dict(duration=-1)), "positive number"),
        (dict(guess=dict(duration="long")), "positive number"),
        (dict(cost=np.nan), "cost is not finite"),
        (dict(mesh="abc", steps=0), "an array of numbers"),
        (dict(options=[1]), "dictionary"),
        (dict(t0=np.nan), "t0"),
        (dict(steps=1, control="constant"), "3 conditions on 2 unknowns"),
    ],
)
def test_what_cannot_be_a_problem_is_said_before_a_solver_runs(change, message, capfd):
    with pytest.raises(vi.InputError, match=message):
        move(vi.gauss(2), **(dict(steps=5) | change))
    assert "WARNING" not in "".join(capfd.readouterr())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (dict(t0=1e20), "do not move a clock"),
        (dict(end=dict(periodic=ca.SX.sym("foreign"))), "periodic takes one finite offset"),
        (dict(end=dict(periodic=[ca.SX.sym("foreign"), 0])), "periodic takes one finite offset"),
        (dict(end=dict(periodic=[np.nan, 0])), "periodic takes one finite offset"),
    ],
)
def test_input_that_fuzzing_found_is_refused(changed, message):
    q, v = vi.coordinates("x", "y")
    push = ca.SX.sym("push")
    cart = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q), force=ca.vertcat(push, 0), control=push)
    problem = dict(
        duration=1.0, steps=3, cost=push**2, start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, 0])
    )
    with pytest.raises(vi.InputError, match=message):
        vi.optimal_control(cart, vi.gauss(2), **problem | changed)
