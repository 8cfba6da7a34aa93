"""Runs through impacts as CasADi functions: closed forms, differences, and solvers around them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from test_through_impacts import ball, bouncing, by_runs, driven_ball, moving_table

import varint as vi


def test_a_flow_through_bounces_has_the_derivatives_of_the_closed_form():
    height, e, g, h = 1.0, 0.8, 9.81, 0.05
    steps = 30  # 1.5 s: two bounces, at 0.45 and 1.17
    flow = vi.flow(ball(e), vi.lobatto(3), h=h, steps=steps, nodes=[2, steps])
    x, c = ca.MX.sym("x"), ca.MX.sym("c")
    q, v = flow(x, 0.0, c, ca.DM(0, steps))
    end = ca.vertcat(q[1], v[1])
    both = ca.Function("both", [x, c], [end, ca.jacobian(end, ca.vertcat(x, c))])
    value, found = (np.array(a) for a in both(height, g))
    closed, slopes = (np.array(a) for a in bouncing(2, h * steps)([height, e, g]))
    assert np.abs(value - closed[:2]).max() < 1e-11
    assert np.abs(found - slopes[:2][:, [0, 2]]).max() < 1e-10 * np.abs(slopes).max()
    falling = np.array(ca.Function("q", [x, c], [q[0], v[0]])(height, g)[0])
    assert falling == pytest.approx(height - g * 0.005, rel=1e-13)


def test_controls_act_through_contacts_and_rows_pull_back_what_columns_carry():
    system, steps = driven_ball(), 6
    flow = vi.flow(system, vi.lobatto(3), h=0.05, steps=steps, nodes=[3, steps], t0=0.3)
    x = [ca.MX.sym(f"x{i}", *flow.size_in(i)) for i in range(4)]
    out, z = ca.vertcat(*map(ca.vec, flow(*x))), ca.vertcat(x[1], ca.vec(x[3]))
    w = np.random.default_rng(3).normal(size=out.numel())
    slopes = ca.Function("slopes", x, [ca.jacobian(out, z), ca.gradient(ca.dot(w, out), z)])
    value = ca.Function("value", x, [out])
    u = np.random.default_rng(1).uniform(-3, 3, (1, steps))
    given = [0.05, 0.1, system.default_vector, u]
    columns, row = (np.array(a) for a in slopes(*given))
    wanted = by_runs(
        lambda y: np.array(value(*given[:1], y[0], given[2], y[1:].reshape(1, -1))).ravel(),
        np.append(0.1, u),
    )
    assert np.abs(columns - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert np.abs(columns.T @ w - row.ravel()).max() < 1e-12 * np.abs(row).max()


def test_newtons_method_finds_the_orbit_of_a_ball_on_a_moving_table():
    """In a period T it flies once, with u = g T/2 at both ends; restitution e asks for a table that
    moves upwards with w = u (1 − e)/(1 + e) when it is hit.
    """
    run, _, _ = moving_table()
    system, steps, e, g = run(np.array([0.2, 0.1, 3.0])).system, 12, 0.7, 9.81
    depth, rate = 0.01, 30.0
    period = 2 * np.pi / rate
    flow = vi.flow(system, vi.lobatto(3), h=period / steps, steps=steps)
    x = ca.MX.sym("x", 2)
    after = ca.vertcat(*flow(x[0], x[1], [depth, rate], ca.DM(0, steps)))
    quiet = {"error_on_fail": True, "abstol": 1e-12}
    solver = ca.rootfinder("orbit", "newton", {"x": x, "g": after - x}, quiet)
    found = np.array(solver(x0=[0.034, -0.72])["x"]).ravel()
    u = g * period / 2
    hit = np.arccos(u * (1 - e) / (1 + e) / (depth * rate)) / rate
    wanted = depth * np.sin(rate * hit) + u * hit - g * hit**2 / 2, g * hit - u
    assert np.abs(found - wanted).max() < 1e-11


def test_what_no_run_can_begin_from_is_not_a_number_and_third_derivatives_are_refused(capfd):
    flow = vi.flow(ball(), vi.lobatto(3), h=0.05, steps=4)
    x = ca.MX.sym("x")
    y = flow(x, 0.0, 9.81, ca.DM(0, 4))[0]
    curved = ca.hessian(y, x)[0]
    both = ca.Function("both", [x], [y, curved])
    assert np.isnan(np.array(both(-1.0))).all()
    with pytest.raises(RuntimeError):
        ca.jacobian(curved, x)
    assert "no third ones" in capfd.readouterr().err


def test_a_flow_that_grazes_has_values_and_no_derivatives():
    q, v = vi.coordinates("x", "y")
    post = vi.System(q, v, ca.sumsqr(v) / 2, contact=ca.norm_2(q) - 1, restitution=1.0)
    flow = vi.flow(post, vi.lobatto(2), h=0.3, steps=14)
    height = ca.MX.sym("height")
    end = ca.sumsqr(flow(ca.vertcat(-2, height), [1, 0], ca.DM(0, 1), ca.DM(0, 14))[0])
    slopes = ca.gradient(end, height), ca.hessian(end, height)[0]
    value, *found = ca.Function("end", [height], [end, *slopes])(1.0)
    assert float(value) == pytest.approx(1 + 2.2**2)
    assert np.isnan(np.array(found)).all()
    assert np.isfinite(np.array(ca.Function("end", [height], slopes)(1 - 1e-3))).all()
