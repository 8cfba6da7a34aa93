"""How the compiled loops are called: one header for C and Python."""

import ctypes
import re

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen import arguments
from varint.codegen.arguments import MembersArguments, RunArguments, RunStats, Status, c_source
from varint.codegen.cache import compiler, library

LOOPS = ("explicit.c", "gauss_loop.c", "newton.c", "members.c", "members_gauss.c")
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@needs_compiler
@pytest.mark.parametrize("layout", (RunArguments, MembersArguments, RunStats))
def test_the_layouts_in_python_are_those_of_the_header(layout):
    names = [name for name, _ in layout._fields_]
    offsets = ", ".join(f"offsetof({layout.__name__}, {name})" for name in names)
    source = "#include <stddef.h>\n#define LANES 1\n#define N 3\n" + c_source("lanes.h")
    source += c_source("run.h") + f"const long offsets[] = {{{offsets}}};\n"
    found = (ctypes.c_long * len(names)).in_dll(library(source), "offsets")
    assert list(found) == [getattr(layout, name).offset for name in names]
    assert arguments.packing(layout).size == ctypes.sizeof(layout)
    body = re.search(rf"\{{([^{{}}]*)\}} {layout.__name__};", c_source("run.h"))[1]
    declared = re.findall(r"(\w+)(?=[,;\[])", re.sub(r"/\*.*?\*/|\[.*?\]", "", body))
    assert declared == names + ["last"] * (layout is RunStats)


@needs_compiler
def test_a_run_ends_with_the_same_names_in_c_and_in_python():
    head = "#define LANES 1\n#define N 1\n" + c_source("lanes.h") + c_source("run.h")
    values = ", ".join(name for name in Status.__members__)
    compiled = library(head + f"const int values[] = {{{values}}};\n")
    found = (ctypes.c_int * len(Status)).in_dll(compiled, "values")
    assert list(found) == [int(status) for status in Status]
    assert set(Status.__members__) == {"DONE", "NOT_CONVERGED", "NOT_FINITE"}


@pytest.mark.parametrize("loop", LOOPS)
def test_no_loop_repeats_what_the_header_has(loop):
    text = c_source(loop)
    shared = ("int64_t steps, save_every", "enum {", "void compensated", "void v_compensated")
    assert not [words for words in shared if words in text]
    assert re.search(r"const (Run|Members)Arguments \*a", text)


@needs_compiler
def test_the_sums_keep_what_rounding_takes_from_them():
    source = "#define LANES 4\n#define N 1\n" + c_source("lanes.h") + c_source("run.h")
    source += """
    void many(double *one, double *four, double x, long count) {
        double rest = 0;
        V sums = splat(1.0), rests = splat(0.0);
        *one = 1;
        for (long i = 0; i < count; i++)
            compensated(one, &rest, x), v_compensated(&sums, &rests, splat(x));
        for (int l = 0; l < 4; l++) four[l] = lane(sums, l);
    }
    """
    one, four, count = np.zeros(1), np.zeros(4), 1_000_000
    many = library(source).many
    many.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_long]
    many(one.ctypes.data, four.ctypes.data, 1e-17, count)
    assert one[0] == pytest.approx(1 + 1e-11, abs=3e-16)
    assert np.array_equal(four, np.full(4, one[0]))


@needs_compiler
def test_threads_that_call_one_kernel_at_once_do_not_mix_their_arguments():
    from concurrent.futures import ThreadPoolExecutor

    q, v = vi.coordinates("theta")
    scene = vi.System(q, v, v**2 / 2 + ca.cos(q))

    def end(start):
        options = {"q0": start, "v0": 0.0, "h": 0.05, "steps": 2000, "backend": "compiled"}
        return vi.simulate(scene, vi.gauss(4), **options).q[-1, 0]

    starts = np.linspace(0.1, 2.0, 40)
    alone = [end(start) for start in starts]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(end, starts)) == alone
