"""How the name of a symbol is written: theta1_dot as θ̇₁, in LaTeX and in plain text."""

from __future__ import annotations

import re
import unicodedata
from typing import NamedTuple

GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "epsilon": "ε",
    "zeta": "ζ",
    "eta": "η",
    "theta": "θ",
    "iota": "ι",
    "kappa": "κ",
    "lambda": "λ",
    "mu": "μ",
    "nu": "ν",
    "xi": "ξ",
    "pi": "π",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "upsilon": "υ",
    "phi": "φ",
    "chi": "χ",
    "psi": "ψ",
    "omega": "ω",
    "ell": "ℓ",
    # of the capitals only those that differ from Latin ones have a command
    "Gamma": "Γ",
    "Delta": "Δ",
    "Theta": "Θ",
    "Lambda": "Λ",
    "Xi": "Ξ",
    "Pi": "Π",
    "Sigma": "Σ",
    "Upsilon": "Υ",
    "Phi": "Φ",
    "Psi": "Ψ",
    "Omega": "Ω",
}
DOT = "_dot"  # ends the name of a velocity
DOTS = (
    "",
    "\N{COMBINING DOT ABOVE}",
    "\N{COMBINING DIAERESIS}",
    "\N{COMBINING THREE DOTS ABOVE}",
)
LATEX_DOTS = ("{}", r"\dot{{{}}}", r"\ddot{{{}}}", r"\dddot{{{}}}")
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
SPECIAL = re.compile(r"[_#$%&{}]")  # of LaTeX
WORD = re.compile(r"([^\W\d_]+)_?(\d*)(?:_([^\W_]+(?:_\d+)?))?")


class Name(NamedTuple):
    """A name in its parts: letter or word, number, what stands below it after an underscore."""

    base: str
    number: str
    below: str
    dots: int


def name_parts(name: str) -> Name | None:
    """The parts of a name; None where it is no word with a number or an index."""
    stem, dots = (name.removesuffix(DOT), 1) if name.endswith(DOT) else (name, 0)
    match = WORD.fullmatch(stem)
    return None if match is None else Name(match[1], match[2], match[3] or "", dots)


def latex_name(name: str, dots: int = 0) -> str:
    r"""A symbol's name in LaTeX; `dots` more derivatives with respect to time.

    Examples
    --------
    >>> from varint.notation.names import latex_name
    >>> latex_name("theta1_dot"), latex_name("p_theta"), latex_name("x", 2)
    ('\\dot{\\theta}_{1}', 'p_{\\theta}', '\\ddot{x}')
    """
    parts = name_parts(name)
    if parts is None:
        word = name if name.isdigit() else r"\mathrm{" + SPECIAL.sub(r"\\\g<0>", name) + "}"
        return LATEX_DOTS[dots].format(word)
    base = parts.base
    letter = "\\" + base if base in GREEK else base if len(base) == 1 else r"\mathrm{" + base + "}"
    below = ", ".join(
        x for x in (parts.number, latex_name(parts.below) if parts.below else "") if x
    )
    letter = LATEX_DOTS[parts.dots + dots].format(letter)
    return f"{letter}_{{{below}}}" if below else letter


def plain_name(name: str, dots: int = 0) -> str:
    """A symbol's name in plain text, Greek letters and dots included.

    Examples
    --------
    >>> from varint.notation.names import plain_name
    >>> plain_name("omega_0"), plain_name("p_theta1"), plain_name("length")
    ('ω₀', 'p_θ₁', 'length')
    """
    parts = name_parts(name)
    if parts is None:
        return name + DOTS[dots]
    dotted = GREEK.get(parts.base, parts.base) + DOTS[parts.dots + dots]
    letter = unicodedata.normalize("NFC", dotted)  # one character where there is one
    below = f"_{plain_name(parts.below)}" if parts.below else ""
    return letter + parts.number.translate(SUBSCRIPTS) + below


def latex_text(text: str, face: str = "text") -> str:
    """Plain words within LaTeX; what LaTeX would take for a command becomes a space."""
    return rf"\{face}{{{SPECIAL.sub(' ', text)}}}"
