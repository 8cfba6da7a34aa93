"""Long functions in parts of bounded length, and refusals that are remembered."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import emit, instructions, newton, parts, routines
from varint.codegen.cache import compiler
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.newton import newton_kernel, newton_source
from varint.integration.compiled_loop import kernel_of

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.fixture(autouse=True)
def _in_c(monkeypatch):
    """As on other processors."""
    monkeypatch.setattr(instructions, "has_instructions", lambda: False)


def rotation(angle, axis):
    c, s = ca.cos(angle), ca.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = ca.SX.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def arm(joints):
    """Links with inertia, whose places are products of rotation matrices, with viscous friction."""
    q, v = vi.coordinates(*[f"a{i}" for i in range(joints)])
    turned, at, lagrangian = ca.SX.eye(3), ca.SX.zeros(3), 0
    for i in range(joints):
        turned = ca.mtimes(turned, rotation(q[i], 2 - i % 2))
        at = at + ca.mtimes(turned, ca.vertcat(0.4, 0.0, 0.1))
        spin = ca.mtimes(turned.T, ca.reshape(ca.jtimes(ca.vec(turned), q, v), 3, 3))
        w = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
        lagrangian += ca.sumsqr(ca.jtimes(at, q, v)) / 2 - 9.81 * at[2]
        lagrangian += ca.dot(w, ca.DM([0.02, 0.03, 0.01]) * w) / 2
    return vi.System(q, v, lagrangian, force=-0.5 * v)


def emitted(system, rule, monkeypatch):
    found = {}
    monkeypatch.setattr(
        newton,
        "source_of",
        lambda about, s, nodes, functions, *rest, **more: found.update(functions),
    )
    newton_source.__wrapped__(system, rule)
    return found


@pytest.mark.parametrize(
    "scene",
    (
        lambda: (arm(4), vi.gauss(2)),
        lambda: (arm(3), vi.lobatto(2)),
        lambda: (vi.models.four_bar(loops=40).system, vi.lobatto(2)),
    ),
    ids=("arm", "arm written out", "linkage"),
)
def test_no_function_of_a_large_scene_is_long(scene, monkeypatch):
    functions = emitted(*scene(), monkeypatch)
    assert max(f.operations for f in functions.values()) > parts.LARGEST
    assert max(f.largest for f in functions.values()) <= parts.LARGEST


def test_functions_of_a_small_scene_are_left_whole(monkeypatch):
    functions = emitted(arm(1), vi.lobatto(3), monkeypatch)
    assert all(f.largest == f.length and "V m[" not in f.source for f in functions.values())


def motion(system, rule, start, forget):
    """Another system of the same scene, compiled anew."""
    forget()
    return vi.simulate(system(), rule, **start, h=0.01, steps=40, backend="compiled").q


@needs_compiler
@pytest.mark.parametrize("part", (7, 50))
@pytest.mark.parametrize("rule", (vi.gauss(2), vi.lobatto(2), vi.lobatto(3)), ids=str)
def test_parts_give_what_the_whole_gives(rule, part, monkeypatch, forget):
    """Sines and cosines together, inputs, outputs and numbers in every part."""
    start = {"q0": [0.4, -0.3], "v0": [0.2, 0.1]}
    whole = motion(lambda: arm(2), rule, start, forget)
    monkeypatch.setattr(emit, "LARGEST", 0)
    monkeypatch.setattr(parts, "PART", part)
    assert np.abs(motion(lambda: arm(2), rule, start, forget) - whole).max() < 1e-13


@needs_compiler
def test_parts_of_a_linkage_give_what_the_whole_gives(monkeypatch, forget):
    model = vi.models.four_bar(loops=3)
    start = {"q0": model.q0, "v0": model.v0}
    whole = motion(lambda: vi.models.four_bar(loops=3).system, vi.lobatto(2), start, forget)
    monkeypatch.setattr(emit, "LARGEST", 0)
    monkeypatch.setattr(parts, "PART", 30)
    split = motion(lambda: vi.models.four_bar(loops=3).system, vi.lobatto(2), start, forget)
    assert np.abs(split - whole).max() < 1e-11


def test_values_take_little_room_between_parts():
    """A chain hands on one value, however many parts it has."""
    text = [parts.Statement("const V x0 = i0[0];", (0,), (), is_input=True)]
    text += [parts.Statement(f"const V x{k} = -x{k - 1};", (k,), (k - 1,)) for k in range(1, 5000)]
    stores = [parts.Statement("o0[0] = x4999;", (), (4999,))]
    found = parts.c_parts("f", text, stores)
    assert len(found) == 10
    assert found[-1].room <= 2
    assert max(len(part.body) for part in found) <= parts.PART + 2


def test_a_scene_that_was_found_too_large_is_not_examined_again(monkeypatch, forget):
    examined = []
    function = routines._short
    monkeypatch.setattr(routines, "MOST_OPERATIONS", 10)
    monkeypatch.setattr(
        routines, "_short", lambda *about: examined.append(about) or function(*about)
    )
    system, rule = arm(2), vi.lobatto(3)
    for _ in range(3):
        with pytest.raises(NotCompilable, match="more than 10"):
            kernel_of(system, rule)
        with pytest.raises(NotCompilable, match="more than 10"):
            newton_kernel(system, rule)
    assert len(examined) == 1
    with pytest.raises(NotCompilable, match="more than 10"):
        newton_kernel(system, vi.lobatto(2))
    assert len(examined) == 2


def test_a_kernel_is_built_once_for_a_system_and_a_rule():
    built = []
    once = kernel_per_system(lambda system, rule: built.append(rule) or object())
    system = arm(1)
    assert once(system, vi.gauss(1)) is once(system, vi.gauss(1))
    assert once(system, vi.gauss(2)) is not once(system, vi.gauss(1))
    assert len(built) == 2


def test_operations_that_are_all_unlike_do_not_become_loops():
    """Loops of one turn each would be one long function that cannot be parted."""
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 2)
    one = ca.sin(x[0] * c[0]) / ca.exp(x[1] - x[2] * c[1])
    many = ca.sum1(ca.sin(ca.vertcat(*[x[0] * k + c[0] for k in range(1, 40)])))
    unlike = emit.emit("f", ca.Function("f", [x, c], [one]), written_out=0)
    alike = emit.emit("f", ca.Function("f", [x, c], [many]), written_out=0)
    assert "for (" not in unlike.source and unlike.uniforms == 2
    assert "for (" in alike.source and alike.length < alike.operations / 2


def test_what_does_not_become_loops_is_fused_however_long_it_is():
    """An operation of a product and a sum rounds once; a long chain of unlike ones took half more
    operations.
    """
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 1)
    at = x
    for k in range(30):  # every turn hangs on the one before
        at = ca.vertcat(at[1] * at[2] + ca.sin(at[0]), at[0] * at[1] - k * at[2], at[0])
    chain = ca.Function("chain", [x, c], [at])
    short, long = (emit.arranged(chain, written_out=k) for k in (10_000, 50))
    assert long.nodes == short.nodes
    assert {"fma", "fms", "fnma"} & {name for name, *_ in long.nodes}
