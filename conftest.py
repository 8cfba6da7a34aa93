"""Tests draw without a screen and leave no figure behind."""

from __future__ import annotations

import os
import sys

import pytest

pytest.register_assert_rewrite("fuzzing", "stopped_runs")  # they judge for several tests
os.environ.setdefault("MPLBACKEND", "Agg")


NEED_SYMPY = "varint.typeset"


@pytest.fixture(autouse=True)
def _examples_need_their_extra(request):
    """Examples in docstrings have no line of their own to skip by."""
    if isinstance(request.node, pytest.DoctestItem) and request.node.name.startswith(NEED_SYMPY):
        pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
