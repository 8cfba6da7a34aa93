"""How an optimal control problem is solved: guesses, solvers, progress, interrupts, failure."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
import pytest
from control_scenes import (
    U,
    move,
    pendulum,
    swing,
    swing_up,
)

import varint as vi
from varint.nlp.watch import Watch


def test_warm_start_takes_fewer_iterations_than_a_cold_one():
    cold = swing_up()
    warm = swing_up(guess=cold)
    finer = swing_up(steps=60, guess=cold)
    other = swing_up(end=dict(q=[1.01, np.pi], v=[0, 0]), guess=cold)
    assert warm.solution.iterations <= 3
    assert max(finer.solution.iterations, other.solution.iterations) < cold.solution.iterations
    assert finer.cost == pytest.approx(cold.cost, rel=1e-8)


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
