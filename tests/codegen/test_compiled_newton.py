"""Newton's method in the compiled loop: the motion of the interpreted stepper, and what it does
on failure.
"""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
import scenes

import varint as vi
from varint.codegen.arguments import DONE, NOT_CONVERGED
from varint.codegen.band import band
from varint.codegen.cache import compiler
from varint.codegen.explicit import explicit_kernel
from varint.codegen.gauss import gauss_kernel
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import run_loop
from varint.codegen.newton import newton_kernel, newton_scheme
from varint.discrete.equations import implicit_equations

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def interpreted(system, rule, q0, v0, h, steps, **options):
    return vi.simulate(
        system, rule, q0=q0, v0=v0, h=h, steps=steps, backend="interpreted", **options
    )


def compiled(motion, kernel, **options):
    c = motion.system.default_vector
    steps, t0 = options.pop("steps", len(motion) - 1), float(motion.t[0])
    return run_loop(kernel, motion.q[0], motion.p[0], c, t0=t0, h=motion.h, steps=steps, **options)


def distance(found, motion):
    return max(
        np.abs(found.rows[:, i] - x).max() for i, x in enumerate((motion.q, motion.p, motion.v))
    )


REGULAR = {
    "closed form": (scenes.double_pendulum(), vi.midpoint(), [1.0, 2.0], [0.0, 0.5], 0.01),
    "band": (scenes.double_pendulum(), vi.lobatto(4), [1.0, 2.0], [0.0, 0.5], 0.02),
    "time and damping": (scenes.driven_damped(), vi.gauss(3), [1.0, 0.2], [0.0, 0.1], 0.05),
    "trapezoidal, mass depends on q": (
        scenes.cart_pendulum(),
        vi.trapezoidal(),
        [1.0, 0.2],
        [0.0, 0.1],
        0.01,
    ),
}


@needs_compiler
@pytest.mark.parametrize("name", REGULAR)
def test_compiled_and_interpreted_newton_steps_agree_to_round_off(name):
    system, rule, q0, v0, h = REGULAR[name]
    motion = interpreted(system, rule, q0, v0, h, 200, t0=0.3)
    found = compiled(motion, newton_kernel(system, rule))
    assert found.status == DONE
    assert distance(found, motion) < 3e-14


CONSTRAINED = {
    "multipliers alone": (lambda: vi.models.chain_rods(4), vi.trapezoidal(), 1e-12),
    "path and multipliers": (lambda: vi.models.chain_rods(3), vi.lobatto(3), 1e-12),
    "closed loop": (vi.models.slider_crank, vi.lobatto(3), 1e-11),
    "mass singular off the manifold": (vi.models.heavy_top_quaternion, vi.lobatto(3), 1e-12),
    "moving constraint": (vi.models.turning_wire, vi.lobatto(2), 1e-12),
    "non-holonomic": (vi.models.rolling_disc, vi.midpoint(), 1e-12),
    "non-holonomic and holonomic": (lambda: non_holonomic_on_a_sphere(), vi.trapezoidal(), 1e-12),
}


def non_holonomic_on_a_sphere():
    q, v = vi.coordinates("x", "y", "z")
    rows = ca.horzcat(-q[1], q[0], 0.3)
    system = vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[2], constraint=ca.sumsqr(q) - 1, nonholonomic=rows
    )
    q0, v0 = vi.project(system, [0.6, 0.0, -0.8], [0.5, 0.2, 0.1])
    return SimpleNamespace(system=system, q0=q0, v0=v0, h=0.01)


@needs_compiler
@pytest.mark.parametrize("name", CONSTRAINED)
def test_compiled_and_interpreted_steps_with_constraints_agree_to_round_off(name):
    make, rule, bound = CONSTRAINED[name]
    model = make()
    motion = interpreted(model.system, rule, model.q0, model.v0, model.h, 100)
    found = compiled(motion, newton_kernel(model.system, rule))
    assert found.status == DONE
    scale = np.abs(motion.v).max() + np.abs(motion.p).max() + 1
    assert distance(found, motion) < bound * scale


@needs_compiler
def test_constraints_and_hidden_constraints_hold_over_many_compiled_steps():
    model = vi.models.chain_rods(5)
    motion = interpreted(model.system, vi.trapezoidal(), model.q0, model.v0, 1e-3, 1)
    found = compiled(
        motion, newton_kernel(model.system, vi.trapezoidal()), steps=100_000, save_every=1000
    )
    s = model.system
    rows = ca.Function(
        "rows", [s.q, s.v, s.c], [s.constraint, ca.jtimes(s.constraint, s.q, s.v)]
    ).map(101)
    gap, slip = rows(found.rows[:, 0].T, found.rows[:, 2].T, s.default_vector)
    assert np.abs(gap.full()).max() < 1e-12
    assert np.abs(slip.full()).max() < 1e-10


@needs_compiler
def test_controls_enter_compiled_newton_steps_with_and_without_constraints():
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u")
    options = dict(force=ca.vertcat(u * q[1], u), control=u)
    free = vi.System(q, v, ca.sumsqr(v) / 2 + q[0] ** 2 * v[1] ** 2 - q[1] ** 4, **options)
    bound = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, **options)
    for system, rule in ((free, vi.gauss(2)), (bound, vi.trapezoidal()), (bound, vi.lobatto(3))):
        values = np.random.default_rng(1).uniform(-1, 1, (80, len(rule.nodes), 1))
        motion = interpreted(system, rule, [0.6, -0.8], [0.8, 0.6], 0.02, 80, u=values)
        assert distance(compiled(motion, newton_kernel(system, rule), u=values), motion) < 1e-13


@needs_compiler
@pytest.mark.parametrize("rule", (vi.trapezoidal(), vi.gauss(2), vi.lobatto(4)))
def test_a_linear_scene_takes_one_solve_a_step_and_gives_what_newtons_method_gives(rule):
    q, v = vi.coordinates("x", "y")
    t, u = vi.time(), ca.SX.sym("u")
    potential = q[0] ** 2 + 1.3 * q[0] * q[1] + 2 * q[1] ** 2 - ca.cos(3 * t) * q[0]
    lagrangian = (
        v[0] ** 2 + 0.3 * v[0] * v[1] + v[1] ** 2 + 0.7 * (q[0] * v[1] - q[1] * v[0]) - potential
    )
    system = vi.System(
        q, v, lagrangian, force=ca.vertcat(u - 0.1 * v[0], -0.2 * v[1]), control=u, t=t
    )
    values = np.random.default_rng(2).uniform(-1, 1, (150, len(rule.nodes), 1))
    motion = interpreted(system, rule, [1.0, -0.5], [0.3, 0.2], 0.1, 150, u=values)
    kernel = newton_kernel(system, rule)
    found = compiled(motion, kernel, u=values)
    assert "constant linear map" in kernel.about
    assert found.iterations == found.steps == 150
    assert distance(found, motion) < 3e-14


@needs_compiler
def test_a_large_linear_scene_is_factorised_once():
    n = 30
    q, v = vi.coordinates(*(f"x{i}" for i in range(n)))
    stretch = ca.vertcat(q, 0) - ca.vertcat(0, q)
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 0.1 * q[0] * v[1] - ca.sumsqr(stretch) / 2)
    start = np.random.default_rng(4).uniform(-1, 1, (2, n))
    motion = interpreted(system, vi.gauss(2), start[0], start[1], 0.2, 60)
    kernel = newton_kernel(system, vi.gauss(2))
    found = compiled(motion, kernel)
    assert "factorised once" in kernel.about
    assert found.iterations <= 2 * found.steps
    assert distance(found, motion) < 3e-14


@needs_compiler
def test_a_run_in_pieces_is_bit_identical_to_one_run():
    system, rule = scenes.double_pendulum(), vi.lobatto(3)
    motion = interpreted(system, rule, [1.0, 2.0], [0.0, 0.5], 0.01, 1)
    kernel = newton_kernel(system, rule)
    whole = compiled(motion, kernel, steps=3000)
    part = compiled(motion, kernel, steps=1100)
    rest = compiled(motion, kernel, steps=1900, first=1100, carry=part.carry)
    assert np.array_equal(np.concatenate([part.rows, rest.rows[1:]]), whole.rows)


@needs_compiler
def test_newtons_method_solves_stiff_steps_on_which_fixed_point_iteration_fails():
    """ω h = 5: fixed-point iteration diverges; Newton's method needs no more steps than for soft
    springs.
    """
    model, rule = vi.models.fpu_chain(omega=50.0), vi.gauss(3)  # which no slopes are taken for
    motion = interpreted(model.system, rule, model.q0, model.v0, 0.1, 200)
    assert compiled(motion, gauss_kernel(model.system, rule)).status == NOT_CONVERGED
    found = compiled(motion, newton_kernel(model.system, rule))
    assert found.status == DONE
    assert found.iterations < 5 * found.steps
    assert distance(found, motion) < 1e-11


@needs_compiler
def test_the_trapezoidal_rule_as_equations_gives_what_kick_and_drift_give():
    system = scenes.henon_heiles()
    motion = interpreted(system, vi.trapezoidal(), [0.1, 0.2], [0.3, 0.1], 0.05, 200)
    by_newton = compiled(motion, newton_kernel(system, vi.trapezoidal()))
    by_kicks = compiled(motion, explicit_kernel(system, vi.trapezoidal()))
    assert np.abs(by_newton.rows - by_kicks.rows).max() < 1e-13


@needs_compiler
def test_a_step_without_solution_ends_the_run_at_the_node_before_it():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 + q**4 * v**2 + 50 * q**6)
    found = run_loop(
        newton_kernel(system, vi.gauss(2)),
        np.ones(1),
        np.zeros(1),
        np.zeros(0),
        t0=0.0,
        h=0.3,
        steps=100,
    )
    assert found.status != DONE
    assert found.steps == len(found.rows) - 1 < 100
    assert np.isfinite(found.rows).all()
    assert not found.failed <= 1e-10


def test_scenes_that_the_loop_cannot_express_are_refused():
    q, v = vi.coordinates("x")
    with pytest.raises(NotCompilable, match="quadratic in"):
        held = vi.System(q, v, -ca.sqrt(1 - v**2) - q**2, constraint=q)
        newton_kernel(held, vi.lobatto(3))
    with pytest.raises(NotCompilable, match="without contacts"):
        newton_kernel(vi.System(q, v, v**2 / 2 - q, contact=q), vi.lobatto(3))


def test_the_band_of_a_chain_is_narrow_in_whatever_order_its_links_come():
    n = 60
    order = np.random.default_rng(0).permutation(n)
    pattern = ca.Sparsity.triplet(
        n,
        n,
        *zip(
            *[(order[i], order[j]) for i in range(n) for j in range(n) if abs(i - j) < 2],
            strict=True,
        ),
    )
    found = band(pattern)
    assert (found.below, found.above) == (1, 1)
    assert sorted(found.order) == list(range(n))


def test_blocks_that_nothing_couples_do_not_widen_the_band():
    block = ca.Sparsity.dense(3, 3)
    pattern = ca.diagcat(*[ca.DM.ones(block)] * 20).sparsity()
    scattered = np.random.default_rng(1).permutation(60).tolist()
    found = band(ca.DM.ones(pattern)[scattered, scattered].sparsity())
    assert (found.below, found.above) == (2, 2)


@needs_compiler
def test_simulate_hands_over_to_newtons_method_where_fixed_point_iteration_fails():
    model, rule = vi.models.fpu_chain(omega=50.0), vi.gauss(3)  # which no slopes are taken for
    options = dict(q0=model.q0, v0=model.v0, h=0.1, steps=150)
    motion = vi.simulate(model.system, rule, backend="compiled", **options)
    slow = vi.simulate(model.system, rule, backend="interpreted", **options)
    assert motion.stats["iterations"] < 5 * 150
    assert np.abs(motion.q - slow.q).max() < 1e-12


@needs_compiler
def test_simulate_compiled_gives_the_multipliers_of_the_interpreted_run():
    model = vi.models.chain_rods(4)
    options = dict(q0=model.q0, v0=model.v0, h=1e-3, steps=200)
    compiled_run, slow = (
        vi.simulate(model.system, backend=b, **options) for b in ("compiled", "interpreted")
    )
    assert (
        np.abs(compiled_run.multipliers - slow.multipliers).max()
        < 1e-10 * np.abs(slow.multipliers).max()
    )


def spring(force=0):
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) * 0.7 + 0.2 * v[0] * v[1] - 20 * (ca.norm_2(q) - 1) ** 2 - q[1]
    return vi.System(q, v, lagrangian, force=force(v) if force else None)


@pytest.mark.parametrize("force", [0, lambda v: -0.1 * v], ids=["separable", "linear drag"])
def test_what_stays_when_the_end_is_eliminated_is_newtons_correction(force):
    system, rule = spring(force), vi.lobatto(3)
    scheme = newton_scheme(system, rule)
    assert scheme.counts["CLOSED"]
    assert scheme.counts["Y"] > 3
    e = implicit_equations(system, rule)
    inputs, (correction,) = scheme.functions["equations"]
    given = [*inputs, e.h, e.c, e.scale]
    every = ca.Function("all", given, [correction, e.left, ca.jacobian(e.left, e.y)])
    random = np.random.default_rng(3)
    numbers = [random.uniform(0.5, 1.5, x.shape) for x in given[:-3]]
    found, left, slope = map(np.array, every(*numbers, 0.1, [], np.ones(4)))
    # rows that are solved with others: Newton's correction is that of any regular combination
    np.testing.assert_allclose(found, np.linalg.solve(slope, left), rtol=1e-12, atol=1e-13)


@needs_compiler
def test_a_step_without_its_end_is_that_of_the_interpreted_loop():
    q0, v0, h = [0.3, -0.7], [0.5, -1.0], 0.01
    motion = interpreted(spring(), vi.lobatto(3), q0, v0, h, 200)
    found = compiled(motion, newton_kernel(spring(), vi.lobatto(3)))
    assert found.status == DONE
    assert distance(found, motion) < 1e-12


def test_the_end_stays_where_forces_bend_with_velocities():
    damped = newton_scheme(spring(lambda v: -0.1 * v**3), vi.lobatto(3))
    assert not damped.counts["CLOSED"]
