"""Tests draw without a screen and leave no figure behind."""

from __future__ import annotations

import os
import sys
from collections import OrderedDict

import pytest

pytest.register_assert_rewrite("fuzzing", "stopped_runs")  # they judge for several tests
os.environ.setdefault("MPLBACKEND", "Agg")


NEED_SYMPY = "varint.typeset"


@pytest.fixture(autouse=True)
def _examples_need_their_extra(request):
    """Examples in docstrings have no line of their own to skip by."""
    if isinstance(request.node, pytest.DoctestItem) and request.node.name.startswith(NEED_SYMPY):
        pytest.importorskip("sympy", reason="needs the extra: pip install varint-mechanics[sympy]")


@pytest.fixture
def forget(monkeypatch):
    """What was built for scenes seen before is forgotten, now and at each call: for tests that
    change how it is built.
    """
    from varint.scene import alike

    def again():
        monkeypatch.setattr(alike, "_SEEN", OrderedDict())

    again()
    return again


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
