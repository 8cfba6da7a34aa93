"""How a diagnostic says what it found."""

from __future__ import annotations

PASS, FAIL, SKIP = "✓", "✗", "–"


def mark(passed: bool | None) -> str:
    """✓, ✗, or – where a property is not expected of the scene."""
    return SKIP if passed is None else PASS if passed else FAIL
