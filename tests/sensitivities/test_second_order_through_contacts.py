"""Second derivatives of runs through impacts, stops and detachments: closed forms, differences of
the exact gradient, and IPOPT with the exact Hessian around a ball that bounces.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from contact_scenes import disc_on_table
from test_through_impacts import (
    ball,
    bouncing,
    by_runs,
    circle_billiard,
    cradle,
    driven_ball,
    moving_table,
    touching,
)

import varint as vi

QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11}


def test_a_ball_that_bounced_has_the_second_derivatives_of_the_closed_form():
    """By height, restitution and gravity."""
    q, v = vi.coordinates("y")
    c = vi.Parameters(e=0.8, g=9.81)
    system = vi.System(q, v, v**2 / 2 - c.g * q, contact=q, restitution=c.e, params=c)
    h, steps = 0.05, 30  # 1.5 s: two bounces, at 0.45 and 1.17
    flow = vi.flow(system, vi.lobatto(3), h=h, steps=steps)
    z, at = ca.MX.sym("z", 3), [1.0, 0.8, 9.81]
    y, w = flow(z[0], 0.0, z[1:], ca.DM(0, steps))
    for number, closed in zip((y, w), ca.vertsplit(bouncing(2, h * steps)(z)[0][:2]), strict=True):
        first, second = (
            ca.Function("f", [z], [x, ca.gradient(x, z), ca.hessian(x, z)[0]])(at)
            for x in (number, closed)
        )
        for found, wanted in zip(first, second, strict=True):
            assert np.abs(np.array(found - wanted)).max() < 1e-10 * np.abs(np.array(wanted)).max()


def on_a_moving_table() -> vi.System:
    return moving_table()[0](np.array([0.2, 0.1, 3.0])).system


def at_rest_in_touch() -> vi.System:
    return touching(0.9)(np.array([-1.5, 1.2])).system


def box() -> vi.System:
    return disc_on_table(9.81, [0.9, 0.7, 0.0])


SCENES = {  # system, start, t0, h, nodes, the last of which is the end
    "ball": (ball, [1.0, 0.0], 0.0, 0.05, [2, 30]),
    "comes to rest": (lambda: ball(0.3), [1.0, 0.1], 0.0, 0.05, [12, 40]),
    "circle": (circle_billiard, [0.0, -0.39, 1.3, 0.0], 0.0, 0.15, [20]),
    "cradle": (cradle, [-1.8, -0.5, 0.8, 1.0, 0.0, 0.1], 0.0, 0.05, [5, 16]),
    "driven": (driven_ball, [0.05, 0.1], 0.3, 0.05, [3, 6]),
    "table": (on_a_moving_table, [0.5, 0.1], 0.2, 0.05, [16]),
    "box": (box, [0.3, 0.4, 1.5, 0.3], 0.0, 0.05, [24]),
    "handed on": (at_rest_in_touch, [-1.5, 0.0, 1.0, 1.2, 0, 0], 0.0, 0.1, [9]),
}


def varied(name: str) -> int:
    """So many of the inputs may vary: balls that touch must not come apart."""
    return 1 if name == "handed on" else 100


@pytest.mark.parametrize(
    ("name", "backend"), [*((name, "auto") for name in SCENES), ("driven", "interpreted")]
)
def test_the_hessian_through_contacts_is_what_differences_of_the_gradient_come_to(name, backend):
    scene, start, t0, h, nodes = SCENES[name]
    system, steps = scene(), nodes[-1]
    flow = vi.flow(system, vi.lobatto(3), h=h, steps=steps, nodes=nodes, t0=t0, backend=backend)
    x = [ca.MX.sym(f"x{i}", *flow.size_in(i)) for i in range(4)]
    q, v = flow(*x)
    w = np.random.default_rng(2).normal(size=(2, *q.shape))
    loss = ca.sum1(ca.sum2(ca.sin(q) * w[0])) + ca.sum1(ca.sum2(v**2 * w[1]))
    z = ca.vertcat(*map(ca.vec, x))
    slope = ca.Function("slope", x, [ca.gradient(loss, z)])
    curved = ca.Function("curved", x, [ca.hessian(loss, z)[0]])
    u = np.random.default_rng(1).uniform(-3, 3, flow.size_in(3))
    given = [*np.split(np.array(start, dtype=float), 2), system.default_vector, u]
    flat, sizes = np.concatenate([x.ravel(order="F") for x in given]), [x.size for x in given]

    def gradient(z: np.ndarray) -> np.ndarray:
        parts = np.split(z, np.cumsum(sizes)[:-1])
        return np.array(slope(*parts[:3], parts[3].reshape(u.shape, order="F"))).ravel()

    along = np.random.default_rng(3).uniform(0.3, 1, len(flat))
    along[varied(name) :] = 0.0
    found = np.array(curved(*given))
    wanted = by_runs(lambda s: gradient(flat + s * along), np.zeros(1), 1e-4)[:, 0]
    assert np.array_equal(found, found.T)
    assert np.abs(found @ along - wanted).max() < 1e-8 * np.abs(wanted).max()


@pytest.mark.parametrize("make", [vi.models.slide_off_sphere, vi.models.falling_ladder])
def test_detachments_are_curved_too(make):
    model = make()
    steps = round(model.duration / model.h / 2)
    flow = vi.flow(model.system, vi.lobatto(3), h=model.duration / steps, steps=steps)
    g = ca.MX.sym("g")
    c = ca.vertcat(*(g if x == "gravity" else float(y) for x, y in model.system.defaults.items()))
    q, v = flow(model.q0, model.v0, c, ca.DM(0, steps))
    loss = ca.sum1(ca.sin(q)) + ca.sumsqr(v)
    slope = ca.Function("slope", [g], [ca.gradient(loss, g)])
    found = float(ca.Function("curved", [g], [ca.hessian(loss, g)[0]])(9.81))
    wanted = float(by_runs(lambda x: np.array(slope(x))[0], np.array([9.81]))[0, 0])
    assert found == pytest.approx(wanted, rel=1e-8)


def test_ipopt_throws_a_ball_into_a_hole_after_two_bounces():
    """With least effort, from a height that is free: as the closed form of its flight has it, in as
    many steps."""
    q, v = vi.coordinates("x", "y")
    lagrangian = ca.sumsqr(v) / 2 - 9.81 * q[1] - 0.02 * q[0] ** 2
    system = vi.System(q, v, lagrangian, contact=q[1], restitution=0.8)
    steps, h, bound = 30, 0.06, [4.0, 0.3]
    flow = vi.flow(system, vi.lobatto(3), h=h, steps=steps)
    z = ca.MX.sym("z", 3)  # height, and velocity of the throw
    x0 = [0.6, 2.0, 3.0]
    end = flow(ca.vertcat(0, z[0]), z[1:], ca.DM(0, 1), ca.DM(0, steps))[0]

    def flight(height, up):
        begin = up / 9.81 + ca.sqrt(up**2 + 2 * 9.81 * height) / 9.81
        speed = 0.8 * ca.sqrt(up**2 + 2 * 9.81 * height)
        since = h * steps - begin - 2 * speed / 9.81
        return 0.8 * speed * since - 9.81 * since**2 / 2

    def energy(x):
        return ca.sumsqr(x[1:]) / 2 + 9.81 * (x[0] - 1) ** 2

    closed = ca.MX.sym("closed", 3)
    far = closed[1] * ca.sin(ca.sqrt(0.04) * h * steps) / ca.sqrt(0.04)
    programs = (z, end), (closed, ca.vertcat(far, flight(closed[0], closed[2])))
    found, counts = [], []
    for x, reached in programs:
        problem = {"x": x, "f": energy(x), "g": reached}
        solver = ca.nlpsol("throw", "ipopt", problem, QUIET)
        ended = solver(x0=x0, lbx=[0.1, 0, 0], lbg=bound, ubg=bound)
        found.append(np.concatenate([np.array(ended[name]).ravel() for name in ("x", "lam_g")]))
        counts.append(solver.stats()["iter_count"])
        assert solver.stats()["success"]
    assert np.abs(found[0] - found[1]).max() < 1e-9 * np.abs(found[1]).max()
    assert counts[0] == counts[1]
