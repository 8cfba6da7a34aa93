"""Tests draw without a screen and leave no figure behind."""

from __future__ import annotations

import os
import sys

import pytest

pytest.register_assert_rewrite("fuzzing", "stopped_runs")  # they judge for several tests
os.environ.setdefault("MPLBACKEND", "Agg")


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
