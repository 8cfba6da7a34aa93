"""Start values of Newton's method: what continues the last steps, and how near it comes."""

import casadi as ca
import numpy as np
import pytest
import scenes

import varint as vi
from varint.codegen.continuation import FORCED_HISTORY, force_table
from varint.codegen.kernel import run_loop
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_scheme
from varint.discrete.equations import implicit_equations

RULES = [
    vi.midpoint(),
    vi.trapezoidal(),
    vi.gauss(2),
    vi.lobatto(3),
    vi.gauss(3),
    vi.lobatto(4),
    vi.gauss(4),
]


def steps_under(push, rule, h, count):
    """Mean velocities z and velocities at the start of steps of a mass under a force of time."""
    q, v = vi.coordinates("x")
    t = vi.time()
    system = vi.System(q, v, v**2 / 2 + q * push(t), t=t)
    e = implicit_equations(system, rule)
    solved = -ca.solve(ca.jacobian(e.left, e.y), ca.substitute(e.left, e.y, 0 * e.y))
    after = ca.substitute([e.increment, e.gain], [e.y], [solved])
    step = ca.Function("step", [e.q, e.p, e.t, e.h, e.c], [solved, *after])
    x, p, stages, speeds = 0.3, 0.7, [], []
    for k in range(count):
        z, increment, gain = (np.array(y).ravel() for y in step(x, p, h * k, h, []))
        stages.append(z), speeds.append(p)
        x, p = x + increment.item(), p + gain.item()
    return stages, speeds


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_steps_under_a_polynomial_force_are_continued_exactly(rule):
    history, d = FORCED_HISTORY.get(rule.degree, 1), rule.degree
    table = force_table(rule, history)
    for known in range(1, history + 1):
        size = known * (d + 1) + 1
        part, table = table[: d * size].reshape(d, size), table[d * size :]
        nodes = {round(c - s, 12) for c in rule.nodes for s in range(known)}
        degree = min(len(nodes), known * (d + 1)) - 1 - max(known - 2, 0)
        c = np.arange(1.0, degree + 2) * (-1) ** np.arange(degree + 1)
        stages, speeds = steps_under(
            lambda t, c=c: sum(x * t**i for i, x in enumerate(c)), rule, 0.1, known + 1
        )
        behind = [np.append(stages[k], speeds[k]) for k in reversed(range(known))]
        found = part @ np.concatenate([*behind, [speeds[known]]])
        np.testing.assert_allclose(found, stages[known], rtol=1e-11)
        one_more = steps_under(lambda t, n=degree + 4: t**n, rule, 1.0, known + 1)
        behind = [np.append(one_more[0][k], one_more[1][k]) for k in reversed(range(known))]
        missed = part @ np.concatenate([*behind, [one_more[1][known]]]) - one_more[0][known]
        # the trapezoidal rule begins a step with the force that the one before ended with
        assert abs(missed).max() > 1e-6 or rule == vi.trapezoidal()
    assert not len(table)


@pytest.mark.parametrize("rule", [vi.lobatto(3), vi.lobatto(4)], ids=lambda rule: rule.name)
def test_one_correction_a_step_is_enough_where_steps_resolve_the_motion(rule):
    model = vi.models.henon_heiles()
    found = run_loop(
        native_newton(model.system, rule),
        np.asarray(model.q0, float),
        np.asarray(model.v0, float),
        model.system.default_vector,
        t0=0.0,
        h=0.0125,
        steps=300,
    )
    assert found.steps == 300 and found.iterations <= 1.05 * 300
    assert found.residual < 1e-14


def test_a_mass_that_depends_on_the_place_is_not_continued_by_its_accelerations():
    assert newton_scheme(scenes.double_pendulum(), vi.lobatto(3)).counts["FORCED"] == 0
    assert newton_scheme(vi.models.henon_heiles().system, vi.lobatto(3)).counts["FORCED"] == 1


def test_factors_used_twice_leave_what_newtons_method_leaves():
    model = vi.models.slider_crank()
    options = dict(q0=model.q0, v0=model.v0, h=1e-3, steps=300)
    motion = vi.simulate(model.system, vi.lobatto(3), backend="native", **options)
    exact = vi.simulate(model.system, vi.lobatto(3), backend="interpreted", **options)
    assert motion.stats["iterations"] <= 2.1 * 300
    assert motion.stats["residual"] < 1e-12
    size = abs(exact.q).max()
    assert abs(motion.q - exact.q).max() < 1e-12 * size
