"""Optimal control problems that are refused, with what to do."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, move, particle, rod, rod_swing

import varint as vi

X = particle().q


def _free_fall():
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(duration=-1.0), "positive"),
        (dict(duration="1"), "must be a number or free(guess, lower, upper), got '1'"),
        (dict(start=dict(q=["0"])), "must be a number, None or free(…), got '0'"),
        (dict(guess=dict(duration="1")), "positive number, got '1'"),
        (dict(duration=vi.free(1, -1, 2)), "positive lower bound"),
        (dict(steps=0), "give steps"),
        (dict(steps=2.5), "whole number"),
        (dict(steps=ca.SX.sym("steps")), "whole number"),
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
        (dict(control="quadratic"), "'nodes'"),
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
        (_free_fall, None, "nothing can be chosen"),
        (particle, vi.composition("verlet"), "composition"),
        (particle, 2, "rule must be"),
        (rod, vi.gauss(2), "lobatto"),
        (lambda: 3, None, "varint.System"),
    ],
)
def test_unfit_scenes_and_rules_are_refused_with_a_remedy(system, rule, message):
    with pytest.raises(vi.InputError, match=message):
        vi.optimal_control(system(), rule, duration=1.0, steps=5)


def test_ends_off_the_constraint_are_refused():
    with pytest.raises(vi.InputError, match="violates constraint 0"):
        rod_swing(vi.lobatto(3), 10, end=dict(q=[0, 1.1], v=[0, 0]))
    with pytest.raises(vi.InputError, match="G v"):
        rod_swing(vi.lobatto(3), 10, end=dict(q=[0, 1], v=[0, 1]))
    with pytest.raises(vi.InputError, match="say the same"):
        rod_swing(vi.lobatto(3), 10, end=dict(q=[None, 1], v=[0, 0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(guess=dict(q=[[0], [np.nan]])), "not finite in 1"),
        (dict(guess=dict(u=lambda t: [np.nan])), "not finite in 10"),
        (dict(guess=dict(duration=-1)), "positive number"),
        (dict(guess=dict(duration="long")), "positive number"),
        (dict(cost=np.nan), "cost is not finite"),
        (dict(cost=U**2 + np.nan), r"^cost is not finite: SX\(.*u.*\) holds nan; math.cos"),
        (dict(terminal_cost=np.inf * X), "^terminal_cost is not finite: .* holds inf"),
        (dict(bounds=[(0, X - np.inf, 1)]), "^an expression in bounds is not finite: .* holds inf"),
        (dict(bounds=[vi.soft(X + np.nan, 0, 1, 1)]), "^an expression in soft is not finite"),
        (dict(integral=[(0, U * np.nan, 1)]), "^an integrand in integral is not finite"),
        (
            dict(end=dict(bounds=[(0, ca.vertcat(X, X + np.nan), 1)])),
            "^an expression in the bounds of end is not finite",
        ),
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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (dict(cost=ca.fabs(U)), "fabs(u) in the cost has a kink in the controls: write vi.abs(…)"),
        (dict(cost=ca.fmax(U, 0)), "write vi.max(…, …)"),
        (dict(cost=ca.if_else(U > 0, U, -2 * U)), "tanh(x / ε)"),
        (dict(cost=ca.sqrt(U**2)), "fabs(u) in the cost"),
        (dict(cost=ca.norm_2(ca.vertcat(U, 2 * U))), "add a small ε² under the root"),
        (dict(cost=U**2, bounds=[(None, ca.fabs(U), 9)]), "a bound |x| <= b is (-b, x, b)"),
    ],
)
def test_kinks_in_the_controls_are_named_before_the_solver_starts_and_when_it_fails(change, words):
    with (
        pytest.warns(UserWarning, match=re.escape(words)),
        pytest.raises(vi.SolverError, match=re.escape(words)),
    ):
        move(vi.gauss(2), 5, **change, options={"ipopt": {"max_iter": 1}})


@pytest.mark.parametrize(
    "cost",
    [
        ca.fabs(U) ** 2,
        ca.fabs(U) ** 3,
        ca.fmax(U, 0) ** 2 + U**2,
        ca.sqrt(U**2 + 0.1),
        ca.if_else(X > 0, U**2, 2 * U**2),
        U**2 + ca.fabs(X + 1),
    ],
)
def test_costs_without_a_kink_in_the_controls_get_no_warning(cost):
    with pytest.raises(vi.SolverError, match="more iterations") as caught:
        move(vi.gauss(2), 5, cost=cost, options={"ipopt": {"max_iter": 0}})
    assert "kink" not in str(caught.value)


def test_a_guess_of_the_duration_that_leads_nowhere_is_named():
    """A motor of a fifth of the weight swings up in time, from other guesses."""
    q, v = vi.coordinates("theta")
    weak = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=U, control=U)
    with pytest.raises(vi.SolverError, match=r"another guess of the duration, here 3\.") as caught:
        vi.optimal_control(
            weak,
            duration=vi.free(3.0, 0.1, 30),
            steps=80,
            cost=1,
            start=dict(q=[0], v=[0]),
            end=dict(q=[np.pi], v=[0]),
            bounds=[(-2, U, 2)],
        )
    assert "contradict" not in str(caught.value)
