"""Second derivatives of a run in the user's own graphs: exact, as differences and unrolled graphs
have them, for IPOPT's exact Hessian, Gauss–Newton, and roots.
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from test_flow import driven
from test_tangents import differences, driven_cart, spring

import varint as vi

SCENES = [
    (lambda: spring()[0], vi.composition("blanes-moan4")),
    (lambda: spring()[0], vi.gauss(2)),
    (driven_cart, vi.gauss(2)),  # its mass matrix depends on q, its force on u²
    (driven, vi.lobatto(2)),
    (lambda: vi.models.pendulum_cartesian().system, vi.lobatto(2)),
]


def start_of(system: vi.System, size: tuple[int, int]) -> list[np.ndarray]:
    n, model = system.structure.n, vi.models.pendulum_cartesian()
    q, v = np.linspace(0.4, 0.2, n), np.linspace(0.3, -0.1, n)
    if system.structure.constraints:
        q, v = model.q0, model.v0
    u = np.random.default_rng(1).uniform(-1, 1, size)
    return [q, v, system.default_vector, u]


def loss_of(flow: ca.Function, x: list[ca.MX]) -> ca.MX:
    q, v = flow(*x)
    w = np.random.default_rng(2).normal(size=(2, *q.shape))
    return ca.sum1(ca.sum2(ca.sin(q) * w[0])) + ca.sum1(ca.sum2(v**2 * w[1]))


@pytest.mark.parametrize("backend", ["native", "interpreted"])
@pytest.mark.parametrize(
    ("scene", "rule"), SCENES, ids=["explicit", "gauss", "cart", "lobatto", "constrained"]
)
def test_the_hessian_is_what_differences_of_the_gradient_come_to(scene, rule, backend):
    system = scene()
    flow = vi.flow(system, rule, h=0.1, steps=3, nodes=[1, 3], backend=backend)
    x = [ca.MX.sym(f"x{i}", *flow.size_in(i)) for i in range(4)]
    loss, z = loss_of(flow, x), ca.vertcat(*map(ca.vec, x))
    slope = ca.Function("slope", x, [ca.gradient(loss, z)])
    given = start_of(system, flow.size_in(3))
    ends = np.cumsum([0, *(a.size for a in given)])

    def gradient(flat: np.ndarray) -> np.ndarray:
        parts = [flat[a:b] for a, b in pairwise(ends)]
        parts[3] = parts[3].reshape(flow.size_in(3), order="F")
        return np.array(slope(*parts)).ravel()

    found = np.array(ca.Function("hessian", x, [ca.hessian(loss, z)[0]])(*given))
    flat = np.concatenate([np.ravel(a, order="F") for a in given])
    wanted = differences(gradient, flat)
    assert np.array_equal(found, found.T)
    assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max()


def test_the_hessian_is_that_of_the_unrolled_graph():
    system, _ = spring()
    rule, steps, h = vi.composition("verlet"), 8, 0.1
    flow = vi.flow(system, rule, h=h, steps=steps)
    step = vi.step_function(system, rule)
    q, v, c = (ca.MX.sym(name, flow.numel_in(i)) for i, name in enumerate("qvc"))
    at = q, ca.Function("momentum", [system.q, system.v, system.c], [system.momentum])(q, v, c)
    for k in range(steps):
        at = step(*at, ca.MX(*step.size_in(2)), c, k * h, h)[:2]
    z = ca.vertcat(q, v, c)
    both = ca.sin(flow(q, v, c, ca.MX(0, steps))[0]), ca.sin(at[0])
    given = start_of(system, (0, steps))[:3]
    found, wanted = (
        np.array(ca.Function("h", [q, v, c], [ca.hessian(ca.sum1(x), z)[0]])(*given)) for x in both
    )
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-10}


def test_ipopt_takes_the_exact_hessian_of_a_run():
    system, steps = driven(), 12
    flow = vi.flow(system, vi.gauss(2), h=0.15, steps=steps)
    u = ca.MX.sym("u", 1, steps)
    q, v = flow(0.0, 0.0, system.default_vector, u)
    problem = {"x": ca.vec(u), "f": ca.sumsqr(u) / 100 - q, "g": ca.vertcat(v)}
    push, counts = [], []
    for more in ({}, {"ipopt.hessian_approximation": "limited-memory"}):
        solver = ca.nlpsol("steer", "ipopt", problem, QUIET | more)
        push.append(np.array(solver(x0=0.1, lbg=0, ubg=0)["x"]))
        counts.append(solver.stats()["iter_count"])
        assert solver.stats()["success"]
    assert np.abs(push[0] - push[1]).max() < 1e-6
    assert counts[0] < counts[1]
    slope = np.array(
        ca.Function("s", [u], [ca.jacobian(ca.vertcat(problem["f"], v), ca.vec(u))])(push[0].T)
    )
    ratio = slope[0] @ slope[1] / (slope[1] @ slope[1])
    assert np.abs(slope[0] - ratio * slope[1]).max() < 1e-9  # stationary along the constraint


def test_gauss_newton_fits_a_run_to_its_nodes():
    system, _ = spring()
    nodes = list(range(0, 25, 4))
    flow = vi.flow(system, vi.gauss(2), h=0.1, steps=24, nodes=nodes)
    start = dict(q0=[0.4, -0.3], v0=[0.2, 0.5])
    truth = dict(m=1.5, k=2.4, rest=[0.9, 0.3])
    motion = vi.simulate(system, vi.gauss(2), **start, h=0.1, steps=24, params=truth)
    x = ca.MX.sym("params", 4)
    miss = ca.vec(flow(*start.values(), x, ca.MX(0, 24))[0] - motion.q[nodes].T)
    slope = ca.jacobian(miss, x)
    lam, p = ca.MX.sym("lam"), ca.MX.sym("p", 0)
    square = ca.triu(ca.mtimes(slope.T, slope))
    hessian = ca.Function("gn", [x, p, lam, ca.MX.sym("g", 0)], [lam * square])
    problem = {"x": x, "f": ca.sumsqr(miss) / 2}
    solver = ca.nlpsol("fit", "ipopt", problem, QUIET | {"hess_lag": hessian})
    found = np.array(solver(x0=system.default_vector)["x"]).ravel()
    wanted = [1.5, 2.4, 0.9, 0.3]
    # m and k act by their quotient alone
    assert found[1] / found[0] == pytest.approx(wanted[1] / wanted[0], rel=1e-6)
    assert found[2:] == pytest.approx(wanted[2:], rel=1e-6)


def test_a_root_of_a_run_has_second_derivatives():
    """Start speed v with which a thrown ball is at the height 1 after h·steps: v = (1 + g t²/2)/t,
    and as g enters squared through √: d²v/ds² with g = s².
    """
    q, v = vi.coordinates("y")
    c = vi.Parameters(s=3.0)
    flow = vi.flow(vi.System(q, v, v**2 / 2 - c.s**2 * q, params=c), vi.gauss(2), h=0.1, steps=8)
    speed, s = ca.MX.sym("speed"), ca.MX.sym("s")
    height = flow(0.0, speed, s, ca.MX(0, 8))[0]
    throw = ca.rootfinder("throw", "newton", {"x": speed, "p": s, "g": height - 1})
    found = ca.Function("curved", [s], [ca.hessian(throw(x0=1.0, p=s)["x"], s)[0]])
    assert float(found(3.0)) == pytest.approx(0.8, rel=1e-9)  # v = 1/t + s² t/2
