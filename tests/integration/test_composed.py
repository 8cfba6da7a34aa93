"""Compositions of steps of order 2, over non-holonomic rows and degenerate Lagrangians."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import slopes

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


def test_compositions_that_are_not_of_equal_kind_and_forced_defaults_are_refused():
    with pytest.raises(vi.InputError, match="cannot carry non-holonomic"):
        vi.plan(KNIFE.system, vi.composition("blanes-moan4"))
    q, v = vi.coordinates("x", "y")
    rows = ca.horzcat(ca.sin(q[0]), 1)
    slowed = vi.System(q, v, ca.sumsqr(v) / 2, nonholonomic=rows, force=-0.1 * v)
    motion = vi.simulate(slowed, q0=[0, 0], v0=[1, 0], duration=1.0, tol=1e-6)
    assert motion.rule == vi.midpoint()  # steps backwards blow up what decays
