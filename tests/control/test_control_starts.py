"""Where the solver starts when nobody says where: problems that a straight line does not solve."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, move, pendulum, swing

import varint as vi
from varint.control.build import build_control_solver
from varint.control.coarse import coarse_start
from varint.control.guess import build_start, read_guess
from varint.control.lifted import can_be_lifted, lifted_start, prices_of
from varint.control.lifted_program import (
    build_places,
    build_program,
    give_aid,
    rows_of_motion,
    without_curvature,
)
from varint.control.neighbours import wave
from varint.control.problem import transcribe
from varint.control.scaling import choose_scales
from varint.control.starts import default_starts
from varint.control.trial import can_be_tried, tried
from varint.errors import SolverError

THRUST, BURN, DURATION = 0.1405, 0.0749, 3.3207  # Bryson & Ho, Applied Optimal Control, §2.5
HIGHEST = 1.525527  # radius reached; gauss(3) × 40 and gauss(4) × 80 agree to these digits


def orbit_raising(coordinates: str, mu: float = 1.0, r0: float = 1.0, steps: int = 40) -> vi.Phase:
    """The highest circular orbit within a given time, from the circular orbit of radius r0; no
    guess.
    """
    t, unit = vi.time(), np.sqrt(r0**3 / mu)
    push = THRUST * mu / r0**2 / (1 - BURN * t / unit)
    if coordinates == "polar":
        q, v = vi.coordinates("r", "phi")
        u = ca.SX.sym("u", 2)
        lagrangian = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + mu / q[0]
        force, radius = push * ca.vertcat(u[0], q[0] * u[1]), q[0]
        start = dict(q=[r0, 0], v=[0, 1 / unit])
        circular = [(0, v[0] * unit / r0, 0), (1, v[1] ** 2 * q[0] ** 3 / mu, 1)]
        bounds = [(None, ca.sumsqr(u), 1)]
    elif coordinates == "angle":
        q, v = vi.coordinates("r", "phi")
        u = ca.SX.sym("beta")
        lagrangian = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + mu / q[0]
        force, radius = push * ca.vertcat(ca.sin(u), q[0] * ca.cos(u)), q[0]
        start = dict(q=[r0, 0], v=[0, 1 / unit])
        circular, bounds = [(0, v[0], 0), (1, v[1] ** 2 * q[0] ** 3 / mu, 1)], []
    else:
        q, v = vi.coordinates("x", "y")
        u, radius = ca.SX.sym("u", 2), ca.norm_2(q)
        lagrangian, force = ca.sumsqr(v) / 2 + mu / radius, push * u
        start = dict(q=[r0, 0], v=[0, r0 / unit])
        circular = [(0, ca.dot(q, v) * unit / r0**2, 0), (1, ca.sumsqr(v) * radius / mu, 1)]
        bounds = [(None, ca.sumsqr(u), 1)]
    system = vi.System(q, v, lagrangian, force=force, control=u, t=t)
    return vi.Phase(
        system,
        vi.gauss(3),
        DURATION * unit,
        steps,
        terminal_cost=-radius,
        start=start,
        end=dict(bounds=circular),
        bounds=bounds,
    )


@pytest.mark.parametrize(
    "given",
    [
        ("polar",),
        pytest.param(("angle",), marks=coarse),  # the angle jumps by full turns
        ("cartesian",),
        ("polar", 3.986e14, 7e6),
        ("cartesian", 3.986e5, 7000.0),
    ],
    ids=str,
)
def test_orbit_is_raised_from_the_default_guess(given):
    [motion] = vi.optimal_phases([orbit_raising(*given)])
    r0 = given[2] if len(given) > 2 else 1.0
    assert -motion.cost / r0 == pytest.approx(HIGHEST, abs=2e-6)
    assert motion.solution.iterations <= 100


def test_highest_orbit_is_that_of_a_finer_mesh():
    phase = orbit_raising("polar", steps=80)
    [motion] = vi.optimal_phases([phase])
    assert -motion.cost == pytest.approx(HIGHEST, abs=1e-6)


def test_a_scene_in_motion_starts_from_its_own_motion():
    """The first start obeys the equations of motion; only conditions at the end are left."""
    problem = transcribe([orbit_raising("polar")], [], 0.0)
    part, x = problem.phases[0], next(default_starts(problem))
    g = np.array(problem.nlp.program.value(x, problem.nlp.p)[1]).ravel()
    assert np.abs(g[part.rows.momentum]).max() < 1e-6
    assert x[part.slots.v[0]] == pytest.approx([0, 1], abs=1e-6)
    coasting = vi.simulate(
        part.phase.system, q0=[1, 0], v0=[0, 1], duration=DURATION, steps=40, u=np.zeros((40, 2))
    )
    assert x[part.slots.q[-1]] == pytest.approx(coasting.q[-1], abs=1e-4)


def test_start_in_motion_is_bent_to_the_end_that_is_wanted():
    phase = vi.Phase(
        pendulum(), vi.gauss(3), 2.0, 20, U**2, start=dict(q=[0], v=[2]), end=dict(q=[3], v=[None])
    )
    problem = transcribe([phase], [], 0.0)
    part, x = problem.phases[0], next(default_starts(problem))
    assert x[part.slots.q[[0, -1], 0]] == pytest.approx([0, 3], abs=1e-9)
    assert x[part.slots.q[1, 0]] == pytest.approx(2 * 0.1, rel=0.1)


def test_guessed_controls_keep_to_all_bounds_along_the_path():
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u", 2)
    heavy = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=u, control=u)
    bounds = [(None, ca.sumsqr(u), 4), (None, u[0] + u[1] * (1 + q[0] ** 2), 1), (-1, u[1], 50)]
    ends = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, 2], v=[0, 0]))
    phase = vi.Phase(heavy, vi.gauss(3), 2.0, 10, ca.sumsqr(u), bounds=bounds, **ends)
    problem = transcribe([phase], [], 0.0)
    part, x = problem.phases[0], build_start(problem)
    found = x[part.slots.u]
    at = np.array(problem.nlp.program.value(x, problem.nlp.p)[1]).ravel()[part.rows.nodes]
    assert (at.reshape(10, 3, 2) <= np.array([4, 1]) + 1e-6).all()
    assert (found[..., 1] >= -1).all()
    # as much lift as the bounds allow, not none
    closest = np.minimum(4 - (found**2).sum(axis=2), 1 - at.reshape(10, 3, 2)[..., 1])
    assert np.abs(closest).max() < 1e-6


@pytest.mark.parametrize("kind", ["ring", "cone", "moving cone"])
def test_controls_of_a_guess_are_the_nearest_within_bounds_that_leave_out_no_force(kind):
    """u = 0 is outside, or on the edge: there is nothing to draw them back to."""
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u", 2)
    heavy = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], force=u, control=u)
    wide = 0.5 if kind == "cone" else 0.3 + q[0] ** 2 / 10
    bounds = {"ring": [(4, ca.sumsqr(u), 25)]}.get(
        kind, [(None, u[0] - wide * (u[1] - 2), 0), (None, -u[0] - wide * (u[1] - 2), 0)]
    )
    ends = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[2, 0], v=[0, 0]))
    phase = vi.Phase(
        heavy,
        vi.gauss(3),
        1.0,
        10,
        ca.sumsqr(u),
        bounds=bounds,
        **ends,
        guess=dict(q=lambda t: [2 * t**2 * (3 - 2 * t), np.sin(6 * t)]),
    )
    problem = transcribe([phase], [], 0.0)
    part, x = problem.phases[0], build_start(problem)
    g, rows = np.array(problem.nlp.program.value(x, problem.nlp.p)[1]).ravel(), part.rows.nodes
    assert (g[rows] <= problem.nlp.g_high[rows] + 1e-7).all()
    assert (g[rows] >= problem.nlp.g_low[rows] - 1e-7).all()
    wanted = build_start(transcribe([replace(phase, bounds=())], [], 0.0))
    moved = np.abs(x - wanted)[part.slots.u].max(axis=2)
    assert (moved > 1).any()
    if kind == "ring":  # the nearest point of a disc is on the ray
        best = wanted[part.slots.u]
        size = np.linalg.norm(best, axis=2)
        away = np.maximum(np.maximum(size - 5, 2 - size), 0)
        assert np.linalg.norm((x - wanted)[part.slots.u], axis=2) == pytest.approx(away, abs=1e-7)


@pytest.mark.parametrize(("limit", "cost"), [(2.5, 18.695873), (3.5, None)])
def test_a_weak_motor_swings_the_pendulum_up_without_a_guess(limit, cost):
    motion = swing(pendulum(9.81), 6.0, 60, rule=vi.gauss(3), bounds=[(-limit, U, limit)])
    assert motion.solution.violation < 1e-9
    assert np.abs(motion.u).max() <= limit + 1e-9
    assert np.abs(motion.replay().q - motion.q).max() < 1e-8
    if cost is not None:
        assert motion.cost <= cost * (1 + 1e-6)


def test_a_guess_of_the_user_is_the_only_start():
    phase = orbit_raising("polar")
    own = dict(q=lambda t: [1.0, t], u=np.zeros((1, 2)))
    problem = transcribe([vi.Phase(**{**vars(phase), "guess": own})], [], 0.0)
    [x] = default_starts(problem)
    part = problem.phases[0]
    assert x[part.slots.q[:, 1]] == pytest.approx(DURATION * part.phase.mesh)


def test_what_cannot_be_done_is_refused_after_all_starts():
    with pytest.raises(SolverError, match="violation"):
        move(vi.gauss(2), 10, 1.0, start=dict(q=[0], v=[1]), bounds=[(-1, U, 1)])


def cart_with_pole(mass: float) -> vi.System:
    """A cart of mass 1 with a pole of length 0.5; theta = 0 hangs."""
    q, v = vi.coordinates("x", "theta")
    lagrangian = (
        (1 + mass) * v[0] ** 2 / 2
        + mass * (0.5 * ca.cos(q[1]) * v[0] * v[1] + v[1] ** 2 / 8)
        + mass * 9.81 * 0.5 * ca.cos(q[1])
    )
    return vi.System(q, v, lagrangian, force=ca.vertcat(U, 0), control=U)


@coarse
@pytest.mark.long
def test_a_motor_too_weak_for_one_swing_finds_several_by_itself():
    system, rest = cart_with_pole(0.1), [0, 0]
    motion = vi.optimal_control(
        system,
        vi.gauss(2),
        duration=6,
        steps=50,
        cost=U**2,
        start=dict(q=rest, v=rest),
        end=dict(q=[0, np.pi], v=rest),
        bounds=[(-2, U, 2), (-2, system.q[0], 2)],
    )
    swings = np.count_nonzero(np.diff(np.sign(motion.v[:, 1])))
    assert swings >= 5 and np.abs(motion.u).max() <= 2 + 1e-9
    assert motion.q[-1] == pytest.approx([0, np.pi], abs=1e-9)


def test_a_motion_found_by_trial_keeps_the_equations_and_the_limits():
    system, rest = cart_with_pole(0.1), [0, 0]
    phase = vi.Phase(
        system,
        vi.gauss(1),
        3.0,
        20,
        U**2,
        start=dict(q=rest, v=rest),
        end=dict(q=[0, np.pi], v=rest),
        bounds=[(-4, U, 4)],
    )
    part = transcribe([phase], [], 0.0).phases[0]
    assert can_be_tried(part)
    found = tried(part)
    at = np.linspace(0, 1, 21)
    u = found.u((at[1:] + at[:-1]) / 2)
    motion = vi.simulate(system, vi.gauss(1), q0=rest, v0=rest, h=0.15, steps=20, u=u)
    assert np.abs(u).max() <= 4
    assert motion.q == pytest.approx(found.q(at), abs=1e-9)
    # nearer to its goal than rest
    assert np.abs(motion.q[-1] - [0, np.pi]).max() < np.pi / 2


@coarse
@pytest.mark.long
def test_a_wavy_guess_is_first_solved_by_the_trapezoidal_rule():
    """From waves that a rule of order six does not follow."""
    phase = vi.models.swing_up_acrobot().phases[0]
    waves = np.random.default_rng(0).normal(size=(4, 2)) / np.arange(1, 5)[:, None]
    first, last = np.zeros(2), np.array([np.pi, 0.0])

    def path(t: float) -> np.ndarray:
        s = t / 3.0
        return (
            first + s * (last - first) + np.sin(np.pi * s * np.arange(1, 5)) @ (waves * [np.pi, 1])
        )

    guessed = replace(phase, rule=vi.gauss(3), steps=60, guess=dict(q=path))
    problem = transcribe([guessed], [], 0.0)
    rough, iterations, _ = coarse_start(problem)
    assert iterations <= 300
    run = build_control_solver(problem, rough)
    found = run(rough, progress=False)
    assert found.success and found.iterations < 60


def random_path(phase: vi.Phase, duration: float, seed: int):
    """The straight line between the ends with four sine waves of random heights."""
    first, last = np.array(phase.start["q"], float), np.array(phase.end["q"], float)
    waves = np.arange(1, 5)
    heights = (last - first) * np.random.default_rng(seed).normal(size=(4, len(first)))

    def path(t: float) -> np.ndarray:
        s = t / duration
        return first + s * (last - first) + np.sin(np.pi * s * waves) @ (heights / waves[:, None])

    return path


def fastest_wire(seed: int) -> vi.Phase:
    """The brachistochrone from a random path, its duration unknown; the wire pushes across."""
    q, v = vi.coordinates("x", "y")
    push = U * ca.vertcat(v[1], -v[0])
    c = vi.Parameters(g=9.80665)
    bead = vi.System(q, v, ca.sumsqr(v) / 2 - c.g * q[1], force=push, control=U, params=c)
    ends = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[10, -5]), bounds=[(-50, U, 50)])
    phase = vi.Phase(bead, vi.gauss(3), vi.free(1, 0.1, 20), 30, 1, **ends)
    return replace(phase, guess=dict(q=random_path(phase, 1.0, seed)))


@pytest.mark.parametrize("seed", range(4))
def test_a_path_that_breaks_the_motion_grossly_leads_to_the_fastest_wire(seed):
    """From the path itself some end on meshes too coarse for where they ended; 1.8016 s by the
    cycloid.
    """
    [motion] = vi.optimal_phases([fastest_wire(seed)])
    assert motion.cost == pytest.approx(1.80160312, abs=1e-7)
    assert len(motion.stats["attempts"]) == 1
    problem = transcribe([fastest_wire(seed)], [], 0.0)
    start, rough, _ = lifted_start(problem)
    assert rough < 60
    found = build_control_solver(problem, start)(start, progress=False)
    assert found.success and found.iterations < 40


UNITS = pytest.mark.parametrize(
    "duration, reach", [(1.0, 1.0), (3.0, 1.0), (vi.free(3.0, 1, 9), 7.0)]
)


def bend(duration, reach):
    """A problem whose straight line bends as q = L s² (3 − 2 s) does, its start values on the mesh
    without aid, and those with it.
    """
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2, force=U, control=U)
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[reach], v=[0]))
    problem = transcribe([vi.Phase(system, vi.gauss(2), duration, 8, U**2, **ends)], [], 0.0)
    part = problem.phases[0].phase
    s = part.mesh
    shape = reach * np.array([s**2 * (3 - 2 * s), 6 * s * (1 - s) / part.duration[0]]).T

    def program(prices):
        places = build_places(part, 8, prices)
        x = np.zeros(places.end)
        x[places.x] = shape
        x[places.shared[places.shared >= 0]] = part.duration[0]
        return build_program(part, 0.0, s, places, prices), places, x

    return problem, part, program


@UNITS
def test_bends_cost_the_same_in_any_units(duration, reach):
    """q = L s² (3 − 2 s): ∫ (d²q/ds² / L)² ds = 12, by N differences of its slopes 12 (1 − 1/N²),
    whatever the duration and the extent; in units of the cost.
    """
    problem, part, program = bend(duration, reach)
    factor = choose_scales(problem, build_start(problem)).f
    prices = prices_of(problem, read_guess(part, 0.0), 0.1)
    with_price, without = (
        float(nlp.program.value(x, nlp.p)[0]) for nlp, _, x in (program(prices), program(None))
    )
    assert factor * (with_price - without) == pytest.approx(1.2 * (1 - 1 / 64), rel=1e-12)


@UNITS
def test_aid_makes_any_path_a_motion_at_the_same_price_in_any_units(duration, reach):
    """q = L s² (3 − 2 s) without controls: the aid is d²q/ds² / L, and costs 12 (1 − 1/N²) as its
    bends do.
    """
    problem, part, program = bend(duration, reach)
    factor = choose_scales(problem, build_start(problem)).f
    prices = prices_of(problem, read_guess(part, 0.0), 0.0, 3.0)
    nlp, places, x = program(prices)
    rows = rows_of_motion(part, 8)[:, 1]
    aided = give_aid(part, part.mesh, places, prices, nlp, x)
    (_, alone), (cost, helped) = (nlp.program.value(y, nlp.p) for y in (x, aided))
    assert np.abs(np.array(alone).ravel()[rows]).max() > 0.1 * reach / part.duration[2]
    assert np.abs(np.array(helped).ravel()[rows]).max() < 1e-14 * reach
    assert factor * float(cost) == pytest.approx(36 * (1 - 1 / 64), rel=1e-12)


def test_without_curvature_some_rows_are_straight_to_the_solver_and_nothing_else_is():
    """A pendulum's rows of motion bend; what is left of the Hessian is that of cost and aid."""
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0]))
    phase = vi.Phase(pendulum(), vi.gauss(2), 2.0, 6, U**2, **ends)
    problem = transcribe([phase], [], 0.0)
    part = problem.phases[0].phase
    prices = prices_of(problem, read_guess(part, 0.0), 0.1, 3.0)
    places = build_places(part, part.steps, prices)
    nlp = build_program(part, 0.0, part.mesh, places, prices)
    straight = without_curvature(nlp, rows_of_motion(part, part.steps))
    rng = np.random.default_rng(0)
    x, weights = rng.normal(size=nlp.unknowns), rng.normal(size=nlp.rows)
    of_motion = np.zeros(nlp.rows)
    of_motion[rows_of_motion(part, part.steps)] = weights[rows_of_motion(part, part.steps)]
    exact, ours, motion = (
        np.array(ca.DM(program.hessian(x, nlp.p, factor, y)).full())
        for program, factor, y in (
            (nlp.program, 2.0, weights),
            (straight.program, 2.0, weights),
            (nlp.program, 0.0, of_motion),
        )
    )
    assert np.abs(motion).max() > 1e-3
    np.testing.assert_allclose(ours, exact - motion, rtol=0, atol=1e-12 * np.abs(exact).max())
    for same in ("value", "gradient", "jacobian"):
        assert getattr(straight.program, same) is getattr(nlp.program, same)


@pytest.mark.parametrize("rule, steps", [(vi.gauss(2), 40), (vi.midpoint(), 20)])
def test_the_rough_solution_is_the_optimum_of_the_midpoint_rule(rule, steps):
    """Double integrator: 12 N²/(N² − 1), on the finest mesh, twice the steps of rules of higher
    order.
    """
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2, force=U, control=U)
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    path = dict(q=lambda t: [3 * np.sin(20 * t)])
    problem = transcribe([vi.Phase(system, rule, 1.0, 20, U**2, guess=path, **ends)], [], 0.0)
    assert can_be_lifted(problem)
    start = lifted_start(problem).x
    part = problem.phases[0]
    u = part.phase.rule.weights @ start[part.slots.u][:, :, 0].T ** 2
    assert u.mean() == pytest.approx(12 * steps**2 / (steps**2 - 1), rel=1e-5)


@pytest.mark.long
def test_finer_and_finer_rough_solutions_end_nearer_to_an_optimum_than_the_path():
    """A quadrotor turns over from six random paths: from the path itself the rule asked for takes
    135 to 380 iterations.
    """
    q, v = vi.coordinates("x", "z", "theta")
    u = ca.SX.sym("u", 2)
    lift, turn = ca.sum1(u), 0.2 * (u[1] - u[0])
    force = ca.vertcat(-lift * ca.sin(q[2]), lift * ca.cos(q[2]), turn)
    lagrangian = ca.sumsqr(v[:2]) / 4 + 0.0025 * v[2] ** 2 - 0.5 * 9.81 * q[1]
    system = vi.System(q, v, lagrangian, force=force, control=u)
    ends = dict(start=dict(q=[0] * 3, v=[0] * 3), end=dict(q=[0, 0, 2 * np.pi], v=[0] * 3))
    bounds = [(0, u[0], 6), (0, u[1], 6)]
    phase = vi.Phase(system, vi.gauss(3), 1.5, 50, ca.sumsqr(u), bounds=bounds, **ends)
    parts = []
    for seed in range(6):
        path = random_path(phase, 1.5, seed)
        problem = transcribe([replace(phase, guess=dict(q=path))], [], 0.0)
        starts = build_start(problem), lifted_start(problem).x
        drawn, found = (build_control_solver(problem, x)(x, progress=False) for x in starts)
        assert drawn.success and found.success
        parts.append(found.iterations / drawn.iterations)
    assert max(parts) < 1 and np.median(parts) < 0.5


@pytest.mark.parametrize("seed", [0, 1])
def test_three_links_are_swung_up_near_a_wild_path(seed):
    """A triple pendulum on a cart from a random path: without aid no rough solution comes near a
    motion in hundreds of iterations.
    """
    q, v = vi.coordinates("x", "a", "b", "c")
    place, lagrangian = ca.vertcat(q[0], 0), v[0] ** 2 / 2
    for i in range(3):
        place = place + 0.4 * ca.vertcat(ca.sin(q[1 + i]), -ca.cos(q[1 + i]))
        lagrangian += 0.2 * (ca.sumsqr(ca.jtimes(place, q, v)) / 2 - 9.81 * place[1])
    system = vi.System(q, v, lagrangian, force=ca.vertcat(U, 0, 0, 0), control=U)
    ends = dict(start=dict(q=[0] * 4, v=[0] * 4), end=dict(q=[0] + [np.pi] * 3, v=[0] * 4))
    bounds = [(-60, U, 60), (-2, q[0], 2)]
    phase = vi.Phase(system, vi.gauss(3), 3.0, 60, U**2, bounds=bounds, **ends)
    problem = transcribe([replace(phase, guess=dict(q=random_path(phase, 3.0, seed)))], [], 0.0)
    start, rough, _ = lifted_start(problem)
    assert rough < 150
    found = build_control_solver(problem, start)(start, progress=False)
    assert found.success and found.iterations < 40


def test_constrained_and_linked_problems_are_not_lifted():
    phase = vi.Phase(
        pendulum(), vi.gauss(2), 1.0, 10, U**2, start=dict(q=[0]), end=dict(periodic=True)
    )
    assert not can_be_lifted(transcribe([phase], [], 0.0))


@pytest.mark.parametrize("size, still", [(2.0, 1.0), (1e-3, 1e-3), (1e3, 1.0)])
def test_waves_move_what_stays_where_it_is_in_the_straight_line(size, still):
    """By at most 1, which may be an angle beside lengths of any size, and within its bounds."""
    q, v = vi.coordinates("x", "y", "angle")
    u = ca.SX.sym("u", 3)
    system = vi.System(q, v, ca.sumsqr(v) / 2, force=u, control=u)
    ends = dict(start=dict(q=[0, 0, 0]), end=dict(q=[0, size, 0]), bounds=[(-1e-6, q[2], 1e-6)])
    part = transcribe([vi.Phase(system, vi.gauss(2), 1.0, 20, 1, **ends)], [], 0.0).phases[0]
    own, at = read_guess(part.phase, 0.0), np.linspace(0, 1, 101)
    waves = [wave(own, part, 1.0, np.random.default_rng(i)).q(at) - own.q(at) for i in range(50)]
    heights = np.sqrt(np.mean(np.square(waves), axis=(0, 1)))
    assert heights == pytest.approx(0.84 * np.array([still, size, 2e-6]), rel=0.3)


@coarse
def test_several_passive_joints_have_their_neighbours_tried(capsys):
    q, v = vi.coordinates("x", "a", "b")
    place, lagrangian = ca.vertcat(q[0], 0), v[0] ** 2 / 2
    for i in (1, 2):
        place = place + 0.5 * ca.vertcat(ca.sin(q[i]), -ca.cos(q[i]))
        lagrangian += 0.2 * (ca.sumsqr(ca.jtimes(place, q, v)) / 2 - 9.81 * place[1])
    system = vi.System(q, v, lagrangian, force=ca.vertcat(U, 0, 0), control=U)
    still = [0, 0, 0]
    motion = vi.optimal_control(
        system,
        vi.gauss(1),
        duration=2,
        steps=20,
        cost=U**2,
        start=dict(q=still, v=still),
        end=dict(q=[0.5, 0, 0], v=still),
    )
    costs = motion.stats["starts"]
    assert costs[0] == min(costs) == pytest.approx(motion.cost, rel=1e-12) and len(costs) > 1
    motion.report()
    assert "costs of the minima found near the first start" in capsys.readouterr().out


def test_a_guess_that_leads_nowhere_is_left_and_the_report_says_so(capsys):
    """A guess with a path that no control follows; the default start has no trouble."""
    phase = orbit_raising("polar", steps=15)
    waves = np.random.default_rng(0).normal(size=(4, 2))

    def path(t: float) -> np.ndarray:
        return np.array([1, 0]) + 20 * np.sin(t / DURATION * np.pi * np.arange(1, 5)) @ waves

    given = {k: getattr(phase, k) for k in ("terminal_cost", "start", "end", "bounds", "steps")}
    motion = vi.optimal_control(
        phase.system, vi.gauss(2), duration=phase.duration, guess=dict(q=path), **given
    )
    assert -motion.cost == pytest.approx(HIGHEST, abs=1e-3)
    motion.report()
    assert "from a default start, for the guess led nowhere" in capsys.readouterr().out
    attempts = motion.stats["attempts"]
    ways = [what for what, _ in attempts]
    assert ways[:2] == ["by rough solutions, of which there is none", "from the guess"]
    assert "by a rough solution near the guess" not in ways  # nor is another rule tried for one
    assert attempts[-1] == (motion.stats["start"], motion.solution.iterations)
