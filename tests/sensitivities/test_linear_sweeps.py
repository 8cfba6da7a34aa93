"""Derivatives of runs of linear scenes, by the map that every step is."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from derivatives import assert_as_step_after_step

import varint as vi
from varint.codegen.sweep_linear import has_linear_sweep
from varint.sensitivities.loops import is_built, sweeper
from varint.sensitivities.pieces import pieces
from varint.sensitivities.start import as_text
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.sweeps import backwards, carried, forwards

RULES = [vi.gauss(1), vi.gauss(2), vi.lobatto(3)]
NEEDS_CORE = pytest.mark.skipif(not is_built(), reason="the native core was not built")


def pushed_springs() -> vi.System:
    """Two masses on springs with friction, a coupled inertia, pushed in time and by a control."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=1.3, k=2.0, d=0.1)
    t, u = vi.time(), ca.SX.sym("u")
    kinetic = c.m * v[0] ** 2 / 2 + v[1] ** 2 / 2 + 0.2 * v[0] * v[1]
    potential = c.k * ca.sumsqr(q) / 2 + q[0] * q[1] / 2
    force = ca.vertcat(u + ca.sin(t), 0) - c.d * v
    return vi.System(q, v, kinetic - potential, force=force, params=c, control=u, t=t)


def hanging_springs(masses: int) -> vi.System:
    """Masses that hang from springs, with friction."""
    q, v = vi.coordinates(*[f"x{i}" for i in range(masses)])
    c = vi.Parameters(m=1.3, k=2.0, d=0.1, g=9.81)
    stretches = ca.vertcat(q[0] - 10, q[1:] - q[:-1])
    lagrangian = c.m * ca.sumsqr(v) / 2 - c.k * ca.sumsqr(stretches) / 2 - c.m * c.g * ca.sum1(q)
    return vi.System(q, v, lagrangian, force=-c.d * v, params=c)


@NEEDS_CORE
@pytest.mark.parametrize("steps", [24, 29])
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_derivatives_by_one_map_are_those_of_step_after_step(rule, steps):
    system, rng = pushed_springs(), np.random.default_rng(steps)
    start = dict(q0=[0.4, -0.3], v0=[0.2, 0.5], t0=0.3, h=0.1, steps=steps)
    motion = vi.simulate(system, rule, **start, u=rng.uniform(-1, 1, (steps, 1)))
    assert has_linear_sweep(system, rule)
    loss = system.q[0] ** 4 * (1 + system.t) + system.v[1] * system.control + system.c[1] ** 2
    assert_as_step_after_step(motion, loss, ["q0", "m", "d", "h", "t0", "u"])


@NEEDS_CORE
@pytest.mark.parametrize(
    "rule, masses, steps",
    [*((x, 2, 70) for x in RULES), (vi.gauss(2), 6, 70), (vi.gauss(1), 20, 96)],
    ids=str,
)
def test_what_pulls_alike_at_all_times_is_pulled_once(rule, masses, steps):
    """Far from where they rest: nothing by time."""
    system = hanging_springs(masses)
    q, v, c = system.q, system.v, system.c
    q0 = 10 + np.sin(np.arange(float(masses)))
    motion = vi.simulate(system, rule, q0=q0, v0=np.cos(q0), h=0.1, steps=steps)
    assert has_linear_sweep(system, rule)
    assert_as_step_after_step(motion, None, ["q0", "m", "g", "d", "h", "t0"])
    density = (q[0] - 10) ** 2 * (c[1] + system.t) + v[1] ** 4
    assert_as_step_after_step(motion, density, ["q0"])


@NEEDS_CORE
def test_every_size_of_a_step_has_its_map():
    rule, steps, system = vi.gauss(2), 30, pushed_springs()
    rng, u = np.random.default_rng(3), np.full((30, 1), 0.2)
    motion = vi.simulate(system, rule, q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=steps, u=u)
    (piece,) = pieces(motion)
    piece = piece._replace(h=np.repeat(rng.uniform(0.05, 0.2, 8), [1, 9, 3, 8, 1, 1, 5, 2]))
    text = as_text(system, ca.sumsqr(system.q) * system.control)
    outer = rng.normal(size=(len(motion.c) + 2, 11))
    tangent, seeds = rng.normal(size=(4, 11)), rng.normal(size=(steps, 4))
    found = []
    for backend in ("native", "interpreted"):
        by = sweeper(system, rule, steps, backend, text)
        mu, pulled = backwards(by, piece, motion.c, tangent[:, 0], seeds, 1)
        every = forwards(by, piece, motion.c, Directions(outer), tangent)
        assert np.array_equal(carried(by, piece, motion.c, Directions(outer), tangent), every[-1])
        parts = mu, pulled.outer, pulled.controls.ravel(), [pulled.loss], every.ravel()
        found.append(np.concatenate(parts))
    assert np.abs(found[0] - found[1]).max() < 1e-12 * np.abs(found[1]).max()


@NEEDS_CORE
@pytest.mark.parametrize("every", [1, 100_000])
def test_a_hundred_thousand_midpoint_steps_turn_the_gradient_by_their_angle(every):
    """q_N = q0 cos(N θ) + v0 sin(N θ) with θ = 2 arctan(h ω / 2), ω² = k."""
    q, v = vi.coordinates("x")
    c = vi.Parameters(k=1.7)
    spring = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c)
    h, steps, omega = 0.03, 100_000, np.sqrt(1.7)
    start = dict(q0=[0.7], v0=[-0.4], h=h, steps=steps, save_every=every)
    motion = vi.simulate(spring, vi.gauss(1), **start)
    found = vi.gradient(motion, terminal_loss=q, backend="native")
    angle = 2 * steps * np.arctan(h * omega / 2)
    of_omega = steps * h / (1 + (h * omega / 2) ** 2)
    amplitude = -0.4 / omega
    by_angle = -0.7 * np.sin(angle) + amplitude * np.cos(angle)
    by_omega = by_angle * of_omega - amplitude / omega * np.sin(angle)
    assert abs(found.q0[0] - np.cos(angle)) < 1e-11
    assert abs(found.v0[0] - np.sin(angle) / omega) < 1e-11
    assert abs(found.params["k"] - by_omega / (2 * omega)) < 1e-10 * of_omega


def test_only_linear_scenes_of_few_unknowns_are_one_map():
    assert has_linear_sweep(hanging_springs(64), vi.gauss(2))  # 128 unknowns
    assert not has_linear_sweep(hanging_springs(65), vi.gauss(2))
    q, v = vi.coordinates("x")
    pendulum = vi.System(q, v, v**2 / 2 + ca.cos(q))
    spring = vi.System(q, v, v**2 / 2 - q**2 / 2)
    loops = [sweeper(spring, vi.gauss(2), steps, "native").kernels for steps in (7, 8)]
    assert loops[0] != loops[1]  # four steps for each unknown repay the map
    assert has_linear_sweep(spring, vi.gauss(2)) and not has_linear_sweep(pendulum, vi.gauss(2))
    assert not has_linear_sweep(spring, vi.composition("verlet"))


@NEEDS_CORE
@pytest.mark.long
def test_compiled_maps_give_the_same_bytes():
    system, u = pushed_springs(), np.full((21, 1), 0.2)
    motion = vi.simulate(system, vi.gauss(2), q0=[0.4, -0.3], v0=[0.2, 0.5], h=0.1, steps=21, u=u)
    loss = system.q[0] ** 4 + system.control * system.v[1]
    found = [vi.gradient(motion, loss, system.q[1], backend=x) for x in ("native", "compiled")]
    for name in ("q0", "v0", "u", "h", "t0", "value"):
        one, two = (getattr(x, name) for x in found)
        assert np.array_equal(one, two), name
    one, two = (vi.sensitivity(motion, ["q0", "m", "u"], backend=x) for x in ("native", "compiled"))
    assert np.array_equal(one, two)
