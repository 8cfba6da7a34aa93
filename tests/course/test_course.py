"""Exercises of the course: every right answer is right, however it is written; wrong ones are
not, and hear where they part from what was computed.
"""

import re
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import varint as vi

COURSE = Path(__file__).resolve().parents[2] / "docs" / "course"
X, XDOT = vi.coordinates("x")
Q, V = vi.coordinates("x", "y")
SPRING = XDOT**2 / 4 - 20 * X**2 + 9.81 * X / 2
WIRE = ca.sumsqr(V) / 2 - 9.81 * Q[1]
SWING = np.sqrt(9.81 * (2 + np.array([-1, 1]) * np.sqrt(2)))


def kicked(q, p, h):
    """Half of Verlet's step."""
    return p - h / 2 * ca.sin(q)


RIGHT = {
    "1.1": [
        vi.System(X, XDOT, SPRING),
        vi.System(X, XDOT, 3 * SPRING + X**2 * XDOT),  # d(x³/3)/dt changes nothing
    ],
    "1.2": [np.pi / 3, 1.04, [1.05]],
    "2.1": [vi.System(X, XDOT, (1 + X**2) * XDOT**2 / 2 - 9.81 * X**2 / 2)],
    "2.2": [
        lambda s: (2 * ca.cos(s), 2 * ca.sin(s)),
        lambda s: (s, ca.sqrt(4 - s**2)),
        lambda s: ca.vertcat(ca.sqrt(4 - s**2), s),
    ],
    "3.1": [
        lambda q, v: v[0] - 2 * q[1],
        lambda q, v: v[1] + 2 * q[0],
        lambda q, v: q[0] * v[1] - q[1] * v[0] + ca.sumsqr(q),
    ],
    "3.2": [(2, 3), np.array([-0.4, -0.6])],
    "4.1": [5.886, 5.89],
    "4.2": [
        vi.System(Q, V, WIRE, constraint=2 * Q[1] - Q[0] ** 2),
        vi.System(Q, V, 2 * WIRE, constraint=ca.exp(Q[1] - Q[0] ** 2 / 2) - 1),
    ],
    "5.1": [SWING, SWING[::-1].round(3)],
    "5.2": [((2 + np.pi / 20) ** 2 - 4) / 2],
    "6.1": [4, 4.001],
    "6.2": [7, 7.0],
    "7.1": [
        lambda q, p, h: (q + h * (p - h * ca.sin(q)), p - h * ca.sin(q)),
        lambda q, p, h: (q + h * p, p - h * ca.sin(q + h * p)),
        lambda q, p, h: (
            q + h * kicked(q, p, h),
            kicked(q, p, h) - h / 2 * ca.sin(q + h * kicked(q, p, h)),
        ),
    ],
    "7.2": [
        lambda q, p: ca.sqrt(2 * q) * ca.sin(p),
        lambda q, p: ca.sqrt(2 * q) * (ca.sin(p) + ca.cos(p)),  # P + Q
    ],
    "8.1": [lambda w: (-w[1] * w[2], w[2] * w[0], -w[0] * w[1] / 3)],
    "8.2": [8.83511, 8.834],
}
WRONG = {
    "1.1": [
        (vi.System(X, XDOT, SPRING - 9.81 * X), "the acceleration is"),
        (vi.System(Q, V, ca.sumsqr(V) / 2), "there must be one coordinate, there are 2"),
    ],
    "1.2": [
        (1.0, "is a minimum still"),
        (1.1, "is no minimum any more"),
        (-1, "is no duration"),
    ],
    "2.1": [(vi.System(X, XDOT, XDOT**2 / 2 - 9.81 * X**2 / 2), "the acceleration is")],
    "2.2": [
        (lambda s: (2 * ca.cos(s), ca.sin(s)), "the ladder has the length"),
        (lambda s: (2, 0), "do not move"),
    ],
    "3.1": [
        (lambda q, v: v[0] + 2 * q[1], "it changes by"),
        (lambda q, v: ca.sumsqr(v) ** 2, "a function of the energy alone"),
        (lambda q, v: 3.0, "a number or"),
    ],
    "3.2": [((3, 2), "this direction changes L"), ((0, 0), "direction 0")],
    "4.1": [(3.924, "too small"), (6.0, "5.9 N|6 N is too large")],
    "4.2": [
        (vi.System(Q, V, WIRE, constraint=Q[1] - Q[0] ** 2), "your constraint does not vanish"),
        (vi.System(Q, V, WIRE + Q[0], constraint=Q[1] - Q[0] ** 2 / 2), "the acceleration is"),
        (vi.System(Q, V, WIRE), "there is no constraint"),
    ],
    "5.1": [((2.39, 5.787), "is no frequency")],
    "5.2": [(0.3, "it takes 21.7"), (-1, "must be a positive number")],
    "6.1": [(3.9, "r goes from")],
    "6.2": [(5, "136.07° apart"), (-1, "must be positive")],
    "7.1": [
        (lambda q, p, h: (q + h * p, p - h * ca.sin(q)), "multiplies areas"),
        (lambda q, p, h: (q, p), "do not follow"),
    ],
    "7.2": [(lambda q, p: -ca.sqrt(2 * q) * ca.sin(p), "is -1, not 1")],
    "8.1": [(lambda w: (w[1] * w[2], w[2] * w[0], -w[0] * w[1] / 3), "dω/dt is")],
    "8.2": [(8.7, "nods"), (0.419, "not the fast one")],
}


def cases(table):
    return [
        pytest.param(number, answer, id=f"{number}-{k}")
        for number, answers in table.items()
        for k, answer in enumerate(answers)
    ]


@pytest.mark.parametrize(("number", "answer"), cases(RIGHT))
def test_a_right_answer_is_right_however_it_is_written(number, answer):
    verdict = vi.course.check(number, answer)
    assert verdict, verdict
    assert str(verdict) == f"{number} right"


@pytest.mark.parametrize(("number", "case"), cases(WRONG))
def test_a_wrong_answer_hears_where_it_parts_from_what_was_computed(number, case):
    answer, words = case
    verdict = vi.course.check(number, answer)
    assert not verdict
    assert re.search(words, str(verdict)) and str(verdict).startswith(f"{number} not yet: ")


def test_every_exercise_has_right_and_wrong_answers_here_and_a_place_in_its_lesson():
    assert set(RIGHT) == set(WRONG) == set(vi.course.exercises)
    pages = {page.name[0]: page.read_text("utf-8") for page in COURSE.glob("[1-8]-*.md")}
    for number in vi.course.exercises:
        assert pages[number[0]].count(f'vi.course.check("{number}", ') == 1
        assert f"**{number}** " in pages[number[0]]
    asked = {n for text in pages.values() for n in re.findall(r'check\("([\d.]+)"', text)}
    assert asked == set(vi.course.exercises)


@pytest.mark.parametrize("number", vi.course.exercises)
def test_without_an_answer_an_exercise_awaits_one(number):
    verdict = vi.course.check(number, None)
    assert not verdict and str(verdict) == f"{number} awaits your answer"


@pytest.mark.parametrize(
    ("number", "answer", "words"),
    [
        ("9.9", 1.0, "no exercise '9.9'; there are 1.1, 1.2"),
        ("1.1", 3.0, "must be a varint.System, got float"),
        ("1.2", "long", "must be 1 number, got 'long'"),
        ("5.1", [1.0], "must be 2 finite numbers"),
        ("4.1", np.nan, "finite"),
        ("3.1", 3.0, r"must be a function quantity\(q, v\), got float"),
        ("2.2", lambda s: s, "must return 2 expressions, it returns 1"),
        ("7.2", lambda q, p: "P", r"momentum\(q, p\) must return expressions, it returns 'P'"),
        ("7.2", lambda q, p: ca.SX.sym("z"), "symbols other than"),
        ("8.1", 3.0, "must be a function"),
    ],
)
def test_what_is_no_answer_is_refused_with_the_remedy(number, answer, words):
    with pytest.raises(vi.InputError, match=words):
        vi.course.check(number, answer)


def test_the_same_answer_gets_the_same_words_every_time():
    answer = vi.System(X, XDOT, XDOT**2 / 2)
    assert str(vi.course.check("1.1", answer)) == str(vi.course.check("1.1", answer))


def test_matplotlib_and_sympy_are_not_needed_to_check():
    code = (
        "import sys, varint as vi; vi.course.check('4.1', 5.886);"
        "print({'matplotlib', 'sympy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
