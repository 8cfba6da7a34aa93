"""Large machines with loops: a matrix near the derivative, the same steps."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.multibody as mb
from varint.codegen import frozen
from varint.codegen.cache import compiler
from varint.codegen.newton import newton_scheme

AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1))


def ring(hinges: int, **joint: mb.Passive) -> mb.Model:
    """A floating trunk with two arms that hold each other."""
    world, half = mb.Model(), hinges // 2
    world.free(world, world.body(10.0, (0, 0, 0.1), (1, 1, 0.5), "trunk"))
    last, hands = "trunk", []
    for i in range(hinges):
        begins = i % half == 0
        parent = "trunk" if begins else last
        at = (0, 0.2 * (i // half) - 0.1, 0) if begins else (0, 0, -0.15)
        last = world.body(1.0, (0.02, 0.01, -0.08), (0.01, 0.012, 0.005), f"link{i}").name
        world.revolute(parent, last, AXES[i % 3], at, **joint)
        if i % half == half - 1:
            hands.append((last, (0, 0.1 - 0.2 * (i // half), -0.15)))
    world.loop("point", *hands)
    return world


@pytest.mark.long
def test_the_frozen_inertia_leads_to_the_same_steps(monkeypatch):
    """Beside Newton's method with the whole derivative, and in few iterations."""
    runs = []
    for large in (frozen.LARGE, 1000):
        monkeypatch.setattr(frozen, "LARGE", large)
        model = ring(6)
        scene = model.system()
        assert frozen.freezes(scene) == (large < 1000)
        start = mb.start_values(model, {}, {"trunk": [0.1, 0.2, 0.3, 1, 2, 3]})
        q0, v0 = vi.project(scene, *start)
        runs.append(vi.simulate(scene, vi.lobatto(3), q0=q0, v0=v0, h=2e-3, steps=20))
    assert abs(runs[0].q - runs[1].q).max() <= 1e-13
    assert abs(runs[0].v - runs[1].v).max() <= 1e-11
    assert runs[0].stats["iterations"] <= 8 * 20


@pytest.mark.long
@pytest.mark.parametrize("hinges", [12, 40])
def test_a_ring_that_floats_keeps_its_loop_and_energy(hinges):
    model = ring(hinges)
    scene = model.system()
    start = mb.start_values(model, {}, {"trunk": [0.1, 0.2, 0.3, 1, 2, 3]})
    q0, v0 = vi.project(scene, *start)
    motion = vi.simulate(scene, q0=q0, v0=v0, h=2e-3, steps=100, backend="native")
    gaps = ca.Function("g", [scene.q], [scene.constraint])
    assert max(abs(np.array(gaps(q))).max() for q in motion.q) <= 1e-14
    assert motion.stats["iterations"] <= 8 * 100
    assert np.ptp(motion.energy) <= 1e-8 * abs(motion.energy[0])
    assert abs(np.linalg.norm(motion.q[:, 3:7], axis=1) - 1).max() <= 1e-15


@pytest.mark.long
def test_the_default_call_of_a_ring_runs_and_steps_too_large_end_with_a_reason():
    """Nothing here takes whole derivatives of L, which would take a minute to set up."""
    model = ring(6)
    scene = model.system()
    start = mb.start_values(model, {}, {"trunk": [0.1, 0.2, 0.3, 1, 2, 3]})
    q0, v0 = vi.project(scene, *start)
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=0.2)
    assert motion.stats["rule"] == "lobatto(3)" and motion.stats["error_estimate"] <= 1e-9
    exact = vi.simulate(scene, vi.lobatto(3), q0=q0, v0=v0, duration=0.2, steps=1600)
    assert abs(motion.q[-1] - exact.q[-1]).max() <= 2e-9
    with pytest.raises(vi.ConvergenceError, match="h is too large"):
        vi.simulate(scene, vi.lobatto(3), q0=q0, v0=v0, h=0.5, steps=20)


@pytest.mark.long
def test_the_default_call_of_a_stiff_ring_takes_steps_that_are_stable():
    """Lobatto rules of three nodes are stable up to h ω = √8; the springs' ω is about 1000 here."""
    model = ring(6, passive=mb.Passive(stiffness=1e4))
    scene = model.system()
    q0, v0 = vi.project(scene, *mb.start_values(model, {}, {"trunk": [0.01, 0.02, 0.03, 1, 2, 3]}))
    motion = vi.simulate(scene, q0=q0, v0=v0, duration=0.1, tol=1e-6)
    assert motion.stats["error_estimate"] <= 1e-6
    exact = vi.simulate(scene, vi.lobatto(3), q0=q0, v0=v0, duration=0.1, steps=4096)
    assert abs(motion.q[-1] - exact.q[-1]).max() <= 2e-6
    with pytest.raises(vi.ConvergenceError, match="h is too large"):
        vi.simulate(scene, vi.lobatto(3), q0=q0, v0=v0, h=0.02, steps=20)


@pytest.mark.long
def test_a_chain_that_moves_violently_runs_by_tolerance_and_says_why_a_step_fails():
    """Where the stages' iteration fails shorter steps are taken; whole derivatives of the links'
    L would take minutes.
    """
    links = np.arange(30)
    world, last = mb.Model(gravity=(0, 0, 0)), "world"
    for i in links:
        body = world.body(1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}").name
        world.revolute(last, body, AXES[i % 3], (0, 0, -1 if i else 0))
        last = body
    scene, start = world.system(), {"q0": 0.3 * np.cos(links), "v0": np.sin(links)}
    motion = vi.simulate(scene, **start, duration=0.2)
    assert abs(motion.v).max() > 5.0
    assert motion.stats["error_estimate"] <= 1e-9
    assert np.ptp(motion.energy) <= 1e-11 * abs(motion.energy[0])
    large = {"h": 0.05, "steps": 10, "backend": "native"} | start
    with pytest.raises(vi.ConvergenceError, match=r"h is too large|try a smaller h"):
        vi.simulate(scene, vi.gauss(2), **large)
    with pytest.raises(vi.InputError, match="give tol in place of h"):
        vi.simulate(scene, vi.gauss(2), on_failure="subdivide", **large)


def four_bars() -> mb.Model:
    world, rod = mb.Model(), {"inertia": (0, 1 / 12, 1 / 12)}
    for name, foot in (("crank", 0.0), ("rocker", 1.5)):
        body = world.body(1.0, (0.5, 0, 0), **rod, name=name)
        world.revolute(world, body, (0, -1, 0), (foot, 0, 0))
    coupler = world.body(1.0, (0.5, 0, 0), **rod, name="coupler")
    world.revolute("crank", coupler, (0, -1, 0), (1, 0, 0))
    world.loop("point", ("coupler", (1, 0, 0)), ("rocker", (1, 0, 0)))
    return world


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize(
    "bars", [pytest.param(True), pytest.param(False, marks=pytest.mark.long)], ids=["four", "ring"]
)
def test_a_frozen_matrix_gives_the_same_bytes_in_both_gears(bars, monkeypatch):
    """A four-bar, and a ring of 12 hinges that floats."""
    if bars:
        monkeypatch.setattr(frozen, "LARGE", 3)
        scene = four_bars().system()
        q0, v0 = vi.project(scene, [1.2, 1.9, -1.2], [1.0, 0, 0])
    else:
        model = ring(12)
        scene = model.system()
        start = mb.start_values(model, {}, {"trunk": [0.1, 0.2, 0.3, 1, 2, 3]})
        q0, v0 = vi.project(scene, *start)
    rule = vi.lobatto(2 if bars else 3)
    assert newton_scheme(scene, rule).counts["FROZEN"]
    run = {"q0": q0, "v0": v0, "h": 2e-3, "steps": 60}
    one, other = (
        vi.simulate(scene, rule, **run, backend=backend) for backend in ("native", "compiled")
    )
    assert one.stats["backend"].startswith("native: ")
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()
    assert one.multipliers.tobytes() == other.multipliers.tobytes()
    assert one.stats["iterations"] == other.stats["iterations"]
