"""Long functions as instructions of the processor: the bytes of C, whatever stands in them."""

import ctypes

import casadi as ca
import numpy as np
import pytest
import scenes

import varint as vi
from varint.codegen import instructions
from varint.codegen.arguments import c_source
from varint.codegen.arranged import arranged
from varint.codegen.cache import AS_WRITTEN, compiler, has_instructions, library
from varint.codegen.emit import emit_graph
from varint.codegen.instructions import as_instructions
from varint.codegen.kernel import run_loop
from varint.codegen.native_newton import native_newton
from varint.codegen.newton import newton_kernel, newton_source
from varint.codegen.prepared import PreparedNumbers
from varint.codegen.registers import REGISTERS, Frame, Registers, Step

pytestmark = pytest.mark.skipif(
    compiler() is None or not has_instructions(), reason="no C compiler, or another processor"
)
SUMS = (
    (3, lambda x, y, z: x * y + z),
    (3, lambda x, y, z: x * y - z),
    (3, lambda x, y, z: z - x * y),
    (2, lambda x, y: x + y),
    (2, lambda x, y: x - y),
    (2, lambda x, y: x * y),
    (1, lambda x: x * x + x),
)
OTHERS = (
    (1, lambda x: -x),
    (1, ca.fabs),
    (1, lambda x: ca.sqrt(ca.fabs(x))),
    (1, lambda x: 1 / ca.sqrt(1 + x * x)),
    (1, lambda x: ca.cos(x) - ca.sin(x)),
    (1, ca.sin),
    (1, ca.exp),
    (1, ca.sign),
    (2, lambda x, y: x / y),
    (2, ca.fmin),
    (2, ca.fmax),
    (2, ca.atan2),
    (2, lambda x, y: ca.if_else(x < y, x, y)),
    (2, lambda x, y: ca.logic_not(x <= y) + x),
    (2, lambda x, y: ca.if_else(x == y, x, 0)),
    (2, lambda x, y: ca.if_else(x != y, x, 0)),
    (2, ca.copysign),
)
COMMON = 0.8  # of the operations are sums and products
SIZE = 4  # numbers of an argument


def tangle(seed, inputs, outputs, operations=400):
    """A function of operations on what has just been made or was there long ago."""
    rng = np.random.default_rng(seed)
    x, c = [ca.SX.sym(f"x{k}", SIZE) for k in range(inputs)], ca.SX.sym("c", SIZE)
    known = [*ca.vertsplit(ca.vertcat(*x, c)), ca.SX(0.75), ca.exp(c[0]) * c[1]]

    def values(count):
        first = max(0, len(known) - 8) if rng.random() < 0.6 else 0
        return [known[k] for k in rng.integers(first, len(known), count)]

    for _ in range(operations):
        kinds = SUMS if rng.random() < COMMON else OTHERS
        count, make = kinds[rng.integers(len(kinds))]
        made = make(*values(count))
        known.append(made if rng.random() < 0.5 else made / (1 + ca.fabs(made)))
    found = [ca.vertcat(*values(SIZE)) for _ in range(outputs)]
    return ca.Function("f", [*x, c], found)


def both(f, points):
    """Values at the points, (points, outputs · SIZE), as instructions and as C."""
    last, outputs, shared = f.n_in() - 1, f.n_out(), PreparedNumbers(SIZE)
    found = [
        as_instructions("instructions", arranged(f), last, shared),
        emit_graph("statements", arranged(f), last, shared=shared, fewest=2),
    ]
    arguments = [f"x + {SIZE * k}" for k in range(last)] + ["w + 2"]
    arguments += [f"y + {SIZE * k}" for k in range(outputs)]
    calls = "".join(
        f"void call_{name}(const double *x, const double *c, double *y) {{ START "
        f"{name}({', '.join(arguments)}); }}\n"
        for name in ("instructions", "statements")
    )
    source = (
        "#define LANES 1\n"
        + c_source("lanes.h")
        + c_source("newton_table.h")
        + "".join(x.source for x in found)
        + shared.source("shared")
        + "static void sines_of(const double *a, double *s, double *c) {"
        "for (int i = 0; i < ANGLES; i++) v_sincos(a[i], &s[i], &c[i]); }\n"
        f"#define START double w[{len(shared) + 2}]; memcpy(w + 1, &(Angles){{sines_of}}, 8); "
        f"memcpy(w + 2, c, {8 * SIZE}); shared_prepare(c, w + 2);\n" + calls
    )
    compiled = library(source, AS_WRITTEN)
    results = []
    for name in ("instructions", "statements"):
        y = np.full((len(points), outputs * SIZE), np.inf)
        for row, x in zip(y, points, strict=True):
            c = np.ascontiguousarray(x[-SIZE:])
            at = (ctypes.c_void_p(a.ctypes.data) for a in (x, c, row))
            getattr(compiled, f"call_{name}")(*at)
        results.append(np.where(np.isnan(y), 0.5, y))  # one that is no number is like another
    return results


@pytest.mark.parametrize("arguments", ((2, 1), (6, 7)), ids=("few arguments", "many"))
@pytest.mark.parametrize("seed", range(6))
def test_instructions_give_the_bytes_of_c(seed, arguments):
    f = tangle(seed, *arguments)
    points = np.random.default_rng(seed).normal(size=(20, SIZE * f.n_in())) * 3
    points[1, ::2], points[2, 1::3], points[3, ::3], points[4] = 0.0, -0.0, np.nan, 1e7
    one, other = both(f, points)
    assert one.tobytes() == other.tobytes()
    assert len(np.unique(one)) > 20


def test_angles_of_angles_and_more_than_a_call_takes():
    x, c = ca.SX.sym("x", SIZE), ca.SX.sym("c", SIZE)
    y = x
    for turn in range(5):
        y = ca.vertcat(*(ca.sin(y[k]) * ca.cos(y[k - 1]) + turn * y[k - 2] for k in range(SIZE)))
    wide = [ca.cos(x[k % SIZE] + k) * ca.sin(x[k % SIZE] + k) for k in range(20)]
    f = ca.Function("f", [x, c], [y, ca.vertcat(*(sum(wide[k::SIZE]) for k in range(SIZE)))])
    one, other = both(f, np.random.default_rng(1).normal(size=(20, 2 * SIZE)))
    assert one.tobytes() == other.tobytes()


def test_a_function_with_more_arguments_than_registers_stays_in_c():
    graph = arranged(tangle(0, 9, 6))
    assert as_instructions("f", graph, 9, PreparedNumbers(SIZE)) is None
    graph = arranged(tangle(0, 8, 6))
    assert as_instructions("f", graph, 8, PreparedNumbers(SIZE)) is not None


def room(many, times):
    """Numbers on the stack for so many products that are all there before they are added up."""
    steps, made = list[Step](), 10
    for _ in range(times):
        products = range(made, made + many)
        steps += [Step("mul", (i,), (0, 1)) for i in products]
        total, made = products[0], made + many
        for i in products[1:]:
            steps.append(Step("add", (made,), (total, i)))
            total, made = made, made + 1
    code = Registers({0: "(%rdi)", 1: "8(%rdi)"}, {}, {}, Frame(0, 0, "", []))
    code.write(steps)
    return code.room


def test_values_go_to_the_stack_where_registers_are_too_few_and_their_places_are_used_again():
    assert room(REGISTERS - 2, 1) == 0
    assert 40 - REGISTERS <= room(40, 1) <= room(40, 2) <= 42 - REGISTERS
    assert room(40, 5) == room(40, 2)


@pytest.mark.parametrize(
    ("scene", "rule"),
    (
        (lambda: vi.models.four_bar(loops=3).system, vi.lobatto(2)),
        (lambda: vi.models.andrews_mechanism().system, vi.lobatto(3)),
        (scenes.double_pendulum, vi.gauss(4)),
    ),
    ids=("linkage", "squeezer", "double pendulum"),
)
def test_a_step_has_the_same_bytes_as_instructions_in_c_and_as_data(
    scene, rule, monkeypatch, forget
):
    starts = {
        2: ([1.0, 0.3], [0.1, 0.2]),
        7: (vi.models.andrews_mechanism().q0, np.zeros(7)),
        8: (vi.models.four_bar(loops=3).q0, np.zeros(8)),
    }

    def rows(build, written):
        forget()
        system = scene()
        assert ("pushsection" in newton_source(system, rule).text) == written
        q0, p0 = map(np.array, starts[system.structure.n])
        kernel, c = build(system, rule), system.default_vector
        found = run_loop(kernel, q0, p0, c, t0=0.0, h=5e-5, steps=30)
        assert found.done
        return found.rows.tobytes()

    found = rows(newton_kernel, True)
    assert rows(native_newton, True) == found
    monkeypatch.setattr(instructions, "has_instructions", lambda: False)
    assert rows(newton_kernel, False) == found
