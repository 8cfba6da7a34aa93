"""Expressions read as in a book, in LaTeX and in plain text."""

from __future__ import annotations

import casadi as ca
import pytest

sp = pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")

import varint as vi  # noqa: E402
from varint.notation.styles import LATEX, PLAIN  # noqa: E402
from varint.notation.tidy import shortest, slope, tidied  # noqa: E402
from varint.notation.writer import write  # noqa: E402

T = sp.Symbol("t")
M, m, ell, g = sp.symbols("M m ell g")
x, y = sp.Function("x")(T), sp.Function("y")(T)
theta = sp.Function("theta")(T)
ORDER = ("M", "m", "ell", "g", "t", "x", "y", "theta")


@pytest.mark.parametrize(
    ("e", "plain", "latex"),
    [
        (m * x.diff(T) ** 2 / 2, "½ m ẋ²", r"\frac{1}{2} m \dot{x}^{2}"),
        (g / ell * sp.sin(theta), "(g/ℓ) sin(θ)", r"\frac{g}{\ell} \sin \theta"),
        (x**2 / (2 * m), "x²/(2 m)", r"\frac{x^{2}}{2 m}"),
        (-g * x, "-g x", "-g x"),
        (x**2 + y**2 - ell**2, "x² + y² - ℓ²", r"x^{2} + y^{2} - \ell^{2}"),
        (
            1 / (M + m * sp.sin(theta) ** 2),
            "1/(M + m sin²(θ))",
            r"\frac{1}{M + m \sin^{2} \theta}",
        ),
        (x * y.diff(T) - y * x.diff(T), "x ẏ - y ẋ", r"x \dot{y} - y \dot{x}"),
        (sp.sqrt(1 - x.diff(T) ** 2), "√(1 - ẋ²)", r"\sqrt{1 - \dot{x}^{2}}"),
        (-(x.diff(T)) + 1, "-ẋ + 1", r"-\dot{x} + 1"),
        (sp.pi * x / 3, "⅓ π x", r"\frac{1}{3} \pi x"),
        (sp.Rational(981, 100) * x, "9.81 x", "9.81 x"),
        (sp.Rational(3, 16) * x, "(3/16) x", r"\frac{3}{16} x"),
        (
            sp.Rational(6674, 10**14) * x / y,
            "6.674e-11 x/y",
            r"\frac{6.674 \cdot 10^{-11} x}{y}",
        ),
        (x ** sp.Rational(3, 2), "x^(3/2)", "x^{3/2}"),
        ((x + y) ** 2, "(x + y)²", r"\left(x + y\right)^{2}"),
        (x ** sp.Symbol("n"), "x^(n)", "x^{n}"),
        (
            sp.cos(theta - x) * theta.diff(T, 2),
            "θ\N{COMBINING DIAERESIS} cos(θ - x)",
            r"\ddot{\theta} \cos\left(\theta - x\right)",
        ),
        (sp.asin(x) ** 2, "asin²(x)", r"\arcsin^{2} x"),
        (sp.exp(-(x**2)), "exp(-x²)", r"\exp\left(-x^{2}\right)"),
        (sp.Abs(x) ** 3, "|x|³", r"\left|x\right|^{3}"),
        (sp.Min(x, y), "Min(x, y)", r"\min\left(x, y\right)"),
        (
            sp.Piecewise((x, x > 0), (2, True)) * y,
            "y (x if x > 0 else 2)",
            r"y \begin{cases} x & \text{if } x > 0 \\ 2 & \text{otherwise} \end{cases}",
        ),
        (sp.Integer(0), "0", "0"),
        (sp.Rational(-1, 2), "-½", r"-\frac{1}{2}"),
        (sp.Symbol("m_0") * sp.Symbol("length"), "length m₀", r"\mathrm{length} \, m_{0}"),
    ],
)
def test_an_expression_reads_as_in_a_book(e, plain, latex):
    assert write(e, PLAIN, ORDER) == plain
    assert write(e, LATEX, ORDER) == latex


def real(names):
    return sp.symbols(names, real=True)


def test_sines_and_cosines_come_together_and_constants_in_front():
    a, b, M, m, v, w = real("a b M m v w")
    speed = (v * sp.cos(a) + w * sp.cos(b)) ** 2 + (v * sp.sin(a) + w * sp.sin(b)) ** 2
    found = tidied(m * speed / 2 + M * v**2 / 2, (v, w), (a, b))
    assert found == (M + m) * v**2 / 2 + m * w**2 / 2 + m * v * w * sp.cos(a - b)
    assert shortest(M + m - m * sp.cos(a) ** 2, (a,)) == M + m * sp.sin(a) ** 2


def test_high_powers_of_sums_are_not_multiplied_out():
    a, b, v = real("a b v")
    e = (1 + a + b) ** 40 * v**2 + (a + b) ** 2 * v
    assert tidied(e, (v,), (a, b)).coeff(v, 2) == (1 + a + b) ** 40


def test_steps_have_no_slope_as_in_casadi():
    a, b = real("a b")
    assert slope(sp.sign(a) * a**2, a) == 2 * a * sp.sign(a)
    assert slope(sp.floor(a) * b, a) == 0 and slope(sp.floor(a) * b, b) == sp.floor(a)


def test_a_condition_is_written_once():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - ca.if_else(q > 0, q**2, 2 * q**4))
    assert str(vi.equations(system).lagrangian) == "L = ½ ẋ² - (x² if x > 0 else 2 x⁴)"
