"""How many iterations a run took: counted truly, inside CasADi's own loops."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, pendulum

import varint as vi
from varint.discrete.equations import implicit_equations
from varint.discrete.tolerances import LAST_CORRECTION
from varint.integration.steppers.implicit import implicit_stepper
from varint.numerics.limits import STEP_ITERATIONS

LONG = dict(backend="interpreted", progress=False)


def plain_counts(system, rule, q, p, h, steps):
    """Iterations of every step as CasADi's root finder tells them, one call a step, without a
    counter.
    """
    n, e, stepper = (
        system.structure.n,
        implicit_equations(system, rule),
        implicit_stepper(system, rule),
    )
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c, e.scale]
    options = {"abstol": 0.0, "abstolStep": LAST_CORRECTION, "max_iter": STEP_ITERATIONS}
    solve = ca.rootfinder(
        "plain", "fast_newton", ca.Function("left", [e.y, *arguments], [e.scaled]), options
    )
    scale = np.ones(2 * n)
    x = np.array(stepper.start(q, p, [], 0, h, [])).ravel()
    counts = []
    for k in range(steps):
        solve(x[4 * n : -2], x[:n], x[2 * n : 3 * n], [], k * h, h, [], scale)
        counts.append(solve.stats()["iter_count"] + 1)  # CasADi numbers the last one, from zero
        x = np.array(stepper.step(x, [], k * h, h, [], scale)).ravel()
    return counts, x


@pytest.mark.parametrize("h", [0.05, 0.4])
@pytest.mark.parametrize("rule", [vi.midpoint(), vi.gauss(3)], ids=str)
@pytest.mark.parametrize(
    "system", [pendulum(), double_pendulum()], ids=["pendulum", "double pendulum"]
)
def test_the_counter_agrees_with_the_root_finders_own_count(system, rule, h):
    n = system.structure.n
    counts, end = plain_counts(
        system, rule, 0.5 * np.ones(n), np.zeros(n), h / (1 if n == 1 else 5), 60
    )
    assert end[-2] == sum(counts) > 0


@pytest.mark.parametrize("every", [1, 7, 1000])
def test_a_linear_scene_takes_two_iterations_a_step(every):
    """One that solves it and one that finds nothing left; with many coordinates no constant
    inverse is kept.
    """
    n = 20
    q, v = vi.coordinates(*(f"x{i}" for i in range(n)))
    chain = vi.System(q, v, (ca.sumsqr(v) - ca.sumsqr(ca.diff(q)) - q[0] ** 2) / 2)
    q0 = np.random.default_rng(0).normal(size=n)
    motion = vi.simulate(
        chain, vi.gauss(2), q0=q0, v0=0 * q0, h=0.5, steps=333, save_every=every, **LONG
    )
    assert motion.stats["iterations"] == 2 * 333


def test_explicit_and_linear_runs_have_none():
    for rule in (vi.trapezoidal(), vi.composition("yoshida4")):
        assert (
            vi.simulate(pendulum(), rule, q0=1, v0=0, h=0.1, steps=50, **LONG).stats["iterations"]
            == 0
        )
    q, v = vi.coordinates("x")
    spring = vi.System(q, v, (v**2 - q**2) / 2)
    assert (
        vi.simulate(spring, vi.gauss(2), q0=1, v0=0, h=0.1, steps=50, **LONG).stats["iterations"]
        == 0
    )


@pytest.mark.parametrize("rule", [vi.lobatto(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize("count", [3, 70], ids=["few links", "many links"])
def test_constrained_runs_count_too_and_larger_steps_need_more(rule, count):
    chain = vi.models.chain_rods(count)
    found = [
        vi.simulate(chain.system, rule, q0=chain.q0, v0=chain.v0, h=h, steps=30, **LONG).stats[
            "iterations"
        ]
        for h in (1e-4, 2e-2)
    ]
    assert 30 <= found[0] < found[1] <= 12 * 30


def test_a_run_taken_up_again_has_counted_what_the_whole_one_does(tmp_path):
    start = dict(q0=[0.4, 0.2], v0=[0, 0], h=0.05, **LONG)
    whole = vi.simulate(double_pendulum(), vi.gauss(2), steps=500, **start)
    again = vi.simulate(
        double_pendulum(), vi.gauss(2), steps=500, checkpoint=tmp_path / "run.npz", **start
    )
    assert again.stats["iterations"] == whole.stats["iterations"] > 500
    halves = vi.simulate(double_pendulum(), vi.gauss(2), steps=250, **start)
    rest = vi.simulate(
        double_pendulum(), vi.gauss(2), q0=halves.q[-1], p0=halves.p[-1], h=0.05, steps=250, **LONG
    )
    assert (
        abs(halves.stats["iterations"] + rest.stats["iterations"] - whole.stats["iterations"]) <= 5
    )


def test_runs_with_contacts_and_with_a_time_scale_count():
    q, v = vi.coordinates("x", "z")
    ball = vi.System(
        q, v, ca.sumsqr(v) * (1 + q[0] ** 2) / 2 - 9.81 * q[1], contact=q[1], restitution=0.8
    )
    runs = [
        vi.simulate(
            ball, vi.lobatto(3), q0=[0, 1], v0=[0.3, 0], h=0.01, steps=150, save_every=every, **LONG
        )
        for every in (1, 10)
    ]
    assert runs[0].events and runs[0].stats["iterations"] == runs[1].stats["iterations"] >= 150
    kepler = vi.models.kepler(0.6)
    r = ca.norm_2(kepler.system.q)
    motion = vi.simulate(
        kepler.system,
        vi.gauss(4),
        q0=kepler.q0,
        v0=kepler.v0,
        h=0.1,
        steps=40,
        time_scale=r**1.5,
        **LONG,
    )
    assert motion.stats["iterations"] >= 40


def test_a_divided_step_counts_its_parts():
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    motion = vi.simulate(
        kepler,
        vi.gauss(4),
        q0=[1, 0],
        v0=[0, 0.1],
        h=0.02,
        steps=200,
        on_failure="subdivide",
        **LONG,
    )
    parts = [int(event.kind.removeprefix("divided in ")) for event in motion.events]
    assert parts and motion.stats["iterations"] >= 200 - len(parts) + sum(parts)


def test_a_loose_step_whose_start_is_far_off_gives_it_up_early():
    """Until the last step's number of iterations it exploded: 21 of them a step, not 15."""
    steps, start = 8, {"q0": [2.0, 1.5], "v0": [0.0, 0.0], "duration": 5.0}
    asked = start | {"steps": steps, "iteration_tol": 1e-3}
    loose = vi.simulate(double_pendulum(), vi.gauss(8), **asked)
    tight = vi.simulate(double_pendulum(), vi.gauss(8), **asked | {"iteration_tol": 1e-12})
    assert loose.stats["iterations"] < 18 * steps
    assert np.abs(loose.q - tight.q).max() < 1e-3


# scene, stages, step: the iteration of the stages seems to be over long before it is
EARLY = [
    # changes are constant: round-off alone, of a momentum that is zero, had told the slopes
    (vi.models.free_rigid_body, 8, 17.893949715776007 / 56),
    # they shrink slowly, and now and then not at all
    (vi.models.spring_pendulum, 7, 1.3939783050212828),
    # they shrink by sixteen digits at once: infinite forces have thrown all bodies far apart
    (vi.models.lennard_jones, 8, 0.319),
    (vi.models.lennard_jones, 4, 0.432),
    (vi.models.lennard_jones, 8, 0.509),
    (vi.models.fpu_chain, 5, 2.646),
]


def ends_of_steps(system, rule, states, h, backend):
    """Where a step ends from each of the states (q, p): (q, p), or None where it is not solved."""
    ends = []
    for q, p in states:
        how = dict(q0=q, p0=p, h=h, steps=1, backend=backend, progress=False)
        try:
            motion = vi.simulate(system, rule, **how)
        except vi.ConvergenceError:
            ends.append(None)
            continue
        assert motion.stats["residual"] <= 1e-10
        ends.append(np.concatenate([motion.q[-1], motion.p[-1]]))
    return ends


@pytest.mark.parametrize(
    "model, stages, h", EARLY, ids=[f"{m.__name__}-{s}-{h:.3g}" for m, s, h in EARLY]
)
def test_every_step_of_a_run_is_solved_to_round_off_or_said_to_fail(model, stages, h):
    """Each step of a run, and the same begun without it, by iterations of the stages satisfies the
    equations that Newton's method solves.
    """
    scene, rule = model(), vi.gauss(stages)
    how = dict(q0=scene.q0, v0=scene.v0, h=h, steps=56, backend="native", progress=False)
    try:
        motion = vi.simulate(scene.system, rule, **how)
    except vi.ConvergenceError as error:
        motion = error.trajectory
    assert motion.stats["residual"] <= 1e-10
    states = list(zip(motion.q, motion.p, strict=True))
    fresh = ends_of_steps(scene.system, rule, states[:-1], h, "native")
    wanted = ends_of_steps(scene.system, rule, states[:-1], h, "interpreted")
    after = [np.concatenate(state) for state in states[1:]]
    size = np.max(np.abs(np.array([np.concatenate(state) for state in states])), axis=0)
    for step, alone, other in zip(after, fresh, wanted, strict=True):
        if other is None:  # Newton's method began too far off
            continue
        for found in (step, alone):
            if found is None or np.any(np.abs(found - other) > 1e-2 * size):
                continue  # another solution: so long steps have several
            np.testing.assert_allclose(found, other, rtol=0, atol=1e-11 * size.max())
