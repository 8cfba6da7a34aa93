"""A scene's operations as data give the bytes that its compiled code gives."""

import ctypes
import os
import struct
import subprocess
import sys
from functools import partial

import casadi as ca
import numpy as np
import pytest
from scenes import cart_pendulum, double_pendulum, driven_damped, henon_heiles, pendulum
from test_compiled import controls, driven, kicked, simulated, turning
from test_compiled_emit import LANES, expressions

import varint as vi
from varint.codegen.arguments import c_source
from varint.codegen.built import built_library
from varint.codegen.cache import AS_WRITTEN, compiler, library
from varint.codegen.emit import arranged, emit_graph
from varint.codegen.gauss import gauss_kernel
from varint.codegen.graph import INPUT, NUMBER, Graph, NotCompilable, operation_codes
from varint.codegen.native import native_gauss
from varint.codegen.tape import tape_of, with_many_roots
from varint.numerics.operations import BINARY, UNARY, operation

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def both_ways(f: ca.Function, lanes: int, many: bool, x: np.ndarray, c) -> tuple[np.ndarray, ...]:
    """f at the points x (count, n): by its tape, and by its compiled code."""
    n, m, graph = f.numel_in(0), f.numel_out(0), arranged(f)
    written, tape = emit_graph("f", graph, 1), tape_of(graph, 1)
    tape = with_many_roots(tape) if many else tape
    loop = f"""
    int run(const Tape *tape, int64_t count, const double *x, const double *c, double *one,
            double *other) {{
        V registers[tape->registers + 1], in[{n}], out[{m}];
        double *w = (double *)registers, u[{written.uniforms} + 1];
        prepare_tape(tape, c, w), f_prepare(c, u);
        for (int64_t k = 0; k < count; k += LANES) {{
            for (int i = 0; i < {n}; i++)
                for (int l = 0; l < LANES; l++) set_lane(&in[i], l, x[(k + l) * {n} + i]);
            evaluate_tape(tape, (const V *const[]){{in}}, (V *const[]){{out}}, 1, w);
            for (int i = 0; i < {m}; i++)
                for (int l = 0; l < LANES; l++) one[(k + l) * {m} + i] = lane(out[i], l);
            f(in, u, out);
            for (int i = 0; i < {m}; i++)
                for (int l = 0; l < LANES; l++) other[(k + l) * {m} + i] = lane(out[i], l);
        }}
        return 0;
    }}"""
    head = f"#define LANES {lanes}\n" + "#define MANY_ROOTS 1\n" * many
    entry = library(
        head + c_source("lanes.h") + c_source("tape.h") + written.source + loop, AS_WRITTEN
    ).run
    arrays = (tape.once, tape.often, tape.constants, tape.inputs, tape.outputs)
    counts = (tape.uniforms, tape.numbers, tape.registers, len(tape.inputs), len(tape.outputs))
    layout = struct.pack("5q5P", *counts, *(a.ctypes.data for a in arrays))
    one, other, c = np.empty((len(x), m)), np.zeros((len(x), m)), np.array([*c, 0.0])
    places = (ctypes.c_void_p(a.ctypes.data) for a in (x, c, one, other))
    first, *rest = places
    entry(ctypes.c_char_p(layout), ctypes.c_int64(len(x)), first, *rest)
    return one, other


@pytest.mark.parametrize("many", (False, True))
@pytest.mark.parametrize("lanes", LANES)
def test_every_operation_gives_the_bytes_of_the_compiled_code(lanes, many):
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c", 2)
    f = ca.Function("f", [x, c], [ca.densify(expressions(x, c))])
    points = np.random.default_rng(2).uniform(-4, 4, (64, 3))
    one, other = both_ways(f, lanes, many, points, (0.7, 1.9))
    assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("seed", range(4))
def test_operations_in_any_order_give_the_bytes_of_the_compiled_code(seed):
    """Random graphs, deep enough for registers to be used again, with infinities and NaN."""
    rng = np.random.default_rng(seed)
    x, c = ca.SX.sym("x", 4), ca.SX.sym("c", 2)
    found = [*ca.vertsplit(x), *ca.vertsplit(c)]
    kinds = [
        lambda a, b: a + b,
        lambda a, b: a - b,
        lambda a, b: a * b,
        lambda a, b: a / (1 + b * b),
        lambda a, b: ca.sin(a) + ca.cos(a),
        lambda a, b: a / ca.sqrt(1 + b**2),
        lambda a, b: ca.if_else(a < b, a, -b),
        lambda a, b: ca.exp(-a * a),
    ]
    for _ in range(300):
        a, b = (found[k] for k in rng.integers(max(0, len(found) - 60), len(found), 2))
        found.append(kinds[rng.integers(len(kinds))](a, b))
    f = ca.Function("f", [x, c], [ca.vertcat(*found[-40:])])
    points = rng.uniform(-3, 3, (64, 4))
    points[:3, 0] = np.inf, np.nan, 0.0
    one, other = both_ways(f, 8, True, points, (0.3, -1.2))
    assert np.array_equal(one, other, equal_nan=True)


@pytest.mark.parametrize("name", sorted((UNARY | BINARY) - {"erfinv"}))
def test_every_operation_with_a_form_in_c_is_that_operation_on_a_tape(name):
    """Beside CasADi; only the error function's inverse has no form."""
    x, c = ca.SX.sym("x", 2), ca.SX.sym("c")
    taken = (x[0],) if name in UNARY else (x[0], x[1])
    f = ca.Function("f", [x, c], [ca.densify(operation(name, *taken))])
    points = np.random.default_rng(9).uniform(0.1, 0.9, (8, 2))
    points += name == "acosh"
    expected = np.array([float(f(p, 0.3)) for p in points])
    for found in both_ways(f, 8, False, points, (0.3,)):
        np.testing.assert_allclose(np.ravel(found), expected, rtol=1e-14)


def test_more_values_than_registers_are_refused():
    """All products are there at once before the first of them is taken again."""
    count = 33_000
    rows = [(INPUT, 0, 0, -1), *((NUMBER, -1, -1, -1) for k in range(2, count))]
    rows += [(operation_codes()["mul"], 0, k, -1) for k in range(1, count - 1)]
    graph_with = partial(Graph, np.array(rows, np.int32), np.arange(1.0, len(rows) + 1))
    wanted = [*range(count - 1, 2 * count - 3)]
    with pytest.raises(NotCompilable, match="too many values"):
        tape_of(graph_with([wanted]), 1)
    few = tape_of(graph_with([wanted[:1000]]), 1)
    assert few.registers <= 2 + 2 * 1001 and len(few.outputs) == 1000


MODELS = [vi.models.chain_rods(k) for k in (2, 3)]
MODELS += [vi.models.four_bar(), vi.models.knife_edge()]


def coupled() -> vi.System:
    return row_of_springs(2)


def row_of_springs(count: int = 9) -> vi.System:
    """Linear; many coordinates are solved for in a band."""
    q, v = vi.coordinates(*[f"x{i}" for i in range(count)])
    stretch = ca.vertcat(q, 0) - ca.vertcat(0, q)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 3 * ca.sumsqr(stretch) / 2)


SCENES = {
    "pendulum": (pendulum, 8, {}),
    "separable": (henon_heiles, 6, {}),
    "full mass": (double_pendulum, 4, {}),
    "two vectors": (double_pendulum, 12, {}),
    "cyclic": (cart_pendulum, 2, {}),
    "damped, time": (driven_damped, 8, {"t0": 0.3}),
    "controls, force on v": (driven, 8, {"t0": 0.3}),
    "controls, kick": (kicked, 3, {"t0": -1.0}),
    "turning": (turning, 8, {}),
}


def carried(part):
    """The bytes of what a run carries on; what is no number has the sign of the processor's."""
    return np.where(np.isnan(part.carry), np.nan, part.carry).tobytes()


@pytest.mark.parametrize("which", SCENES)
def test_a_run_has_the_bytes_of_the_compiled_one(which):
    """So has what it carries on: either may go on where the other stopped."""
    make, stages, options = SCENES[which]
    system = make()
    n = system.structure.n
    tape, code = native_gauss(system, vi.gauss(stages)), gauss_kernel(system, vi.gauss(stages))
    start = [0.5, 0.4][:n], [0.2, 0.6][:n], 0.05
    u = controls(tape, 200) if tape.controls else None
    one, other = (
        simulated(k, *start, 200, system, u=u, save_every=3, **options) for k in (tape, code)
    )
    assert one.rows.tobytes() == other.rows.tobytes()
    assert carried(one) == carried(other)
    assert one.iterations == other.iterations and one.residual == other.residual
    half = None if u is None else u[:100]
    rest = None if u is None else u[100:]
    first = simulated(tape, *start, 100, system, u=half, **options)
    then = simulated(code, *start, 100, system, u=rest, first=100, carry=first.carry, **options)
    assert then.last.tobytes() == other.last.tobytes()


METHODS = {
    "kicks": (henon_heiles, vi.composition("kahan-li8")),
    "kicks, controls": (kicked, vi.composition("verlet")),
    "full mass": (double_pendulum, vi.lobatto(3)),
    "midpoint in closed form": (cart_pendulum, vi.gauss(1)),
    "linear": (coupled, vi.lobatto(4)),
    "linear in a band": (row_of_springs, vi.gauss(2)),
    "controls": (driven, vi.lobatto(2)),
    "rods by multipliers": (lambda: vi.models.chain_rods(3).system, vi.lobatto(2)),
    "rods": (lambda: vi.models.chain_rods(2).system, vi.lobatto(4)),
    "linkage": (lambda: vi.models.four_bar().system, vi.lobatto(2)),
    "knife edge": (lambda: vi.models.knife_edge().system, vi.lobatto(2)),
}


@pytest.mark.parametrize("which", METHODS)
def test_another_method_has_the_bytes_of_the_compiled_one(which):
    make, rule = METHODS[which]
    system = make()
    model = next((m for m in MODELS if m.system.names == system.names), None)
    n = system.structure.n
    q0 = model.q0 if model else np.linspace(0.3, 0.6, n)
    v0 = model.v0 if model else np.linspace(0.2, 0.4, n)
    u = 0.1 * np.ones(system.structure.controls) if system.structure.controls else None
    start = {"q0": q0, "v0": v0, "u": u, "h": 0.01, "steps": 300, "save_every": 7}
    one, other = (
        vi.simulate(system, rule, **start, backend=backend) for backend in ("native", "compiled")
    )
    assert one.stats["backend"].startswith("native: ")
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()
    assert one.stats["iterations"] == other.stats["iterations"]
    assert one.stats["residual"] == other.stats["residual"]


def test_what_has_no_native_loop_is_refused():
    ball = vi.models.bouncing_ball()
    start = {"q0": ball.q0, "v0": ball.v0, "h": -0.1, "steps": 3, "backend": "native"}
    with pytest.raises(vi.InputError, match="runs with contacts are interpreted"):
        vi.simulate(ball.system, **start)
    q, v = ca.SX.sym("q", 257), ca.SX.sym("v", 257)
    large = vi.System(q, v, ca.sumsqr(v) / 2 + ca.sum1(ca.cos(q)))
    with pytest.raises(NotCompilable, match="too large"):
        native_gauss(large, vi.gauss(4))


def test_without_a_compiler_the_loop_that_was_built_runs(tmp_path):
    """With an empty PATH and nothing in the cache; where the package was built without one, the
    run is interpreted.
    """
    script = (
        "import varint as vi\n"
        "m = vi.models.henon_heiles()\n"
        "r = vi.simulate(m.system, vi.gauss(8), q0=m.q0, v0=m.v0, h=m.h, steps=50)\n"
        "print(r.stats['backend'], r.q[-1].tobytes().hex())\n"
    )
    room = {**os.environ, "PATH": "", "XDG_CACHE_HOME": str(tmp_path)} | {"CC": ""}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=room, check=True
    )
    model = vi.models.henon_heiles()
    ours = vi.simulate(model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=model.h, steps=50)
    loop, *_, digits = done.stdout.split()
    if built_library() is None:
        assert loop == "interpreted"
    else:
        assert loop == "native:" and digits == ours.q[-1].tobytes().hex()


def test_without_a_compiler_at_any_time_scenes_with_forces_are_interpreted(tmp_path):
    """Nothing was built with the package, and nothing can be compiled: by default, all is as it
    is elsewhere, only slower.
    """
    script = """
import varint.codegen.built as built
built.built_library = built.built_module = lambda: None
import warnings
warnings.simplefilter("ignore")
import casadi as ca, numpy as np, varint as vi
q, v = vi.coordinates("x", "y")
t = vi.time()
for damper, drive in ((0.1, 0), (300.0, 0), (0.1, ca.sin(3 * t)), (300.0, ca.sin(3 * t))):
    way = damper * (v[1] - v[0])
    force = ca.vertcat(way + drive, -way - 0.2 * v[1])
    moving = ca.sumsqr(v) / 2 + ca.cos(q[0]) - ca.sumsqr(q) / 2 - q[1] ** 4
    system = vi.System(q, v, moving, force=force, t=t)
    start = dict(q0=[1.0, 0.2], v0=[0.0, 0.5], duration=1.5, tol=1e-6)
    for more in ({}, dict(at=np.linspace(0, 1.5, 4)), dict(until=q[0]), dict(events={"low": q[0]})):
        motion = vi.simulate(system, **start, **more)
        print(*motion.q[-1], motion.t[-1])
        loop = motion.stats.get("backend", "")
        assert not loop.startswith(("native", "compiled")) or not LACKING, loop
"""
    told = []
    for lacking in (True, False):
        room = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
        text = script.replace("LACKING", str(lacking))
        if lacking:
            room |= {"PATH": "", "CC": ""}
        else:
            text = text.replace("built.built_library", "was")
        done = subprocess.run(
            [sys.executable, "-c", text], capture_output=True, text=True, env=room, check=True
        )
        told.append(np.array([line.split() for line in done.stdout.splitlines()], float))
    assert told[0].shape == (16, 3)
    assert np.abs(told[0] - told[1]).max() < 3e-6
