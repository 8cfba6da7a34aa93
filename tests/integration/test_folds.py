"""Runs through configurations in which constraint rows are dependent: over them, never on them in
silence.
"""

from __future__ import annotations

import warnings
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import varint as vi
from varint import models

GRAVITY = 9.81
CONSTRAINED = [
    "pendulum_cartesian",
    "spherical_pendulum_cartesian",
    "atwood",
    "double_atwood",
    "chain_rods",
    "turning_wire",
    "free_body_quaternion",
    "heavy_top_quaternion",
    "slider_crank",
    "four_bar",
    "andrews_mechanism",
]
WITHIN = {3: 0.5, 4: (1 - np.sqrt(0.2)) / 2, 5: (1 - np.sqrt(3 / 7)) / 2}  # nodes of Lobatto rules


@cache
def time_of_fold(loops: int) -> float:
    """When the cranks of the four-bar model lie level, from the claim of the model."""
    inertia, weight = (loops + 1) / 3 + loops, ((loops + 1) / 2 + loops) * GRAVITY

    def level(_t, y):
        return y[0] - np.pi / 2

    level.terminal = True
    solution = solve_ivp(
        lambda _t, y: [y[1], weight / inertia * np.sin(y[0])],
        [0, 5],
        [0.0, 1.0],
        events=level,
        rtol=1e-13,
        atol=1e-14,
    )
    return float(solution.t_events[0][0])


@cache
def four_bar(loops: int) -> vi.models.Model:
    """The same model for all tests, whose steps are built once."""
    return models.four_bar(loops)


def folded_at(loops: int, rule: vi.Rule, node: float, **options) -> tuple[vi.Trajectory, str]:
    """100 steps of the four-bar linkage that folds after so many of them, and what was said."""
    model = four_bar(loops)
    start = dict(q0=model.q0, v0=model.v0, h=time_of_fold(loops) / node, steps=100)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(model.system, rule, **start, **options)
        except vi.ConvergenceError as error:
            return error.trajectory, str(error)
    return motion, "; ".join(str(each.message) for each in said)


def energy_error(motion: vi.Trajectory) -> float:
    return float(np.abs(motion.energy - motion.energy[0]).max() / motion.energy[0])


@pytest.mark.parametrize("loops", [1, 2, 4, 8])
@pytest.mark.parametrize("stages", [3, 4, 5])
@pytest.mark.parametrize("beyond", [0, 1e-12, -1e-8, 1e-6])
def test_a_node_on_a_fold_ends_the_run_with_the_nodes_before_it(loops, stages, beyond):
    motion, said = folded_at(loops, vi.lobatto(stages), 64 + beyond, backend="interpreted")
    assert "constraint rows [" in said or "no solution" in said or "not finite" in said
    assert 60 <= len(motion) <= 64
    assert energy_error(motion) < 1e-6


@pytest.mark.parametrize("loops", [1, 2])
@pytest.mark.parametrize("stages", [3, 4, 5])
def test_both_gears_end_at_the_same_node(loops, stages):
    ends = [
        folded_at(loops, vi.lobatto(stages), 64, backend=backend)
        for backend in ("interpreted", "compiled")
    ]
    assert all("(step 64) lies on a fold" in said for _, said in ends)
    assert [len(motion) for motion, _ in ends] == [64, 64]


@pytest.mark.parametrize("loops", [1, 2, 4, 8])
@pytest.mark.parametrize("stages", [3, 4, 5])
@pytest.mark.parametrize("where", ["between saved nodes", "within a step"])
@pytest.mark.parametrize("every", [1, 10])
def test_a_fold_that_no_saved_node_shows_does_no_harm_or_is_told_of(loops, stages, where, every):
    node = 64 + (WITHIN[stages] if where == "within a step" else 0)
    motion, said = folded_at(loops, vi.lobatto(stages), node, save_every=every)
    assert said or energy_error(motion) < 1e-7 * 10 ** (5 - stages)


@pytest.mark.parametrize("loops", [1, 2, 4, 8])
@pytest.mark.parametrize("stages", [2, 3, 4, 5])
@pytest.mark.parametrize("beyond", [1e-3, 0.3, 0.7])
def test_a_step_over_the_fold_stays_on_the_branch_without_a_word(loops, stages, beyond):
    motion, said = folded_at(loops, vi.lobatto(stages), 64 + beyond, backend="interpreted")
    assert not said
    assert energy_error(motion) < {2: 1e-2, 3: 1e-6, 4: 1e-9, 5: 1e-11}[stages]
    np.testing.assert_allclose(motion.q[:, 2] - motion.q[:, 0], 1, atol=1e-9)


DRAG, SHAKE = 0.3, 0.5


@cache
def driven(loops: int, shaken: bool) -> tuple[vi.System, np.ndarray, np.ndarray, float]:
    """The four-bar model with drag on every joint, or a force that shakes the first; its start and
    when it folds.
    """
    model, t = four_bar(loops), vi.time()
    q, v = model.system.q, model.system.v
    lagrangian = ca.substitute(model.system.lagrangian, model.system.c, GRAVITY)
    rows = model.system.constraint
    if shaken:
        lagrangian -= SHAKE * ca.sin(3 * t) * q[0]
        system = vi.System(q, v, lagrangian, constraint=rows, t=t)
    else:
        system = vi.System(q, v, lagrangian, constraint=rows, force=-DRAG * v)
    inertia, weight = (loops + 1) / 3 + loops, ((loops + 1) / 2 + loops) * GRAVITY

    def slope(time, y):
        push = -SHAKE * np.sin(3 * time) * np.cos(y[0]) if shaken else -DRAG * (loops + 1) * y[1]
        return [y[1], (weight * np.sin(y[0]) + push) / inertia]

    def level(_t, y):
        return y[0] - np.pi / 2

    level.terminal = True
    found = solve_ivp(slope, [0, 5], [0.0, 1.0], events=level, rtol=1e-13, atol=1e-14)
    return system, model.q0, model.v0, float(found.t_events[0][0])


@pytest.mark.parametrize("shaken", [False, True])
@pytest.mark.parametrize("stages", [3, 4, 5])
@pytest.mark.parametrize("where", ["between saved nodes", "within a step"])
@pytest.mark.parametrize(("loops", "backend"), [(2, "interpreted"), (1, "compiled")])
def test_a_hidden_node_on_a_fold_is_told_of_where_forces_act(loops, shaken, stages, where, backend):
    """Energy says nothing there. Half a step further on the same scene passes without a word."""
    system, q0, v0, fold = driven(loops, shaken)
    within, every = (WITHIN[stages], 1) if where == "within a step" else (0, 10)
    run = dict(q0=q0, v0=v0, save_every=every, backend=backend)
    h = fold / (64 + within)
    try:
        motion = vi.simulate(system, vi.lobatto(stages), **run, h=h, steps=100)
    except vi.ConvergenceError as error:
        told = (
            "other steps lead elsewhere",
            "lies on a fold",
            "no solution",
            "not finite",
            "folds",
        )
        assert any(words in str(error) for words in told)
        assert 60 // every <= len(error.trajectory) <= 67
    else:  # no harm was done
        half = vi.simulate(system, vi.lobatto(stages), **run, h=0.997 * h, steps=110)
        np.testing.assert_allclose(half.at(motion.t[-1]).q, motion.q[-1], atol=1e-5)
    beside = vi.simulate(system, vi.lobatto(stages), **run, h=fold / (64.4 + within), steps=100)
    assert beside.k[-1] == 100


FAR = 700  # steps to a fold that lies between saved nodes 1000 steps apart


@pytest.mark.parametrize("backend", ["interpreted", "native"])
@pytest.mark.parametrize(("loops", "stages", "shaken"), [(1, 2, True), (2, 3, False)])
def test_a_fold_far_from_all_saved_nodes_is_told_of_at_its_step(loops, stages, shaken, backend):
    system, q0, v0, fold = driven(loops, shaken)
    start = dict(q0=q0, v0=v0, steps=2000, save_every=1000, backend=backend)
    with pytest.raises(vi.ConvergenceError, match=rf"\(step {FAR}\) lies on a fold") as caught:
        vi.simulate(system, vi.lobatto(stages), **start, h=fold / FAR)
    assert caught.value.step == FAR - 1 and len(caught.value.trajectory) == 1
    beside = vi.simulate(system, vi.lobatto(stages), **start, h=fold / (FAR + 0.4))
    assert beside.k.tolist() == [0, 1000, 2000]


@pytest.mark.long
@pytest.mark.parametrize("backend", ["interpreted", "native"])
@pytest.mark.parametrize("loops", [1, 2, 3, 4])
@pytest.mark.parametrize("stages", [3, 4, 5])
def test_no_energy_is_lost_in_silence_over_folds_far_from_all_saved_nodes(loops, stages, backend):
    """Of 360 such runs 65 lost more than 1e-5 of it in silence when saved nodes alone were seen."""
    model = four_bar(loops)
    start = dict(q0=model.q0, v0=model.v0, backend=backend)
    said = 0
    for node in [*range(40, 90, 3), 200, 333, 700]:
        h = time_of_fold(loops) / (node + WITHIN[stages])
        run = dict(h=h, steps=node + 30, save_every=node + 30)
        try:
            motion = vi.simulate(model.system, vi.lobatto(stages), **start, **run)
        except vi.ConvergenceError:
            said += 1
        else:
            assert energy_error(motion) < 1e-5
    assert said or loops == 1


def test_what_is_told_of_a_fold_does_not_depend_on_the_pieces_of_a_run(monkeypatch):
    """Pieces of 7 steps in place of thousands: folds lie near their ends."""
    from varint.integration import compiled_loop

    said = []
    for most in (compiled_loop.STEPS_IN_BLOCK, 7):
        monkeypatch.setattr(compiled_loop, "STEPS_IN_BLOCK", most)
        for node in (43.5, 55.5, 61.5, 64):
            run = dict(save_every=50, backend="native")
            _, words = folded_at(2, vi.lobatto(3), node, **run)
            within = "other steps lead elsewhere", "left a residual"  # by its last digits
            told = ("lies on a fold",) if node == 64 else within
            assert any(x in words for x in told)
            said.append(words.partition("Error.trajectory")[0])
            assert f"(step {int(node)})" in words or node == 64
    assert said[:4] == said[4:] and len(set(said)) == 4


@pytest.mark.parametrize("node", [43.5, 50.5, 55.5, 60.5, 61.5, 64.5])
@pytest.mark.parametrize("backend", ["interpreted", "native"])
def test_a_fold_near_the_end_of_a_run_is_told_of_from_three_steps_on(node, backend):
    """Or no harm was done. Nearer to the end it depends on the last digits."""
    model, last = four_bar(2), int(node) + 3
    run = dict(q0=model.q0, v0=model.v0, steps=last, save_every=last, backend=backend)
    try:
        motion = vi.simulate(model.system, vi.lobatto(3), **run, h=time_of_fold(2) / node)
    except vi.ConvergenceError as error:
        assert f"step {int(node)}" in str(error) or f"steps {int(node)} to" in str(error)
    else:
        assert energy_error(motion) < 1e-5


def slider_crank(crank: float, rod: float) -> vi.System:
    """A massive crank pin and a slider; with rod = crank it may fold on to its bearing."""
    q, v = vi.coordinates("x", "y", "s")
    rows = ca.vertcat(ca.sumsqr(q[:2]) - crank**2, (q[2] - q[0]) ** 2 + q[1] ** 2 - rod**2)
    return vi.System(q, v, ca.sumsqr(v) / 2, constraint=rows)


def test_a_slider_crank_with_equal_arms_is_stopped_where_it_folds_and_others_pass_dead_points():
    long = vi.simulate(
        slider_crank(1.0, 2.0), vi.lobatto(4), q0=[0, 1, 3**0.5], v0=[-1, 0, -1], h=0.01, steps=2000
    )
    assert energy_error(long) < 1e-10 and long.q[:, 0].min() < -0.99 and long.q[:, 0].max() > 0.99
    # from 45°, s = 2 x, energy (1 + 4 sin²θ)/2 · θ̇²; folded at 90°
    root = np.sqrt(0.5)
    start = dict(q0=[root, root, 2 * root], v0=[-root, root, -2 * root])

    def level(_t, y):
        return y[0] - np.pi / 2

    level.terminal = True
    solution = solve_ivp(
        lambda _t, y: [np.sqrt(3 / (1 + 4 * np.sin(y[0]) ** 2))],
        [0, 9],
        [np.pi / 4],
        events=level,
        rtol=1e-13,
        atol=1e-14,
    )
    time = float(solution.t_events[0][0])
    with pytest.raises(vi.ConvergenceError, match=r"rows \[0, 1\]") as caught:
        vi.simulate(slider_crank(1.0, 1.0), vi.lobatto(4), **start, h=time / 40, steps=80)
    assert len(caught.value.trajectory) == 40
    assert energy_error(caught.value.trajectory) < 1e-8


def test_a_curve_that_crosses_itself_is_refused_at_the_crossing_and_passed_beside_it():
    """Gerono's lemniscate x⁴ = x² − y², run through by symmetry from its right end."""
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2, constraint=q[0] ** 4 - q[0] ** 2 + q[1] ** 2)

    def speed(s):
        return np.hypot(np.sin(s), np.cos(2 * s))  # of (cos s, sin 2s / 2)

    angles = np.linspace(0, np.pi / 2, 200_001)
    mid = (angles[1:] + angles[:-1]) / 2
    length = float(speed(mid).sum() * (angles[1] - angles[0]))
    start = dict(q0=[1, 0], v0=[0, 1])
    with pytest.raises(vi.ConvergenceError, match=r"rows \[0\]") as caught:
        vi.simulate(system, vi.lobatto(5), **start, h=length / 40, steps=80)
    assert len(caught.value.trajectory) == 40
    beside = vi.simulate(system, vi.lobatto(5), **start, h=length / 40.4, steps=80)
    assert energy_error(beside) < 1e-5


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("name", CONSTRAINED)
def test_models_with_constraints_raise_no_false_alarm(name, every):
    model = models.catalogue[name]()
    steps = min(round(2 * model.duration / model.h), 500)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for rule in (None, vi.lobatto(2), vi.lobatto(5)):
            motion = vi.simulate(
                model.system,
                rule,
                q0=model.q0,
                v0=model.v0,
                h=model.h,
                steps=steps,
                save_every=every,
                backend="interpreted",
            )
            assert motion.k[-1] == steps


def test_a_scene_without_constraints_is_not_watched(monkeypatch):
    from varint.integration import fold_watch

    def never(*_arguments):
        raise AssertionError("rows were looked at")

    monkeypatch.setattr(fold_watch, "_seen", never)
    q, v = vi.coordinates("x")
    vi.simulate(vi.System(q, v, v**2 / 2 - q**2 / 2), q0=1, v0=0, h=0.1, steps=10)
    x, w = vi.coordinates("a", "b")  # rows that are the same everywhere have the same rank
    flat = vi.System(x, w, ca.sumsqr(w) / 2, constraint=x[0] - x[1])
    vi.simulate(flat, q0=[1, 1], v0=[0, 0], h=0.1, steps=10)


def test_a_compiled_loop_looks_at_its_nodes_itself(monkeypatch):
    """So that saving every step costs no more than saving: nodes are handed over near a fold."""
    from varint.integration import fold_watch

    seen, look = [], fold_watch._seen

    def counted(scene, problem, passed):
        seen.append(len(passed.k))
        return look(scene, problem, passed)

    monkeypatch.setattr(fold_watch, "_seen", counted)
    x, w = vi.coordinates("a", "b", "c", "d")
    rods = ca.vertcat(ca.sumsqr(x[:2]) - 1, ca.sumsqr(x[2:] - x[:2]) - 1)
    chain = vi.System(x, w, ca.sumsqr(w) / 2 - 9.81 * (x[1] + x[3]), constraint=rods)
    run = dict(q0=[1, 0, 2, 0], v0=[0, 0, 0, 0], h=0.01, steps=2000)
    vi.simulate(chain, vi.lobatto(2), **run, backend="compiled")
    assert sum(seen) < 50
    seen.clear()
    vi.simulate(chain, vi.lobatto(2), **run, backend="interpreted")
    assert sum(seen) > 2000


@pytest.mark.parametrize(
    ("stages", "within"), [(2, ()), (3, (0.5,)), (4, (WITHIN[4],)), (5, (WITHIN[5], 0.5))]
)
def test_steps_are_taken_again_only_where_a_node_within_may_lie_on_the_fold(stages, within):
    """A passed fold costs nothing where it is plain from the distances that no node meets it: by a
    rule without nodes within in every step, by the others in all but those nearby.
    """
    from varint.integration.fold_crossing import NEAR, _may_meet

    at = np.linspace(0.01, 0.99, 99)  # of the step, distances falling and bent
    nodes = np.arange(-2, 4)
    for bend in (-0.3, 0.0, 0.3):
        to = nodes - at[:, None]
        looked = _may_meet(vi.lobatto(stages), 0.01 * np.abs(to * (1 + bend * to / 3)))
        nearest = np.abs(at[:, None] - [*within, *(1 - np.array(within))]).min(1, initial=np.inf)
        assert looked[nearest <= 0.9 * NEAR].all()
        assert not looked[nearest > 3 * NEAR].any()
    unknown = np.full((1, 6), -1.0)
    assert _may_meet(vi.lobatto(stages), unknown).all()
