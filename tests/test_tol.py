"""Accuracy on demand: the true error is what was asked for, or the run is refused."""

import numpy as np
import pytest

import varint as vi

SLOW = {"toda_chain"}  # 200 sites: ten seconds
EXACT = sorted(name for name, factory in vi.models.catalogue.items() if name not in SLOW and factory().exact)
STEPPER_FAILS = {"knife_edge"}  # its small steps do not converge, with or without tol


def run(model, tol, rule=None, **more):
    start = {name: value for name, value in model.start.items() if name != "h"} | more
    return vi.simulate(model.system, rule, tol=tol, **start)


def error(motion, model):
    return np.abs(motion.q - model.exact(motion.t)[0]).max() / np.abs(motion.q).max()


@pytest.mark.parametrize("name", [name for name in EXACT if name not in STEPPER_FAILS])
def test_the_true_error_is_at_most_ten_times_the_wanted_one(name):
    model = vi.models.catalogue[name]()
    motion = run(model, 1e-6)
    assert error(motion, model) <= 1e-5
    assert motion.stats["error_estimate"] <= 1e-6


@pytest.mark.parametrize("tol", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
@pytest.mark.parametrize("name", ["kepler", "rosette", "pendulum", "pendulum_cartesian"])
def test_errors_follow_the_tolerance(name, tol):
    model = vi.models.catalogue[name]()
    motion = run(model, tol)
    assert error(motion, model) <= 10 * tol
    assert error(motion, model) <= 10 * motion.stats["error_estimate"]


def test_a_smaller_tolerance_takes_more_steps():
    model = vi.models.kepler()
    rough, fine = run(model, 1e-3), run(model, 1e-11)
    assert fine.rule.order >= rough.rule.order and fine.k[-1] > 1.5 * rough.k[-1]
    assert error(fine, model) < error(rough, model) / 100


@pytest.mark.parametrize("name", ["henon_heiles", "double_pendulum"])
def test_scenes_without_closed_form_agree_with_a_run_of_order_twenty(name):
    model = vi.models.catalogue[name]()
    motion = run(model, 1e-8)
    steps = 6 * (len(motion) - 1)
    tight = vi.simulate(
        model.system, vi.gauss(10), q0=model.q0, v0=model.v0, duration=model.duration, steps=steps, save_every=6
    )
    assert np.abs(tight.q - motion.q).max() <= 1e-7 * np.abs(motion.q).max()


def test_a_rule_that_is_given_is_kept():
    model = vi.models.pendulum()
    motion = run(model, 1e-5, vi.gauss(2))
    assert motion.rule == vi.gauss(2)
    assert error(motion, model) <= 1e-4


def test_nodes_that_are_not_saved_are_left_out_of_the_result():
    model = vi.models.pendulum()
    every, few = run(model, 1e-6), run(model, 1e-6, save_every=10)
    assert (few.q[:-1] == every.q[: 10 * (len(few) - 1) : 10]).all()
    assert few.t[-1] == model.duration


def test_the_same_input_gives_the_same_digits():
    model = vi.models.kepler()
    assert (run(model, 1e-7).q == run(model, 1e-7).q).all()


def test_motion_past_its_horizon_is_refused():
    model = vi.models.double_pendulum(theta=(2.0, 2.5))
    with pytest.raises(vi.InputError, match=r"chaotic|converge"):
        run(model, 1e-8, duration=40.0)


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
def test_what_iterations_leave_behind_does_not_add_up_over_many_orbits(tol):
    model = vi.models.kepler(e=0.6)
    motion = run(model, tol, duration=200 * np.pi, backend="compiled")
    assert error(motion, model) <= 10 * tol


def test_what_cannot_be_chosen_for_a_tolerance_is_refused():
    model = vi.models.pendulum()
    with pytest.raises(vi.InputError, match="relative"):
        run(model, 1e-17)
    with pytest.raises(vi.InputError, match="until"):
        run(model, 1e-6, until=model.system.q)
    with pytest.raises(vi.InputError, match="give duration"):
        vi.simulate(model.system, q0=1.0, v0=0.0, tol=1e-6)
    with pytest.raises(vi.InputError, match="save_every must be a whole number"):
        run(model, 1e-6, save_every=0)
    with pytest.raises(vi.InputError, match="no checkpoint"):
        run(model, 1e-6, checkpoint="run")
