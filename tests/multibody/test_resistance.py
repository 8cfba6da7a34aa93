"""Springs and dampers of machines so large that their whole derivatives are not taken."""

from __future__ import annotations

import casadi as ca
import numpy as np

import varint as vi
import varint.multibody as mb
from varint.codegen import frozen
from varint.integration.failures import failure
from varint.scene.description import description, parts_of

AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1))


def held_chain(links: int, passive: mb.Passive, **spring: float) -> mb.Model:
    """A chain whose joints resist, and a spring from its tip to the ceiling."""
    world, last = mb.Model(), "world"
    for i in range(links):
        last_at = (0, 0, -0.5 if i else 0)
        body = world.body(1.0, (0.05, 0.02, -0.3), (0.1, 0.12, 0.05), f"link{i}")
        world.revolute(last, body, AXES[i % 3], last_at, passive=passive)
        last = body.name
    world.spring("world", (last, (0, 0, -0.5)), **spring)
    return world


def test_what_resists_is_the_derivative_of_the_forces():
    """Where the spring has its rest length, nothing moves, and gravity is away."""
    passive = mb.Passive(stiffness=30.0, damping=2.0, friction=0.1)
    model = held_chain(3, passive, stiffness=50.0, rest=1.5, damping=4.0)
    model.machine.gravity = np.zeros(3)
    s = model.system()
    push = ca.gradient(s.lagrangian, s.q) + s.force
    exact = [-ca.jacobian(push, s.q), -ca.jacobian(push, s.v)]
    found = [s.kinetics.stiffness, s.kinetics.damping]
    q, v = np.zeros(3), np.zeros(3)
    both = ca.Function("both", [s.q, s.v], [*map(ca.densify, (*exact, *found))])(q, v)
    stiffness, damping, near, drag = map(np.array, both)
    assert np.allclose(drag, damping, rtol=1e-13, atol=1e-13 * abs(damping).max())
    assert np.allclose(near, stiffness, rtol=1e-13, atol=1e-12 * abs(stiffness).max())


def test_a_stiff_chain_too_large_for_whole_derivatives_takes_steps_beyond_its_period(monkeypatch):
    """The stages' iteration fails there, Newton's method with the chain's resistance does not, and
    ends at the step that whole derivatives lead to.
    """
    model = held_chain(4, mb.Passive(stiffness=1e5, damping=20.0), stiffness=1e4, damping=30.0)
    run = {"q0": 1e-3 * np.cos(np.arange(4)), "v0": np.zeros(4), "h": 0.02, "steps": 10}
    exact = vi.simulate(model.system(), vi.gauss(2), backend="interpreted", **run)
    monkeypatch.setattr(frozen, "LARGE_TREE", 4)
    scene = model.system()
    assert frozen.stiff_tree(scene)
    motion = vi.simulate(scene, vi.gauss(2), **run)
    assert abs(motion.q - exact.q).max() <= 1e-13
    assert motion.stats["iterations"] <= 30 * run["steps"]


def test_resistance_is_saved_with_its_scene():
    s = held_chain(2, mb.Passive(damping=1.0), stiffness=2.0).system()
    again = vi.System(**parts_of(description(s))).kinetics
    assert s.kinetics.stiffness.nnz() == again.stiffness.nnz() == 4
    assert s.kinetics.damping.nnz() == again.damping.nnz() == 2
    bare = mb.Model()
    bare.revolute(bare, bare.body(1.0, (0, 0, -1), 1.0))
    assert not vi.System(**parts_of(description(bare.system()))).kinetics.resists


def test_a_step_that_does_not_settle_is_not_said_to_miss_a_limit_that_it_keeps():
    model = vi.models.pendulum()
    motion = vi.simulate(model.system, vi.trapezoidal(), q0=1.0, v0=0.0, h=0.01, steps=5)
    assert "did not settle" in str(failure(motion, 5, 1.3e-12, None))
    assert "residual of 1.0e-05 (limit 1e-10)" in str(failure(motion, 5, 1e-5, None))
