"""Names are written as in a book, in LaTeX, in plain text and beside axes."""

from __future__ import annotations

import pytest

from varint.drawing.style import label
from varint.notation.names import latex_name, plain_name


@pytest.mark.parametrize(
    ("name", "latex", "plain"),
    [
        ("theta", r"\theta", "θ"),
        ("theta_dot", r"\dot{\theta}", "θ\N{COMBINING DOT ABOVE}"),
        ("theta12_dot", r"\dot{\theta}_{12}", "θ\N{COMBINING DOT ABOVE}₁₂"),
        ("omega_0", r"\omega_{0}", "ω₀"),
        ("p_theta", r"p_{\theta}", "p_θ"),
        ("p_theta2", r"p_{\theta_{2}}", "p_θ₂"),
        ("p_theta_1", r"p_{\theta_{1}}", "p_θ₁"),
        ("Omega", r"\Omega", "Ω"),
        ("Alpha", r"\mathrm{Alpha}", "Alpha"),  # LaTeX has no \Alpha
        ("ell", r"\ell", "ℓ"),
        ("length_dot", r"\dot{\mathrm{length}}", "lengtḣ"),
        ("m_0", "m_{0}", "m₀"),
        ("x1_2", "x_{1, 2}", "x₁_2"),
        ("V_eff", r"V_{\mathrm{eff}}", "V_eff"),
        ("angle_of_arm", r"\mathrm{angle\_of\_arm}", "angle_of_arm"),
        ("50%", r"\mathrm{50\%}", "50%"),
    ],
)
def test_a_name_reads_as_in_a_book(name, latex, plain):
    assert latex_name(name) == latex and plain_name(name) == plain


def test_dots_add_up():
    assert latex_name("x", 2) == latex_name("x_dot", 1) == r"\ddot{x}"
    assert plain_name("x", 2) == "ẍ" and len(plain_name("x", 2)) == 1
    assert latex_name("strange name", 1) == r"\dot{\mathrm{strange name}}"


@pytest.mark.parametrize(
    "name", ["theta1_dot", "p_theta", "length", "ell", "Omega", "Alpha", "x_1"]
)
def test_axes_have_the_same_names(name):
    from matplotlib.mathtext import MathTextParser

    assert label(name) == f"${latex_name(name)}$"
    MathTextParser("agg").parse(label(name))


def test_axes_keep_a_name_that_is_no_symbol():
    assert label("angle of the arm") == "angle of the arm" and label("a_b_c") == "a_b_c"
