"""Input that no run can come of: every verb refuses it at once and says what to do (found by
fuzzing).
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import varint as vi

Q, V = vi.coordinates("x", "y")
PUSH = ca.SX.sym("push")
CART = vi.System(Q, V, ca.sumsqr(V) / 2, force=ca.vertcat(PUSH, 0), control=PUSH)
HORIZON = vi.Phase(CART, vi.gauss(2), 1.0, 3, PUSH**2 + Q[0] ** 2)
FREE = vi.System(Q, V, ca.sumsqr(V) / 2)
START = dict(q0=[1.0, 0.0], v0=[0.0, 1.0])
ENDS = dict(q_start=[0, 0], q_end=[1, 1])


def verbs_with_steps(h: float, t0: float) -> dict:
    """Every verb, asked for steps of h from t0."""
    control = dict(cost=PUSH**2, start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, 0]), progress=False)
    closed = dict(periodic=True, guess=[[1, 0], [0, 1], [-1, 0], [0, -1]])
    return {
        "simulate": lambda: vi.simulate(FREE, **START, h=h, steps=4, t0=t0),
        "to a tolerance": lambda: vi.simulate(FREE, **START, duration=4 * h, tol=1e-6, t0=t0),
        "variable steps": lambda: vi.simulate(
            FREE, **START, h=h, steps=4, t0=t0, time_scale=1 + ca.sumsqr(Q)
        ),
        "ensemble": lambda: vi.ensemble(FREE, q0=[[1, 0], [0, 1]], v0=[0, 1], h=h, steps=4, t0=t0),
        "least action": lambda: vi.least_action(FREE, **ENDS, duration=4 * h, steps=4, t0=t0),
        "closed path": lambda: vi.least_action(FREE, **closed, duration=4 * h, steps=4, t0=t0),
        "paths": lambda: vi.paths(FREE, **ENDS, duration=4 * h, steps=4, t0=t0),
        "optimal control": lambda: vi.optimal_control(
            CART, duration=4 * h, steps=4, t0=t0, **control
        ),
        "multistart": lambda: vi.multistart(replace(HORIZON, duration=4 * h), 2, t0=t0),
        "mpc": lambda: vi.mpc(replace(HORIZON, duration=4 * h))([1, 0], [0, 0], t=t0),
        "a step function": lambda: vi.diagnostics.energy_slope(
            FREE, vi.step_function(FREE, vi.gauss(2)), **START, h=h, steps=60, t0=t0
        ),
    }


@pytest.mark.parametrize("verb", verbs_with_steps(1.0, 0.0))
def test_steps_that_do_not_move_the_clock_are_refused_by_every_verb(verb):
    with pytest.raises(
        vi.InputError,
        match=r"do not move a clock at t=1e\+20: .* 1.6e\+04 apart there; begin nearer",
    ):
        verbs_with_steps(0.25, 1e20)[verb]()


@pytest.mark.parametrize("h", [1e-300, 1e200])
@pytest.mark.parametrize("verb", verbs_with_steps(1.0, 0.0))
def test_steps_whose_square_is_no_number_are_refused_by_every_verb(verb, h):
    with pytest.raises(
        vi.InputError,
        match=r"the square of h is no number of double precision; measure time in another",
    ):
        verbs_with_steps(h, 0.0)[verb]()


def test_steps_just_long_enough_move_the_clock():
    """2⁵³ is where whole numbers end: one more is lost, eight are not."""
    t0 = 2.0**53
    motion = vi.simulate(FREE, **START, h=8.0, steps=100, t0=t0)
    assert (np.diff(motion.t) == 8).all() and abs(motion.q[-1, 1] - 800) <= 1e-10
    with pytest.raises(vi.InputError, match="do not move a clock"):
        vi.simulate(FREE, **START, h=1.0, steps=100, t0=t0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            dict(h=9.9e-253, duration=7),
            "steps=7.07071e.252 is more than any run can take",
        ),
        (dict(h=1e-320, duration=7), "steps=inf is more"),
        (dict(h=1e300, duration=1e-300), "not a whole number; give steps=1"),
        (
            dict(h=0.1, steps=10**14),
            "u of 100000000000000 steps would take 8e.05 GB, more than this machine's memory",
        ),
        (dict(h=0.1, duration=1e18, time_scale=1 + Q[0] ** 2, u=None), "more than any run can"),
    ],
)
def test_more_steps_than_can_be_taken_or_kept_are_refused(arguments, message):
    system = FREE if "time_scale" in arguments else CART
    with pytest.raises(vi.InputError, match=message):
        vi.simulate(system, **dict(u=0.3) | START | arguments)


def test_paths_of_more_steps_than_memory_holds_are_refused():
    with pytest.raises(
        vi.InputError, match=r"a path of 10+ steps would take .* GB, .* take fewer steps"
    ):
        vi.least_action(FREE, **ENDS, duration=1.0, steps=10**13)
    with pytest.raises(vi.InputError, match=r"a path of 10+ steps would take .* GB"):
        vi.mpc(replace(HORIZON, steps=10**14))
    with pytest.raises(vi.InputError, match=r"a loop of 10+ steps would take .* GB"):
        vi.closed_loop(vi.mpc(HORIZON, backend="interpreted"), [1, 0], [0, 0], 10**14)
    with pytest.raises(
        vi.InputError,
        match=r"an ensemble of 10+ steps would take .* keep fewer of them: save_every=",
    ):
        vi.ensemble(FREE, q0=[[1, 0], [0, 1]], v0=[0, 1], h=0.1, steps=10**14)
    with pytest.raises(vi.InputError, match=r"a run of 10+ steps would take .* GB"):
        step = vi.step_function(FREE, vi.gauss(2))
        vi.diagnostics.reversibility_defect(FREE, step, **START, h=0.1, steps=10**14)


@pytest.mark.parametrize(
    "rubbish",
    [ca.SX.sym("foreign"), ca.MX.sym("m"), "a", object()],
    ids=["SX", "MX", "str", "object"],
)
def test_symbols_and_words_are_refused_where_numbers_are_expected(rubbish):
    controller = vi.mpc(HORIZON, backend="interpreted")
    problem = dict(
        duration=1.0, steps=3, cost=PUSH**2, start=dict(q=[0, 0], v=[0, 0]), progress=False
    )
    refused = {
        "periodic": lambda: vi.optimal_control(CART, **problem, end=dict(periodic=rubbish)),
        "offset of a link": lambda: vi.optimal_phases(
            [HORIZON] * 2, [vi.Link(0, 1, offset=rubbish)]
        ),
        "before of a link": lambda: vi.optimal_phases([HORIZON] * 2, [vi.Link(rubbish, 1)]),
        "time of a link": lambda: vi.optimal_phases([HORIZON] * 2, [vi.Link(0, 1, time=rubbish)]),
        "the guess of q": lambda: vi.optimal_control(
            CART, **problem, guess=dict(q=lambda t: [rubbish, rubbish])
        ),
        "u (must|is)": lambda: vi.simulate(CART, **START, duration=1.0, tol=1e-6, u=rubbish),
        "save_every": lambda: vi.simulate(
            FREE, **START, duration=1.0, tol=1e-6, save_every=rubbish
        ),
        "starts": lambda: vi.paths(FREE, **ENDS, duration=1.0, steps=4, starts=rubbish),
        "spread": lambda: vi.paths(FREE, **ENDS, duration=1.0, steps=4, spread=rubbish),
        "seed": lambda: vi.paths(FREE, **ENDS, duration=1.0, steps=4, seed=rubbish),
        "winding": lambda: vi.paths(FREE, **ENDS, duration=1.0, steps=4, winding=rubbish),
        "winding ": lambda: vi.paths(FREE, **ENDS, duration=1.0, steps=4, winding=dict(x=rubbish)),
        "starts ": lambda: vi.multistart(HORIZON, rubbish),
        "spread ": lambda: vi.multistart(HORIZON, 2, spread=rubbish),
        "seed ": lambda: vi.multistart(HORIZON, 2, seed=rubbish),
        "t0": lambda: vi.multistart(HORIZON, 2, t0=rubbish),
        "t ": lambda: controller([1, 0], [0, 0], t=rubbish),
        "previous": lambda: controller([1, 0], [0, 0], previous=rubbish),
        "q0": lambda: vi.closed_loop(controller, rubbish, [0, 0], 2),
        "disturbance": lambda: vi.closed_loop(controller, [1, 0], [0, 0], 2, disturbance=rubbish),
        "tol": lambda: vi.refine(vi.simulate(FREE, **START, h=0.1, steps=2), rubbish),
    }
    for what, call in refused.items():
        with pytest.raises(vi.InputError, match=rf"^{what}"):
            call()


def test_periodic_offsets_may_come_from_any_numbers():
    """Periodic but for a shift of x by one: the cheapest is to coast at speed 1, whoever wrote
    the numbers.
    """
    problem = dict(duration=1.0, steps=3, cost=PUSH**2, start=dict(q=[0, 0]), progress=False)
    for offset in ([1, 0], np.array([1.0, 0.0]), ca.DM([1, 0])):
        motion = vi.optimal_control(CART, **problem, end=dict(periodic=offset))
        np.testing.assert_allclose(motion.v, [[1, 0]] * 4, atol=1e-6)


def test_an_entry_of_the_mass_matrix_that_is_seen_to_be_zero_is_so_on_both_sides():
    """∂²/∂ẋ∂ẏ log(ẋ/ẏ) = 0 is plain in one order of derivatives only; LDLᵀ wants a symmetric
    pattern.
    """
    q, v = vi.coordinates("x", "y")
    odd, plain = (
        vi.System(q, v, ca.sumsqr(v) / 2 + term - q[0])
        for term in (ca.log(v[0] / v[1]), ca.log(v[0]) - ca.log(v[1]))
    )
    assert odd.mass_matrix.sparsity().is_diag() and plain.mass_matrix.sparsity().is_diag()
    start = dict(q0=[0.0, 0.0], v0=[2.0, 1.0], h=0.001, steps=5, backend="interpreted")
    with pytest.raises(vi.ConvergenceError, match="1024 parts"):  # L is not defined where v = 0
        vi.simulate(odd, on_failure="subdivide", **start)


@pytest.mark.parametrize("masses", [(0.625, -0.90625), (1.0, 1e300)])
def test_the_symplectic_defect_of_steps_with_hardly_a_derivative_is_a_number_or_refused(masses):
    c = vi.Parameters(masses=[1.0, 2.0])
    quartic = vi.System(Q, V, ca.dot(c.masses, V**2) / 2 - ca.sumsqr(Q) ** 2, params=c)
    try:
        found = vi.diagnostics.symplectic_defect(
            quartic, vi.gauss(2), **START, h=0.05, params=dict(masses=masses)
        )
    except vi.InputError as error:
        assert "has no finite derivative" in str(error)
    else:
        assert np.isfinite(found.values).all() and found.values.max() <= 1.0


@pytest.mark.parametrize(
    "condition", [lambda q, v: q > 0.5, lambda q, v: ca.logic_and(q > 0, v < 1)]
)
@pytest.mark.parametrize("asked", [lambda x: {"until": x}, lambda x: {"events": {"half": (x, 1)}}])
def test_a_condition_is_no_expression_whose_zeros_end_or_mark_a_run(condition, asked):
    """0 or 1: it becomes zero where it ends to hold, and crosses it nowhere."""
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, v**2 / 2 - q**2 / 2)
    with pytest.raises(vi.InputError, match=r"is a condition, 0 or 1.* give what crosses zero"):
        vi.simulate(spring, q0=1.0, v0=0.0, duration=7.0, **asked(condition(q, v)))


@pytest.mark.parametrize("where", ["Lagrangian", "force"])
def test_functions_of_pythons_own_are_named_where_they_lost_the_symbol(where):
    q, v = vi.coordinates("x")
    lost = math.cos(q)
    of = {"lagrangian": v**2 / 2 + lost} if where == "Lagrangian" else {"lagrangian": v**2 / 2}
    scene = vi.System(q, v, **of, **({"force": lost} if where == "force" else {}))
    with pytest.raises(
        vi.InputError, match=f"the {where} holds what is no number: math.cos.* ca.cos"
    ):
        vi.simulate(scene, q0=1.0, v0=0.0, duration=1.0)


@pytest.mark.parametrize(
    "given",
    [
        dict(duration="1"),
        dict(duration=np.str_("1")),
        dict(duration=b"1"),
        dict(h=".1", steps=3),
        dict(duration=1, t0="0"),
        dict(duration=1, q0=["1", "0"]),
        dict(at=["0.5"]),
    ],
)
def test_words_are_no_numbers_even_where_they_are_digits(given):
    with pytest.raises(vi.InputError, match=r"must be.*got .*'"):
        vi.simulate(FREE, **(START | given))


@pytest.mark.parametrize("what", ["q0", "v0", "duration", "t0", "tol", "at"])
@pytest.mark.parametrize("digits", [400, 5000])  # more than Python writes
def test_messages_do_not_repeat_what_is_far_too_long(what, digits):
    body = vi.System(Q[0], V[0], V[0] ** 2 / 2)
    given = dict(q0=1.0, v0=0.0) | ({} if what == "at" else dict(duration=1.0))
    with pytest.raises(vi.InputError, match=r" must be .* got ") as refused:
        vi.simulate(body, **(given | {what: 10**digits}))
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("constant", [1.0, T := vi.time(), ca.vertcat(Q[0], 2.0)])
def test_a_constraint_that_no_coordinate_changes_is_refused(constant):
    with pytest.raises(vi.InputError, match=r"row \d of the constraint is .* no coordinate"):
        vi.System(Q, V, ca.sumsqr(V) / 2, constraint=constant, t=T)
