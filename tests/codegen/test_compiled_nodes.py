"""Long equations of a step as a loop over the rule's nodes, and bands that stay narrow."""

import itertools

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import newton, nodes
from varint.codegen.arguments import DONE
from varint.codegen.cache import compiler
from varint.codegen.kernel import run_loop
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_kernel, newton_source
from varint.discrete.shake_equations import eliminates_path
from varint.integration.problem import RunOptions, Start, initial_value_problem

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def driven():
    """Coupled inertia, damping, time, a control and parameters."""
    q, v = vi.coordinates("a", "b")
    t, c, u = vi.time(), vi.Parameters(k=1.3), ca.SX.sym("u")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + 0.5 * ca.cos(q[0] - q[1]) * v[0] * v[1]
    potential = c.k * (2 - ca.cos(q[0]) - ca.cos(q[1])) + 0.1 * q[0] * ca.sin(t)
    force = ca.vertcat(u * ca.cos(q[1]), -0.2 * v[1])
    return vi.System(q, v, kinetic - potential, force=force, control=u, params=c, t=t)


def held():
    """Two points on rods in a turning field, whose inertia depends on the place; damped, driven."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    t, c, u = vi.time(), vi.Parameters(g=9.81), ca.SX.sym("u")
    kinetic = ca.sumsqr(v) / 2 + 0.3 * ca.sumsqr(q[:2]) * v[2] ** 2 + 0.1 * q[0] * v[1] * v[2]
    lagrangian = kinetic + 0.4 * (q[0] * v[1] - q[1] * v[0]) - c.g * (q[1] + q[3])
    rods = ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 1 - 0.1 * ca.sin(t))
    force = ca.vertcat(u * q[1], -0.2 * v[1], 0, -0.1 * v[2])
    return vi.System(q, v, lagrangian, constraint=rods, force=force, control=u, params=c, t=t)


def steady():
    """The same rods with constant inertia and no force but weight."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    rods = ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 1)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[3]), constraint=rods)


STARTS = {2: ([0.5, 1.0], [0.3, -0.2]), 4: ([0.6, -0.8, 1.6, -0.8], [0, 0, 0, 0])}
LOOPED = {"LOOPED": 0, "LOOPED_WITH_ANGLES": 0, "LOOPED_FREE": 0}
WRITTEN = dict.fromkeys(LOOPED, 10**9)


def rows(rule, monkeypatch, forget, steps=60, u=None, scene=driven, kernel=newton_kernel, **how):
    forget()
    system = scene()
    for name, value in how.items():
        monkeypatch.setattr(nodes, name, value)
    kernel = kernel(system, rule)
    q0, v0 = STARTS[system.structure.n]
    if system.structure.constraints:
        q0, v0 = vi.project(system, q0, v0, t0=0.3)
    start = {"q0": q0, "v0": v0, "p0": None}
    problem = initial_value_problem(
        system, rule, Start(**start, t0=0.3, u=u), RunOptions(h=0.05, steps=steps)
    )
    controls = problem.controls(0, steps) if kernel.controls else None
    found = run_loop(
        kernel, problem.q0, problem.p0, problem.c, t0=0.3, h=0.05, steps=steps, u=controls
    )
    assert found.status == DONE
    return found.rows


@needs_compiler
@pytest.mark.parametrize("by_directions", (10**9, 0))
@pytest.mark.parametrize("rule", (vi.gauss(2), vi.gauss(4), vi.lobatto(3)), ids=str)
def test_a_loop_over_the_nodes_gives_what_the_written_out_equations_give(
    rule, by_directions, monkeypatch, forget
):
    u = np.random.default_rng(0).uniform(-1, 1, (60, 1))
    written = rows(rule, monkeypatch, forget, u=u, **WRITTEN)
    looped = rows(rule, monkeypatch, forget, u=u, **LOOPED, BY_DIRECTIONS=by_directions)
    assert np.abs(looped - written).max() < 1e-12


@needs_compiler
@pytest.mark.parametrize("by_directions", (10**9, 0))
@pytest.mark.parametrize("scene", (held, steady))
@pytest.mark.parametrize("rule", (vi.lobatto(3), vi.lobatto(5)), ids=str)
def test_constraints_hold_in_a_loop_over_the_nodes_as_in_equations_written_out(
    rule, scene, by_directions, monkeypatch, forget
):
    """The motion, and its bytes in both gears; only what is left at the end of a step is a loop."""
    u = np.random.default_rng(0).uniform(-1, 1, (60, 1)) if scene is held else None
    given = {"u": u, "scene": scene, "BY_DIRECTIONS": by_directions}
    written = rows(rule, monkeypatch, forget, **given, **WRITTEN, LOOPED_ENDS=10**9)
    for how in (WRITTEN, LOOPED):
        looped = [
            rows(rule, monkeypatch, forget, **given, **how, LOOPED_ENDS=0, kernel=kernel)
            for kernel in (newton_kernel, native_newton)
        ]
        assert looped[0].tobytes() == looped[1].tobytes()
        assert np.abs(looped[0] - written).max() < 1e-11


@needs_compiler
@pytest.mark.parametrize(
    "scene, rules, most",
    [(driven, [vi.gauss(s) for s in (2, 4, 8)], 1), (held, [vi.lobatto(s) for s in (3, 5, 9)], 3)],
)
def test_code_does_not_grow_with_the_number_of_nodes(scene, rules, most, monkeypatch, forget):
    """But for the tables of the rule and the sizes of the unknowns, one number each; those of the
    multipliers are summed besides.
    """
    emitted = []
    for name, value in LOOPED.items():
        monkeypatch.setattr(nodes, name, value)
    monkeypatch.setattr(
        newton,
        "source_of",
        lambda about, system, nodes, functions, *rest, **more: emitted.append(
            sum(f.length for f in functions.values())
        ),
    )
    system = scene()
    for rule in rules:
        newton_source.__wrapped__(system, rule)
    unknowns = system.structure.n + system.structure.constraints
    more = [unknowns * (b.degree - a.degree) for a, b in itertools.pairwise(rules)]
    grown = [b - a for a, b in itertools.pairwise(emitted)]
    assert all(x <= most * y for x, y in zip(grown, more, strict=True))


def rods(count):
    """Rods with mass between joints: M couples neighbours, so that its inverse is full."""
    q, v = vi.coordinates(*[f"{a}{i}" for i in range(count) for a in "xy"])
    at = [ca.SX.zeros(2), *(q[2 * i : 2 * i + 2] for i in range(count))]
    speed = [ca.SX.zeros(2), *(v[2 * i : 2 * i + 2] for i in range(count))]
    pairs = list(itertools.pairwise(speed))
    kinetic = sum(ca.sumsqr(a) + ca.dot(a, b) + ca.sumsqr(b) for a, b in pairs) / 6
    height = sum(a[1] + b[1] for a, b in itertools.pairwise(at)) / 2
    lengths = [ca.sumsqr(b - a) - 1 for a, b in itertools.pairwise(at)]
    return vi.System(q, v, kinetic - 9.81 * height, constraint=ca.vertcat(*lengths))


@needs_compiler
def test_rods_with_mass_keep_a_narrow_band_whatever_their_number(monkeypatch):
    reach = []
    monkeypatch.setattr(
        newton,
        "source_of",
        lambda about, system, nodes, functions, defines, *rest, **more: reach.append(
            (defines["BELOW"], defines["HIDDEN_BELOW"])
        ),
    )
    for count in (10, 20, 40):
        assert not eliminates_path(rods(count), vi.lobatto(2))
        newton_source.__wrapped__(rods(count), vi.lobatto(2))
    assert reach[0] == reach[1] == reach[2]
    assert max(reach[0]) <= 6


@needs_compiler
def test_rods_move_alike_however_their_positions_are_found():
    """Few rods are cheaper by their multipliers alone: the same discrete motion."""
    system = rods(3)
    assert eliminates_path(system, vi.lobatto(2))
    start = {"q0": [0.6, -0.8, 1.6, -0.8, 1.6, -1.8], "v0": np.zeros(6), "h": 0.01, "steps": 50}
    motions = [
        vi.simulate(system, vi.lobatto(2), **start, backend=backend)
        for backend in ("interpreted", "compiled")
    ]
    assert np.abs(motions[0].q - motions[1].q).max() < 1e-11


def test_point_masses_keep_their_multipliers_alone():
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    lengths = ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 1)
    assert eliminates_path(vi.System(q, v, ca.sumsqr(v) / 2, constraint=lengths), vi.lobatto(2))
