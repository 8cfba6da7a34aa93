"""Emitted C agrees with CasADi's own evaluation, and the vector functions with mpmath."""

import ctypes
import subprocess

import casadi as ca
import mpmath
import numpy as np
import pytest

import varint as vi
from varint.codegen.algebra import graph_of
from varint.codegen.arguments import c_source
from varint.codegen.cache import compiler, library
from varint.codegen.dependence import halves, needed, uniform_nodes
from varint.codegen.emit import emit
from varint.codegen.graph import NotCompilable

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
LANES = (1, 2, 4, 8)


def evaluator(f: ca.Function, lanes: int, head: str = "", written_out: int = 20_000):
    """Rows of arguments (count, n) and parameters to rows of results, `lanes` at a time through
    the emitted C.
    """
    n, m = f.numel_in(0), f.numel_out(0)
    emitted = emit("f", f, written_out=written_out)
    loop = f"""
    int run(int64_t count, const double *x, const double *c, double *y) {{
        double w[{emitted.uniforms} + 1];
        f_prepare(c, w);
        for (int64_t k = 0; k < count; k += LANES) {{
            V in[{n}], out[{m}];
            for (int i = 0; i < {n}; i++) for (int l = 0; l < LANES; l++) set_lane(&in[i], l, x[(k + l) * {n} + i]);
            f(in, w, out);
            for (int i = 0; i < {m}; i++) for (int l = 0; l < LANES; l++) y[(k + l) * {m} + i] = lane(out[i], l);
        }}
        return 0;
    }}"""
    entry = library(
        f"#define LANES {lanes}\n{head}" + c_source("lanes.h") + emitted.source + loop
    ).run

    def evaluate(x: np.ndarray, c=()) -> np.ndarray:
        x, c, y = np.ascontiguousarray(x), np.array([*c, 0.0]), np.empty((len(x), m))
        entry(ctypes.c_int64(len(x)), *(ctypes.c_void_p(a.ctypes.data) for a in (x, c, y)))
        return y

    return evaluate


def expressions(x: ca.SX, c: ca.SX) -> ca.SX:
    """Every kind of operation that SX has, on arguments of any sign, and with shared
    denominators.
    """
    a, b, d = x[0], x[1], x[2]
    positive = ca.fabs(a) + 0.1
    r = ca.sqrt(a**2 + b**2 + 0.01)
    return ca.vertcat(
        a + b,
        a - b,
        a * b,
        a / positive,
        -a,
        ca.exp(a),
        ca.log(positive),
        positive**b,
        positive**1.5,
        b**3,
        b**-2,
        positive**-2.5,
        ca.sqrt(positive),
        a**2,
        2 * a,
        ca.sin(a),
        ca.cos(a),
        ca.sin(b),
        ca.cos(d),
        ca.tan(a),
        ca.asin(b / 9),
        ca.acos(b / 9),
        ca.atan(a),
        a < b,
        a <= b,
        ca.eq(a, b),
        ca.ne(a, b),
        ca.logic_not(a),
        ca.logic_and(a, b),
        ca.logic_or(a, b),
        ca.floor(a),
        ca.ceil(a),
        ca.fmod(a, positive),
        ca.fabs(a),
        ca.sign(a),
        ca.copysign(a, b),
        ca.if_else(a > b, a, d),
        ca.erf(a),
        ca.fmin(a, b),
        ca.fmax(a, b),
        1 / positive,
        ca.sinh(a),
        ca.cosh(a),
        ca.tanh(a),
        ca.asinh(a),
        ca.acosh(1 + positive),
        ca.atanh(b / 9),
        ca.atan2(a, b),
        ca.log1p(positive),
        ca.expm1(a),
        ca.hypot(a, b),
        ca.remainder(a, positive),
        a / r,
        b / r**3,
        d / (2 * r**2),
        (a - b) / (c[0] * r),
        d / c[1],
        d * ca.exp(c[0]) / ca.sin(c[1]),
        (3 * (2 * a - 5 * b + c[0] * d) - 6 * a + 15 * b) / 32,
        ca.if_else(c[0] < c[1], d, a),
        ca.fmax(c[0], c[1]) * a,
        ca.SX(7),
        c[1],
        ca.SX(0),
    )


@pytest.mark.parametrize("lanes", LANES)
def test_every_operation_agrees_with_casadi(lanes):
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 2)
    f = ca.Function("f", [x, c], [ca.densify(expressions(x, c))])
    points = np.random.default_rng(1).uniform(-4, 4, (64, 3))
    values = (0.7, 1.9)
    expected = np.array([np.array(f(p, values)).ravel() for p in points])
    found = evaluator(f, lanes)(points, values)
    # sums of terms that cancel are exact to the size of the terms
    scale = np.maximum(np.abs(expected), 1.0)
    worst = np.abs(found - expected) / scale
    assert worst.max() < 8e-15, f"output {worst.max(0).argmax()} differs by {worst.max():.1e}"


@pytest.mark.parametrize("lanes", (4, 8))
def test_own_declarations_give_the_bytes_that_the_systems_headers_give(lanes):
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 2)
    f = ca.Function("f", [x, c], [ca.densify(expressions(x, c))])
    points = np.random.default_rng(4).uniform(-4, 4, (16, 3))
    points[3, 0], points[6, 1], points[9, 2] = np.nan, np.inf, 1e7
    heads = ("", "#define SYSTEM_HEADERS\n")
    own, system = (evaluator(f, lanes, head)(points, (0.7, 1.9)) for head in heads)
    assert own.tobytes() == system.tobytes()


def test_a_kernel_asks_for_no_header_but_that_of_the_c_librarys_version():
    source = c_source("lanes.h") + c_source("run.h") + c_source("newton.c")
    source += "".join(map(c_source, ("gauss.h", "gauss_step.c", "gauss_loop.c")))
    text = subprocess.run(
        [*compiler(), "-E", "-march=native", "-x", "c", "-"],
        input=f"#define LANES 8\n#define N 1\n{c_source('lanes.h')}",
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "#include <" not in source.replace(c_source("intrinsics.h"), "")
    assert len(text.splitlines()) < 1000  # immintrin.h alone has 40,000


@pytest.mark.parametrize("lanes", (1, 8))
@pytest.mark.parametrize("name", ("sin", "cos", "exp", "sincos"))
def test_vector_functions_are_accurate_to_a_unit_in_the_last_place(lanes, name):
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    both = name == "sincos"
    f = ca.Function(
        "f", [x, c], [ca.vertcat(ca.sin(x), ca.cos(x)) if both else getattr(ca, name)(x)]
    )
    small = np.random.default_rng(2).uniform(-30, 30, 400)
    large = np.array([700.0, -700.0, 707.0, -707.0] if name == "exp" else [1e5, -9e5, 1e7, 1e15])
    near = np.array([0.0, 1e-300, 1e-8, -1e-8]) if name == "exp" else np.pi / 2 * np.arange(-30, 30)
    points = np.concatenate([small, large, near])
    points = points[: len(points) // 8 * 8]
    found = evaluator(f, lanes)(points[:, None])
    functions = [mpmath.sin, mpmath.cos] if both else [getattr(mpmath, name)]
    with mpmath.workdps(40):
        for k, function in enumerate(functions):
            exact = [function(mpmath.mpf(p)) for p in points]
            errors = np.array(
                [float(abs(mpmath.mpf(y) - e)) for y, e in zip(found[:, k], exact, strict=True)]
            )
            ulps = errors / [np.spacing(abs(float(e))) for e in exact]
            assert ulps[: len(small) + 4].max() < 2.0
            # next to a zero far below what rounding the argument does
            assert ((errors < 1e-25) | (ulps < 2)).all()


def test_vector_functions_pass_on_what_is_not_finite():
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    f = ca.Function("f", [x, c], [ca.vertcat(ca.sin(x), ca.cos(x) + 1, ca.exp(x))])
    found = evaluator(f, 8)(
        np.array([[np.inf], [-np.inf], [np.nan], [0.0], [1.0], [2.0], [3.0], [800.0]])
    )
    assert np.isnan(found[:3, :2]).all() and np.isnan(found[2, 2])
    assert found[0, 2] == np.inf and found[1, 2] == 0 and found[7, 2] == np.inf
    assert np.isfinite(found[3:7]).all()


@pytest.mark.parametrize("many", ("", "#define MANY_ROOTS 1\n"))
def test_reciprocal_roots_are_accurate_over_the_whole_range(many):
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    f = ca.Function("f", [x, c], [1 / ca.sqrt(x) + 1 / (1e-300 * ca.sqrt(x) ** 3) * 0])
    assert any(node[0] == "rsqrt" for node in graph_of(f).nodes)
    points = 10.0 ** np.random.default_rng(3).uniform(-150, 300, 800)
    found = evaluator(f, 8, many)(points[:, None])[:, 0]
    with mpmath.workdps(40):
        worst = max(
            abs(float(mpmath.mpf(y) * mpmath.sqrt(mpmath.mpf(p)) - 1))
            for y, p in zip(found, points, strict=True)
        )
    assert worst < 3e-16


def test_divisions_by_powers_of_one_expression_share_a_reciprocal():
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    f = ca.Function("f", [x, c], [ca.gradient(1 / ca.norm_2(x), x)])
    names = [node[0] for node in graph_of(f).nodes]
    assert names.count("rsqrt") == 1 and "div" not in names and "sqrt" not in names


def test_powers_of_one_expression_that_cancel_leave_nothing():
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    square = ca.sumsqr(x) + 1
    f = ca.Function("f", [x, c], [x[0] / ca.sqrt(square) * (3 * ca.sqrt(square))])
    graph = graph_of(f)
    names = {graph.nodes[i][0] for i in needed(graph)}
    assert names == {"input", "const", "mul"}


@pytest.mark.parametrize("name", ["fabs", "sign"])
def test_signs_are_found_factor_by_factor(name):
    """Beside CasADi where factors are negative, zero, or the same all the time."""
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    r, of = ca.norm_2(x), getattr(ca, name)
    products = (
        c / r**3,
        -2 * x[0] * c,
        x[0] ** 2 * x[1],
        c * x[1] / r,
        x[0] ** 2 * c,
        ca.SX(-3),
        r**2,
    )
    f = ca.Function("f", [x, c], [ca.densify(ca.vertcat(*map(of, products)))])
    points = np.random.default_rng(6).uniform(-2, 2, (8, 2))
    points[0], points[1, 0], points[2, 1] = (-1.5, 0.5), 0.0, -0.0
    for constant in (-0.7, 0.0, 1.3):
        exact = np.array([np.array(f(p, constant)).ravel() for p in points])
        np.testing.assert_allclose(evaluator(f, 8)(points, (constant,)), exact, rtol=1e-15)
    far = ca.Function("f", [x, c], [of(c / r**3)])
    body = emit("f", far).source.split("INLINE void f(")[1]
    assert name not in body  # that of c, once a run


def test_what_cancels_is_not_added_first():
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c", 2)
    both = x[0] + ca.exp(x[1]) - c[0]
    f = ca.Function(
        "f", [x, c], [ca.vertcat(both, both - ca.exp(x[1]), x[0] * 2 + c[0] + 3 + c[1])]
    )
    graph = graph_of(f)
    _, second, third = (graph.nodes[i] for i in graph.outputs[0])
    assert [graph.nodes[i][0] for i in second[1:]] == ["input", "input"]  # x[0] − c[0]
    uniform = uniform_nodes(graph, 1)
    assert sum(uniform[i] for i in third[1:]) == 1  # c[0] + 3 + c[1]


@pytest.mark.parametrize("make", (vi.models.four_bar, vi.models.pleiades, vi.models.rolling_disc))
def test_equal_operations_become_one_whether_they_were_before_or_not(make):
    """Where they are arranged, not by CasADi before: all the same is found."""
    s = make().system
    inputs = [s.q, s.v, s.t, s.control, s.c]
    outputs = [ca.densify(x) for x in (s.lagrangian, ca.hessian(s.lagrangian, s.q)[0])]
    first = graph_of(ca.Function("f", inputs, outputs, {"live_variables": False}))
    second = graph_of(ca.Function("f", inputs, ca.cse(outputs)))
    assert (first.nodes, first.outputs) == (second.nodes, second.outputs)


def test_a_sum_times_a_number_that_cancels_is_zero():
    """What CasADi does not see to be zero; a factor that all terms have is no zero."""
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    nothing = (1 + x[0]) - 1.5 * x[0] + 0.5 * x[0] - 1
    f = ca.Function("f", [x, c], [ca.cos(nothing * (x[0] + x[1])) * x[0]])
    assert f.n_instructions() > 10
    points = np.random.default_rng(4).uniform(-2, 2, (8, 2))
    assert (evaluator(f, 8)(points)[:, 0] == points[:, 0]).all()


def test_a_sum_of_many_terms_takes_memory_by_its_length():
    """Each of its parts is a sum of its own; their terms all together are twenty million."""
    resource = pytest.importorskip("resource")
    x, c = ca.SX.sym("x", 6000), ca.SX.sym("c")
    total = x[0]
    for k in range(1, 6000):
        total = total + x[k]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    graph = graph_of(ca.Function("f", [x, c], [total], {"live_variables": False}))
    assert [node[0] for node in graph.nodes].count("add") == 5999
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_what_depends_on_parameters_alone_is_computed_once():
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    body = emit("f", ca.Function("f", [x, c], [x * ca.exp(c) / ca.sin(c)])).source.split(
        "INLINE void f("
    )[1]
    assert "exp" not in body and "sin" not in body and "/" not in body


def test_operations_without_a_form_in_c_are_refused():
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    with pytest.raises(NotCompilable, match="interpreted"):
        emit("f", ca.Function("f", [x, c], [ca.erfinv(x)]))


def test_two_halves_give_what_the_whole_gives_and_share_what_comes_first():
    """The second half takes a sine from the first, and its own constants from the parameters."""
    x, late, c = ca.SX.sym("x", 2), ca.SX.sym("late"), ca.SX.sym("c")
    shared = ca.sin(x[0]) / c
    f = ca.Function(
        "f", [x, c, late], [shared * x[1], ca.vertcat(shared * late + c, ca.exp(x[1]), late**2 / c)]
    )
    first, second = halves(graph_of(f, 1), 2, 1)
    assert {node[0] for node in second.nodes} <= {"input", "const", "mul", "add", "div"}
    assert len(first.outputs[-1]) == 2  # what holds the sine, and the exponential
    values = {
        ("input", 0, 0): 0.3,
        ("input", 0, 1): -0.7,
        ("input", 1, 0): 1.7,
        ("input", 2, 0): 2.9,
    }
    before = evaluated(first, values)
    taken = {("input", 1, k): value for k, value in enumerate(before[1])}
    after = evaluated(second, taken | {("input", 0, 0): 2.9, ("input", 2, 0): 1.7})
    expected = [np.array(y).ravel() for y in f([0.3, -0.7], 1.7, 2.9)]
    np.testing.assert_allclose(before[0], expected[0], rtol=1e-15)
    np.testing.assert_allclose(after[0], expected[1], rtol=1e-15)


def evaluated(graph, values):
    """The outputs of a graph, operation by operation."""
    does = {
        "add": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "div": np.divide,
        "sin": np.sin,
        "exp": np.exp,
    }
    found = {}
    for i in needed(graph):
        name, *rest = graph.nodes[i]
        if name == "input":
            found[i] = values[graph.nodes[i]]
        else:
            found[i] = rest[0] if name == "const" else does[name](*(found[j] for j in rest))
    return [[found[i] for i in output] for output in graph.outputs]


def test_powers_of_one_expression_merge_and_cancel():
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    scale = ca.norm_2(x) ** 1.5
    speed = scale * x[0] / c
    f = ca.Function("f", [x, c], [c * (speed / scale) ** 2 / scale * scale])
    graph = graph_of(f)
    assert {graph.nodes[i][0] for i in needed(graph)} <= {"input", "mul", "div", "const"}
    body = emit("f", f).source.split("INLINE void f(")[1]
    assert "/" not in body  # 1/c once a run


def random_expression(generator, atoms, depth):
    """Products, quotients, roots and sums of positive atoms, nested."""
    if not depth:
        return atoms[generator.integers(len(atoms))]
    a, b = (random_expression(generator, atoms, depth - 1) for _ in range(2))
    return [
        a + b,
        a * b,
        a / b,
        ca.sqrt(a),
        a - 2 * b,
        a / ca.sqrt(b),
        a**1.5 * b,
        a * 0.5 + b / 3,
    ][generator.integers(8)]


def random_case(seed, more=lambda x, c: ()):
    """Four random expressions and more as a function; points, parameters and its values there."""
    generator = np.random.default_rng(seed)
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 2)
    sums = [x[0] + x[1], x[1] * x[2] + c[0], ca.SX(1.5), ca.sumsqr(x)]
    atoms = [*ca.vertsplit(x), *ca.vertsplit(c), *sums]
    wanted = ca.vertcat(*(random_expression(generator, atoms, 4) for _ in range(4)), *more(x, c))
    f = ca.Function("f", [x, c], [ca.cse(wanted)])
    points, constants = generator.uniform(0.5, 2, (8, 3)), np.array([0.7, 1.3])
    return f, points, constants, np.array([np.array(f(p, constants)).ravel() for p in points])


@pytest.mark.parametrize("seed", range(40))
def test_random_products_powers_and_sums_keep_their_values(seed):
    f, points, constants, exact = random_case(seed)
    found = evaluator(f, 8)(points, constants)
    defined = np.isfinite(exact)
    assert np.isfinite(found[defined]).all()
    size = np.abs(exact[defined]).max(initial=1.0)
    assert np.abs(found - exact)[defined].max(initial=0.0) <= 1e-12 * size


@pytest.mark.parametrize("seed", range(12))
def test_loops_over_operations_of_the_same_form_keep_the_values(seed):
    f, points, constants, exact = random_case(seed, lambda x, c: (ca.sin(x[0]), ca.cos(x[0]), c[0]))
    found, defined = evaluator(f, 8, written_out=0)(points, constants), np.isfinite(exact)
    np.testing.assert_allclose(found[defined], exact[defined], rtol=1e-11, atol=1e-11)


def gravity(bodies):
    x, c = ca.SX.sym("x", 3 * bodies), ca.SX.sym("c", bodies)
    places, energy = ca.reshape(x, 3, bodies), ca.SX(0)
    for i in range(bodies):
        for j in range(i):
            energy -= c[i] * c[j] / ca.norm_2(places[:, i] - places[:, j])
    return ca.Function("f", [x, c], [ca.gradient(energy, x)])


@pytest.mark.parametrize("lanes", LANES)
def test_many_bodies_become_a_loop_over_pairs_and_sums_over_bodies(lanes):
    bodies, generator = 16, np.random.default_rng(0)
    f = gravity(bodies)
    emitted = emit("f", f, written_out=1000)
    assert emitted.length < 100 < emitted.operations / 20
    longer = emit("f", gravity(bodies + 4), written_out=1000)
    assert longer.length - emitted.length == 4 * 3  # a statement for every output
    points, masses = generator.normal(size=(8, 3 * bodies)), generator.uniform(0.5, 2, bodies)
    exact = np.array([np.array(f(p, masses)).ravel() for p in points])
    found = evaluator(f, lanes, written_out=1000)(points, masses)
    np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-11)


def test_a_factor_that_all_terms_share_is_multiplied_once_and_last():
    x, c = ca.SX.sym("x", 4), ca.SX.sym("c")
    late = 1 / ca.sqrt(1 + ca.sumsqr(x))
    y = late * x[0] - late * x[1] * x[2] - 3 * late**3 * (x[2] * c + x[3] ** 2)
    graph = graph_of(ca.Function("f", [x, c], [y]))
    (out,) = graph.outputs[0]
    name, *factors = graph.nodes[out]
    (root,) = (i for i, node in enumerate(graph.nodes) if node[0] == "rsqrt")
    assert name == "mul" and root in factors
    readers = [node for node in graph.nodes if root in node[1:]]
    assert sorted(node[0] for node in readers) == ["mul", "mul"]  # that one, and its square
