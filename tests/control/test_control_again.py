"""A problem solved again with other numbers is the problem solved afresh, found sooner."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, cartpole, coarse, move, particle, replay_defect, swing_up

import varint as vi


def test_second_solve_is_the_fresh_solution_in_a_quarter_of_the_iterations():
    first, end = swing_up(steps=20), dict(q=[1.05, np.pi], v=[0.1, 0])
    again, fresh = first.again(end=end), swing_up(steps=20, end=end)
    assert again.cost == pytest.approx(fresh.cost, rel=1e-11)
    assert np.abs(again.u - fresh.u).max() < 1e-7
    assert np.abs(again.costates.p - fresh.costates.p).max() < 1e-7
    assert replay_defect(again) < 1e-9
    assert 4 * again.solution.iterations <= fresh.solution.iterations
    assert again.q[-1] == pytest.approx(end["q"], abs=1e-14)


def test_what_is_not_named_keeps_its_numbers():
    first = move(vi.gauss(2), 5)
    further = first.again(end=dict(q=[2]))
    assert further.cost == pytest.approx(48.0, rel=1e-12)
    back = further.again(start=dict(q=[1]), duration=2.0)
    assert (back.q[0, 0], back.q[-1, 0], back.duration) == (1.0, 2.0, 2.0)
    assert back.cost == pytest.approx(12 / 8, rel=1e-12)
    assert first.cost == pytest.approx(12.0)  # it is as it was
    later = first.again(t0=3.0)
    assert later.t[[0, -1]] == pytest.approx([3.0, 4.0])


def test_parameters_change_without_building():
    q, v = vi.coordinates("x")
    c = vi.Parameters(mass=1.0, weight=1.0)
    cart = vi.System(q, v, c.mass * v**2 / 2, force=U, control=U, params=c)
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    first = vi.optimal_control(cart, vi.gauss(2), duration=1, steps=5, cost=c.weight * U**2, **ends)
    heavy = first.again(params=dict(mass=3.0))
    assert heavy.cost == pytest.approx(9 * 12, rel=1e-11)
    assert float(heavy.parameters["mass"]) == 3.0
    both = heavy.again(params={c.weight: 0.5})
    assert both.cost == pytest.approx(9 * 6, rel=1e-11)
    assert both.solution.origin.problem.nlp.program is first.solution.origin.problem.nlp.program


def test_conditions_at_ends_that_are_rows_take_other_numbers():
    q, v = particle().q, particle().v

    def ends(a, b):
        return dict(p=[a], bounds=[(b, q, b)])

    first = move(vi.gauss(2), 6, end=ends(0.0, 1.0))
    again, fresh = first.again(end=ends(0.5, 2.0)), move(vi.gauss(2), 6, end=ends(0.5, 2.0))
    assert again.cost == pytest.approx(fresh.cost, rel=1e-11)
    assert [again.q[-1, 0], again.p[-1, 0]] == pytest.approx([2.0, 0.5], abs=1e-11)
    with pytest.raises(vi.InputError, match="conditions of another kind"):
        first.again(end=dict(bounds=[(1, q + v, 1)]))


def test_active_bounds_may_come_and_go():
    bounds = [(-7.0, U, 7.0)]
    first = move(vi.gauss(2), 20, bounds=bounds)
    assert not first.solution.active
    for x in (1.15, 1.0, 1.2):
        again, fresh = (
            first.again(end=dict(q=[x])),
            move(vi.gauss(2), 20, bounds=bounds, end=dict(q=[x], v=[0])),
        )
        assert again.cost == pytest.approx(fresh.cost, rel=1e-9)
        assert bool(again.solution.active) == (x > 7 / 6)
        first = again


def test_prepared_problem_is_solved_from_every_start_of_its_own():
    phase = vi.Phase(
        cartpole(),
        vi.gauss(3),
        2.0,
        20,
        U**2,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[1, np.pi], v=[0, 0]),
    )
    transfer = vi.prepare(phase, backend="interpreted")
    first = transfer()
    [alone] = vi.optimal_phases([phase])
    assert first.cost == pytest.approx(alone.cost, rel=1e-11)
    cold, warm = (transfer(end=dict(q=[0.9, np.pi]), guess=guess) for guess in (None, first))
    assert warm.cost == pytest.approx(cold.cost, rel=1e-10)
    assert warm.solution.iterations < cold.solution.iterations
    fine = vi.refine(warm, 1e-7)  # the new numbers are those of the problem
    assert fine.q[-1, 0] == pytest.approx(0.9, abs=1e-12)


def test_minimum_time_is_solved_again():
    first = move(vi.gauss(2), 8, vi.free(2, 0.1, 9), cost=1, bounds=[(-1, U, 1)])
    assert first.duration == pytest.approx(2.0, rel=1e-8)
    assert first.again(end=dict(q=[2.25])).duration == pytest.approx(3.0, rel=1e-8)


@coarse
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(end=dict(q=[None])), "were given when the problem was built"),
        (dict(end=dict(x=[1])), "unknown keys"),
        (dict(end=[1]), "must be a dictionary"),
        (dict(duration=-1), "must be positive"),
        (dict(params=dict(mass=2)), "unknown parameters"),
        (dict(end=dict(periodic=True)), "another kind"),
        (dict(start=dict(q=[5.0])), "outside its bounds"),
    ],
)
def test_numbers_of_another_problem_are_refused(change, message):
    motion = move(vi.gauss(2), 5, bounds=[(-3, particle().q, 3)])
    with pytest.raises(vi.InputError, match=message):
        motion.again(**change)


@coarse
def test_again_belongs_to_solutions_that_know_their_problem(tmp_path):
    still = vi.simulate(particle(), q0=0, v0=0, h=0.1, steps=2, u=np.zeros((2, 1)))
    with pytest.raises(vi.InputError, match="belongs to trajectories that optimal_control"):
        still.again()
    move(vi.gauss(2), 5).save(tmp_path / "a.npz")
    with pytest.raises(vi.InputError, match="loaded from a file"):
        vi.load(tmp_path / "a.npz").again()
    free = move(vi.gauss(2), 8, vi.free(2, 0.1, 9), cost=1, bounds=[(-1, U, 1)])
    with pytest.raises(vi.InputError, match="duration is free"):
        free.again(duration=2.0)
    with pytest.raises(vi.InputError, match=r"varint\.Phase"):
        vi.prepare(particle())


def _two_carts(mass: float = 1.0) -> list[vi.Phase]:
    """Push, then push another way: two phases of given and free duration, one parameter."""
    q, v = vi.coordinates("x")
    c = vi.Parameters(mass=mass)
    cart = vi.System(q, v, c.mass * v**2 / 2, force=U, control=U, params=c)
    first = vi.Phase(cart, vi.gauss(2), 1.0, 6, U**2, start=dict(q=[0], v=[0]))
    wall = dict(bounds=[(None, v, 5)])
    last = vi.Phase(
        cart, vi.gauss(2), 2.0, 6, 2 * U**2, end=dict(q=[1], v=[0], **wall), bounds=[(-9, U, 9)]
    )
    return [first, last]


def test_several_phases_are_solved_again_as_if_afresh():
    legs = vi.optimal_phases(_two_carts())
    numbers = dict(end=dict(q=[3]), params=dict(mass=2.0), phases={0: dict(duration=1.5)}, t0=0.5)
    again = legs[1].again(**numbers)
    fresh = _two_carts(2.0)
    fresh[0] = replace(fresh[0], duration=1.5)
    fresh[1] = replace(fresh[1], end=fresh[1].end | dict(q=[3]))
    alone = vi.optimal_phases(fresh, t0=0.5)
    for one, two in zip(again, alone, strict=True):
        assert one.cost == pytest.approx(two.cost, rel=1e-10)
        assert one.q == pytest.approx(two.q, abs=1e-9)
        assert one.t == pytest.approx(two.t, abs=1e-14)
        assert float(one.parameters["mass"]) == 2.0
    assert again[0].solution.iterations <= alone[0].solution.iterations
    program = legs[0].solution.origin.problem.nlp.program
    assert again[0].solution.origin.problem.nlp.program is program
    back = again[0].again(
        end=dict(q=[1]), params=dict(mass=1.0), phases={0: dict(duration=1.0)}, t0=0.0
    )
    assert [x.cost for x in back] == pytest.approx([x.cost for x in legs], rel=1e-9)


def test_prepared_phases_with_impacts_and_free_times_are_solved_for_other_numbers():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], contact=q[1])
    free = vi.free(0.5, 0.1, 2)
    throw = [
        vi.Phase(ball, vi.gauss(2), free, 4, start=dict(q=[0, 1], v=[2.0, None])),
        vi.Phase(ball, vi.gauss(2), free, 4, end=dict(q=[2.5, 0.5])),
    ]
    links = [vi.Link(0, 1, contact=ball.contact, restitution=0.8)]
    at = vi.prepare(throw, links)
    first = at()
    assert isinstance(first, list)
    further = at(end=dict(q=[2.7, 0.4]), guess=first)
    cold = at(end=dict(q=[2.7, 0.4]))
    assert further[1].q[-1] == pytest.approx([2.7, 0.4], abs=1e-13)
    assert further[0].v[0] == pytest.approx(cold[0].v[0], abs=1e-9)
    assert further[1].t[0] == pytest.approx(further[0].t[-1], abs=1e-12)
    assert further[0].solution.iterations <= cold[0].solution.iterations


def test_numbers_of_phases_that_do_not_fit_are_refused():
    legs = vi.optimal_phases(_two_carts())
    for change, message in (
        (dict(duration=1.0), "phases={0: dict(duration=…)}"),
        (dict(phases={2: {}}), "there are 2"),
        (dict(phases={0: dict(cost=1)}), "takes a dictionary with some of"),
        (dict(phases=[1]), "numbers by phase"),
        (dict(end=dict(q=[1]), phases={1: dict(end=dict(q=[2]))}), "given twice"),
        (dict(params=dict(length=1.0)), "unknown parameters"),
        (dict(guess=legs[:1]), "one for each of the 2 phases"),
    ):
        with pytest.raises(vi.InputError, match=re.escape(message)):
            legs[0].again(**change)
    with pytest.raises(vi.InputError, match="at least one"):
        vi.prepare([])
