"""What is the value of a notebook's cell shows itself: tableaux, tables and small pictures."""

from __future__ import annotations

import io
import re
from base64 import b64decode
from html.parser import HTMLParser

import casadi as ca
import numpy as np
import pytest
from matplotlib import pyplot as plt

import varint as vi
from varint.rules.closed_form import closed_form


class Whole(HTMLParser):
    """Reads HTML, and whether every element that is opened is closed."""

    def __init__(self, text: str):
        super().__init__()
        self.open: list[str] = []
        self.pictures: list[bytes] = []
        self.words: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        if tag != "img":
            self.open.append(tag)
            return
        fields = dict(attrs)
        assert len(fields["alt"]) > 5
        self.pictures.append(b64decode(fields["src"].partition("base64,")[2]))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def drawn(text: str) -> tuple[str, np.ndarray]:
    """The words and the picture."""
    read = Whole(text)
    [png] = read.pictures
    assert len(text) < 60_000 and not plt.get_fignums()
    return " | ".join(read.words), plt.imread(io.BytesIO(png))


def test_a_motion_shows_its_ends_and_draws_its_coordinates():
    model = vi.models.sliding_support()
    motion = vi.simulate(model.system, q0=[0, 1.2], v0=[0.5, 0], h=0.01, steps=1000)
    words, pixels = drawn(motion._repr_html_())
    assert f"1.2 … {motion.q[-1, 1]:.6g}" in words and "1001, t = 0 … 10" in words
    assert f"{motion.energy[0]:.9g}" in words and str(motion.rule) in words
    assert (pixels[..., :3].min(axis=2) < 0.8).mean() > 0.01  # not empty


def test_events_and_energy_are_told():
    ball = vi.models.bouncing_ball()
    motion = vi.simulate(ball.system, q0=ball.q0, v0=ball.v0, h=0.05, duration=3.0)
    words, _ = drawn(motion._repr_html_())
    assert f"events: {motion.events[0].kind}" in words


def test_a_long_motion_is_shown_without_going_through_its_nodes(monkeypatch):
    q, v = vi.coordinates("x")
    motion = vi.simulate(vi.System(q, v, (v**2 - q**2) / 2), q0=1, v0=0, h=0.01, steps=20_000)
    seen = []
    kept = type(motion).evaluated
    monkeypatch.setattr(
        type(motion), "evaluated", lambda self, f: seen.append(len(self)) or kept(self, f)
    )
    text = motion._repr_html_()
    assert seen and max(seen) <= 400 and len(text) < 60_000


def test_an_optimal_control_shows_its_cost_and_its_controls():
    q, v = vi.coordinates("x")
    push = ca.SX.sym("push")
    system = vi.System(q, v, v**2 / 2, force=push, control=push)
    motion = vi.optimal_control(
        system,
        vi.gauss(2),
        duration=1.0,
        steps=4,
        cost=push**2,
        start=dict(q=0, v=0),
        end=dict(q=1, v=0),
    )
    words, wide = drawn(motion._repr_html_())
    assert "cost | 12 |" in words.replace("12.0000000", "12") and motion.solution.status in words
    words, narrow = drawn(motion.solution._repr_html_())
    assert "steps | 4" in words and wide.shape[1] == pytest.approx(2 * narrow.shape[1], rel=0.02)


def test_an_ensemble_shows_its_members_and_their_spread():
    model = vi.models.kepler()
    many = vi.ensemble(model.system, q0=[[1, 0], [1.1, 0], [0.9, 0]], v0=[0, 1], h=0.01, steps=50)
    words, _ = drawn(many._repr_html_())
    assert "3, 0 failed" in words and "51, t = 0 … 0.5" in words


def test_a_plan_lists_what_runs_and_what_is_skipped():
    plan = vi.plan(vi.models.pendulum().system)
    words = " | ".join(Whole(plan._repr_html_()).words)
    assert all(text in words for text in (*plan.runs, *plan.skipped)) and plan.method in words


def test_a_system_shows_its_lagrangian():
    pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")
    shown = vi.models.pendulum().system._repr_latex_()
    assert shown == (
        r"$\displaystyle L = \frac{1}{2} m \, \mathrm{length}^{2} \, \dot{\theta}^{2}"
        r" + m \, \mathrm{length} \, g \cos \theta$"
    )
    assert vi.models.toda_chain().system._repr_latex_() is None  # too long to be read
    q, v = vi.coordinates("x")
    assert vi.System(q, v, v**2 - ca.remainder(q, 2))._repr_latex_() is None  # SymPy has it not


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (5 / 36, r"\frac{5}{36}"),
        (-0.25, r"-\frac{1}{4}"),
        (2.0, "2"),
        (2 / 9 + 15**0.5 / 15, r"\frac{2}{9} + \frac{\sqrt{15}}{15}"),
        (0.25 - 3**0.5 / 6, r"\frac{1}{4} - \frac{\sqrt{3}}{6}"),
        (5**0.5 / 2, r"\frac{\sqrt{5}}{2}"),
        (-(3**0.5), r"-\sqrt{3}"),
        (0.2113248654, "0.2113248654"),  # ten digits of a number are not the number
        (np.pi / 10, "0.3141592654"),
    ],
)
def test_a_number_of_a_rule_reads_as_in_a_book(x, text):
    assert closed_form(x) == text


def evaluated(text: str) -> float:
    """A closed form as a number."""
    text = re.sub(r"\\frac\{([^{}]*(?:\{\d+\})?)\}\{(\d+)\}", r"((\1)/\2)", text)
    return eval(re.sub(r"(\d*)\\sqrt\{(\d+)\}", lambda m: f"{m[1] or 1}*{m[2]}**0.5", text))


@pytest.mark.parametrize("rule", [*map(vi.gauss, range(1, 5)), *map(vi.lobatto, range(2, 5))])
def test_the_tableau_of_a_rule_is_that_of_a_symplectic_runge_kutta_pair(rule):
    """Row sums are the nodes, ½ is the sum of b c, and b_i â_ij + b_j a_ji = b_i b_j."""
    tables = []
    for part in re.findall(r"\\begin\{array\}\{c\|c+\} (.*?) \\end\{array\}", rule._repr_latex_()):
        body, last = part.split(r" \\ \hline ")
        rows = [[evaluated(x) for x in row.split(" & ")] for row in body.split(r" \\ ")]
        weights = np.array([evaluated(x) for x in last.split(" & ")[1:]])
        tables.append((np.array(rows)[:, 0], np.array(rows)[:, 1:], weights))
    (c, a, b), (_, other, _) = tables[0], tables[-1]
    assert len(tables) == (1 if rule.degree == len(rule.nodes) else 2)
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-9)
    np.testing.assert_allclose(b[:, None] * other + (b[:, None] * a).T, np.outer(b, b), atol=1e-9)
    assert b @ c == pytest.approx(0.5, abs=1e-9)


def test_gauss_of_two_stages_is_that_of_the_book():
    assert vi.gauss(2)._repr_latex_() == (
        r"$\displaystyle \texttt{gauss(2)} \qquad \begin{array}{c|cc} "
        r"\frac{1}{2} - \frac{\sqrt{3}}{6} & \frac{1}{4} & \frac{1}{4} - \frac{\sqrt{3}}{6} \\ "
        r"\frac{1}{2} + \frac{\sqrt{3}}{6} & \frac{1}{4} + \frac{\sqrt{3}}{6} & \frac{1}{4} \\ "
        r"\hline  & \frac{1}{2} & \frac{1}{2} \end{array}$"
    )


def test_large_rules_and_compositions_show_columns():
    assert vi.gauss(16)._repr_latex_().count("&") == 17
    kicks = vi.composition("verlet")._repr_latex_()
    assert r"\frac{1}{2} & 1 \\ \frac{1}{2} & " in kicks and "drifts" in kicks
