"""When to compile: from the scene, the rule and the number of steps alone."""

import itertools

import casadi as ca
import pytest

import varint as vi
import varint.multibody as mb
from varint.codegen import gauss, instructions, newton
from varint.codegen.cache import has_instructions
from varint.codegen.gauss import gauss_source
from varint.codegen.newton import newton_source
from varint.integration import backend, compiled_loop, cost
from varint.integration.cost import (
    EXPLICIT_STARTING,
    EXPLICIT_STATEMENT,
    STARTING,
    STATEMENT,
    compiling_seconds,
    interpreted_run_seconds,
    newton_repays,
    repays,
)


def double_pendulum():
    q, v = vi.coordinates("a", "b")
    x = ca.vertcat(ca.sin(q[0]), -ca.cos(q[0]))
    y = x + 0.7 * ca.vertcat(ca.sin(q[1]), -ca.cos(q[1]))
    kinetic = ca.sumsqr(ca.jtimes(x, q, v)) / 2 + 1.3 * ca.sumsqr(ca.jtimes(y, q, v)) / 2
    return vi.System(q, v, kinetic - 2 * x[1] - 3 * y[1])


def bodies(count):
    q, v = vi.coordinates(*[f"{a}{i}" for i in range(count) for a in "xy"])
    at = [q[2 * i : 2 * i + 2] for i in range(count)]
    distances = [ca.norm_2(at[i] - at[j]) for i in range(count) for j in range(i)]
    pull = sum(1 / d for d in distances)
    return vi.System(q, v, ca.sumsqr(v) / 2 + pull), 1 / ca.sqrt(sum(d**-2 for d in distances))


def rods(count):
    """Point masses on rods."""
    q, v = vi.coordinates(*[f"{a}{i}" for i in range(count) for a in "xy"])
    at = [ca.SX.zeros(2), *(q[2 * i : 2 * i + 2] for i in range(count))]
    lengths = [ca.sumsqr(b - a) - 1 for a, b in itertools.pairwise(at)]
    return vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.vertcat(*lengths))


@pytest.mark.parametrize("rule", (vi.gauss(4), vi.lobatto(3), vi.composition("verlet")), ids=str)
def test_auto_compiles_nothing_that_takes_longer_than_it_saves(rule):
    """From some number of steps on it compiles, never below the predicted time of the compiler."""
    system = rods(12) if rule == vi.lobatto(3) else bodies(4)[0]
    needed = next(n for n in range(1, 40) if repays(system, rule, 2**n))
    assert needed > 1
    assert interpreted_run_seconds(system, rule, 2**needed) > compiling_seconds(system, rule)
    assert not repays(system, rule, 2 ** (needed - 1))


@pytest.fixture
def in_c(monkeypatch, forget):
    """As on other processors."""
    for module in (instructions, cost):
        monkeypatch.setattr(module, "has_instructions", lambda: False)


def test_larger_expressions_take_longer_to_compile(in_c):
    rules = (vi.gauss(2), vi.lobatto(2), vi.lobatto(3))
    for rule in rules:
        scenes = [rods(n) if rule != rules[0] else bodies(n)[0] for n in (3, 6, 12)]
        times = [compiling_seconds(scene, rule) for scene in scenes]
        assert times == sorted(times) and times[2] > 1.5 * times[0]


def test_the_choice_follows_from_scene_rule_and_steps(monkeypatch):
    """8,000 steps by gauss(4) of a double pendulum, and seven bodies with a time scale, compile."""
    assert repays(double_pendulum(), vi.gauss(4), 8000)
    assert not repays(double_pendulum(), vi.gauss(4), 1000)
    scene, scale = bodies(7)
    asked = []
    monkeypatch.setattr(compiled_loop, "kernel_in_gear", lambda *about: None)
    monkeypatch.setattr(backend, "repays", lambda *about: asked.append(about))
    q0 = [3, 3, 3, -3, -1, 2, -3, 0, 2, 0, -2, -4, 2, 4]
    start = {"q0": q0, "v0": [0.1] * 14, "h": 0.01, "steps": 2}
    vi.simulate(scene, vi.gauss(2), **start, time_scale=scale)
    ((transformed, _, steps),) = asked  # the scene with the time among its coordinates decides
    assert (transformed.structure.n, steps) == (15, 2)
    assert repays(transformed, vi.gauss(8), 400)
    assert not repays(transformed, vi.gauss(2), 2)


def test_newtons_method_is_compiled_after_a_failure_only_where_that_pays(in_c):
    large, _ = bodies(9)
    assert newton_repays(large, vi.gauss(4), 10**6)
    assert not newton_repays(large, vi.gauss(4), 100)
    assert newton_repays(double_pendulum(), vi.gauss(4), 1)  # quick


def statements(module, source, system, rule, monkeypatch):
    """Statements of C of the functions that `source` hands to its loop."""
    found = []
    monkeypatch.setattr(
        module,
        "source_of",
        lambda about, s, nodes, functions, *rest, **more: found.append(functions),
    )
    source.__wrapped__(system, rule)
    return sum(f.length for f in found[0].values())


@pytest.mark.parametrize(
    "scene",
    (
        lambda: (double_pendulum(), vi.lobatto(3)),
        lambda: (bodies(7)[0], vi.lobatto(2)),
        lambda: (bodies(7)[0], vi.lobatto(3)),
        lambda: (rods(20), vi.lobatto(2)),
        lambda: (rods(20), vi.lobatto(3)),
        lambda: (vi.models.four_bar(loops=20).system, vi.lobatto(2)),
        lambda: (vi.models.four_bar(loops=20).system, vi.lobatto(3)),
        lambda: (vi.models.heavy_top().system, vi.lobatto(2)),
    ),
)
def test_the_prediction_is_never_below_half_of_what_is_written(scene, monkeypatch, in_c):
    """In statements of C, which the compiler's time is proportional to: functions are bounded."""
    system, rule = scene()
    written = statements(newton, newton_source, system, rule, monkeypatch)
    explicit = rule.kicks and system.structure.explicit
    starting = EXPLICIT_STARTING if explicit else STARTING
    statement = EXPLICIT_STATEMENT if explicit else STATEMENT
    predicted = (compiling_seconds(system, rule) - starting) / statement
    assert written / 2 < predicted < 6 * written


@pytest.mark.skipif(not has_instructions(), reason="another processor")
def test_what_is_written_as_instructions_is_predicted_to_take_less(monkeypatch, forget):
    """But not functions within a step of few unknowns, which stay in C."""

    def seconds(system, rule):
        forget()
        return compiling_seconds(system(), rule)

    scenes = ((lambda: rods(20), vi.lobatto(3)), (double_pendulum, vi.lobatto(2)))
    large, few = (seconds(*scene) for scene in scenes)
    monkeypatch.setattr(cost, "has_instructions", lambda: False)
    assert 3 * large < seconds(*scenes[0])
    assert few == seconds(*scenes[1])


def tree(links, parent_of, floating=False):
    """Links on hinges about y, x and z by turns, the first one's base floating or not."""
    world, names = mb.Model(), ["world"]
    if floating:
        world.free(world, world.body(10.0, (0, 0, 0.1), (1, 1, 0.5), "trunk"))
        names = ["trunk"]
    for i in range(links):
        names.append(world.body(1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}").name)
        axis = ((0, 1, 0), (1, 0, 0), (0, 0, 1))[i % 3]
        world.revolute(names[parent_of(i)], names[-1], axis, (0, 0, -1))
    return world.system()


@pytest.mark.parametrize(
    ("system", "rule"),
    (
        (lambda: tree(5, lambda i: i), vi.gauss(2)),
        (lambda: tree(14, lambda i: i), vi.gauss(2)),
        (lambda: tree(11, lambda i: (i - 1) // 2 + 1 if i else 0), vi.gauss(4)),
        (lambda: tree(6, lambda i: 0 if i % 3 == 0 else i, floating=True), vi.gauss(4)),
    ),
    ids=("short chain", "chain", "tree", "floating base"),
)
def test_the_prediction_of_trees_of_links_is_what_their_statements_take(system, rule, monkeypatch):
    """2.5e-4 seconds a statement of C, measured for 10 to 200 links: within a factor of 1.5."""
    system = system()
    measured = 0.33 + 2.5e-4 * statements(gauss, gauss_source, system, rule, monkeypatch)
    assert measured / 1.5 < compiling_seconds(system, rule) < 1.5 * measured
