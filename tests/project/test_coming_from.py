"""The other tools' code on the page "coming from" runs where the tool is installed, and finds
what varint finds.
"""

import re
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "coming-from.md"
sys.path.insert(0, str(ROOT / "docs" / "_tools"))

from blocks import marked_blocks, outcome, python_blocks  # noqa: E402  (only findable now)

SECTIONS = dict(
    re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", PAGE.read_text(encoding="utf-8"), re.M | re.S)
)
PREFACE = PAGE.read_text(encoding="utf-8").partition("\n## ")[0]
AGREE = {  # relative
    "SciPy": 1e-8,
    "SymPy mechanics": 1e-8,
    "heyoka": 1e-9,
    "REBOUND": 1e-8,
    "rockit, and CasADi by hand": 3e-3,  # whose controls are constant on a step: 12 N²/(N² − 1)
}


@pytest.mark.parametrize("section", AGREE)
def test_the_other_tool_finds_the_same(section):
    theirs = [code for kind, code in marked_blocks(SECTIONS[section]) if kind == "still"]
    for name in re.findall(r"^(?:import|from) (\w+)", "\n".join(theirs), re.M):
        pytest.importorskip(name)
    namespace = {"__name__": "page"}
    for code in python_blocks(PREFACE) + python_blocks(SECTIONS[section]):
        outcome(code, namespace, section, draw=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # theirs to answer for
        for code in theirs:
            exec(compile(code, section, "exec"), namespace)
    assert np.shape(namespace["theirs"]) == np.shape(namespace["ours"])
    np.testing.assert_allclose(namespace["theirs"], namespace["ours"], rtol=AGREE[section])


def test_every_section_has_both_sides_and_some_blocks_never_run_but_are_python():
    never = []
    for section, text in SECTIONS.items():
        marked, ours = marked_blocks(text), python_blocks(text)
        kinds = [kind for kind, _ in marked]
        if section in AGREE:
            assert kinds == ["still"] and len(ours) == 1, section
        elif marked:
            assert kinds == ["illustration"] and len(ours) == 1, section
            never.append(section)
        for _, code in marked:
            compile(code, section, "exec")
    assert never == ["opty", "trep", "bioptim"]


def test_heyoka_takes_what_the_table_says_it_takes():
    """A Lagrangian with a Rayleigh function, a Hamiltonian, and SymPy's expressions."""
    hy, sm = pytest.importorskip("heyoka"), pytest.importorskip("sympy")
    x, u, p = hy.make_vars("x", "u", "p")
    damped = hy.lagrangian(0.5 * u**2 - hy.cos(x), [x], [u], 0.05 * u**2)
    swung = hy.hamiltonian(0.5 * p**2 + hy.cos(x), [x], [p])
    q, v = sm.symbols("x u")
    read = hy.lagrangian(hy.from_sympy(v**2 / 2 - sm.cos(q)), [x], [u])
    angle, speed = vi.coordinates("x")
    L = speed**2 / 2 - ca.cos(angle)
    free, slowed = vi.System(angle, speed, L), vi.System(angle, speed, L, force=-0.1 * speed)
    for equations, system in ((damped, slowed), (swung, free), (read, free)):
        orbit = hy.taylor_adaptive(equations, [0.3, 0.2])
        orbit.propagate_until(10.0)
        ours = vi.simulate(system, q0=0.3, v0=0.2, duration=10.0, tol=1e-11).q[-1]
        np.testing.assert_allclose(orbit.state[:1], ours, rtol=1e-9)
