"""Rates of controls, integrals over the motion and states beside the mechanics."""

from __future__ import annotations

import pickle
import warnings

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, move, particle, pendulum, replay_defect, swing

import varint as vi

RATE = vi.control_rate(U)


def test_least_rate_of_a_linear_control_converges_to_its_closed_form_with_order_two():
    """∫ (du/dt)² of a rest to rest transfer with free forces at its ends: x is a polynomial of
    degree 5, u = 60 t − 180 t² + 120 t³ − 60·… with ∫ = 120.
    """
    errors = [move(vi.gauss(2), n, cost=RATE**2, control="linear").cost - 120 for n in (10, 20, 40)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.02)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.02)
    assert errors[2] == pytest.approx(100 / 40**2, rel=0.01)


def test_linear_controls_have_the_order_four_in_the_cost_where_constant_ones_have_two():
    exact = swing(pendulum(9.81), 3.0, 40, rule=vi.gauss(5)).cost
    for control, order in (("linear", 4), ("constant", 2)):
        errors = [
            abs(swing(pendulum(9.81), 3.0, n, rule=vi.gauss(4), control=control).cost - exact)
            for n in (20, 40)
        ]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


def test_linear_control_is_a_straight_line_between_the_nodes_and_is_replayed():
    motion = swing(pendulum(9.81), 3.0, 40, rule=vi.gauss(3), control="linear")
    at = motion.solution.mesh * 3.0
    inside = np.linspace(0, 3.0, 301)
    assert motion.u_at(inside)[:, 0] == pytest.approx(
        np.interp(inside, at, motion.u_at(at)[:, 0]), abs=1e-10
    )
    assert motion.u.shape == (40, 3, 1)
    assert replay_defect(motion) < 1e-9


@pytest.mark.parametrize("control", ["linear", "constant"])
def test_rates_stay_within_their_bounds(control):
    def rates(motion):
        u = motion.u_at(motion.t) if control == "linear" else motion.u[:, 0]
        return np.abs(np.diff(u[:, 0]) / motion.h).max()

    scene, given = pendulum(9.81), dict(rule=vi.gauss(2), control=control)
    free = swing(scene, 3.0, 20, **given)
    most = 0.7 * rates(free)
    motion = swing(scene, 3.0, 20, bounds=[(-most, RATE, most)], guess=free, **given)
    assert rates(motion) == pytest.approx(most, rel=1e-7)
    assert motion.cost > free.cost + 1e-3


def test_rate_in_the_cost_of_constant_controls_is_a_sum_of_squared_steps():
    weight = 0.01
    motion = move(vi.gauss(2), 20, control="constant", cost=U**2 + weight * RATE**2)
    u, h = motion.u[:, 0, 0], motion.h
    wanted = h * (u @ u) + weight * h * (np.diff(u) ** 2).sum() / h**2
    assert motion.cost == pytest.approx(wanted, rel=1e-10)
    again = motion.again(end=dict(q=[2]))
    assert again.cost == pytest.approx(4 * motion.cost, rel=1e-10)


def test_integral_of_the_path_is_the_isoperimetric_closed_form():
    """x = 3t² − 2t³ + c·30t²(1 − t)² has ∫x = ½ + c and ∫ẍ² = 12 + 720 c²."""
    for wanted in (0.5, 0.7):
        motion = move(vi.gauss(3), 6, integral=[(wanted, particle().q, wanted)])
        assert motion.cost == pytest.approx(12 + 720 * (wanted - 0.5) ** 2, rel=1e-11)
        h, rule = motion.h, motion.rule
        nodes = np.einsum("ij,kjn->kin", rule.basis, motion.solution.q.values)[..., 0]
        assert h * (nodes @ np.array(rule.weights)).sum() == pytest.approx(wanted, abs=1e-12)


def test_multiplier_of_an_integral_is_in_the_costates():
    """The costate of p at the start is the derivative of the cost by the start momentum."""
    given, step = dict(integral=[(None, U**2 + particle().q, 14.0)]), 1e-4
    base, ahead, back = (
        move(vi.gauss(3), 6, start=dict(q=[0], v=[v]), cost=(1 + particle().t) * U**2, **given)
        for v in (0, step, -step)
    )
    assert (ahead.cost - back.cost) / (2 * step) == pytest.approx(base.costates.p[0, 0], rel=1e-5)
    moved = [
        move(vi.gauss(3), 6, start=dict(q=[x], v=[0]), cost=(1 + particle().t) * U**2, **given)
        for x in (step, -step)
    ]
    slope = (moved[0].cost - moved[1].cost) / (2 * step)
    assert slope == pytest.approx(base.costates.q[0, 0], rel=1e-5)


def _rocket(burn=1.0, speed=2.0):
    """Mass m, thrust u, dm/dt = −u/c, no gravity: v = c log(m0/m) (Tsiolkovsky)."""
    q, v = vi.coordinates("x")
    mass = ca.SX.sym("mass")
    rocket = vi.System(q, v, v**2 / 2, force=U / mass, control=ca.vertcat(U, mass))
    return rocket, mass, {mass: -U / speed}


@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(2), vi.lobatto(3)], ids=str)
def test_rocket_gains_the_speed_of_its_equation_to_the_order_of_the_rule(rule):
    rocket, mass, states = _rocket()
    errors = []
    for steps in (4, 8):
        motion = vi.optimal_control(
            rocket,
            rule,
            duration=1.0,
            steps=steps,
            states=states,
            bounds=[(1, U, 1)],
            start=dict(q=[0], v=[0], states={mass: 1.0}),
            cost=0 * U,
        )
        assert motion.stats["states"]["mass"] == pytest.approx(1 - motion.t / 2, abs=1e-11)
        errors.append(abs(motion.v[-1, 0] - 2 * np.log(2)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(rule.order, abs=0.35)


def test_state_of_the_work_is_the_cost_and_its_end_may_be_given():
    """A battery: dE/dt = −u². Its least loss is the cost ∫u²; a given loss is reached."""
    q, v = vi.coordinates("x")
    energy = ca.SX.sym("energy")
    cart = vi.System(q, v, v**2 / 2, force=U, control=ca.vertcat(U, energy))
    given = dict(duration=1.0, steps=5, states={energy: -(U**2)})
    ends = dict(start=dict(q=[0], v=[0], states={energy: 20.0}))
    least = vi.optimal_control(
        cart, vi.gauss(2), terminal_cost=-energy, end=dict(q=[1], v=[0]), **given, **ends
    )
    assert least.stats["states"]["energy"][[0, -1]] == pytest.approx([20, 8], abs=1e-9)
    assert least.cost == pytest.approx(-8, abs=1e-9)
    ahead = vi.optimal_control(
        cart, vi.gauss(2), terminal_cost=-q, end=dict(v=[0], states={energy: 0.0}), **given, **ends
    )
    assert ahead.q[-1, 0] == pytest.approx(np.sqrt(20 / 12), rel=1e-9)
    assert replay_defect(ahead) < 1e-10
    less = ahead.again(start=dict(states={energy: 12.0}))
    assert less.q[-1, 0] == pytest.approx(1.0, rel=1e-9)


def test_nonlinear_state_follows_its_own_equation():
    """dz/dt = −z³ with z(0) = 1: z = 1/√(1 + 2t), by the stages to the order of the rule."""
    q, v = vi.coordinates("x")
    z = ca.SX.sym("z")
    cart = vi.System(q, v, v**2 / 2, force=U, control=ca.vertcat(U, z))
    errors = []
    for steps in (3, 6):
        motion = vi.optimal_control(
            cart,
            vi.gauss(2),
            duration=1.0,
            steps=steps,
            cost=U**2,
            states={z: -(z**3)},
            start=dict(q=[0], v=[0], states={z: 1.0}),
            end=dict(q=[1], v=[0]),
        )
        errors.append(np.abs(motion.stats["states"]["z"] - 1 / np.sqrt(1 + 2 * motion.t)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)


def goddard(rule, steps, **given):
    """Goddard's rocket in the units of COPS: height, mass and gravity are 1 at the start."""
    q, v = vi.coordinates("height")
    thrust, mass = ca.SX.sym("thrust"), ca.SX.sym("mass")
    drag = 310 * v**2 * ca.exp(-500 * (q - 1))
    rocket = vi.System(
        q, v, v**2 / 2 + 1 / q, force=(thrust - drag) / mass, control=ca.vertcat(thrust, mass)
    )
    return vi.optimal_control(
        rocket,
        rule,
        duration=vi.free(0.2, 0.05, 0.5),
        steps=steps,
        terminal_cost=-q,
        states={mass: -2 * thrust},
        start=dict(q=[1], v=[0], states={mass: 1.0}),
        end=dict(states={mass: 0.6}),
        bounds=[(0, thrust, 3.5)],
        **given,
    )


def test_rocket_of_goddard_rises_to_the_height_of_cops():
    """1.01283 (Dolan, Moré, Munson, Benchmarking optimization software with COPS 3.0, 2004)."""
    flight = goddard(vi.gauss(2), 50)
    assert flight.q[-1, 0] == pytest.approx(1.01283, abs=1e-5)
    mass = flight.stats["states"]["mass"]
    assert (mass[0], mass[-1]) == pytest.approx((1.0, 0.6), abs=1e-12)
    assert (np.diff(mass) < 1e-12).all()
    assert replay_defect(flight) < 1e-9
    assert flight.u[0, 0, 0] == pytest.approx(3.5, abs=1e-6)
    assert flight.u[-1, -1, 0] == pytest.approx(0, abs=1e-6)


def test_states_and_softened_bounds_travel_with_their_motion():
    flight = goddard(vi.gauss(2), 20)
    copied = pickle.loads(pickle.dumps(flight))
    assert copied.stats["states"]["mass"] == pytest.approx(flight.stats["states"]["mass"], abs=0)
    soft = move(vi.gauss(2), 10, bounds=[vi.soft(U, -5, 5, 1.0)])
    assert pickle.loads(pickle.dumps(soft)).stats["softened"] == soft.stats["softened"]


def test_predictive_control_refuses_states_that_nobody_measures():
    rocket, _, states = _rocket()
    with pytest.raises(vi.InputError, match="no measured start"):
        vi.mpc(vi.Phase(rocket, vi.gauss(2), 1.0, 5, U**2, states=states))


def test_states_go_on_from_phase_to_phase():
    rocket, mass, states = _rocket()
    half = [
        vi.Phase(rocket, vi.gauss(3), 0.5, 4, 0, bounds=[(1, U, 1)], states=states, start=start)
        for start in (dict(q=[0], v=[0], states={mass: 1.0}), None)
    ]
    first, second = vi.optimal_phases(half)
    assert second.stats["states"]["mass"][[0, -1]] == pytest.approx([0.75, 0.5], abs=1e-11)
    assert second.v[-1, 0] == pytest.approx(2 * np.log(2), rel=1e-7)
    assert first.stats["states"]["mass"][-1] == pytest.approx(0.75, abs=1e-11)


def test_a_control_that_hardly_acts_beside_a_strong_one_does_not_spoil_the_cost():
    q, v = vi.coordinates("x")
    weak = ca.SX.sym("weak")
    for factor in (1e-3, 1e-6, 1e-9, 1e-12):
        cart = vi.System(q, v, v**2 / 2, force=U + factor * weak, control=ca.vertcat(U, weak))
        motion = vi.optimal_control(
            cart,
            vi.gauss(2),
            duration=1,
            steps=10,
            cost=U**2 + weak**2,
            start=dict(q=[0], v=[0]),
            end=dict(q=[1], v=[0]),
        )
        assert motion.cost == pytest.approx(12 / (1 + factor**2), rel=1e-10)
        assert motion.u[..., 1] == pytest.approx(
            factor * motion.u[..., 0], abs=1e-6 * factor + 1e-9
        )


@coarse
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(cost=RATE**2), 'control_rate needs control="linear"'),
        (dict(cost=vi.control_rate(ca.SX.sym("w")) ** 2, control="linear"), "no control"),
        (dict(states={U: U}, control="constant"), "a value at every node"),
        (dict(states={particle().q: U}), "takes controls of the system"),
        (dict(states=[(U, U), (U, 1)]), "two rates"),
        (dict(states={U: ca.SX.sym("w")}), "the rate of u depends on"),
        (dict(states={U: 1}, start=dict(states={ca.SX.sym("w"): 1})), "takes values of the states"),
        (dict(integral=[(0, ca.SX.sym("w"), 1)]), "depends on"),
        (dict(integral=[(2, U, 1)]), "contradict"),
        (dict(integral=[(0, vi.abs(U), 1)]), "costs of optimal control"),
        (dict(integral=[(0, U, 1)], solver="fatrop"), "takes no integrals"),
        (dict(cost=RATE**2, control="linear", solver="fatrop"), "takes no control="),
    ],
)
def test_rates_integrals_and_states_are_refused_where_they_make_no_sense(change, message):
    with pytest.raises(vi.InputError, match=message):
        move(vi.gauss(2), 5, **change)


def test_no_warning_is_given_by_a_resolved_flight():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        goddard(vi.gauss(2), 50)
