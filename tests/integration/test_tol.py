"""Accuracy on demand: the true error is what was asked for."""

import subprocess
import sys

import numpy as np
import pytest

import varint as vi
from varint.integration.to_tolerance import DEFAULT_TOL

SLOW = {"toda_chain"}  # 200 sites: ten seconds
EXACT = sorted(
    name for name, factory in vi.models.catalogue.items() if name not in SLOW and factory().exact
)
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
        model.system,
        vi.gauss(10),
        q0=model.q0,
        v0=model.v0,
        duration=model.duration,
        steps=steps,
        save_every=6,
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


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
def test_what_iterations_leave_behind_does_not_add_up_over_many_orbits(tol):
    model = vi.models.kepler(e=0.6)
    motion = run(model, tol, duration=200 * np.pi, backend="compiled")
    assert error(motion, model) <= 10 * tol


@pytest.mark.parametrize("name", ["kepler", "pendulum", "pendulum_cartesian", "uniform_fields"])
def test_a_duration_alone_runs_at_the_default_accuracy(name):
    model = vi.models.catalogue[name]()
    motion = run(model, None)
    assert motion.stats["tol"] == DEFAULT_TOL == 1e-9
    assert error(motion, model) <= 10 * DEFAULT_TOL
    np.testing.assert_array_equal(motion.q, run(model, DEFAULT_TOL).q)


@pytest.mark.parametrize("tol", [None, 1e-6])
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (dict(duration=None), "give duration .* or two of h, steps, duration"),
        (dict(save_every=0), "save_every must be a whole number"),
        (dict(duration="long"), "duration must be a number"),
        (dict(duration=0.0), "duration must not be zero"),
        (dict(iteration_tol=1e-6), "iteration_tol goes with h or steps"),
        (dict(time_scale=1 + vi.models.pendulum().system.q ** 2), "give h, the step of the fict"),
    ],
)
def test_what_cannot_be_done_with_chosen_steps_is_refused(tol, more, message):
    model = vi.models.pendulum()
    with pytest.raises(vi.InputError, match=message):
        run(model, tol, **more)


@pytest.mark.parametrize("tol", [1e-17, 0.5])
def test_a_tolerance_out_of_range_is_refused(tol):
    with pytest.raises(
        vi.InputError, match="tol is the wanted error relative to the motion, between"
    ):
        run(vi.models.pendulum(), tol)


@pytest.mark.parametrize("wrong", [-1.0, 0, 1.0, "fine"])
@pytest.mark.parametrize("name", ["tol", "iteration_tol"])
def test_accuracies_are_relative_errors_between_zero_and_one(name, wrong):
    with pytest.raises(vi.InputError, match=f"^{name} must be a relative error between 0 and 1"):
        vi.simulate(vi.models.pendulum().system, q0=1.0, v0=0.0, h=0.1, steps=2, **{name: wrong})


GRIDS = {
    "h and steps": dict(h=0.1, steps=2000),
    "steps and duration": dict(steps=2000, duration=200.0),
    "h and duration": dict(h=0.1, duration=200.0),
    "variable steps": dict(h=0.1, steps=2000),
}


@pytest.mark.parametrize("grid", GRIDS)
def test_iterations_may_end_early_and_tol_beside_steps_is_their_old_name(grid):
    model = vi.models.double_pendulum()
    call = dict(q0=model.q0, v0=model.v0, backend="compiled") | GRIDS[grid]
    if grid == "variable steps":
        call["time_scale"] = 1 + model.system.q[0] ** 2 / 10
    exact = vi.simulate(model.system, vi.gauss(6), **call)
    early = vi.simulate(model.system, vi.gauss(6), **call, iteration_tol=1e-6)
    assert early.stats["iterations"] < 0.9 * exact.stats["iterations"]
    with pytest.warns(
        DeprecationWarning, match=r"tol with h or steps .* write iteration_tol=1e-06"
    ) as said:
        old = vi.simulate(model.system, vi.gauss(6), **call, tol=1e-6)
    assert said[0].filename == __file__
    np.testing.assert_array_equal(old.q, early.q)
    with pytest.raises(vi.InputError, match="tol chooses the steps: leave h and steps out"):
        vi.simulate(model.system, vi.gauss(6), **call, tol=1e-6, iteration_tol=1e-6)


CHECKED_RUNS = """
import sys
import casadi as ca
import varint as vi

held = vi.models.pendulum_cartesian()
vi.simulate(held.system, q0=held.q0, v0=held.v0, h=held.h, steps=20)
free = vi.models.pendulum()
vi.simulate(free.system, q0=free.q0, v0=free.v0, duration=5.0, tol=1e-6)
q, v = vi.coordinates("x")
u = ca.SX.sym("u")
cart = vi.System(q, v, v**2 / 2, force=u, control=u)
move = vi.optimal_control(
    cart, vi.gauss(2), duration=1, steps=5, cost=u**2, q0=0, v0=0, end=dict(q=[1], v=[0])
)
assert move.solution.success and "error_estimate" in move.stats
assert "varint.control.sensitivity" not in sys.modules
assert "numpy.random" not in sys.modules
assert "numpy" in sys.modules
sys.exit(int("numpy.ma" in sys.modules))
"""


def test_runs_and_solves_load_nothing_that_they_do_not_need():
    assert subprocess.run([sys.executable, "-c", CHECKED_RUNS], check=False).returncode == 0
