"""A run as a function in the user's own graphs: the same nodes, exact first derivatives, and
solvers that work with it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum
from test_tangents import spring

import varint as vi


def driven() -> vi.System:
    q, v = vi.coordinates("theta")
    u, c = ca.SX.sym("u"), vi.Parameters(g=9.81, drag=0.2)
    lagrangian = v**2 / 2 + c.g * ca.cos(q)
    return vi.System(q, v, lagrangian, force=u - c.drag * v, control=u, params=c)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.composition("blanes-moan4")], ids=str)
def test_a_flow_is_the_run_and_has_its_derivatives(rule):
    system, _ = spring()
    flow = vi.flow(system, rule, h=0.1, steps=12, nodes=[0, 5, 12])
    start = dict(q0=[0.4, -0.3], v0=[0.2, 0.5])
    motion = vi.simulate(system, rule, **start, h=0.1, steps=12)
    out = flow(**start)
    assert np.allclose(np.array(out["q"]).T, motion.q[[0, 5, 12]], rtol=1e-13, atol=1e-14)
    assert np.allclose(np.array(out["v"]).T, motion.v[[0, 5, 12]], rtol=1e-13, atol=1e-14)
    x = [ca.MX.sym(f"x{i}", flow.numel_in(i)) for i in range(3)]
    q, v = flow(*x, ca.MX(0, 12))
    everything = ca.vertcat(ca.vec(q), ca.vec(v))
    slopes = ca.Function("slopes", x, [ca.jacobian(everything, ca.vertcat(*x))])
    found = np.array(slopes(*start.values(), system.default_vector))
    wanted = vi.sensitivity(motion, ["q0", "v0", "m", "k", "rest"])[[0, 5, 12]]
    wanted = wanted.reshape(3, 2, 2, -1).transpose(1, 0, 2, 3).reshape(12, -1)
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_the_gradient_of_a_scalar_by_many_controls_is_one_adjoint_sweep():
    system, steps = driven(), 30
    flow = vi.flow(system, vi.gauss(2), h=0.05, steps=steps)
    u, g = ca.MX.sym("u", 1, steps), ca.MX.sym("c", 2)
    q, v = flow(0.3, 0.1, g, u)
    loss = ca.sin(q) + v**2
    of = ca.Function("of", [u, g], [ca.gradient(loss, ca.vec(u)), ca.gradient(loss, g)])
    push = np.sin(np.arange(steps))
    by_u, by_c = (np.array(x).ravel() for x in of(push[None], [9.0, 0.1]))
    motion = vi.simulate(
        system,
        vi.gauss(2),
        q0=0.3,
        v0=0.1,
        h=0.05,
        steps=steps,
        u=push[:, None],
        params=dict(g=9.0, drag=0.1),
    )
    wanted = vi.gradient(motion, terminal_loss=ca.sin(system.q) + system.v**2)
    assert np.allclose(by_u, wanted.u.ravel(), rtol=1e-11, atol=1e-13)
    assert np.allclose(by_c, [wanted.params["g"], wanted.params["drag"]], rtol=1e-11)
    # more columns than rows: the Jacobian is made of adjoints too
    whole = ca.Function("whole", [u, g], [ca.jacobian(ca.vertcat(q, v), ca.vec(u))])
    rows = np.array(whole(push[None], [9.0, 0.1]))
    by = vi.sensitivity(motion, ["u"])[-1]
    assert np.abs(rows - by).max() < 1e-12 * np.abs(by).max()


def test_newtons_method_finds_a_periodic_orbit_through_a_flow():
    """x(T) = x(0) with the period as an unknown parameter of time, of the double pendulum."""
    q, v = vi.coordinates("a", "b")
    c = vi.Parameters(period=1.0)
    base = double_pendulum()
    slow = ca.substitute(base.lagrangian, ca.vertcat(base.q, base.v), ca.vertcat(q, v / c.period))
    system = vi.System(q, v, c.period * slow, params=c)  # time in units of the period
    flow = vi.flow(system, vi.gauss(4), h=1 / 40, steps=40)
    x = ca.MX.sym("x", 2)  # the second angle at rest, and the period; the first is given
    start = ca.vertcat(0.1, x[0])
    end = flow(start, ca.DM.zeros(2), x[1], ca.MX(0, 40))
    solve = ca.rootfinder("orbit", "newton", {"x": x, "g": end[1]}, {"abstol": 1e-12})
    b, period = np.array(solve(x0=[0.14, 2.6])["x"]).ravel()
    motion = vi.simulate(base, vi.gauss(4), q0=[0.1, b], v0=[0.0, 0.0], duration=period, steps=40)
    assert np.abs(motion.q[-1] - motion.q[0]).max() < 1e-9
    assert np.abs(motion.v[-1]).max() < 1e-9 and period > 1.0


def test_ipopt_steers_a_pendulum_through_a_flow():
    system, steps = driven(), 20
    flow = vi.flow(system, vi.gauss(2), h=0.1, steps=steps)
    u = ca.MX.sym("u", 1, steps)
    q, v = flow(0.0, 0.0, system.default_vector, u)
    problem = {"x": ca.vec(u), "f": ca.sumsqr(u), "g": ca.vertcat(q - 0.5, v)}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    options = quiet | {"ipopt.hessian_approximation": "limited-memory", "ipopt.tol": 1e-9}
    found = ca.nlpsol("steer", "ipopt", problem, options)(x0=0.1, lbg=0, ubg=0)
    push = np.array(found["x"])
    motion = vi.simulate(system, vi.gauss(2), q0=0.0, v0=0.0, h=0.1, steps=steps, u=push)
    assert abs(motion.q[-1, 0] - 0.5) < 1e-7 and abs(motion.v[-1, 0]) < 1e-7


def test_a_run_that_cannot_be_finished_is_not_a_number():
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=1.0)
    system = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    flow = vi.flow(system, vi.gauss(2), h=0.1, steps=5)
    assert np.isnan(float(flow(1.0, np.nan, 1.0, ca.DM(0, 5))[0]))
    assert np.isfinite(float(flow(q0=1.0, v0=0.0)["q"]))  # parameters left out are the defaults


def test_what_has_no_flow_is_refused_in_words():
    system, _ = spring()
    for nodes in ([], [3, 2], [11], [0.5]):
        with pytest.raises(vi.InputError, match="nodes"):
            vi.flow(system, h=0.1, steps=10, nodes=nodes)
    with pytest.raises(vi.InputError, match="backend"):
        vi.flow(system, h=0.1, steps=10, backend="fast")
