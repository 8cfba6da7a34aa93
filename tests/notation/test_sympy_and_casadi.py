"""Every operation means the same in CasADi and in SymPy, or is refused by name."""

from __future__ import annotations

import math
import subprocess
import sys
from math import pi, sqrt

import casadi as ca
import numpy as np
import pytest

sp = pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")

import varint as vi  # noqa: E402
from varint.notation import to_sympy  # noqa: E402
from varint.notation.from_sympy import FUNCTIONS, casadi_of  # noqa: E402
from varint.notation.numbers import exact_number  # noqa: E402
from varint.notation.to_sympy import sympy_of  # noqa: E402
from varint.numerics.operations import BINARY, CODES, UNARY  # noqa: E402

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
LETTERS = sp.symbols("x y", real=True)
POINTS = [(0.3, 0.7), (0.8, -0.4), (-0.6, 0.25), (-0.35, -0.9), (0.0, 0.5), (2.5, 1.5), (1.0, 1.0)]
ROUGH = {"erfinv": 1e-7}  # how exactly CasADi evaluates it
REFUSED = {"remainder"}  # IEEE 754's, which rounds to even


def at(e, x: float, y: float) -> float | None:
    """The value of a SymPy expression by its own arithmetic of 30 digits, if it is real."""
    exact = dict(zip(LETTERS, (sp.Rational(str(x)), sp.Rational(str(y))), strict=True))
    value = sp.N(e.subs(exact), 30)
    return float(value) if value.is_real and value.is_finite else None


def in_casadi(name: str) -> ca.SX:
    if name in UNARY:
        return ca.SX.unary(CODES[name], X)
    return ca.SX.binary(CODES[name], X, Y)


@pytest.mark.parametrize("name", sorted(UNARY | BINARY))
def test_an_operation_has_the_same_values_in_sympy(name):
    expression = in_casadi(name)
    if name in REFUSED:
        with pytest.raises(vi.InputError, match=name):
            sympy_of([ca.vertcat(X, Y)], [LETTERS], [expression])
        return
    [[found]] = sympy_of([ca.vertcat(X, Y)], [LETTERS], [expression])
    function = ca.Function("f", [X, Y], [expression])
    compared = 0
    for x, y in POINTS:
        wanted = float(function(x, y))
        value = at(found, x, y) if math.isfinite(wanted) else None
        if value is not None:
            assert value == pytest.approx(wanted, rel=ROUGH.get(name, 1e-13), abs=1e-15), (x, y)
            compared += 1
    assert compared >= 2


@pytest.mark.parametrize("name", sorted(UNARY | BINARY - REFUSED))
def test_an_operation_comes_back_from_sympy(name):
    expression = in_casadi(name)
    [[found]] = sympy_of([ca.vertcat(X, Y)], [LETTERS], [expression])
    back = casadi_of("it", found, dict(zip(LETTERS, (X, Y), strict=True)))
    one, other = (ca.Function("f", [X, Y], [e]) for e in (expression, back))
    for x, y in POINTS:
        if math.isfinite(wanted := float(one(x, y))):
            assert float(other(x, y)) == pytest.approx(wanted, rel=1e-13, abs=1e-15), (x, y)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_a_function_of_sympy_has_the_same_values_in_casadi(name):
    function = getattr(sp, name)
    x, y = LETTERS
    one = next((LETTERS[:k] for k in (1, 2) if _takes(function, k)), ())
    special = {"And": (x > 0, y > 0), "Or": (x > 0, y > 0), "Not": (x > 0,)}
    special |= dict.fromkeys(("Add", "Min", "Max"), LETTERS)
    e = function(*special.get(name, one))
    if isinstance(e, sp.logic.boolalg.Boolean):
        e = sp.Piecewise((1, e), (0, True))
    made = ca.Function("f", [X, Y], [casadi_of("it", e, dict(zip(LETTERS, (X, Y), strict=True)))])
    compared = 0
    for x, y in POINTS:
        exact = at(e, x, y) if math.isfinite(float(made(x, y))) else None
        if exact is not None:
            assert float(made(x, y)) == pytest.approx(exact, ROUGH.get(name, 1e-13), 1e-15), (x, y)
            compared += 1
    assert compared >= 2


def _takes(function, count: int) -> bool:
    """Whether a function has so many arguments."""
    try:
        function(*LETTERS[:count])
    except TypeError:
        return False
    return True


@pytest.mark.parametrize(
    ("x", "exact"),
    [
        (0.5, sp.Rational(1, 2)),
        (9.81, sp.Rational(981, 100)),
        (1 / 3, sp.Rational(1, 3)),
        (-2.0, sp.Integer(-2)),
        (6.02e23, sp.Integer(int(6.02e23))),
        (1e-20, sp.Rational(1, 10**20)),
        (pi / 6, sp.pi / 6),
        (-2 * pi, -2 * sp.pi),
        (sqrt(3) / 2, sp.sqrt(3) / 2),
        (-sqrt(0.02), -sp.sqrt(2) / 10),
    ],
)
def test_a_constant_is_the_number_that_it_stands_for(x, exact):
    assert exact_number(x) == exact


def test_a_constant_keeps_its_bits():
    rng = np.random.default_rng(1)
    values = [*rng.normal(size=200), *10.0 ** rng.uniform(-300, 300, 100), 5e-324, 1.7e308]
    for x in values:
        back = float(casadi_of("it", exact_number(float(x)), {}))
        assert back == pytest.approx(x, rel=4e-16, abs=0)
    assert exact_number(math.inf) == sp.oo and exact_number(-math.inf) == -sp.oo
    with pytest.raises(vi.InputError, match="NaN"):
        exact_number(math.nan)


def test_an_expression_that_would_never_end_is_refused():
    x = X
    for _ in range(60):
        x = x * x + ca.sin(x)
    with pytest.raises(vi.InputError, match="more than anybody reads"):
        sympy_of([ca.vertcat(X, Y)], [LETTERS], [x])
    assert to_sympy.LONGEST >= 100


def test_structural_zeros_and_columns_stay_where_they_are():
    matrix = ca.SX(2, 2)
    matrix[1, 0] = X
    matrix[0, 1] = X + Y
    [entries] = sympy_of([ca.vertcat(X, Y)], [LETTERS], [matrix])
    x, y = LETTERS
    assert entries == [0, x, x + y, 0]


@pytest.mark.parametrize(
    ("e", "named"),
    [
        (sp.gamma(LETTERS[0]) + sp.besselj(0, LETTERS[0]), r"\['besselj', 'gamma'\]"),
        (sp.Integral(sp.sin(LETTERS[0] ** 2), LETTERS[0]), "Integral"),
        (sp.I * LETTERS[0], "ImaginaryUnit"),
        (LETTERS[0] * sp.Symbol("w") + sp.Symbol("z"), r"\['w', 'z'\]"),
    ],
)
def test_what_casadi_has_not_is_named(e, named):
    with pytest.raises(vi.InputError, match=named):
        casadi_of("it", e, dict(zip(LETTERS, (X, Y), strict=True)))


def test_nobody_pays_for_sympy_who_does_not_ask_for_it():
    code = (
        "import sys, varint as vi\n"
        "m = vi.models.pendulum()\n"
        "motion = vi.simulate(m.system, **m.start)\n"
        "assert vi.gauss(2)._repr_latex_() and str(vi.plan(m.system))\n"
        "vi.symmetries(m.system), vi.equations, vi.from_sympy\n"
        "assert 'sympy' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
