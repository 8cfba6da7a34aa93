"""A solver that is watched, and one that is left alone."""

from __future__ import annotations

import os
import signal

import casadi as ca
import numpy as np
import pytest

from varint.nlp.arrangement import natural_scales, plain_order
from varint.nlp.program import NonlinearProgram, Program
from varint.nlp.solver import Solver, build_solver


def rosenbrock(value: ca.Function | None = None) -> Solver:
    """min (1 − a)² + 100 (b − a²)², a + b − c = 0."""
    x, p = ca.MX.sym("x", 3), ca.MX.sym("p", 0)
    f = (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2
    g, lam_f, lam_g = x[0] + x[1] - x[2], ca.MX.sym("lam_f"), ca.MX.sym("lam_g")
    curvature = ca.triu(ca.hessian(lam_f * f + lam_g * g, x)[0])
    program = Program(
        ca.Function("nlp", [x, p], [f if value is None else value(x), g], ["x", "p"], ["f", "g"]),
        ca.Function("slope", [x, p], [f, ca.gradient(f, x)], ["x", "p"], ["f", "grad_f_x"]),
        ca.Function("rows", [x, p], [g, ca.jacobian(g, x)], ["x", "p"], ["g", "jac_g_x"]),
        ca.Function(
            "curvature",
            [x, p, lam_f, lam_g],
            [curvature],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    )
    wide, row = np.full(3, np.inf), np.zeros(1)
    nlp = NonlinearProgram(program, np.zeros(0), -wide, wide, row, row)
    return build_solver(nlp, "ipopt", None, natural_scales(nlp), plain_order(nlp))


FAR = np.array([-1.2, 1.0, 0.0])
NO_MULTIPLIERS = np.zeros(3), np.zeros(1)


def test_a_warm_solve_that_nobody_watches_hands_no_iterate_to_python_and_ends_where_others_do():
    solver = rosenbrock()
    seen: list[int] = []
    alone = solver(FAR, NO_MULTIPLIERS, progress=False)
    watched = solver(FAR, NO_MULTIPLIERS, progress=False, callback=lambda y: seen.append(1))
    assert alone.success and np.array_equal(alone.x, watched.x)
    assert alone.iterations == watched.iterations and len(seen) == watched.iterations + 1 > 10
    calls = [f.stats().get("n_call_callback_fun", 0) for f in map(one(solver), (False, True))]
    assert calls[0] == 0 < calls[1]


def one(solver: Solver):
    return lambda watched: solver.attempts(True, watched)[0]


class Interrupting(ca.Callback):
    """The cost of Rosenbrock's valley; presses Ctrl-C at its fifth value."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.calls = 0
        self.construct("interrupting", {})

    def get_n_in(self):
        return 1

    def get_n_out(self):
        return 1

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(3, 1)

    def eval(self, arg):
        self.calls += 1
        if self.calls == 5:
            os.kill(os.getpid(), signal.SIGINT)
        a, b, _ = arg[0].full().ravel()
        return [(1 - a) ** 2 + 100 * (b - a**2) ** 2]


def test_ctrl_c_ends_a_warm_solve_that_nobody_watches():
    cost = Interrupting()
    solver = rosenbrock(cost)
    with pytest.raises(KeyboardInterrupt):
        solver(FAR, NO_MULTIPLIERS, progress=False)
    assert cost.calls < 12


def test_ctrl_c_is_a_request_to_stop_where_somebody_watches():
    whole = rosenbrock()(FAR, progress=False)
    cost = Interrupting()
    outcome = rosenbrock(cost)(FAR, progress=False)
    assert outcome.stopped and not outcome.success
    assert len(outcome.history["cost"]) < whole.iterations
