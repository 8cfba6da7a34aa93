"""Compositions of steps of order 2, over non-holonomic rows and degenerate Lagrangians."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import slopes
from scipy.integrate import solve_ivp

import varint as vi

HIGH = [("suzuki4", 4), ("yoshida4", 4), ("kahan-li6", 6), ("kahan-li8", 8)]
KNIFE, DISC = vi.models.knife_edge(), vi.models.rolling_disc()


def vortices() -> vi.System:
    """Three point vortices: ϑ is linear in q."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
    strength, lagrangian = (1.0, -0.6, 1.3), 0
    for i, a in enumerate(strength):
        x, y = q[2 * i], q[2 * i + 1]
        lagrangian += a / 2 * (x * v[2 * i + 1] - y * v[2 * i])
        for j, b in enumerate(strength[:i]):
            apart = ca.sumsqr(q[2 * i : 2 * i + 2] - q[2 * j : 2 * j + 2])
            lagrangian += a * b / (4 * np.pi) * ca.log(apart)
    return vi.System(q, v, lagrangian)


def errors_of(model: vi.models.Model, rule: vi.Rule, steps: list[int], **how) -> np.ndarray:
    found = []
    for n in steps:
        motion = vi.simulate(
            model.system, rule, q0=model.q0, v0=model.v0, duration=6.0, steps=n, **how
        )
        q, v = model.exact(motion.t)
        found.append([np.abs(motion.q - q).max(), np.abs(motion.v - v).max()])
    return np.array(found)


@pytest.mark.parametrize("backend", ["interpreted", "native"])
@pytest.mark.parametrize(("name", "order"), HIGH)
@pytest.mark.parametrize("model", [KNIFE, DISC], ids=lambda model: model.name)
def test_non_holonomic_rows_keep_to_their_closed_form_with_the_order_of_the_composition(
    model, name, order, backend
):
    if order == 8 and model is DISC:  # there is nothing but round-off left of 20 steps
        steps = [3, 4, 5]
    else:
        steps = [10, 13, 17] if order == 8 else [24, 32, 48]
    errors = errors_of(model, vi.composition(name), steps, backend=backend)[:, :1]
    np.testing.assert_allclose(slopes(steps, errors, 1e-14), order, atol=0.25)


@pytest.mark.parametrize(("name", "order"), HIGH[:3])
@pytest.mark.parametrize("which", ["vortices", "lotka_volterra", "guiding_centre"])
@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
def test_degenerate_scenes_show_the_order_of_the_composition(which, name, order):
    """Whether a step leads from p = ϑ(q) to p = ϑ(q), or two of them do."""
    if which == "vortices":
        system, q0 = vortices(), [0, 0, 1, 0, 0.3, 0.9]
    else:
        system, q0 = (getattr(vi.models, which)().system, getattr(vi.models, which)().q0)
    how = dict(q0=q0, duration=5.0)
    fine = vi.simulate(system, vi.composition("kahan-li8"), steps=300, **how)
    other = vi.simulate(system, vi.midpoint(), steps=8000, **how)
    assert np.abs(fine.q[-1] - other.q[-1]).max() < 1e-6  # of the rule that needs no theory
    steps = [16, 24, 32] if which == "guiding_centre" else [40, 60, 80]
    rule = vi.composition(name)
    errors = [
        np.abs(vi.simulate(system, rule, steps=n, **how).q[-1] - fine.q[-1]).max() for n in steps
    ]
    np.testing.assert_allclose(slopes(steps, np.array(errors)[:, None], 1e-13), order, atol=0.4)


@pytest.mark.parametrize("model", [KNIFE, DISC], ids=lambda model: model.name)
@pytest.mark.parametrize("longer", [1, 20])
def test_a_tolerance_is_met_by_few_steps_of_high_order(model, longer):
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=model.duration * longer)
    exact = model.exact(motion.t)[0]
    size = np.abs(exact).max(axis=0)
    assert (np.abs(motion.q - exact) <= 1e-9 * size).all()
    assert motion.rule.order >= 6
    assert motion.k[-1] < 200 * longer  # by order 2 a million


@pytest.mark.parametrize("which", ["lotka_volterra", "guiding_centre"])
@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
def test_a_tolerance_of_degenerate_scenes_is_met_by_few_steps(which):
    model = getattr(vi.models, which)()
    how = dict(q0=model.q0, duration=model.duration)
    motion = vi.simulate(model.system, **how)
    fine = vi.simulate(model.system, vi.composition("kahan-li8"), steps=4 * motion.k[-1], **how)
    apart = np.abs(motion.q[-1] - fine.q[-1]) / np.abs(fine.q).max(axis=0)
    assert apart.max() <= 1e-9
    assert motion.rule.order >= 6 and motion.k[-1] < 2000


def test_the_step_is_symmetric_and_keeps_to_the_rows():
    rule = vi.composition("kahan-li6")
    there = vi.simulate(KNIFE.system, rule, q0=KNIFE.q0, v0=KNIFE.v0, h=0.2, steps=20)
    back = vi.simulate(KNIFE.system, rule, q0=there.q[-1], p0=-there.p[-1], h=0.2, steps=20)
    np.testing.assert_allclose(back.q[-1], KNIFE.q0, atol=1e-12)
    slip = np.sin(there.q[:, 2]) * there.v[:, 0] - np.cos(there.q[:, 2]) * there.v[:, 1]
    assert np.abs(slip).max() < 1e-13


def test_both_gears_and_pieces_of_a_run_have_the_same_bytes():
    rule, system = vi.composition("kahan-li6"), vi.models.chaplygin_sleigh().system
    how = dict(q0=[0, 0, 0], v0=[0.4, 0, 1.0], h=0.1)
    native = vi.simulate(system, rule, steps=60, backend="native", **how)
    compiled = vi.simulate(system, rule, steps=60, backend="compiled", **how)
    assert native.q.tobytes() == compiled.q.tobytes()
    assert native.p.tobytes() == compiled.p.tobytes()
    fewer = vi.simulate(system, rule, steps=60, save_every=7, backend="native", **how)
    assert fewer.q[1].tobytes() == native.q[7].tobytes()
    slow = vi.simulate(system, rule, steps=60, backend="interpreted", **how)
    np.testing.assert_allclose(slow.q, native.q, rtol=0, atol=1e-13)


def test_a_step_that_fails_leaves_the_node_before_it():
    """Not what the first of its parts led to."""
    q, v = vi.coordinates("x", "y", "phi")
    blade = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    lagrangian = (ca.sumsqr(v) + 2 * q[0]) / 2 + 0.3 * ca.sqrt(1 - q[0])  # no force beyond x = 1
    scene = vi.System(q, v, lagrangian, nonholonomic=blade)
    how = dict(q0=[0, 0, 0.0], v0=[1.0, 0, 0.0], h=0.25, steps=20)
    for backend in ("native", "interpreted"):
        with pytest.raises(vi.ConvergenceError) as failure:
            vi.simulate(scene, vi.composition("yoshida4"), backend=backend, **how)
        got = failure.value.trajectory
        again = vi.simulate(
            scene, vi.composition("yoshida4"), backend=backend, **(how | dict(steps=len(got) - 1))
        )
        np.testing.assert_allclose(got.q, again.q, rtol=0, atol=1e-12)


def test_what_follows_from_a_run_is_that_of_many_steps_of_the_base():
    rule, model = vi.composition("kahan-li8"), vi.models.chaplygin_sleigh()
    how = dict(q0=model.q0, v0=model.v0, duration=4.0)
    few = vi.simulate(model.system, rule, steps=30, **how)
    many = vi.simulate(model.system, vi.midpoint(), steps=8000, **how)
    assert few.action == pytest.approx(many.action, abs=1e-6)
    np.testing.assert_allclose(few.at(1.234).q, many.at(1.234).q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(few.multipliers[-1], many.multipliers[-1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(few.transition_matrix(), many.transition_matrix(), rtol=0, atol=1e-5)
    symmetry = vi.symmetries(model.system)[1]  # translation, which the blade breaks
    told = few.momentum_map(symmetry)
    assert np.abs(told.values[-1] - many.momentum_map(symmetry).values[-1]).max() < 1e-6


def test_derivatives_of_a_run_are_those_of_differences():
    model, rule = vi.models.chaplygin_sleigh(), vi.composition("kahan-li6")
    q, v = model.system.q, model.system.v

    def run(arm: float) -> vi.Trajectory:
        how = dict(q0=model.q0, v0=model.v0, duration=2.0, steps=10)
        return vi.simulate(model.system, rule, params={"arm": arm}, **how)

    step, at = 1e-5, run(0.7)
    end = vi.gradient(at, terminal_loss=q[0] * q[1])
    difference = [run(0.7 + d).q[-1, :2].prod() for d in (step, -step)]
    assert float(end.params["arm"]) == pytest.approx(
        (difference[0] - difference[1]) / (2 * step), rel=1e-6
    )
    along = [vi.gradient(run(0.7 + d), v[2] ** 2) for d in (step, -step, 0)]
    assert float(along[2].params["arm"]) == pytest.approx(
        (along[0].value - along[1].value) / (2 * step), rel=1e-6
    )


def test_compositions_that_are_not_of_equal_kind_are_refused():
    with pytest.raises(vi.InputError, match="cannot carry non-holonomic"):
        vi.plan(KNIFE.system, vi.composition("blanes-moan4"))


def blade(drag: float = 0.0, controlled: bool = False, clock: bool = False) -> vi.System:
    """A blade that goes where it points, pushed and turned."""
    (q, v), t = vi.coordinates("x", "y", "theta"), vi.time()
    u = ca.SX.sym("u", 2) if controlled else None
    push = u if controlled else ca.vertcat(0.2 * (ca.cos(t) if clock else 1), 0.1)
    rows = ca.horzcat(-ca.sin(q[2]), ca.cos(q[2]), 0)
    force = ca.vertcat(push[0] * ca.cos(q[2]), push[0] * ca.sin(q[2]), push[1]) - drag * v
    kinetic = (v[0] ** 2 + v[1] ** 2 + 0.3 * v[2] ** 2) / 2
    return vi.System(q, v, kinetic, nonholonomic=rows, force=force, control=u, t=t)


ON_ITS_WAY = {"q0": [0.0, 0.0, 0.2], "v0": [np.cos(0.2), np.sin(0.2), 0.3]}


def along_the_blade(drag: float, pushes: np.ndarray, duration: float) -> np.ndarray:
    """Its end by the equations of speed along the blade and rate of turning."""
    state = np.array([0.0, 0.0, 0.2, 1.0, 0.3])
    for push, turn in pushes:

        def rate(_, y, push=push, turn=turn):
            x = y[3] * np.cos(y[2]), y[3] * np.sin(y[2]), y[4]
            return [*x, push - drag * y[3], (turn - drag * y[4]) / 0.3]

        span = (0.0, duration / len(pushes))
        state = solve_ivp(rate, span, state, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return state[:3]


@pytest.mark.parametrize("drag", [0.0, 0.3, 3.0, 30.0])
def test_forced_rows_meet_a_tolerance_by_few_steps_of_high_order(drag):
    """Steps backwards blow up what decays, by no more than such steps do forwards."""
    asked = ON_ITS_WAY | {"duration": 10.0}
    exact = along_the_blade(drag, np.array([[0.2, 0.1]]), 10.0)
    for tol in (1e-6, 1e-9):
        motion = vi.simulate(blade(drag), **asked, tol=tol)
        size = np.abs(motion.q).max()
        assert motion.rule.order >= 6 and motion.stats["steps"] < 4000
        assert np.abs(motion.q[-1] - exact).max() <= tol * size


@pytest.mark.parametrize("rows", [1, 4, 20])
def test_a_table_of_controls_beside_rows_is_followed_by_compositions(rows):
    table = np.random.default_rng(rows).uniform(-1, 1, (rows, 2))
    given = table if rows > 1 else table[0]
    motion = vi.simulate(blade(0.1, True), **ON_ITS_WAY, duration=8.0, tol=1e-9, u=given)
    exact = along_the_blade(0.1, table, 8.0)
    assert motion.rule.order >= 6 and motion.stats["steps"] < 1000
    assert np.abs(motion.q[-1] - exact).max() <= 1e-9 * np.abs(motion.q).max()


def test_controls_of_composed_steps_are_the_same_in_all_loops_and_in_derivatives():
    system, rule = blade(0.1, True), vi.composition("kahan-li8")
    table = np.repeat(np.random.default_rng(1).uniform(-1, 1, (4, 2)), 8, axis=0)

    def run(backend, u=table):
        return vi.simulate(system, rule, **ON_ITS_WAY, duration=8.0, steps=32, u=u, backend=backend)

    ways = [run(x) for x in ("interpreted", "native", "compiled")]
    assert ways[1].q.tobytes() == ways[2].q.tobytes()
    assert np.abs(ways[0].q - ways[1].q).max() < 1e-12
    between = np.linspace(0.1, 7.9, 9)
    assert np.abs(ways[0].at(between).q - ways[1].at(between).q).max() < 1e-11
    loss = system.q[0] ** 2 + system.control[0] ** 2 + system.v[1]
    found, change = vi.gradient(ways[1], loss), np.zeros_like(table)
    change[5, 0] = 1e-5
    beside = [vi.gradient(run("native", table + way * change), loss).value for way in (1, -1)]
    assert found.u[5].ravel()[0] == pytest.approx((beside[0] - beside[1]) / 2e-5, rel=1e-7)


def test_explicit_time_beside_rows_acts_at_the_times_of_composed_steps():
    asked = ON_ITS_WAY | {"duration": 5.0}
    fine = vi.simulate(blade(0.2, clock=True), vi.composition("kahan-li8"), **asked, steps=400)
    motion = vi.simulate(blade(0.2, clock=True), **asked)
    assert motion.rule.order >= 6 and motion.stats["steps"] < 400
    assert np.abs(motion.q[-1] - fine.q[-1]).max() < 1e-9 * np.abs(fine.q).max()


def test_a_pendulum_in_phase_space_whose_damper_is_not_linear_takes_composed_steps():
    x, v = vi.coordinates("q", "p")
    drag = 0.1 * v[0] * ca.sqrt(v[0] ** 2 + 1e-2)
    hamiltonian = x[1] ** 2 / 2 - 9.81 * ca.cos(x[0])
    scene = vi.System(x, v, x[1] * v[0] - hamiltonian, force=ca.vertcat(-drag, 0))
    with pytest.warns(UserWarning, match="degenerate"):
        motion = vi.simulate(scene, q0=[1.0, 0.0], duration=10.0)

    def rate(_, y):
        return [y[1], -9.81 * np.sin(y[0]) - 0.1 * y[1] * np.sqrt(y[1] ** 2 + 1e-2)]

    exact = solve_ivp(rate, (0, 10), [1.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert motion.stats["steps"] < 5000 and np.abs(motion.q[-1] - exact).max() < 1e-9
