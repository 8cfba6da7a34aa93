"""Blocks that repeat in long functions: an order of evaluation, forms that are written once, and
the bytes of what is written out.
"""

from functools import cache

import casadi as ca
import numpy as np
import pytest

import varint as vi
import varint.multibody as mb
from varint.codegen import emit, pieces
from varint.codegen.cache import compiler
from varint.codegen.dependence import needed, sine_and_cosine, uniform_nodes
from varint.codegen.emit import emit_graph
from varint.codegen.gauss import gauss_scheme
from varint.codegen.graph import operands
from varint.codegen.joined import join
from varint.codegen.repeats import Repeats

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1))


def chain(links, masses=lambda i: 1.0):
    """Links whose axes turn; their masses may differ, their joints' form does not."""
    world = mb.Model(gravity=(0, 0, -9.81))
    last = world
    for i in range(links):
        body = world.body(masses(i), (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}")
        world.revolute(last, body, AXES[i % 3], (0, 0, -1 if i else 0))
        last = body
    return world.system()


@cache
def functions(links):
    return gauss_scheme(chain(links), 2).functions


def blocks(routine):
    graph, last = routine.graph, routine.last
    live, uniform = needed(graph), uniform_nodes(graph, last)
    pairs = sine_and_cosine(graph, live, uniform)
    varying = [i for i in live if not uniform[i] and graph.nodes[i][0] != "input"]
    units = [pairs.get(i, (i,)) for i in varying if pairs.get(i) != (0, 0)]
    return units, Repeats(graph, units, uniform)


@pytest.mark.parametrize("joined", (False, True), ids=("blocks", "joined"))
@pytest.mark.parametrize("name", ("kick", "drift", "inertia"))
def test_blocks_follow_one_another_in_an_order_of_evaluation(name, joined):
    units, found = blocks(functions(12)[name])
    if joined:
        join(found)
    assert sorted(unit for block in found.order for unit in block) == sorted(units)
    known = set()
    for block in found.order:
        for unit in block:
            taken = operands(found.graph.nodes[unit[0]])
            assert all(j in known or not found.varying(j) for j in taken)
            known |= set(unit)


def test_what_is_written_does_not_grow_with_the_links():
    """Of twice the links only the tables are twice as long."""
    lengths = []
    for links in (18, 36):
        units, found = blocks(functions(links)["inertia"])
        join(found)
        lengths.append(found.written())
    assert lengths[1] < 1.2 * lengths[0]
    assert 3 * lengths[1] < len(units)


@needs_compiler
@pytest.mark.parametrize(
    ("scene", "least"),
    (
        (lambda: (chain(6, lambda i: 1 + i), 0.3 * np.sin(np.arange(6.0))), 250),
        (lambda: (vi.models.toda_chain(24).system, np.sin(np.arange(24.0))), 60),
    ),
    ids=("links of different masses", "sites of a Toda chain"),
)
def test_blocks_give_the_bytes_of_what_is_written_out(scene, least, monkeypatch, forget):
    def motion():
        forget()
        system, q0 = scene()
        rule, start = vi.gauss(2), {"q0": q0, "v0": np.zeros(len(q0))}
        return vi.simulate(system, rule, **start, h=0.01, steps=40, backend="compiled").q

    whole = motion()
    written = []
    monkeypatch.setattr(emit, "LARGEST", least)
    monkeypatch.setattr(emit, "worth_it", lambda blocks, parts: True)
    monkeypatch.setattr(pieces, "SHORT", 0)
    monkeypatch.setattr(pieces, "REPEATED", 100.0)
    monkeypatch.setattr(
        emit, "emit_graph", lambda *a: written.append(emit_graph(*a)) or written[-1]
    )
    assert motion().tobytes() == whole.tobytes()
    assert any("switch (" in f.source for f in written)


def test_blocks_that_are_met_once_are_not_worth_it():
    f = gauss_scheme(chain(2), 2).functions["inertia"]
    assert pieces.repeats_of(f.graph, needed(f.graph), uniform_nodes(f.graph, f.last)) is None


def test_pairs_of_bodies_that_take_more_to_fetch_than_to_compute_stay_in_parts():
    q, v = vi.coordinates(*(f"{axis}{i}" for i in range(20) for axis in "xyz"))
    apart = [q[3 * i : 3 * i + 3] - q[3 * j : 3 * j + 3] for i in range(20) for j in range(i)]
    lagrangian = ca.sumsqr(v) / 2 + sum(1 / ca.norm_2(r) for r in apart)
    f = gauss_scheme(vi.System(q, v, lagrangian), 2).functions["rhs"]
    assert "switch (" not in emit_graph("f", f.graph, f.last).source
