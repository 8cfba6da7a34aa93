"""Systems as plain data: what comes back is the same system to the last bit, and nothing but
arithmetic comes back.
"""

from __future__ import annotations

import json
import math

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, henon_heiles, rocking

import varint as vi
from varint.codegen import source as kernels
from varint.codegen.algebra import graph_of
from varint.codegen.graph import NotCompilable
from varint.integration.compiled_loop import kernel_of
from varint.integration.plan import plan
from varint.numerics.operations import BINARY, UNARY, expressions_of, operations_of
from varint.scene.description import parts_of
from varint.scene.serialisation import describe, expression_as_data, identity, revive, rule_of

NUMBERS = [0.1, -1e-300, 5e-324, 2.0, -3.0, 1e308, math.inf, -math.inf, math.nan, 1 / 3]


def systems() -> dict[str, vi.System]:
    """Every scene of the catalogues: models, and the phases of control problems."""
    found = {name: make().system for name, make in vi.models.catalogue.items()}
    for name, make in vi.models.control_catalogue.items():
        found |= {f"{name}:{i}": phase.system for i, phase in enumerate(make().phases)}
    return found


@pytest.fixture(scope="module")
def catalogue():
    return systems()


NAMES = [*vi.models.catalogue, *(f"{name}:0" for name in vi.models.control_catalogue)]


def again(system: vi.System) -> vi.System:
    """The system after a way through a file."""
    return revive(json.loads(json.dumps(describe(system))))


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_comes_back_with_its_operations_names_and_identity(catalogue, name):
    system = catalogue[name]
    back = again(system)
    assert describe(back) == describe(system)
    assert identity(back, vi.gauss(2)) == identity(system, vi.gauss(2))
    assert (back.names, back.control_names) == (system.names, system.control_names)
    for part in ("lagrangian", "force", "constraint", "nonholonomic", "contact"):
        one, other = (getattr(s, part).sparsity() for s in (back, system))
        assert one == other, part
    for key, value in system.defaults.items():
        assert back.defaults[key].tobytes() == value.tobytes()
        assert back.defaults[key].shape == value.shape
    assert back.restitution.tobytes() == system.restitution.tobytes()
    for derived in ("energy", "momentum"):
        f, g = (
            operations_of(ca.Function("f", [s.q, s.v, s.t, s.control, s.c], [getattr(s, derived)]))
            for s in (system, back)
        )
        assert repr(f) == repr(g), derived


@pytest.mark.filterwarnings("ignore::UserWarning")  # of redundant rows and of energies
@pytest.mark.parametrize("name", list(vi.models.catalogue))
def test_every_model_moves_by_the_same_bytes_when_it_has_come_back(name):
    model = vi.models.catalogue[name]()
    start = dict(q0=model.q0, v0=model.v0, h=model.h, steps=12, backend="interpreted")
    controls = model.system.structure.controls
    start |= {"u": np.full(controls, 0.1)} if controls else {}
    start |= {"v0": None} if model.system.structure.degenerate else {}
    one, other = (vi.simulate(s, **start) for s in (model.system, again(model.system)))
    for array in ("t", "q", "p", "v", "energy", "multipliers"):
        assert getattr(one, array).tobytes() == getattr(other, array).tobytes(), array


class Seen(Exception):
    """Carries the C source that would have been compiled."""


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_gives_the_same_c_source_when_it_has_come_back(catalogue, name, monkeypatch):
    """The same source is the same library, and the same bytes."""

    def caught(source, contraction):
        raise Seen(source)

    monkeypatch.setattr(kernels, "library", caught)
    sources = []
    for system in (catalogue[name], again(catalogue[name])):
        if system.structure.contacts:
            pytest.skip("contacts have no source of their own")
        with pytest.raises((Seen, NotCompilable)) as found:
            kernel_of(system, plan(system).rule)
        sources.append(str(found.value))
    assert sources[0] == sources[1]


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (double_pendulum, vi.gauss(2)),
        (henon_heiles, vi.composition("verlet")),
        (double_pendulum, vi.gauss(1)),
    ],
)
def test_compiled_runs_give_the_same_bytes(make, rule):
    start = dict(q0=[0.3, 0.2], v0=[0.1, 0], h=0.01, steps=300, backend="compiled")
    one, other = (vi.simulate(s, rule, **start) for s in (make(), again(make())))
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()


def test_numbers_come_back_to_the_bit_infinities_and_all():
    q, v = vi.coordinates("x")
    terms = [ca.fmin(ca.SX(x) * q, ca.SX(x)) for x in NUMBERS]
    c = vi.Parameters(a=-0.0, b=[[0.1, 1 / 3]], e=np.zeros((2, 1)), f=[5e-324])
    system = vi.System(
        q, v, v**2 / 2 + sum(terms) + c.a * c.b[0, 1] + c.e[1] + c.f, params=c, t=ca.SX.sym("τ")
    )
    back = again(system)
    constants = [x[1] for x in describe(back)["operations"] if x[0] == "const"]
    assert constants == [x[1] for x in describe(system)["operations"] if x[0] == "const"]
    for x in NUMBERS:
        assert x.hex() in constants
    assert np.signbit(back.defaults["a"]) and back.defaults["b"].shape == (1, 2)
    assert back.t.name() == "τ"


def test_every_known_operation_comes_back_as_itself():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    for name in sorted(UNARY | BINARY):
        code = getattr(ca, f"OP_{name.upper()}")
        e = ca.SX.unary(code, x) if name in UNARY else ca.SX.binary(code, x, y)
        q, v = vi.coordinates("x")
        c = vi.Parameters(y=0.5)
        term = ca.substitute(e, ca.vertcat(x, y), ca.vertcat(q, c.y))
        system = vi.System(q, v, v**2 / 2 + term, params=c)
        assert describe(again(system)) == describe(system), name
        f = ca.Function("f", [x, y], [e])
        at = parts_of(describe(system))
        g = ca.Function("g", [at["q"], at["params"].y, at["v"]], [at["lagrangian"]])
        value, wanted = float(g(0.3, 0.7, 0.0)), float(f(0.3, 0.7))
        assert value == wanted or math.isnan(value) == math.isnan(wanted), name


def test_structural_zeros_and_stored_zeros_stay_what_they_are():
    q, v = vi.coordinates("x", "y", "z")
    rows = ca.SX(2, 3)
    rows[0, 2], rows[1, 0] = q[0], 0  # the second is stored
    force = ca.SX(3, 1)
    force[1] = -v[1]
    system = vi.System(q, v, ca.sumsqr(v) / 2, nonholonomic=rows, force=force)
    back = again(system)
    assert back.nonholonomic.sparsity() == system.nonholonomic.sparsity()
    assert back.force.nnz() == 1 and back.nonholonomic.nnz() == 2


def test_what_calls_a_function_is_refused_with_what_to_do():
    q, v = vi.coordinates("x")
    x = ca.SX.sym("x")
    hidden = ca.Function("hidden", [x], [ca.sin(x)], {"never_inline": True})
    system = vi.System(q, v, v**2 / 2 + hidden(q))
    with pytest.raises(vi.VarintError, match=r"'call', which is no arithmetic.*never_inline"):
        describe(system)
    with pytest.raises(NotCompilable, match="interpreted"):
        graph_of(ca.Function("f", [q], [hidden(q)]))
    with pytest.raises(NotCompilable, match="erfinv has no form in C"):
        graph_of(ca.Function("f", [q], [ca.erfinv(q)]))


@pytest.mark.parametrize("make", (vi.models.four_bar, double_pendulum, vi.models.rolling_disc))
def test_operations_are_read_the_same_where_places_are_used_again_and_where_not(make):
    s = getattr(make(), "system", None) or make()
    inputs, outputs = [s.q, s.v, s.t, s.control, s.c], [s.lagrangian, s.momentum]
    again, once = (
        ca.Function("f", inputs, [ca.densify(x) for x in outputs], {"live_variables": live})
        for live in (True, False)
    )
    assert again.sz_w() < once.sz_w()
    assert operations_of(again) == operations_of(once)
    values = [np.random.default_rng(3).uniform(0.5, 1, x.shape) for x in inputs]
    back = ca.Function("f", inputs, expressions_of(operations_of(once), inputs))
    for one, other in zip(back.call(values), again.call(values), strict=True):
        assert np.array_equal(np.array(one), np.array(other))


def test_a_chain_of_a_hundred_thousand_operations_comes_back():
    q, v = vi.coordinates("x")
    e = q
    for i in range(50_000):
        e = ca.sin(e) + (i % 7)
    system = vi.System(q, v, v**2 / 2 + e)
    assert describe(again(system)) == describe(system)


def test_rotated_scenes_with_contacts_keep_their_restitution():
    system = rocking()
    assert again(system).restitution.tolist() == system.restitution.tolist()


def test_restitution_that_is_a_parameter_stays_one():
    q, v = vi.coordinates("y")
    c = vi.Parameters(e=0.8)
    system = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=c.e**2, params=c)
    back = again(system)
    assert describe(back) == describe(system)
    run = dict(q0=1.0, v0=0.0, h=0.1, steps=40, params=dict(e=0.6))
    one, other = (vi.simulate(x, vi.lobatto(2), **run) for x in (system, back))
    assert one.q.tobytes() == other.q.tobytes() and len(one.events) > 1


def test_expressions_as_text_differ_where_their_seventh_digit_does():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2)
    texts = {
        expression_as_data(system, e, "it")
        for e in (q - 1.0000001, q - 1.0000002, q - 1, 1 - q, v - 1, ca.sin(q) - 1)
    }
    assert len(texts) == 6
    other, _ = vi.coordinates("x")
    assert expression_as_data(system, other - 1, "it") == expression_as_data(system, q - 1, "it")


BROKEN = [
    ("operations", [["sin", 0]]),  # of itself
    ("operations", [["input", 0, 0], ["sin", 2], ["sin", 1]]),  # a circle
    ("operations", [["input", 0, 7]]),
    ("operations", [["input", 9, 0]]),
    ("operations", [["input", -1, 0]]),
    ("operations", [["input", 0]]),
    ("operations", [["input", True, 0]]),
    ("operations", [["input", 0, 0], ["sin", -1]]),
    ("operations", [["input", 0, 0], ["sin", 0.0]]),
    ("operations", [["input", 0, 0], ["sin", 0, 0]]),
    ("operations", [["input", 0, 0], ["mul", 0]]),
    ("operations", [["input", 0, 0], ["system", 0]]),
    ("operations", [["input", 0, 0], ["call", 0]]),
    ("operations", [["input", 0, 0], ["printme", 0, 0]]),
    ("operations", [["const", "nonsense"]]),
    ("operations", [["const", 1.0]]),
    ("operations", [["const"]]),
    ("operations", [["const", "0x1p99999"]]),
    ("operations", [[]]),
    ("operations", [7]),
    ("operations", {"a": 1}),
    ("operations", None),
    ("symbols", {"q": ["x"], "v": ["w"]}),
    ("symbols", {"q": "xy", "v": ["a", "b"], "t": ["t"], "control": []}),
    ("symbols", {"q": [1], "v": ["a"], "t": ["t"], "control": []}),
    ("symbols", {"q": ["\ud800"], "v": ["a"], "t": ["t"], "control": []}),
    ("symbols", {"q": ["x"], "v": ["x"], "t": ["t"], "control": []}),
    ("symbols", {"q": [], "v": [], "t": ["t"], "control": []}),
    ("symbols", 3),
    ("parameters", [{"name": "a", "shape": [2], "values": [1.0]}]),
    ("parameters", [{"name": "a", "shape": [-1], "values": [1.0]}]),
    ("parameters", [{"name": "a", "shape": [-1, -1], "values": [1.0]}]),
    ("parameters", [{"name": "a", "shape": [1, 1, 1], "values": [1.0]}]),
    ("parameters", [{"name": "a", "shape": [10**30], "values": []}]),
    ("parameters", [{"name": "a", "shape": [], "values": [math.nan]}]),
    ("parameters", [{"name": "a", "shape": [], "values": [1.0]}] * 2),
    ("parameters", [{"name": 3, "shape": [], "values": [1.0]}]),
    ("parameters", [{"shape": [], "values": [1.0]}]),
    ("restitution", [0.5]),
    ("restitution", [10**400]),
    ("restitution", "much"),
    ("expressions", {}),
    ("expressions", {"lagrangian": {"shape": [1, 1], "places": [0], "nodes": [0]}}),
]
SHAPES = [
    {"shape": [10**9, 10**9], "places": [], "nodes": []},
    {"shape": [-1, 1], "places": [], "nodes": []},
    {"shape": [2, 1], "places": [1, 0], "nodes": [0, 0]},
    {"shape": [2, 1], "places": [0, 0], "nodes": [0, 0]},
    {"shape": [2, 1], "places": [0, 2], "nodes": [0, 0]},
    {"shape": [2, 1], "places": [0], "nodes": [0, 0]},
    {"shape": [1, 1], "places": [0], "nodes": [10**6]},
    {"shape": [1, 1], "places": [0], "nodes": [-1]},
    {"shape": [1], "places": [0], "nodes": [0]},
    {"shape": [1, 1, 1], "places": [0], "nodes": [0]},
    {"shape": [math.nan, 1], "places": [0], "nodes": [0]},
    {"places": [0], "nodes": [0]},
]


def data_of_a_system() -> dict:
    return json.loads(json.dumps(describe(henon_heiles())))


@pytest.mark.parametrize(("field", "value"), BROKEN)
def test_descriptions_of_no_system_are_refused(field, value):
    with pytest.raises(vi.InputError):
        revive(data_of_a_system() | {field: value})


@pytest.mark.parametrize("output", SHAPES)
@pytest.mark.parametrize("part", ["lagrangian", "force", "constraint", "nonholonomic", "contact"])
def test_impossible_shapes_are_refused(part, output):
    data = data_of_a_system()
    data["expressions"][part] = output
    with pytest.raises(vi.InputError):
        revive(data)


@pytest.mark.parametrize("data", [None, 3, "system", [], {}, {"q": 1}, {"functions": "x"}])
def test_what_is_no_description_at_all_is_refused(data):
    with pytest.raises(vi.InputError):
        revive(data)


@pytest.mark.parametrize(
    "change",
    [
        dict(nodes=[math.nan] * 2),
        dict(nodes=[1e308, 1e308], weights=[1e308, -1e308]),
        dict(nodes=["a", "b"]),
        dict(nodes=[0.5] * 10**4, weights=[1e-4] * 10**4),
        dict(order="two"),
        dict(name=None),
        dict(weights=[0.5]),
        dict(points=[0.0, 2.0]),
        dict(nodes=None),
    ],
)
def test_rules_that_are_none_are_refused(change):
    data = json.loads(json.dumps(vars(vi.gauss(2)), default=list))
    whole = {key: data[key] for key in ("name", "order", "nodes", "weights", "points")}
    whole |= {"kicks": [], "drifts": []}
    assert rule_of(whole) == vi.gauss(2)
    with pytest.raises(vi.InputError):
        rule_of(whole | change)
    for key in whole:
        with pytest.raises(vi.InputError):
            rule_of({name: x for name, x in whole.items() if name != key})
