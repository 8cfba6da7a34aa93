"""Derivatives of explicit runs, as many steps at once as a vector has numbers: those of step after
step, wherever a run, a step's size or a vector ends.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from derivatives import assert_as_step_after_step

import varint as vi
from varint.codegen import sweep
from varint.codegen.sweep_explicit import explicit_sweep_scheme, has_explicit_sweep
from varint.sensitivities import shifting
from varint.sensitivities.loops import is_built, sweeper
from varint.sensitivities.pieces import pieces
from varint.sensitivities.start import as_text
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.sweeps import backwards, carried, forwards

RULES = [vi.composition("verlet"), vi.composition("blanes-moan4")]
NEEDS_CORE = pytest.mark.skipif(not is_built(), reason="the native core was not built")


def pushed_pair() -> vi.System:
    """Two masses on springs, one of them with a coupled inertia, pushed in time and by controls."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.3, k=2.0, g=[0.4, 0.1])
    t, u = vi.time(), ca.SX.sym("u", 2)
    kinetic = c.m * v[0] ** 2 / 2 + v[1] ** 2 / 2 + 0.2 * v[0] * v[1]
    potential = c.k * ca.sumsqr(q) / 2 + ca.cos(q[0] - q[1]) * c.g[0]
    force = ca.vertcat(u[0] * ca.cos(q[1]), u[1] + c.g[1] * ca.sin(t))
    return vi.System(q, v, kinetic - potential, force=force, params=c, control=u, t=t)


def run_of(rule: vi.Rule, steps: int) -> vi.Trajectory:
    u = np.random.default_rng(steps).uniform(-1, 1, (steps, 2))
    start = dict(q0=[0.4, -0.3], v0=[0.2, 0.5], t0=0.3)
    return vi.simulate(pushed_pair(), rule, **start, h=0.1, steps=steps, u=u)


@NEEDS_CORE
@pytest.mark.parametrize("steps", [1, 7, 8, 9, 33])
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_a_run_of_any_length_has_the_gradient_and_the_tangents_of_step_after_step(rule, steps):
    motion = run_of(rule, steps)
    system = motion.system
    assert has_explicit_sweep(system, rule)
    loss = system.q[0] ** 2 * (1 + system.t) + system.v[1] * system.control[0] + system.c[1]
    assert_as_step_after_step(motion, loss, ["q0", "m", "h", "t0", "u"])


def wells() -> vi.System:
    """Two coupled masses that nothing pushes: a step's last kick is the first of the next."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.3, k=2.0)
    kinetic = c.m * v[0] ** 2 / 2 + v[1] ** 2 / 2 + 0.2 * v[0] * v[1]
    return vi.System(q, v, kinetic - c.k * ca.sumsqr(q) / 2 - ca.cos(q[0] - q[1]), params=c)


@pytest.mark.parametrize("rule", [vi.composition("verlet"), vi.composition("yoshida4")], ids=str)
def test_only_a_kick_that_time_and_controls_leave_alone_is_shared_by_two_steps(rule):
    assert explicit_sweep_scheme(wells(), rule).counts["SHARED"]
    assert not explicit_sweep_scheme(pushed_pair(), rule).counts["SHARED"]


@NEEDS_CORE
@pytest.mark.parametrize("steps", [1, 8, 9, 30])
@pytest.mark.parametrize("lossy", [False, True])
def test_a_kick_that_two_steps_share_pulls_back_as_that_of_each(steps, lossy):
    rule, system, rng = vi.composition("yoshida4"), wells(), np.random.default_rng(steps)
    sizes = np.repeat(rng.uniform(0.05, 0.2, 8), [1, 9, 3, 8, 1, 1, 5, 2])[:steps]
    start = dict(q0=[0.4, -0.3], v0=[0.2, 0.5])
    motion = vi.simulate(system, rule, **start, h=0.1, steps=steps)
    x = [np.hstack([motion.q[0], motion.p[0]])]
    for h in sizes:
        last = vi.simulate(system, rule, q0=x[-1][:2], p0=x[-1][2:], h=h, steps=1)
        x.append(np.hstack([last.q[1], last.p[1]]))
    text = as_text(system, ca.sumsqr(system.q) * system.v[1]) if lossy else None
    (piece,) = pieces(motion)
    for one in (piece, piece._replace(x=np.array(x), h=sizes)):
        found = []
        for backend in ("native", "interpreted"):
            by = sweeper(system, rule, steps, backend, text)
            mu, seeds = np.array([0.3, -1.0, 0.7, 0.2]), np.sin(np.arange(4.0 * steps))
            mu, pulled = backwards(by, one, motion.c, mu, seeds.reshape(-1, 4), 1)
            found.append(np.concatenate([mu, pulled.outer, [pulled.loss]]))
        assert np.abs(found[0] - found[1]).max() < 1e-13 * np.abs(found[1]).max()


@NEEDS_CORE
def test_steps_of_many_sizes_are_differentiated_in_groups_of_one_size():
    rule, steps = vi.composition("yoshida4"), 30
    motion = run_of(rule, steps)
    system, rng = motion.system, np.random.default_rng(3)
    (piece,) = pieces(motion)
    piece = piece._replace(h=np.repeat(rng.uniform(0.05, 0.2, 8), [1, 9, 3, 8, 1, 1, 5, 2]))
    text = as_text(system, ca.sumsqr(system.q) * system.control[1])
    outer = rng.normal(size=(len(motion.c) + 2, 11))
    tangent, seeds = rng.normal(size=(4, 11)), rng.normal(size=(steps, 4))
    found = []
    for backend in ("native", "interpreted"):
        by = sweeper(system, rule, steps, backend, text)
        mu, pulled = backwards(by, piece, motion.c, tangent[:, 0], seeds, 1)
        every = forwards(by, piece, motion.c, Directions(outer), tangent)
        last = carried(by, piece, motion.c, Directions(outer), tangent)
        assert np.array_equal(last, every[-1])
        parts = mu, pulled.outer, pulled.controls.ravel(), [pulled.loss], every.ravel()
        found.append(np.concatenate(parts))
    assert np.abs(found[0] - found[1]).max() < 1e-13 * np.abs(found[1]).max()


def test_masses_that_all_act_on_each_other_are_differentiated_step_by_step():
    """Their Jacobians have more numbers than a product with an adjoint has operations."""
    n, rule = 40, vi.composition("verlet")
    q, v = vi.coordinates(*(f"x{i}" for i in range(n)))
    dense = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sum1(q) ** 4 - ca.sumsqr(q))
    chain = vi.System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q[1:] - q[:-1]))
    assert has_explicit_sweep(chain, rule) and not has_explicit_sweep(dense, rule)
    assert not has_explicit_sweep(chain, vi.gauss(2))
    motion = vi.simulate(dense, rule, q0=np.sin(range(n)), v0=np.zeros(n), h=1e-2, steps=9)
    loss = ca.sumsqr(q)
    one, two = (
        vi.gradient(motion, terminal_loss=loss, backend=x).q0 for x in ("auto", "interpreted")
    )
    assert np.allclose(one, two, rtol=1e-12, atol=1e-12)


@NEEDS_CORE
@pytest.mark.parametrize("rule", [vi.composition("verlet"), vi.gauss(2), vi.gauss(4)], ids=str)
def test_what_the_compiler_is_given_in_the_background_is_what_takes_over(rule, monkeypatch):
    given, asked = [], []
    loops = SimpleNamespace(tangents=None, adjoints=None)
    monkeypatch.setattr(sweep, "library", lambda text, _: asked.append(text) or loops)
    monkeypatch.setattr(sweep, "entry_of", lambda *_: None)
    monkeypatch.setattr(shifting, "SweepGears", lambda *parts: given.append(parts) or parts)
    monkeypatch.setattr(shifting, "shifting", lambda gears: gears)
    q, v = vi.coordinates("x", "y", "z")  # a scene of this test alone: its loops are none
    wells = vi.System(q, v, ca.sumsqr(v) / 2 - 0.731 * ca.sumsqr(q) ** 2 - q[0] * q[2])
    sweeper(wells, rule, 10**6, "auto")
    _, source, compiled, _ = given[0]
    compiled()
    assert asked == [source()]
