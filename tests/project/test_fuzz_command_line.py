"""Random command lines end with an exit code and no traceback.

The long command, ``pytest -m long tests/project/test_fuzz_command_line.py``, takes many more.
"""

from __future__ import annotations

import contextlib
import io
import os

import pytest
from fuzzing import both, judged
from hypothesis import strategies as st

import varint as vi
from varint.__main__ import main

WORDS = st.one_of(
    st.sampled_from(
        [
            "run",
            "check",
            "bench",
            "list",
            "kepler",
            "pendulum",
            "--rule",
            "--h",
            "--duration",
            "--steps",
        ]
    ),
    st.sampled_from(
        [
            "gauss(2)",
            "gauss(-1)",
            "lobatto",
            "nan",
            "inf",
            "-1",
            "0",
            "1e-3",
            "0.1",
            "--plot",
            "--save",
        ]
    ),
    st.text(max_size=4),
)


@st.composite
def command_lines(draw):
    """Words of the command line; where a run would be long, it is made short."""
    words = draw(st.lists(WORDS, max_size=6))
    if words[:1] in (["check"], ["bench"]) and len(words) > 1 and words[1] in vi.models.catalogue:
        words[0] = "run"  # checks of whole models are no test of input
    return (
        [*words, "--duration", draw(st.sampled_from(["0.1", "nan", "-1", "inf", "1e-300"]))]
        if words
        else words
    )


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A folder for what command lines write."""
    before = os.getcwd()
    os.chdir(tmp_path_factory.mktemp("shell"))
    yield
    os.chdir(before)


def shell_case(elsewhere, words):
    def run():
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            try:
                code = main(words)
            except SystemExit as end:  # of argparse, which says what is wrong
                code = end.code
        assert code in (0, 1, 2) and "Traceback" not in text.getvalue()

    judged(run)


test_command_lines_end_with_an_exit_code_and_no_traceback, test_many_command_lines = both(
    command_lines(), shell_case, 100, 3000
)
