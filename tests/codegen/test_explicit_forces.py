"""Forces of explicit compositions in C: in loops where their operations are alike, and written once
where they are long.
"""

import casadi as ca
import numpy as np
import pytest
from test_compiled import composition_by_numpy, simulated

import varint as vi
from varint.codegen.cache import compiler
from varint.codegen.explicit import LOOPS_FROM, explicit_functions, explicit_kernel, loops_from
from varint.codegen.native import native_explicit

EXPLICIT = explicit_kernel, native_explicit
pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def coupled(count):
    """Pendulums in a row, each coupled with the next."""
    q, v = vi.coordinates(*(f"a{i}" for i in range(count)))
    potential = -ca.sum1(ca.cos(q)) - 0.3 * ca.sum1(ca.cos(q[1:] - q[:-1]))
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential)


@pytest.mark.parametrize(("count", "loops"), ((12, False), (40, True)))
def test_forces_that_are_alike_are_loops_and_keep_the_bytes_of_their_operations(count, loops):
    system, rule = coupled(count), vi.composition("yoshida4")
    force = explicit_functions(system, rule)["rhs"]
    assert (loops_from(force) < LOOPS_FROM) == loops
    start = np.linspace(-1, 1, count) ** 3, np.linspace(0.3, -0.2, count)
    one, other = (simulated(k(system, rule), *start, 0.05, 50, system) for k in EXPLICIT)
    assert one.rows.tobytes() == other.rows.tobytes()
    q, p = composition_by_numpy(system, rule, *start, 0.05, 50)
    assert np.abs(one.rows[-1, :2] - [q, p]).max() < 1e-13


@pytest.mark.parametrize(
    ("of", "loops"), ((lambda d: -ca.cos(d), False), (lambda d: ca.sqrt(1 + d**2), True))
)
def test_forces_of_many_neighbours_keep_the_bytes_of_their_operations(of, loops):
    """Long sums, which loops add up in an order of their own, are written out."""
    q, v = vi.coordinates(*(f"a{i}" for i in range(40)))
    near = [(i, (i + far) % 40) for i in range(40) for far in (1, 2, 3, 4)]
    potential = sum(of(q[i] - q[j]) for i, j in near)
    system, rule = vi.System(q, v, ca.sumsqr(v) / 2 - potential), vi.composition("verlet")
    assert (loops_from(explicit_functions(system, rule)["rhs"]) < LOOPS_FROM) == loops
    start = np.linspace(-1, 1, 40) ** 3, np.zeros(40)
    one, other = (simulated(k(system, rule), *start, 0.05, 50, system) for k in EXPLICIT)
    assert one.rows.tobytes() == other.rows.tobytes()


@pytest.mark.parametrize("count", (3, 7))
def test_the_code_of_a_long_force_does_not_grow_with_the_number_of_kicks(
    count, monkeypatch, tmp_path
):
    """In line or out of it: the bytes are those of the operations as data."""
    sizes, start = {}, (np.linspace(0.1, 0.8, count), np.zeros(count))
    for name in ("verlet", "kahan-li8"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        kernels = [make(coupled(count), vi.composition(name)) for make in EXPLICIT]
        runs = [simulated(kernel, *start, 0.1, 200) for kernel in kernels]
        assert runs[0].rows.tobytes() == runs[1].rows.tobytes()
        (made,) = (tmp_path / name / "varint").glob("*.so")
        sizes[name] = made.stat().st_size
    assert sizes["kahan-li8"] < 1.3 * sizes["verlet"]
