"""∂L/∂q and ∂L/∂v by recursion against reverse differentiation of L, and what a step costs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machines import AXES, andrews, floating, many_joints, plane_chain, spatial_chain

import varint as vi
import varint.multibody as mb
from varint.codegen import mechanics
from varint.codegen.gauss import PRODUCT, gauss_scheme
from varint.multibody.grouped import grouped
from varint.multibody.tree import tree_of
from varint.scene.kinetics import Kinetics


def branched(links: int, gravity: float = 0.0, chain: bool = False) -> mb.Model:
    """Each link carries the next, or two others."""
    world, names = mb.Model(gravity=(0, 0, -gravity)), ["world"]
    for i in range(links):
        names.append(world.body(1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}").name)
        parent = i if chain or not i else (i - 1) // 2 + 1
        world.revolute(names[parent], names[-1], AXES[i % 3], (0, 0, -1 if parent else 0))
    return world


def with_parameters() -> mb.Model:
    """Masses, places, inertias, springs and gravity that are no numbers, links that slide."""
    world = floating()
    world.prismatic("b1", world.body(2.0, (0.3, 0.1, 0.2), (1, 2, 2.5), "slide"), (1, 2, 0))
    world.revolute("slide", world.body(1.5, (0.1, 0.2, 0.4), (1, 1, 1.5), "end"), (0, 1, 1))
    world.spring(("b0", (0.1, 0, 0)), ("end", (0, 0.2, 0)), stiffness=3.0, rest=0.5, damping=0.2)
    world.symbolic("gravity", "b0.mass", "b1.com", "slide.inertia", "end.com", "end.position")
    return world


MACHINES = {
    "spatial chain": lambda: spatial_chain(7),
    "long chain": lambda: spatial_chain(20),
    "plane chain": lambda: plane_chain(4),
    "tree": lambda: branched(15, 9.81),
    "all joints": many_joints,
    "floating": floating,
    "loops": andrews,
    "parameters": with_parameters,
}


@pytest.mark.parametrize("name", MACHINES)
def test_slopes_are_those_of_the_lagrangian(name):
    """Whatever the lengths of quaternions, and for other parameters than the defaults; the least of
    a long chain's stand beside the largest.
    """
    s = MACHINES[name]().system()
    n, state = s.structure.n, ca.vertcat(s.q, s.v)
    reverse = ca.gradient(s.lagrangian, state)
    known = ca.vertcat(mechanics.force(s) - s.force, mechanics.momentum(s))
    both = ca.Function("both", [s.q, s.v, s.c], [reverse, known])
    random = np.random.default_rng(3)
    for _ in range(3):
        c = s.default_vector * (1 + 0.2 * random.normal(size=s.default_vector.size))
        true, found = (np.array(x).ravel() for x in both(*random.normal(size=(2, n)), c))
        for part in (slice(n), slice(n, 2 * n)):
            assert abs(found - true)[part].max() <= 3e-15 * abs(true[part]).max()


def test_a_link_that_turns_keeps_seven_numbers_of_its_inertia():
    model = branched(7)
    tree = tree_of(model.machine.bodies, model.machine.joints.values())
    for mass, moment, inertia in grouped(tree):
        assert mass.is_zero() and moment[2].is_zero() and inertia[1, 1].is_zero()


def test_slopes_of_kinetics_must_be_those_of_the_lagrangian():
    s = spatial_chain(3).system()
    parts, known = (s.q, s.v, s.lagrangian), s.kinetics
    wrong = known._replace(slopes=known.slopes + 1e-6 * s.v[0])
    with pytest.raises(vi.InputError, match="the slopes of kinetics is not that of the Lagr"):
        vi.System(*parts, kinetics=wrong)
    low = s.lagrangian - s.q[0] ** 2
    with pytest.raises(vi.InputError, match=r"with another potential give kinetics.of_other_pot"):
        vi.System(s.q, s.v, low, kinetics=known)
    assert vi.System(s.q, s.v, low, kinetics=known.of_other_potential()).kinetics.velocity.numel()
    with pytest.raises(vi.InputError, match=r"slopes of kinetics must be \(6,\) or empty"):
        vi.System(*parts, kinetics=Kinetics(known.mass_matrix, slopes=s.v))
    strange = known._replace(slopes=known.slopes + ca.SX.sym("x"))
    with pytest.raises(vi.InputError, match=r"the slopes of kinetics may not depend on \['x'\]"):
        vi.System(*parts, kinetics=strange)


def test_recursion_takes_fewer_operations_than_differentiation():
    """A further link costs at most two thirds of what it does in reverse."""

    def costs(links: int) -> np.ndarray:
        s = spatial_chain(links).system()
        reverse = ca.gradient(s.lagrangian, ca.vertcat(s.q, s.v))
        inputs = [s.q, s.v]
        functions = (
            ca.Function("f", inputs, [x], {"cse": True}) for x in (s.kinetics.slopes, reverse)
        )
        return np.array([f.n_instructions() for f in functions])

    recursive, reverse = costs(9) - costs(6)
    assert recursive <= 2 / 3 * reverse


@pytest.mark.long
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("chain", [True, False])
def test_operations_of_a_step_and_link_are_those_of_ten_within_thirty_percent(chain, gravity):
    """Of a hundred links: those of the links, and of every evaluation the products of each
    coordinate's and momentum's stages with the rule's coefficients.
    """

    def each(links: int, evaluations: int = 3) -> float:
        functions = gauss_scheme(branched(links, gravity, chain).system(), 2).functions
        sizes = {name: f.arrangement.sizes[name].operations for name, f in functions.items()}
        often = sizes["kick"] + sizes["drift"] + 2 * links * PRODUCT
        return (sizes["inertia"] + evaluations * often) / links

    assert 1.0 <= each(100) / each(10) <= 1.3
